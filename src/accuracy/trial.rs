//! One run of one configuration, measured.

use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, RunFailure, Schedule, Statistics, Status, run};
use crate::system::{State, System};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// A way to simulate: everything but the step size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Configuration {
    /// The method.
    pub method: Method,
    /// Stiffness and linear solver; without meaning for methods without matrices.
    pub options: ImplicitOptions,
}

impl Configuration {
    /// Name of the stiffness policy; `none` for a method without matrices.
    pub fn stiffness(&self) -> &'static str {
        if self.method.is_implicit() { self.options.stiffness.name() } else { "none" }
    }
}

/// What a run did and where it led.
#[derive(Debug, Clone)]
pub struct Trial {
    /// How it ended.
    pub status: Status,
    /// What broke it, if anything did.
    pub failure: Option<RunFailure>,
    /// The linear solver really used; `none` for a method without matrices.
    pub solver: &'static str,
    /// Steps done.
    pub steps: u64,
    /// The last good state.
    pub state: State,
    /// Work and residuals.
    pub statistics: Statistics,
    /// Elapsed time, set-up included.
    pub wall: Duration,
}

/// Runs a configuration from a state along a schedule; gives up at the deadline, with [`Status::Interrupted`].
///
/// # Errors
/// Coincident ends of a spring in `start`; a matrix that is too large.
pub fn trial(
    system: &System,
    start: &State,
    configuration: &Configuration,
    schedule: &Schedule,
    deadline: Option<Instant>,
) -> Result<Trial> {
    let clock = Instant::now();
    let mut state = start.clone();
    let mut stepper = configuration.method.stepper(system, start, &configuration.options)?;
    let outcome = run(stepper.as_mut(), &mut state, schedule, |_, _| match deadline {
        Some(deadline) if Instant::now() > deadline => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    Ok(Trial {
        status: outcome.status(),
        failure: outcome.end.err(),
        solver: stepper.solver().unwrap_or("none"),
        steps: outcome.steps,
        state,
        statistics: *stepper.statistics(),
        wall: clock.elapsed(),
    })
}
