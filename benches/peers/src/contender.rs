//! What takes part, and how a run of it is measured.

use crate::Failure;
use crate::limits::{LONGEST, TOO_LONG};
use crate::peers::{Integrator, diffsol};
use sprung::accuracy::{Configuration, Pace, relative_position_error, trial};
use sprung::chart::{LARGEST_ERROR, Reference, dop853};
use sprung::figure::Look;
use sprung::integrate::{Method, Status};
use sprung::{State, System};
use std::time::{Duration, Instant};

/// A run that takes this long is not repeated.
const LONG: Duration = Duration::from_millis(300);

/// A motion to be computed, and its end.
pub struct Task<'s> {
    pub system: &'s System,
    pub start: &'s State,
    pub duration: f64,
    pub reference: Reference,
}

/// An integrator.
pub enum Contender {
    /// Of `diffsol`.
    Diffsol(Integrator),
    /// Of `ivp`.
    Dop853,
    /// Of this crate, with steps of one length.
    Steps(Configuration),
    /// Of this crate, with adaptive steps.
    Adaptive(Configuration),
}

/// A measured run.
pub struct Run {
    pub seconds: f64,
    /// The relative position error at the end, or why there is no useful one.
    pub outcome: Result<f64, String>,
}

impl Contender {
    /// The name in tables and legends.
    pub fn name(&self) -> String {
        match self {
            Self::Diffsol(integrator) => integrator.name().into(),
            Self::Dop853 => "ivp DOP853".into(),
            Self::Steps(configuration) if configuration.method.is_implicit() => {
                format!("{} ({})", configuration.method.name(), configuration.stiffness())
            }
            Self::Steps(configuration) => configuration.method.name().into(),
            Self::Adaptive(configuration) => format!("{}, adaptive", configuration.method.name()),
        }
    }

    /// The colour and shape of a method are those it has in the charts; the peers have those of methods that are not here.
    pub fn look(&self) -> Look {
        let (method, hollow) = match self {
            Self::Diffsol(Integrator::Bdf) => (Method::Bdf2, false),
            Self::Diffsol(Integrator::Esdirk34) => (Method::BackwardEuler, false),
            Self::Dop853 => (Method::SymplecticEuler, false),
            Self::Steps(configuration) => (configuration.method, false),
            Self::Adaptive(configuration) => (configuration.method, true),
        };
        let number = Method::ALL.iter().position(|known| *known == method).unwrap_or(Method::ALL.len());
        Look { number, hollow }
    }

    /// Runs with smaller and smaller tolerances or steps, as long as the reference can tell their errors and they are not too long.
    pub fn runs(&self, task: &Task<'_>) -> Vec<Run> {
        let mut runs = Vec::new();
        for refinement in 0..20 {
            let run = self.measure(task, refinement);
            let is_at_floor = matches!(run.outcome, Ok(error) if error < 3.0 * task.reference.error_estimate);
            let is_long = run.seconds > 0.3 * LONGEST.as_secs_f64();
            runs.push(run);
            if is_at_floor || is_long {
                break;
            }
        }
        runs
    }

    /// The best of three times.
    fn measure(&self, task: &Task<'_>, refinement: i32) -> Run {
        let once = || {
            let clock = Instant::now();
            let result = self.run(task, refinement, clock + LONGEST);
            (clock.elapsed(), result)
        };
        let (first, result) = once();
        let best = if first < LONG { once().0.min(once().0).min(first) } else { first };
        let outcome = match result {
            Err(why) => Err(why.to_string()),
            Ok(state) => {
                let reference = &task.reference.state.positions;
                match relative_position_error(&state.positions, reference, &task.start.positions) {
                    error if error < LARGEST_ERROR => Ok(error),
                    _ => Err("error above 100 %".into()),
                }
            }
        };
        Run { seconds: best.as_secs_f64(), outcome }
    }

    fn run(&self, task: &Task<'_>, refinement: i32, deadline: Instant) -> Result<State, Failure> {
        let Task { system, start, duration, .. } = *task;
        let in_time = || Instant::now() < deadline;
        let halved = 0.5f64.powi(refinement);
        let rtol = 0.1 * 0.25f64.powi(refinement);
        let ours = |configuration, pace| -> Result<State, Failure> {
            let run = trial(system, start, configuration, pace, duration, &in_time)?;
            match run.status {
                Status::Completed => Ok(run.state),
                Status::Interrupted => Err(TOO_LONG.into()),
                status => Err(status.name().replace('-', " ").into()),
            }
        };
        match self {
            Self::Diffsol(integrator) => diffsol(*integrator, system, start, duration, rtol, &in_time),
            Self::Dop853 => {
                let state = dop853(system, start, duration, rtol, deadline);
                state.ok_or_else(|| if in_time() { "broke down" } else { TOO_LONG }.into())
            }
            Self::Steps(configuration) => ours(configuration, Pace::Step(0.125 * duration * halved)),
            Self::Adaptive(configuration) => {
                ours(configuration, Pace::Adaptive { rtol, first_step: Some(1e-2 * duration * halved) })
            }
        }
    }
}
