//! The runs under study, done as the command does them, through the library's public interface.

use super::reference::Reference;
use serde::{Deserialize, Serialize};
use sprung::accuracy::{AccuracyOptions, Verdict, relative_position_error, run_to_accuracy};
use sprung::integrate::{
    AdaptiveOptions, ErrorIndicators, ImplicitOptions, Method, Monitor, MonitorOptions, OutputTimes, Schedule,
    Statistics, Status, StiffnessPolicy, run_adaptive_monitored, run_monitored,
};
use sprung::{Error, State, Stiffness, System};
use std::cell::Cell;
use std::ops::ControlFlow;
use std::time::Instant;

/// The configuration of a run.
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
    /// The configuration.
    pub ask: Ask,
    /// Its status by name; `too-long` for one that was stopped by the study's limit.
    pub status: String,
    /// Its true relative position error; `None` where the last state is not finite.
    pub error: Option<f64>,
    /// The estimate of its own error.
    pub estimate: Option<f64>,
    /// Its warnings.
    pub warnings: Vec<String>,
    /// The figures that these were made from.
    #[serde(skip_deserializing)]
    pub indicators: Option<ErrorIndicators>,
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
    /// The run was completed.
    pub fn is_completed(&self) -> bool {
        self.status == Status::Completed.name()
    }

    /// The true error, infinite where there is no number.
    pub fn error(&self) -> f64 {
        self.error.unwrap_or(f64::INFINITY)
    }
}

/// Steps of one run at most: beyond that it is too dear for a study. In particle-steps, so that small scenes may have more.
const MOST_PARTICLE_STEPS: u64 = 1_000_000;

/// The budget of a search for a required accuracy, in steps times particles.
const MOST_ASKED: u64 = 5_000_000;

/// A scene that runs start from.
pub struct TestCase<'s> {
    /// The system.
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

impl TestCase<'_> {
    /// A run with steps of dt seconds.
    ///
    /// # Errors
    /// Coincident ends of a spring at the start; a matrix that is too large.
    pub fn fixed(&self, way: Way, dt: f64) -> sprung::Result<Run> {
        self.run(way, Ask::Dt(dt))
    }

    /// A run with adaptive steps.
    ///
    /// # Errors
    /// Coincident ends of a spring at the start; a matrix that is too large.
    pub fn adaptive(&self, way: Way, rtol: f64) -> sprung::Result<Run> {
        self.run(way, Ask::Rtol(rtol))
    }

    /// A run with a required accuracy, everything left to the program.
    ///
    /// # Errors
    /// Coincident ends of a spring at the start; a matrix that is too large.
    pub fn accurate(&self, accuracy: f64) -> sprung::Result<Run> {
        let clock = Instant::now();
        let system = self.system;
        let duration = self.duration;
        let interval = duration / 100.0;
        let (method, stiffness, solver) = (None, None, None);
        let options = AccuracyOptions { accuracy, duration, interval, par: faer::Par::Seq, method, stiffness, solver };
        let left = Cell::new(MOST_ASKED / system.particles().max(1) as u64);
        let go_on = || {
            left.set(left.get().saturating_sub(1));
            left.get() > 0
        };
        let found = run_to_accuracy(system, self.start, &options, &mut (), &go_on)?;
        let ask = Ask::Accuracy(accuracy);
        let seconds = clock.elapsed().as_secs_f64();
        let nothing = Run {
            method: "auto".into(),
            stiffness: "none".into(),
            ask,
            status: if left.get() > 0 { "unconfirmed".into() } else { "too-long".into() },
            error: None,
            estimate: None,
            warnings: Vec::new(),
            indicators: None,
            steps: 0,
            evaluations: 0,
            factorizations: 0,
            seconds,
        };
        Ok(found.map_or(nothing.clone(), |found| Run {
            method: found.configuration.method.name().into(),
            stiffness: found.configuration.stiffness().into(),
            status: match &found.verdict {
                Verdict::Confirmed => Status::Completed.name().into(),
                Verdict::Unconfirmed(_) => "unconfirmed".into(),
                Verdict::Interrupted => "too-long".into(),
            },
            error: self.error(&found.state),
            estimate: found.estimated_error,
            warnings: match found.verdict {
                Verdict::Unconfirmed(why) => vec![why],
                Verdict::Confirmed | Verdict::Interrupted => Vec::new(),
            },
            steps: found.steps,
            evaluations: found.total_cost as u64,
            factorizations: found.statistics.work.factorizations,
            ..nothing
        }))
    }

    fn run(&self, (method, stiffness): Way, ask: Ask) -> sprung::Result<Run> {
        let options = ImplicitOptions { stiffness, ..Default::default() };
        self.run_with(method, &options, MonitorOptions::default(), ask).map(|(run, ..)| run)
    }

    /// A run with any options of implicit methods, where it ended and the work that it took; no search for an accuracy.
    ///
    /// # Errors
    /// Coincident ends of a spring at the start; a matrix that is too large.
    pub fn run_with(
        &self,
        method: Method,
        options: &ImplicitOptions,
        watch: MonitorOptions,
        ask: Ask,
    ) -> sprung::Result<(Run, State, Statistics)> {
        let stiffness = options.stiffness;
        let mut monitor = Monitor::new(self.system, self.start, watch)?;
        let mut state = self.start.clone();
        let clock = Instant::now();
        let mut left = MOST_PARTICLE_STEPS / self.system.particles().max(1) as u64;
        let observe = |_: u64, _: &State, _: &Monitor| {
            left = left.saturating_sub(1);
            if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let (outcome, statistics, rtol) = match ask {
            Ask::Rtol(rtol) => {
                let mut stepper = method
                    .adaptive_stepper(self.system, self.start, options)?
                    .ok_or_else(|| Error::Usage(format!("{} has no error estimate", method.name())))?;
                // As the command does where no step is given.
                let first_step = self.duration / 100.0;
                let how = AdaptiveOptions {
                    duration: self.duration,
                    rtol,
                    first_step: Some(first_step),
                    sampling: OutputTimes::Steps,
                    part_of: None,
                };
                let outcome =
                    run_adaptive_monitored(&mut *stepper, self.system, &mut state, &how, &mut monitor, observe);
                (outcome, *stepper.statistics(), Some(rtol))
            }
            Ask::Dt(dt) | Ask::Accuracy(dt) => {
                let mut stepper = method.stepper(self.system, self.start, options)?;
                let schedule = Schedule::duration(dt, self.duration);
                let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, observe);
                (outcome, *stepper.statistics(), None)
            }
        };
        let status = match outcome.status() {
            Status::Interrupted => "too-long",
            other => other.name(),
        };
        let indicators = monitor.indicators(&state);
        let run = Run {
            method: method.name().into(),
            stiffness: if method.is_implicit() { stiffness.name().into() } else { "none".into() },
            ask,
            status: status.into(),
            error: self.error(&state),
            estimate: indicators.estimate,
            warnings: indicators.warnings(rtol).iter().map(ToString::to_string).collect(),
            indicators: Some(indicators),
            steps: outcome.steps,
            evaluations: statistics.work.force_evaluations,
            factorizations: statistics.work.factorizations,
            seconds: clock.elapsed().as_secs_f64(),
        };
        Ok((run, state, statistics))
    }

    /// The true error of a last state.
    pub fn error(&self, state: &State) -> Option<f64> {
        let error = relative_position_error(&state.positions, &self.reference.points(), &self.start.positions);
        error.is_finite().then_some(error)
    }
}
