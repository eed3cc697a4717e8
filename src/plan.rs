//! The defaults of a run, shared by the command and every other front end so that they compute the same bits.
//!
//! [`RunOptions`] with the system, its state and a step become a [`Plan`], in which nothing is open; a plan makes the [`Stepper`] that
//! [runs](Stepper::run).

use crate::accuracy::{AccuracyOptions, Configuration, SpectralRadius, adaptive_stepper, default_method};
use crate::error::{Result, significant};
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

/// Options of a run. Where one is `None` the program chooses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RunOptions {
    /// The method.
    pub method: Option<MethodChoice>,
    /// The relative position error at the end.
    pub accuracy: Option<f64>,
    /// The tolerance of adaptive steps.
    pub rtol: Option<f64>,
    /// The stiffness in the matrix.
    pub stiffness: Option<StiffnessPolicy>,
    /// The linear solver.
    pub solver: Option<SolverChoice>,
    /// The preconditioner of conjugate gradients.
    pub preconditioner: Option<PreconditionerKind>,
    /// The relative residual at which conjugate gradients stop.
    pub tolerance: Option<f64>,
    /// A request to end the run.
    pub interrupt: Interrupt,
}

/// The step where one is needed and none is given, in s.
pub const DEFAULT_STEP: f64 = 0.01;

/// Records of an adaptive run: thirty a second in a page that plays them in ten.
pub const RECORDS: u32 = 300;

/// The interval at which an adaptive run of `duration` seconds is recorded, in s: `duration/RECORDS`, whatever the time scale.
pub fn records_every(duration: f64) -> f64 {
    duration / f64::from(RECORDS)
}

/// The parallelism of factorizations. Splitting changes the rounding, so it depends on the system alone, never on the number of
/// threads: up to 16 of them work on one dense block.
pub fn parallelism(system: &System) -> Par {
    // Measured on cloths: from here on splitting pays.
    if system.dofs().len() < 30_000 { Par::Seq } else { Par::rayon(16) }
}

impl RunOptions {
    /// The method by name, or the default of fixed steps; `None` for the program's choice.
    pub fn method(&self) -> Option<Method> {
        match self.method {
            Some(MethodChoice::Named(method)) => Some(method),
            Some(MethodChoice::Auto) => None,
            None if self.accuracy.is_some() || self.rtol.is_some() => None,
            None => Some(Method::LinearBackwardEuler),
        }
    }

    /// The tolerance of adaptive steps of a run without dt, 1e-2 if none is given; `None` for a method that does not estimate its error.
    pub fn rtol_without_step(&self) -> Option<f64> {
        match self.method {
            Some(MethodChoice::Named(method)) if !method.estimates_errors() => self.rtol,
            _ => Some(self.rtol.unwrap_or(1e-2)),
        }
    }

    fn linear(&self, system: &System) -> SolverOptions {
        SolverOptions {
            solver: self.solver.unwrap_or(SolverOptions::default().solver),
            preconditioner: self.preconditioner,
            tolerance: match (self.tolerance, self.solver) {
                (Some(tolerance), _) => Tolerance::Fixed(tolerance),
                (None, None | Some(SolverChoice::Auto)) => Tolerance::Adaptive,
                // The results of a solver that is given are compared digit by digit.
                (None, Some(_)) => Tolerance::default(),
            },
            par: parallelism(system),
            interrupt: self.interrupt,
        }
    }

    /// A plan for `duration` seconds with steps of dt seconds, or with adaptive steps of a tolerance. Call inside the pool of threads
    /// that is to compute.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn plan(&self, system: &System, state: &State, [dt, duration]: [f64; 2], rtol: Option<f64>) -> Result<Plan> {
        let asked = if self.method.is_none() && rtol.is_some() { None } else { self.method() };
        let (method, reason) = match (asked, rtol) {
            (Some(method), _) => (method, None),
            (None, Some(_)) => default_method(system, state, duration).map(|(method, why)| (method, Some(why)))?,
            (None, None) => of_fixed_step(system, state, dt).map(|(method, why)| (method, Some(why)))?,
        };
        let stiffness = self.stiffness.unwrap_or(ImplicitOptions::default().stiffness);
        let options = ImplicitOptions { stiffness, linear: self.linear(system) };
        Ok(Plan { configuration: Configuration { method, options }, rtol, reason })
    }

    /// The accuracy that is required, if one is.
    pub fn accuracy_options(&self, system: &System, duration: f64, interval: f64) -> Option<AccuracyOptions> {
        Some(AccuracyOptions {
            accuracy: self.accuracy?,
            duration,
            interval,
            par: parallelism(system),
            method: self.method(),
            stiffness: self.stiffness,
            solver: self.solver,
        })
    }
}

/// The method for steps of dt seconds: the explicit one of second order where they resolve the fastest vibration, else the implicit one.
fn of_fixed_step(system: &System, state: &State, dt: f64) -> Result<(Method, String)> {
    let limit = SpectralRadius::at(system, state)?.verlet_limit();
    let stable = format!("explicit steps are stable up to {} s", significant(limit, 4));
    // Steps near the limit are stable and hardly accurate.
    Ok(if dt <= 0.5 * limit {
        (Method::Verlet, format!("the step resolves the fastest vibration: {stable}"))
    } else {
        (Method::Bdf2, stable)
    })
}

/// A run with nothing left open.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// For adaptive steps.
    pub rtol: Option<f64>,
    /// The reason for the method, where the program chose.
    pub reason: Option<String>,
}

impl Plan {
    /// A stepper that follows the plan.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; a tolerance for a method without an error estimate.
    pub fn stepper<'s>(&self, system: &'s System, state: &State) -> Result<Stepper<'s>> {
        let Configuration { method, options } = &self.configuration;
        Ok(match self.rtol {
            None => Stepper::Scheduled(method.stepper(system, state, options)?),
            Some(rtol) => Stepper::Adaptive { stepper: adaptive_stepper(*method, system, state, options)?, rtol },
        })
    }

    /// The options of the monitor; without an error estimate it balances energies alone.
    pub fn monitor(&self, stops_unstable: bool, estimates_error: bool) -> MonitorOptions {
        MonitorOptions { threshold: estimates_error.then(|| threshold(self.rtol)), stops_unstable }
    }

    /// The stiffness option and the dt of the first matrix of a step.
    pub fn failed_matrix(&self, step: f64) -> (Stiffness, f64) {
        let Configuration { method, options } = &self.configuration;
        let option = match options.stiffness {
            StiffnessPolicy::Always(option) => option,
            StiffnessPolicy::OnDemand | StiffnessPolicy::Progressive => Stiffness::Full,
        };
        (option, method.matrix_dt(step))
    }
}

/// A stepper with steps as scheduled, or with steps that keep an error within a tolerance.
pub enum Stepper<'s> {
    /// Scheduled steps.
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

    /// The stepper itself.
    pub fn get(&self) -> &dyn TimeStepper {
        match self {
            Self::Scheduled(stepper) => &**stepper,
            Self::Adaptive { stepper, .. } => &**stepper,
        }
    }
}

#[cfg(test)]
mod tests;
