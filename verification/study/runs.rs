//! The runs under study, done as the command does them, through the library's public interface.

use serde::{Deserialize, Serialize};
use sprung::accuracy::{Configuration, Pace, relative_position_error, trial};
use sprung::integrate::{ImplicitOptions, Method, Status, StiffnessPolicy};
use sprung::{State, Stiffness, System};
use std::cell::Cell;

use super::reference::Reference;

/// What is asked of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ask {
    /// Steps of this length, in s.
    Dt(f64),
    /// Adaptive steps with this tolerance.
    Rtol(f64),
    /// An error at the end below this.
    Accuracy(f64),
}

/// A run: what was asked, what it said, and how wrong it was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Method by name; `auto` where the program chose.
    pub method: String,
    /// Stiffness policy by name.
    pub stiffness: String,
    /// What was asked.
    pub ask: Ask,
    /// Its status by name; `too-long` for one that was stopped by the study's limit.
    pub status: String,
    /// Its true relative position error; `None` where the last state is not finite.
    pub error: Option<f64>,
    /// What it said of its own error.
    pub estimate: Option<f64>,
    /// What it warned of.
    pub warnings: Vec<String>,
    /// Steps done.
    pub steps: u64,
    /// Evaluations of the forces.
    pub evaluations: u64,
    /// Factorizations.
    pub factorizations: u64,
    /// Elapsed time, in s.
    pub seconds: f64,
}

impl Run {
    /// Whether it came to its end.
    pub fn is_completed(&self) -> bool {
        self.status == Status::Completed.name()
    }

    /// The true error, infinite where there is no number.
    pub fn error(&self) -> f64 {
        self.error.unwrap_or(f64::INFINITY)
    }
}

/// Steps of one run at most: beyond that it is too dear for a study. In particle-steps, so that small scenes may have more.
const MOST_PARTICLE_STEPS: u64 = 4_000_000;

/// A scene that runs start from.
pub struct Subject<'s> {
    /// What moves.
    pub system: &'s System,
    /// Where it starts.
    pub start: &'s State,
    /// For how long, in s.
    pub duration: f64,
    /// Where it really ends.
    pub reference: &'s Reference,
}

/// A method with a stiffness policy.
pub type Way = (Method, StiffnessPolicy);

/// Every method with the policy that it has by default, and the notes' options of the notes' method.
pub fn ways() -> Vec<Way> {
    let default = ImplicitOptions::default().stiffness;
    let mut ways: Vec<Way> = Method::ALL.into_iter().map(|method| (method, default)).collect();
    for stiffness in [Stiffness::Tension, Stiffness::Axial] {
        ways.push((Method::LinearBackwardEuler, StiffnessPolicy::Always(stiffness)));
    }
    ways.push((Method::W2, StiffnessPolicy::Always(Stiffness::Axial)));
    ways
}

impl Subject<'_> {
    /// A run with steps of dt seconds.
    ///
    /// # Errors
    /// As for [`trial`].
    pub fn fixed(&self, (method, stiffness): Way, dt: f64) -> sprung::Result<Run> {
        self.run((method, stiffness), Pace::Step(dt), Ask::Dt(dt))
    }

    /// A run with adaptive steps.
    ///
    /// # Errors
    /// As for [`trial`].
    pub fn adaptive(&self, (method, stiffness): Way, rtol: f64) -> sprung::Result<Run> {
        let pace = Pace::Adaptive { rtol, first_step: self.duration / 100.0 };
        self.run((method, stiffness), pace, Ask::Rtol(rtol))
    }

    fn run(&self, (method, stiffness): Way, pace: Pace, ask: Ask) -> sprung::Result<Run> {
        let configuration = Configuration { method, options: ImplicitOptions { stiffness, ..Default::default() } };
        let left = Cell::new(MOST_PARTICLE_STEPS / self.system.particles().max(1) as u64);
        let go_on = || {
            left.set(left.get().saturating_sub(1));
            left.get() > 0
        };
        let done = trial(self.system, self.start, &configuration, pace, self.duration, &go_on)?;
        let status = if done.status == Status::Interrupted { "too-long" } else { done.status.name() };
        Ok(Run {
            method: method.name().into(),
            stiffness: configuration.stiffness().into(),
            ask,
            status: status.into(),
            error: self.error(&done.state),
            estimate: None,
            warnings: Vec::new(),
            steps: done.steps,
            evaluations: done.statistics.work.force_evaluations,
            factorizations: done.statistics.work.factorizations,
            seconds: done.wall.as_secs_f64(),
        })
    }

    /// The true error of a last state.
    pub fn error(&self, state: &State) -> Option<f64> {
        let error = relative_position_error(&state.positions, &self.reference.points(), &self.start.positions);
        error.is_finite().then_some(error)
    }
}
