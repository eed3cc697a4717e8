//! What takes part, and how a run of it is measured.

use crate::Failure;
use crate::curve::{ACCURACIES, Curve, Run, Side};
use crate::limits::{LONGEST, Patience, TOO_LONG, last};
use crate::peers::{Method as OfDiffsol, Peer};
use cpu_time::ThreadTime;
use sprung::accuracy::{Configuration, StepControl, relative_position_error, trial};
use sprung::chart::{LARGEST_ERROR, Reference};
use sprung::figure::Look;
use sprung::integrate::{ImplicitOptions, Method, Status};
use sprung::{State, System};
use std::time::Duration;

/// Timings of a run go on for this long, between these numbers of times; on the way up a ladder a run that takes [`LONG`] is timed once.
const SPAN: Duration = Duration::from_millis(25);
const REPEATS: [u32; 2] = [2, 40];
const LONG: Duration = Duration::from_millis(60);

/// Runs that take so many times as long as the fastest are not timed again.
const NEAR: f64 = 3.0;

/// Rungs of a ladder at most.
const RUNGS: i32 = 120;

/// A ladder ends with an error so far below all that is asked for.
const BELOW: f64 = 0.2;

/// A motion to be computed, and its end.
pub struct Task<'s> {
    pub system: &'s System,
    pub start: &'s State,
    pub duration: f64,
    pub reference: &'s Reference,
}

/// An integrator.
pub enum Contender {
    /// Of another library, with steps that adapt to a tolerance.
    Peer(Peer),
    /// Of this crate, with steps of one length.
    Steps(Configuration),
    /// Of this crate, with adaptive steps.
    Adaptive(Configuration),
}

impl Contender {
    /// All of them; the fastest first, so that the ladders of others need not become hopeless.
    pub fn all() -> Vec<Self> {
        let ours = |method| Configuration { method, options: ImplicitOptions::default() };
        let steps = [
            Method::Dop853,
            Method::Verlet,
            Method::SymplecticEuler,
            Method::ImplicitMidpoint,
            Method::Bdf2,
            Method::LinearBackwardEuler,
        ];
        let adaptive = [Method::Dop853, Method::Rodas4, Method::W2, Method::Bdf2];
        let steps = steps.map(|method| Self::Steps(ours(method)));
        let adaptive = adaptive.map(|method| Self::Adaptive(ours(method)));
        Peer::ALL.map(Self::Peer).into_iter().chain(adaptive).chain(steps).collect()
    }

    /// The name in tables and legends.
    fn name(&self) -> String {
        match self {
            Self::Peer(peer) => peer.name().into(),
            Self::Steps(configuration) => configuration.method.name().into(),
            Self::Adaptive(configuration) => format!("{}, adaptive", configuration.method.name()),
        }
    }

    /// The colour and shape of a method are those it has in the charts; the peers have those of methods that are not here.
    fn look(&self) -> Look {
        let (method, hollow) = match self {
            Self::Peer(Peer::Ivp) => (Method::BackwardEuler, false),
            Self::Peer(Peer::OdeSolvers) => (Method::BackwardEuler, true),
            Self::Peer(Peer::Diffsol(OfDiffsol::Bdf)) => (Method::ForwardEuler, false),
            Self::Peer(Peer::Diffsol(OfDiffsol::Esdirk34)) => (Method::ForwardEuler, true),
            Self::Peer(Peer::Diffsol(OfDiffsol::Tsit45)) => (Method::ImplicitMidpoint, true),
            Self::Steps(configuration) => (configuration.method, false),
            Self::Adaptive(configuration) => (configuration.method, true),
        };
        let number = Method::ALL.iter().position(|known| *known == method).unwrap_or(Method::ALL.len());
        Look { number, hollow }
    }

    /// Runs with smaller and smaller tolerances or steps, as long as the reference can tell their errors and they are not too long. The
    /// shortest time to the smallest error that anybody needed so far is known, or not yet.
    pub fn climb(&self, task: &Task<'_>, fastest: Option<f64>) -> Curve {
        let side = if matches!(self, Self::Peer(_)) { Side::Peer } else { Side::Ours };
        let mut curve = Curve { name: self.name(), side, look: self.look(), runs: Vec::new() };
        let least = ACCURACIES.into_iter().fold(f64::INFINITY, f64::min);
        let floor = (BELOW * least).max(3.0 * task.reference.error_estimate);
        for rung in 0..RUNGS {
            let run = self.measure(task, rung, LONG);
            let is_broken_off = run.seconds > LONGEST.as_secs_f64();
            let is_long = run.outcome.is_ok() && run.seconds > last(fastest);
            let ends = run.reaches(floor) || is_broken_off || is_long;
            curve.runs.push(run);
            if ends {
                break;
            }
        }
        curve
    }

    /// Times those runs again that are among the fastest for an error: other work that slowed this contender's runs has passed by then.
    pub fn repeat(&self, task: &Task<'_>, curve: &mut Curve, fastest: &[Option<f64>]) {
        let mut near = Vec::new();
        for (&accuracy, &fastest) in ACCURACIES.iter().zip(fastest) {
            if let Some(rung) = curve.fastest(accuracy)
                && curve.shortest(accuracy).zip(fastest).is_some_and(|(own, fastest)| own < NEAR * fastest)
                && !near.contains(&rung)
            {
                near.push(rung);
            }
        }
        for rung in near {
            let again = self.measure(task, rung as i32, LONGEST).seconds;
            if let Some(run) = curve.runs.get_mut(rung) {
                run.seconds = run.seconds.min(again);
            }
        }
    }

    /// The shortest of several times, in processor time of this thread; of a run that takes `long` the first.
    fn measure(&self, task: &Task<'_>, rung: i32, long: Duration) -> Run {
        let once = || {
            let (clock, patience) = (ThreadTime::now(), Patience::new());
            let result = self.run(task, rung, &patience);
            (clock.elapsed().saturating_sub(patience.excused()), result)
        };
        let (mut best, result) = once();
        if best < long {
            let [least, most] = REPEATS;
            let repeats = (SPAN.as_secs_f64() / best.as_secs_f64()) as u32;
            for _ in 0..repeats.clamp(least, most) {
                best = best.min(once().0);
            }
        }
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

    fn run(&self, task: &Task<'_>, rung: i32, patience: &Patience) -> Result<State, Failure> {
        let Task { system, start, duration, .. } = *task;
        let rtol = 0.2 * 0.5f64.powi(rung);
        let ours = |configuration, pace| -> Result<State, Failure> {
            let run = trial(system, start, configuration, pace, duration, &|| patience.lasts())?;
            match run.status {
                Status::Completed => Ok(run.state),
                Status::Interrupted => Err(TOO_LONG.into()),
                status => Err(status.name().replace('-', " ").into()),
            }
        };
        match self {
            Self::Peer(peer) => peer.run(system, start, duration, rtol, patience),
            Self::Steps(configuration) => ours(configuration, StepControl::Step(duration / steps(rung))),
            Self::Adaptive(configuration) => ours(configuration, StepControl::Adaptive { rtol, first_step: None }),
        }
    }
}

/// Three numbers of steps to a power of two, from four on.
fn steps(rung: i32) -> f64 {
    (4.0 * 2f64.powf(f64::from(rung) / 3.0)).round()
}
