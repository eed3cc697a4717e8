//! How a run is made where little is said of it: what the command and every other front end decide alike, so that they compute the
//! same bits.
//!
//! [`RunOptions`] are what a user says. With the system, its state and a step they become a [`Plan`], in which nothing is open, and a
//! plan makes the [`Stepper`] that [runs](Stepper::run).

use crate::accuracy::{AccuracyOptions, Configuration, SpectralRadius, default_method};
use crate::error::{Error, Result};
use crate::integrate::{
    AdaptiveOptions, AdaptiveStepper, ImplicitOptions, Method, Monitor, MonitorOptions, Outcome, OutputTimes, Schedule,
    StiffnessPolicy, TimeStepper, run_adaptive_monitored, run_monitored, threshold,
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
    /// The stiffness of the scene decides, see [`default_method`].
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
pub struct RunOptions {
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

/// Records of a run that chooses its steps: a page that plays them in ten seconds shows thirty a second.
pub const RECORDS: u32 = 300;

/// The interval at which a run of `duration` seconds is recorded that chooses its steps, in s: `duration/RECORDS`. It has no scale of its
/// own, so that the files of a motion of microseconds and of one of years have the same size.
///
/// # Examples
/// ```
/// use sprung::plan::records_every;
///
/// assert!((records_every(30.0) - 0.1).abs() < 1e-15);
/// assert!((records_every(3e-9) - 1e-11).abs() < 1e-25);
/// ```
pub fn records_every(duration: f64) -> f64 {
    duration / f64::from(RECORDS)
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

impl RunOptions {
    /// The tolerance of adaptive steps where no step is given.
    const RTOL: f64 = 1e-2;

    /// The method asked for by name, or the one that stands for none; `None` for the program's own choice.
    pub fn method(&self) -> Option<Method> {
        match self.method {
            Some(MethodChoice::Named(method)) => Some(method),
            Some(MethodChoice::Auto) => None,
            None if self.accuracy.is_some() || self.rtol.is_some() => None,
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

    /// How exactly conjugate gradients solve: as the motion needs, but to a tolerance given, and where the solver was asked for by name, so that
    /// it can be compared with others digit by digit.
    fn tolerance(&self) -> Tolerance {
        match (self.tolerance, self.solver) {
            (Some(tolerance), _) => Tolerance::Fixed(tolerance),
            (None, None | Some(SolverChoice::Auto)) => Tolerance::Adaptive,
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

    /// How to run for `duration` seconds with steps of dt seconds, or with adaptive ones of a tolerance. Call inside the pool of threads that is to
    /// compute.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn plan(&self, system: &System, state: &State, [dt, duration]: [f64; 2], rtol: Option<f64>) -> Result<Plan> {
        let linear = self.linear(system);
        let asked = if self.method.is_none() && rtol.is_some() { None } else { self.method() };
        let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
        let (method, reason) = match (asked, rtol) {
            (Some(method), _) => (method, None),
            (None, Some(_)) => default_method(system, state, duration).map(|(method, why)| (method, Some(why)))?,
            (None, None) => of_fixed_step(system, state, dt).map(|(method, why)| (method, Some(why)))?,
        };
        let mut configuration = Configuration { method, options };
        configuration.options.stiffness = self.stiffness.unwrap_or(configuration.options.stiffness);
        Ok(Plan { configuration, rtol, reason })
    }

    /// The accuracy that is required, if one is.
    pub fn accuracy_options(&self, system: &System, duration: f64, interval: f64) -> Option<AccuracyOptions> {
        Some(AccuracyOptions {
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

/// The method for steps of dt seconds: the explicit one of second order where they resolve the fastest vibration, else the implicit one.
fn of_fixed_step(system: &System, state: &State, dt: f64) -> Result<(Method, String)> {
    let limit = SpectralRadius::at(system, state)?.verlet_limit();
    // Steps near the limit are stable and hardly accurate.
    Ok(if dt <= 0.5 * limit {
        (
            Method::Verlet,
            format!("the step resolves the fastest vibration: explicit steps are stable up to {limit:.3e} s"),
        )
    } else {
        (Method::Bdf2, format!("explicit steps are stable up to {limit:.3e} s"))
    })
}

/// How a run is to be done.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// For adaptive steps.
    pub rtol: Option<f64>,
    /// Why, where the program chose.
    pub reason: Option<String>,
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

    /// What a monitor is to do; without an error estimate it balances energies alone.
    pub fn monitor(&self, stops_unstable: bool, estimates_error: bool) -> MonitorOptions {
        MonitorOptions { threshold: estimates_error.then(|| threshold(self.rtol)), stops_unstable }
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
                let part_of = Some(schedule.duration_of_whole());
                let how =
                    AdaptiveOptions { duration, rtol: *rtol, first_step, sampling: OutputTimes::Every(dt), part_of };
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
mod tests;
