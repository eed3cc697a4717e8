//! One run of one configuration, measured.

use crate::error::{Error, Result};
use crate::integrate::{
    AdaptiveOptions, AdaptiveStepper, Equations, ImplicitOptions, Method, OutputTimes, RunFailure, Schedule,
    Statistics, Status, TimeStepper, run, run_adaptive,
};
use crate::linear::FactorSize;
use crate::spring::Stiffness;
use crate::system::{State, System};
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Everything about a run but the step size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Configuration {
    /// The method.
    pub method: Method,
    /// Stiffness and linear solver; without meaning for methods without matrices.
    pub options: ImplicitOptions,
}

impl Configuration {
    /// Name of the stiffness policy; `none` for a method without matrices, and `full` for one that needs the full stiffness.
    pub fn stiffness(&self) -> &'static str {
        match self.method.equations() {
            Equations::Explicit => "none",
            Equations::LinearExact => Stiffness::Full.name(),
            Equations::Linear | Equations::Nonlinear => self.options.stiffness.name(),
        }
    }
}

/// The control of step lengths.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepControl {
    /// All steps but the last are of this length, in s.
    Step(f64),
    /// Steps adapt to an error estimate; for methods that have one.
    Adaptive {
        /// The relative tolerance.
        rtol: f64,
        /// The first step to try, in s; `None` for one that the forces suggest.
        first_step: Option<f64>,
    },
}

/// A run and its end.
#[derive(Debug, Clone)]
pub struct Trial {
    /// The status at the end.
    pub status: Status,
    /// The failure that ended it, if any.
    pub failure: Option<RunFailure>,
    /// The linear solver really used; `none` for a method without matrices.
    pub solver: &'static str,
    /// The size of the factor, where there was one.
    pub factor: Option<FactorSize>,
    /// Steps done.
    pub steps: u64,
    /// The last good state.
    pub state: State,
    /// Work and residuals.
    pub statistics: Statistics,
    /// Elapsed time, set-up included.
    pub wall: Duration,
}

/// Runs a configuration for `duration` seconds from a state; where `go_on` returns `false` the status is [`Interrupted`](Status::Interrupted).
///
/// # Errors
/// Coincident ends of a spring in `start`; a matrix that is too large; adaptive steps of a method without error estimate.
pub fn trial(
    system: &System,
    start: &State,
    configuration: &Configuration,
    control: StepControl,
    duration: f64,
    go_on: &dyn Fn() -> bool,
) -> Result<Trial> {
    let clock = Instant::now();
    let Configuration { method, options } = configuration;
    let mut state = start.clone();
    let observe = |_: u64, _: &State| if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    let (outcome, stepper): (_, Box<dyn TimeStepper>) = match control {
        StepControl::Step(dt) => {
            let mut stepper = method.stepper(system, start, options)?;
            let outcome = run(stepper.as_mut(), &mut state, &Schedule::duration(dt, duration), observe);
            (outcome, stepper)
        }
        StepControl::Adaptive { rtol, first_step } => {
            let mut stepper = adaptive_stepper(*method, system, start, options)?;
            let how = AdaptiveOptions { duration, rtol, first_step, sampling: OutputTimes::Steps, part_of: None };
            (run_adaptive(stepper.as_mut(), system, &mut state, &how, observe), stepper)
        }
    };
    Ok(Trial {
        status: outcome.status(),
        failure: outcome.end.err(),
        solver: stepper.linear_solver().map_or("none", |solver| solver.name()),
        factor: stepper.linear_solver().and_then(|solver| solver.factor()).map(|factor| factor.size),
        steps: outcome.steps,
        state,
        statistics: *stepper.statistics(),
        wall: clock.elapsed(),
    })
}

/// A stepper of a method that estimates errors.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large; a method without an error estimate.
pub(crate) fn adaptive_stepper<'s>(
    method: Method,
    system: &'s System,
    state: &State,
    options: &ImplicitOptions,
) -> Result<Box<dyn AdaptiveStepper + Send + 's>> {
    method.adaptive_stepper(system, state, options)?.ok_or_else(|| {
        let methods = Method::ALL.into_iter().filter(|method| method.estimates_errors());
        let others = methods.map(Method::name).collect::<Vec<_>>().join(", ");
        Error::Unsupported(format!("rtol needs an error estimate, and {} has none: use {others}", method.name()))
    })
}
