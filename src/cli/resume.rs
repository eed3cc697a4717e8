//! A run in parts, from one checkpoint to the next, and its continuation with `--resume`.
//!
//! Every part begins from a state alone, with a stepper of its own, so that it makes no difference whether the same process ran the part
//! before. A run without checkpoints is one part.

use super::console::{Console, number};
use super::files::{Files, Recorder};
use super::threads::is_interrupted;
use sprung::integrate::{Monitor, MonitorOptions, Outcome, Schedule, Statistics, Status};
use sprung::output::Checkpoint;
use sprung::plan::{Plan, Stepper};
use sprung::{Error, Result, State, System};
use std::collections::HashMap;
use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

pub struct Parts<'s> {
    pub system: &'s System,
    pub start: &'s State,
    pub plan: &'s Plan,
    pub schedule: &'s Schedule,
    pub monitor: MonitorOptions,
    pub checkpoints: Option<Checkpoints<'s>>,
}

pub struct Checkpoints<'s> {
    pub every: NonZeroU64,
    pub folder: &'s Path,
    pub run: String,
    /// Options that depend on its length.
    pub length: String,
}

pub struct Ended<'s> {
    pub stepper: Stepper<'s>,
    pub monitor: Monitor<'s>,
    pub outcome: Outcome,
    pub statistics: Statistics,
    pub wall_seconds: f64,
}

impl<'s> Parts<'s> {
    /// The reason why the run cannot continue from a checkpoint, if it cannot.
    fn obstacle(&self, found: &Checkpoint) -> Option<String> {
        let ours = self.checkpoints.as_ref()?;
        let mut differences = differences(&found.run, &ours.run);
        if found.every != ours.every.get() {
            differences.push(format!("--checkpoint was {}, and is {}", found.every, ours.every));
        }
        let [before, now] = [found.positions.len(), self.system.particles()];
        if before != now {
            differences.push(format!("the number of particles was {before}, and is {now}"));
        }
        if !differences.is_empty() {
            return Some(format!("its checkpoint is of another run ({})", differences.join("; ")));
        }
        let reason = if found.length == ours.length {
            (found.reached >= self.schedule.len()).then_some("its checkpoint is not before the end of this run")?
        } else if self.plan.rtol.is_some() {
            "its adaptive steps depend on the length of the run and on the interval of records, which differ"
        } else {
            "its frames are as far apart as the length of the run makes them (with --frames N they are not)"
        };
        Some(reason.into())
    }

    /// Whether every longer run has a checkpoint at the end of this one, with the same bits.
    fn ends_on_longer_runs(&self, every: NonZeroU64) -> bool {
        let Self { schedule, plan, .. } = self;
        plan.rtol.is_none() && schedule.ends_with_whole_step() && schedule.len().is_multiple_of(every.get())
    }

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

    /// Runs from the beginning or a checkpoint to the end, a failure or an interruption, with the monitor and the stepper of the first part.
    pub fn run(
        &self,
        mut from: Option<Checkpoint>,
        (mut monitor, mut stepper): (Monitor<'s>, Stepper<'s>),
        state: &mut State,
        recorder: &mut Recorder,
    ) -> Result<Ended<'s>> {
        let Self { system, schedule, plan, .. } = *self;
        let mut clock = Instant::now();
        let (outcome, statistics, wall_seconds) = loop {
            let reached = from.as_ref().map_or(0, |checkpoint| checkpoint.reached);
            let part = self.checkpoints.as_ref().map_or(*schedule, |c| schedule.part(reached, c.every.get()));
            let mut unwritten = None;
            let mut outcome = stepper.run(system, state, &part, &mut monitor, |number, state, monitor| {
                unwritten = recorder.record(system, state, number, monitor).err();
                let stops = unwritten.is_some() || is_interrupted();
                if stops { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            if let Some(error) = unwritten {
                return Err(error);
            }
            let (mut statistics, mut wall_seconds) = (*stepper.get().statistics(), clock.elapsed().as_secs_f64());
            clock = Instant::now();
            if let Some(before) = &from {
                statistics.add(&before.statistics);
                wall_seconds += before.wall_seconds;
                // Adaptive steps are counted anew in every part.
                if plan.rtol.is_some() {
                    outcome.steps += before.steps;
                    if let Err(failed) = &mut outcome.end {
                        failed.step += before.steps;
                    }
                }
            }
            let is_last = part.len() >= schedule.len();
            let is_due = |c: &&Checkpoints| {
                outcome.status() == Status::Completed && (!is_last || self.ends_on_longer_runs(c.every))
            };
            let Some(checkpoints) = self.checkpoints.as_ref().filter(is_due) else {
                break (outcome, statistics, wall_seconds);
            };
            let (energies, frames) = recorder.position()?;
            let checkpoint = Checkpoint {
                run: checkpoints.run.clone(),
                length: checkpoints.length.clone(),
                every: checkpoints.every.get(),
                reached: part.len(),
                steps: outcome.steps,
                time: state.time,
                positions: state.positions.clone(),
                velocities: state.velocities.clone(),
                statistics,
                wall_seconds,
                account: monitor.account(),
                energies,
                frames,
            };
            checkpoint.write(checkpoints.folder)?;
            if is_last {
                break (outcome, statistics, wall_seconds);
            }
            (monitor, stepper) = self.begin(Some(&checkpoint), state)?;
            // An interruption in the last step ends the run here, with everything in the checkpoint.
            if is_interrupted() {
                let outcome = Outcome { steps: checkpoint.steps, end: Ok(ControlFlow::Break(())) };
                break (outcome, statistics, wall_seconds);
            }
            from = Some(checkpoint);
        };
        Ok(Ended { stepper, monitor, outcome, statistics, wall_seconds })
    }
}

/// The value of an option that is not given, and the name of options without a name of their own, in the description of a run.
pub const NOT_GIVEN: &str = "not given";
pub const OTHER_OPTIONS: &str = "options";

/// What differs between two runs by their descriptions. What follows from a named option is not named again.
fn differences(found: &str, ours: &str) -> Vec<String> {
    fn values(text: &str) -> impl Iterator<Item = (&str, &str)> {
        text.lines().filter_map(|line| line.split_once(' '))
    }
    let before: HashMap<&str, &str> = values(found).collect();
    let changed = values(ours).map(|(name, now)| (name, before.get(name).copied(), now));
    let changed = changed.filter(|(_, then, now)| *then != Some(*now));
    let (others, named): (Vec<_>, Vec<_>) = changed.partition(|(name, ..)| *name == OTHER_OPTIONS);
    let told = if named.is_empty() { others } else { named };
    let in_words = |(name, then, now): (&str, Option<&str>, &str)| match (name, then) {
        ("scene", _) => "the scene or its state at the start has changed".into(),
        (OTHER_OPTIONS, _) => "other options differ".into(),
        (_, Some(then)) => format!("{name} was {then}, and is {now}"),
        (_, None) => format!("{name} is {now}"),
    };
    told.into_iter().map(in_words).collect()
}

/// What an earlier run left in the folder.
pub struct Earlier<'a> {
    folder: &'a Path,
    files: &'a Files,
    resume: bool,
    /// Where the run is to be resumed.
    checkpoint: Option<Checkpoint>,
    /// The run of the checkpoint came to its end.
    is_finished: bool,
}

impl<'a> Earlier<'a> {
    pub fn of(folder: &'a Path, resume: bool, files: &'a Files) -> Result<Self> {
        let unfinished = if resume { Checkpoint::read(folder)? } else { None };
        let is_finished = resume && unfinished.is_none();
        let checkpoint = if is_finished { Checkpoint::read_finished(folder)? } else { unfinished };
        Ok(Self { folder, files, resume, checkpoint, is_finished })
    }

    pub fn every(&self) -> Option<NonZeroU64> {
        NonZeroU64::new(self.checkpoint.as_ref()?.every)
    }

    /// The checkpoint to continue from, if that is requested and possible; notes what happens to the earlier run. An error for an
    /// unfinished checkpoint of another run, and for none where this run writes none.
    pub fn checkpoint(self, console: &Console, parts: &Parts) -> Result<Option<Checkpoint>> {
        let Self { folder, files, resume, checkpoint, is_finished } = self;
        let run = earlier_run(folder);
        let replaces = match &files.removed(folder)[..] {
            [] => "this run replaces its files".to_owned(),
            [names @ .., last] => {
                let names = if names.is_empty() { String::new() } else { format!("{} and ", names.join(", ")) };
                format!("this run replaces its files, and removes {names}{last}")
            }
        };
        let folder = folder.display();
        let Some(found) = checkpoint else {
            match run {
                Some(run) if resume => console.note(format_args!(
                    "{run} and left nothing to go on from, as it wrote no checkpoint: this run starts again"
                )),
                Some(run) => console.note(format_args!("{run}: {replaces}")),
                None if resume && parts.checkpoints.is_none() => {
                    return Err(Error::Usage(format!(
                        "{folder}: no checkpoint to resume from; --checkpoint N writes them"
                    )));
                }
                None => {}
            }
            return Ok(None);
        };
        let run = run.unwrap_or_else(|| format!("{folder}: a run ended here"));
        let (step, time) = (found.reached, number(found.time));
        match parts.obstacle(&found) {
            None if is_finished => {
                console.note(format_args!("{run}: this run goes on from its checkpoint at step {step}, t = {time} s"))
            }
            None => {}
            Some(why) if is_finished => {
                console.note(format_args!("{run}; {why}: this run starts again"));
                return Ok(None);
            }
            Some(why) => {
                return Err(Error::Usage(format!(
                    "{folder}: {why}: give the scene and the arguments of the run that wrote it, or leave out --resume"
                )));
            }
        }
        Ok(Some(found))
    }
}

/// A sentence on the run whose summary is in a folder, if one can be read.
fn earlier_run(folder: &Path) -> Option<String> {
    let text = std::fs::read_to_string(folder.join("summary.json")).ok()?;
    let summary: serde_json::Value = serde_json::from_str(&text).ok()?;
    let text = |key: &str| summary.get(key)?.as_str();
    let (scene, method, status) = (text("scene")?, text("method")?, text("status")?);
    let time = number(summary.get("time")?.as_f64()?);
    Some(format!("{}: a run of {scene} by {method} ended here, {status} at t = {time} s", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::{NOT_GIVEN, OTHER_OPTIONS, differences};

    #[test]
    fn what_differs_is_named() {
        let run = |dt: &str, view: &str, scene: &str, others: &str| {
            format!("scene {scene}\n--dt {dt}\n--view {view}\n{OTHER_OPTIONS} {others}\n")
        };
        let ours = run("0.01", NOT_GIVEN, "abc", "x");
        assert!(differences(&ours, &ours).is_empty());
        let all = differences(&run("0.02", "given", "abd", "y"), &ours);
        let expected = [
            "the scene or its state at the start has changed",
            "--dt was 0.02, and is 0.01",
            "--view was given, and is not given",
        ];
        assert_eq!(all, expected);
        assert_eq!(differences(&run("0.01", NOT_GIVEN, "abc", "y"), &ours), ["other options differ"]);
        // A description of an older form.
        assert_eq!(differences("0123abc", &ours).len(), 3);
    }
}
