//! How a run is made where little is said of it: what the command and every other front end decide alike, so that they compute the
//! same bits.
//!
//! [`Wishes`] are what a user says. With the system, its state and a step they become a [`Plan`], in which nothing is open, and a
//! plan makes the [`Stepper`] that [runs](Stepper::run).

use crate::accuracy::{Configuration, Requirement, preset};
use crate::error::{Error, Result};
use crate::integrate::{
    AdaptiveStepper, Adaptivity, ImplicitOptions, Method, Monitor, MonitorOptions, Outcome, Sampling, Schedule,
    StiffnessPolicy, TimeStepper, run_adaptive_monitored, run_monitored,
};
use crate::interrupt::Interrupt;
use crate::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use std::ops::ControlFlow;

/// A method, or the one that suits the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MethodChoice {
    /// This one.
    Named(Method),
    /// [`preset`] chooses.
    Auto,
}

impl MethodChoice {
    /// Every method, and the choice between them.
    pub const ALL: [Self; Method::ALL.len() + 1] = {
        let mut all = [Self::Auto; Method::ALL.len() + 1];
        let mut i = 0;
        while i < Method::ALL.len() {
            all[i] = Self::Named(Method::ALL[i]);
            i += 1;
        }
        all
    };

    /// The name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Named(method) => method.name(),
            Self::Auto => "auto",
        }
    }
}

/// What is asked of a run. What is `None` is left to the program.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wishes {
    /// The method.
    pub method: Option<MethodChoice>,
    /// The relative position error at the end.
    pub accuracy: Option<f64>,
    /// The tolerance of adaptive steps.
    pub rtol: Option<f64>,
    /// Which stiffness enters the matrix.
    pub stiffness: Option<StiffnessPolicy>,
    /// The linear solver.
    pub solver: Option<SolverChoice>,
    /// The preconditioner of conjugate gradients.
    pub preconditioner: Option<PreconditionerKind>,
    /// Where conjugate gradients stop.
    pub tolerance: Option<f64>,
    /// Who may end the run.
    pub interrupt: Interrupt,
}

/// The step where one is needed and none is given, in s.
pub const DEFAULT_STEP: f64 = 0.01;

/// The interval of records of runs that choose their steps, in s: that of a screen, which no eye follows more often.
const RECORDS_EVERY: f64 = 1.0 / 60.0;

/// Records of such a run at least.
const RECORDS: f64 = 100.0;

/// The interval at which a run of `duration` seconds is recorded that chooses its steps, in s.
///
/// # Examples
/// ```
/// use sprung::plan::records_every;
///
/// // A hundred records of a short motion, sixty a second of a long one.
/// assert!((records_every(0.1) - 0.001).abs() < 1e-15);
/// assert!((records_every(30.0) - 1.0 / 60.0).abs() < 1e-15);
/// ```
pub fn records_every(duration: f64) -> f64 {
    RECORDS_EVERY.min(duration / RECORDS)
}

/// Degrees of freedom from which splitting a factorization pays: a cloth of about 10⁴ particles.
const LARGE: usize = 30_000;

/// Pieces that a dense block is cut into, and so the most threads that work on one: on two threads as fast as two pieces.
const PIECES: usize = 16;

/// How a factorization is split. Splitting changes how numbers are rounded, so it depends on the system alone, never on
/// the number of threads; any number of threads then gives the same bits.
pub fn parallelism(system: &System) -> Par {
    if system.dofs().len() < LARGE { Par::Seq } else { Par::rayon(PIECES) }
}

impl Wishes {
    /// The method of adaptive steps where none is asked for: the header of `integrate/adaptive.rs` has the measurement.
    const ADAPTIVE: Method = Method::Rodas4;

    /// The tolerance of adaptive steps where no step is given.
    const RTOL: f64 = 1e-2;

    /// The method asked for by name, or the one that stands for none; `None` for the program's own choice.
    pub fn method(&self) -> Option<Method> {
        match self.method {
            Some(MethodChoice::Named(method)) => Some(method),
            Some(MethodChoice::Auto) => None,
            None if self.accuracy.is_some() => None,
            None if self.rtol.is_some() => Some(Self::ADAPTIVE),
            None => Some(Method::LinearBackwardEuler),
        }
    }

    /// The tolerance of adaptive steps for a run for which no dt is given; `None` where a method was asked for that does not
    /// estimate its error.
    pub fn rtol_without_step(&self) -> Option<f64> {
        match self.method {
            Some(MethodChoice::Named(method)) if !method.estimates_errors() => self.rtol,
            _ => Some(self.rtol.unwrap_or(Self::RTOL)),
        }
    }

    /// Whether what cannot move is to be looked for and left out.
    pub fn reduces(&self) -> bool {
        self.accuracy.is_some() || self.method == Some(MethodChoice::Auto)
    }

    /// How exactly conjugate gradients solve: as the motion needs, but to a tolerance given, and where the solver was asked for by name, so that
    /// it can be compared with others digit by digit.
    fn tolerance(&self) -> Tolerance {
        match (self.tolerance, self.solver) {
            (Some(tolerance), _) => Tolerance::Fixed(tolerance),
            (None, None | Some(SolverChoice::Auto)) => Tolerance::OfMotion,
            (None, Some(_)) => Tolerance::default(),
        }
    }

    /// The linear solver.
    fn linear(&self, system: &System) -> SolverOptions {
        let defaults = SolverOptions::default();
        SolverOptions {
            solver: self.solver.unwrap_or(defaults.solver),
            preconditioner: self.preconditioner,
            tolerance: self.tolerance(),
            par: parallelism(system),
            interrupt: self.interrupt,
        }
    }

    /// How to run with steps of dt seconds, or with adaptive ones of a tolerance. Call inside the pool of threads that is to
    /// compute.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn plan(&self, system: &System, state: &State, dt: f64, rtol: Option<f64>) -> Result<Plan> {
        let linear = self.linear(system);
        let asked = if self.method.is_none() && rtol.is_some() { Some(Self::ADAPTIVE) } else { self.method() };
        let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
        let (mut configuration, reason) = match (asked, rtol) {
            (Some(method), _) => (Configuration { method, options }, None),
            (None, Some(_)) => {
                (Configuration { method: Self::ADAPTIVE, options }, Some("the method with an error estimate"))
            }
            (None, None) => {
                let (configuration, reason) = preset(system, state, dt, linear)?;
                (configuration, Some(reason))
            }
        };
        configuration.options.stiffness = self.stiffness.unwrap_or(configuration.options.stiffness);
        Ok(Plan { configuration, rtol, reason })
    }

    /// What an accuracy asks for, if one is asked for.
    pub fn requirement(&self, system: &System, duration: f64, interval: f64) -> Option<Requirement> {
        Some(Requirement {
            accuracy: self.accuracy?,
            duration,
            interval,
            par: self.linear(system).par,
            method: self.method(),
            stiffness: self.stiffness,
            solver: self.solver,
        })
    }
}

/// How a run is to be done.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// For adaptive steps.
    pub rtol: Option<f64>,
    /// Why, where the program chose.
    pub reason: Option<&'static str>,
}

impl Plan {
    /// A stepper that follows the plan.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; a tolerance for a method without an error estimate.
    pub fn stepper<'s>(&self, system: &'s System, state: &State) -> Result<Stepper<'s>> {
        let Configuration { method, options } = &self.configuration;
        let Some(rtol) = self.rtol else {
            let stepper = method.stepper(system, state, options)?;
            return Ok(Stepper::Scheduled(stepper));
        };
        let without = || {
            let methods = Method::ALL.into_iter().filter(|method| method.estimates_errors());
            let others = methods.map(Method::name).collect::<Vec<_>>().join(", ");
            Error::Unsupported(format!("rtol needs an error estimate, and {} has none: use {others}", method.name()))
        };
        let stepper = method.adaptive_stepper(system, state, options)?.ok_or_else(without)?;
        Ok(Stepper::Adaptive { stepper, rtol })
    }

    /// What a monitor is to do.
    pub fn monitor(&self, stops_unstable: bool) -> MonitorOptions {
        let Configuration { method, options } = &self.configuration;
        MonitorOptions { stops_unstable, ..MonitorOptions::of(*method, options.stiffness) }
    }

    /// The option of the matrices that a failed solve was given, and the dt of the first one of a step.
    pub fn failed_matrix(&self, step: f64) -> (Stiffness, f64) {
        let Configuration { method, options } = &self.configuration;
        let option = match options.stiffness {
            StiffnessPolicy::Always(option) => option,
            StiffnessPolicy::OnDemand => Stiffness::Full,
        };
        (option, method.matrix_dt(step))
    }
}

/// A stepper with steps as scheduled, or with steps that keep an error within a tolerance.
pub enum Stepper<'s> {
    /// As scheduled.
    Scheduled(Box<dyn TimeStepper + 's>),
    /// With error control.
    Adaptive {
        /// The method.
        stepper: Box<dyn AdaptiveStepper + 's>,
        /// The tolerance.
        rtol: f64,
    },
}

impl Stepper<'_> {
    /// Runs a schedule or a part of one; `observe` sees the state after every step, with error control at every multiple of dt.
    pub fn run(
        &mut self,
        system: &System,
        state: &mut State,
        schedule: &Schedule,
        monitor: &mut Monitor,
        mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
    ) -> Outcome {
        match self {
            Self::Scheduled(stepper) => run_monitored(&mut **stepper, state, schedule, monitor, observe),
            Self::Adaptive { stepper, rtol } => {
                let (first, dt) = (schedule.first(), schedule.dt());
                let duration = schedule.elapsed(schedule.len()) - schedule.elapsed(first);
                // A later part of a run begins with a step that the forces suggest.
                let first_step = (first == 0).then_some(dt);
                let how = Adaptivity { duration, rtol: *rtol, first_step, sampling: Sampling::Every(dt) };
                let observe = |count, state: &State, monitor: &Monitor| observe(first + count, state, monitor);
                run_adaptive_monitored(&mut **stepper, system, state, &how, monitor, observe)
            }
        }
    }

    /// What can be asked of it.
    pub fn get(&self) -> &dyn TimeStepper {
        match self {
            Self::Scheduled(stepper) => &**stepper,
            Self::Adaptive { stepper, .. } => &**stepper,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::Rodas4;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// Method, tolerance without a step, and whether what cannot move is left out, of wishes for a method, an accuracy, a tolerance.
    #[test]
    fn what_is_not_asked_for_is_decided() {
        let (verlet, bdf2) = (MethodChoice::Named(Method::Verlet), MethodChoice::Named(Method::Bdf2));
        let auto = Some(MethodChoice::Auto);
        for (method, accuracy, rtol, expected) in [
            (None, None, None, (Some(Method::LinearBackwardEuler), Some(1e-2), false)),
            (None, None, Some(1e-5), (Some(Method::Rodas4), Some(1e-5), false)),
            (None, Some(1e-3), None, (None, Some(1e-2), true)),
            (None, Some(1e-3), Some(1e-5), (None, Some(1e-5), true)),
            (auto, None, None, (None, Some(1e-2), true)),
            (auto, None, Some(1e-5), (None, Some(1e-5), true)),
            (Some(verlet), None, None, (Some(Method::Verlet), None, false)),
            (Some(verlet), Some(1e-3), Some(1e-5), (Some(Method::Verlet), Some(1e-5), true)),
            (Some(bdf2), None, None, (Some(Method::Bdf2), Some(1e-2), false)),
        ] {
            let wishes = Wishes { method, accuracy, rtol, ..Wishes::default() };
            assert_eq!((wishes.method(), wishes.rtol_without_step(), wishes.reduces()), expected, "{wishes:?}");
        }
    }

    /// Each method by its name, and the choice between them last; sixty records a second, or a hundred of a short motion.
    #[test]
    fn there_is_a_choice_for_every_method() {
        let named = Method::ALL.into_iter().map(MethodChoice::Named);
        assert!(named.chain([MethodChoice::Auto]).eq(MethodChoice::ALL));
        for (duration, expected) in [(0.1, 0.001), (30.0, 1.0 / 60.0)] {
            assert!((records_every(duration) - expected).abs() < 1e-15, "{duration}");
        }
    }

    /// As the motion needs where nothing is said, else as is said; solvers that are named are compared to all digits.
    #[test]
    fn tolerances_follow_the_motion_where_nothing_is_said() {
        let (system, state) = swing();
        let cg = Some(SolverChoice::Cg);
        for (tolerance, solver, expected) in [
            (None, None, Tolerance::OfMotion),
            (None, Some(SolverChoice::Auto), Tolerance::OfMotion),
            (None, cg, Tolerance::default()),
            (Some(1e-3), None, Tolerance::Fixed(1e-3)),
            (Some(1e-3), cg, Tolerance::Fixed(1e-3)),
        ] {
            let wishes = Wishes { tolerance, solver, ..Wishes::default() };
            let linear = wishes.plan(&system, &state, 0.01, None).unwrap().configuration.options.linear;
            assert_eq!(linear.tolerance, expected, "{tolerance:?} {solver:?}");
        }
    }

    /// A particle on a spring, held at the other end, swinging about its rest length with a period of 2π/√10 s.
    fn swing() -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
        builder.hold(0);
        builder.build().unwrap()
    }

    #[test]
    fn monitors_look_at_what_the_method_needs_and_stop_as_they_are_told() {
        let (system, state) = swing();
        for (method, forces) in [(Method::LinearBackwardEuler, true), (Method::Rodas4, false)] {
            let wishes = Wishes { method: Some(MethodChoice::Named(method)), ..Wishes::default() };
            let plan = wishes.plan(&system, &state, 0.01, None).unwrap();
            for stops_unstable in [false, true] {
                assert_eq!(plan.monitor(stops_unstable), MonitorOptions { forces, stops_unstable });
            }
        }
    }

    /// Samples of parts have the numbers and times of the whole; the first part begins with a step of dt, later ones with a step that the
    /// forces suggest.
    #[test]
    fn adaptive_runs_go_on_in_parts() {
        let (system, mut state) = swing();
        let plan = Wishes::default().plan(&system, &state, 0.25, Some(1e-3)).unwrap();
        let schedule = Schedule::duration(0.25, 1.5);
        let mut samples = Vec::new();
        for (part, first_step) in [(schedule.part(0, 2), Some(0.25)), (schedule.part(2, 100), None)] {
            let mut alone = state.clone();
            let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
            let mut stepper = plan.stepper(&system, &state).unwrap();
            let observe = |count, state: &State, _: &Monitor| {
                samples.push((count, state.time));
                ControlFlow::Continue(())
            };
            stepper.run(&system, &mut state, &part, &mut monitor, observe);

            let duration = if first_step.is_some() { 0.5 } else { 1.0 };
            let how = Adaptivity { duration, rtol: 1e-3, first_step, sampling: Sampling::Every(0.25) };
            let mut monitor = Monitor::new(&system, &alone, MonitorOptions::default()).unwrap();
            let mut stepper = Rodas4::new(&system, &alone, &plan.configuration.options).unwrap();
            let observe = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
            run_adaptive_monitored(&mut stepper, &system, &mut alone, &how, &mut monitor, observe);
            assert_eq!(state, alone);
        }
        assert_eq!(samples, [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0), (5, 1.25), (6, 1.5)]);
    }

    /// Threads decide nothing, the number of unknowns does.
    #[test]
    fn large_factorizations_are_split() {
        for (particles, is_split) in [(10, false), (LARGE / 3 - 1, false), (LARGE / 3, true)] {
            let mut builder = SystemBuilder::new();
            (0..particles).for_each(|i| {
                builder.particle([i as f64, 0.0, 0.0], 1.0);
            });
            let (system, _) = builder.build().unwrap();
            assert_eq!(matches!(parallelism(&system), Par::Rayon(_)), is_split, "{particles}");
        }
    }
}
