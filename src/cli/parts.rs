//! A run in parts: from one checkpoint to the next.
//!
//! Every part begins from a state alone, with a stepper of its own; so it makes no difference whether the part before was done by the
//! same process. A run without checkpoints is one part.

use super::recorder::Recorder;
use sprung::integrate::{Monitor, MonitorOptions, Outcome, Schedule, Statistics, Status};
use sprung::output::{Checkpoint, rows};
use sprung::plan::{Plan, Stepper};
use sprung::{Result, State, System};
use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// What all parts have in common.
pub struct Parts<'s> {
    pub system: &'s System,
    /// The state that the run began with.
    pub start: &'s State,
    pub plan: &'s Plan,
    pub schedule: &'s Schedule,
    pub monitor: MonitorOptions,
    pub interrupted: &'s AtomicBool,
    pub checkpoints: Option<Checkpoints<'s>>,
}

/// When checkpoints are written, and where.
pub struct Checkpoints<'s> {
    pub every: NonZeroU64,
    pub folder: &'s Path,
    /// The run's fingerprint.
    pub run: String,
    /// What depends on its length.
    pub length: String,
}

/// A run that has ended.
pub struct Ended<'s> {
    pub stepper: Stepper<'s>,
    pub monitor: Monitor<'s>,
    pub outcome: Outcome,
    pub statistics: Statistics,
    pub wall_seconds: f64,
}

/// How far a run is.
#[derive(Default)]
struct Reached {
    /// Of the schedule.
    steps: u64,
    /// Really done, where they are adaptive.
    accepted: u64,
    statistics: Statistics,
    wall_seconds: f64,
}

impl<'s> Parts<'s> {
    /// Why the run cannot go on from a checkpoint, if it cannot.
    pub fn obstacle(&self, found: &Checkpoint) -> Option<&'static str> {
        let ours = self.checkpoints.as_ref()?;
        if found.run != ours.run || found.every != ours.every.get() || found.positions.len() != self.system.particles()
        {
            return Some("its checkpoint is of another run");
        }
        if found.length != ours.length {
            return Some(match self.plan.rtol {
                Some(_) => "its adaptive steps depend on the length of the run",
                None => {
                    "its frames are as far apart as the length of the run makes them (with --frames N they are not)"
                }
            });
        }
        (found.reached >= self.schedule.len()).then_some("its checkpoint is not before the end of this run")
    }

    /// Whether the end of the run is also a place of checkpoints of every longer one, with the same bits.
    fn ends_on_longer_runs(&self, every: NonZeroU64) -> bool {
        let Self { schedule, plan, .. } = self;
        plan.rtol.is_none() && schedule.ends_with_whole_step() && schedule.len().is_multiple_of(every.get())
    }

    /// A monitor for the part that begins at a state, and a stepper.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn begin(&self, from: Option<&Checkpoint>, state: &State) -> Result<(Monitor<'s>, Stepper<'s>)> {
        let monitor = match from {
            None => Monitor::new(self.system, state, self.monitor)?,
            Some(checkpoint) => {
                let steps = if self.plan.rtol.is_some() { 0 } else { checkpoint.reached };
                Monitor::continued(self.system, [self.start, state], steps, &checkpoint.account, self.monitor)?
            }
        };
        Ok((monitor, self.plan.stepper(self.system, state)?))
    }

    /// Runs to the end, or to what comes before it, from the beginning or from a checkpoint, with the monitor and the stepper of the
    /// first part.
    ///
    /// # Errors
    /// A file that cannot be written; a matrix that does not fit the memory any more.
    pub fn run(
        &self,
        from: Option<Checkpoint>,
        (mut monitor, mut stepper): (Monitor<'s>, Stepper<'s>),
        state: &mut State,
        recorder: &mut Recorder,
    ) -> Result<Ended<'s>> {
        let Self { system, schedule, plan, .. } = *self;
        let clock = Instant::now();
        let mut reached = from.map_or_else(Reached::default, |checkpoint| Reached {
            steps: checkpoint.reached,
            accepted: checkpoint.steps,
            statistics: checkpoint.statistics,
            wall_seconds: checkpoint.wall_seconds,
        });
        loop {
            let part = self.checkpoints.as_ref().map_or(*schedule, |c| schedule.part(reached.steps, c.every.get()));
            let mut unwritten = None;
            let mut outcome = stepper.run(system, state, &part, &mut monitor, |number, state, monitor| {
                unwritten = recorder.record(system, state, number, monitor).err();
                if unwritten.is_some() || self.interrupted.load(Ordering::Relaxed) {
                    return ControlFlow::Break(());
                }
                ControlFlow::Continue(())
            });
            if let Some(error) = unwritten {
                return Err(error);
            }
            if plan.rtol.is_some() {
                outcome.steps += reached.accepted;
                if let Err(failed) = &mut outcome.end {
                    failed.step += reached.accepted;
                }
            }
            let mut statistics = *stepper.get().statistics();
            statistics.add(&reached.statistics);
            let wall_seconds = reached.wall_seconds + clock.elapsed().as_secs_f64();
            let is_last = part.len() >= schedule.len();
            let is_kept = |c: &&Checkpoints| {
                outcome.status() == Status::Completed && (!is_last || self.ends_on_longer_runs(c.every))
            };
            let Some(checkpoints) = self.checkpoints.as_ref().filter(is_kept) else {
                return Ok(Ended { stepper, monitor, outcome, statistics, wall_seconds });
            };
            reached = Reached { steps: part.len(), accepted: outcome.steps, statistics, ..reached };
            let (energies, frames) = recorder.position()?;
            let checkpoint = Checkpoint {
                run: checkpoints.run.clone(),
                length: checkpoints.length.clone(),
                every: checkpoints.every.get(),
                reached: reached.steps,
                steps: reached.accepted,
                time: state.time,
                positions: rows(&state.positions),
                velocities: rows(&state.velocities),
                statistics,
                wall_seconds,
                account: monitor.account(),
                energies,
                frames,
            };
            checkpoint.write(checkpoints.folder)?;
            if is_last {
                return Ok(Ended { stepper, monitor, outcome, statistics, wall_seconds });
            }
            (monitor, stepper) = self.begin(Some(&checkpoint), state)?;
            // The last step's request to stop is answered here: with everything in the checkpoint.
            if self.interrupted.load(Ordering::Relaxed) {
                let outcome = Outcome { steps: reached.accepted, end: Ok(ControlFlow::Break(())) };
                return Ok(Ended { stepper, monitor, outcome, statistics, wall_seconds });
            }
        }
    }
}
