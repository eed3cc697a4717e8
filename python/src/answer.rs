//! A run of a required accuracy.

use crate::compute::Flag;
use crate::recorded::Recorded;
use crate::task::{Done, Pacing, Subject};
use sprung::accuracy::{AccuracyOptions, Observer, run_to_accuracy};
use sprung::integrate::{Monitor, Schedule};
use sprung::output::{EnergyChange, Summary};
use sprung::{Result, State, System};
use std::time::Instant;

/// What is kept of a run until it is known whether it is the answer.
struct Kept {
    recorded: Recorded,
    energy: EnergyChange,
}

/// Records runs.
struct Recorder<'a> {
    system: &'a System,
    start: &'a State,
    pacing: &'a Pacing,
}

impl Observer for Recorder<'_> {
    type Records = Kept;

    fn begin(&mut self, monitor: &Monitor) -> Result<Kept> {
        let Pacing { interval, duration, every, .. } = *self.pacing;
        let mut recorded = Recorded::new(self.system, Schedule::duration(interval, duration).len(), every)?;
        recorded.push(0, self.start, monitor);
        Ok(Kept { recorded, energy: EnergyChange::of(monitor) })
    }

    fn record(&mut self, kept: &mut Kept, number: u64, state: &State, monitor: &Monitor) -> Result<()> {
        kept.energy = EnergyChange::of(monitor);
        kept.recorded.push(number, state, monitor);
        Ok(())
    }
}

/// Searches for an answer, and moves the state to its end; `None` where no run comes to the end.
pub fn search(
    subject: &Subject<'_>,
    options: &AccuracyOptions,
    pacing: &Pacing,
    flag: &Flag,
    state: &mut State,
) -> Result<Option<Done>> {
    let clock = Instant::now();
    let start = state.clone();
    let mut recorder = Recorder { system: subject.system, start: &start, pacing };
    let go_on = || !flag.is_raised();
    // Who interrupts a search is not handed what it had so far, so the state stays where it was.
    let found = run_to_accuracy(subject.system, &start, options, &mut recorder, &go_on)?.filter(|_| go_on());
    let Some(found) = found else { return Ok(None) };
    let Subject { name, system } = subject;
    let (energy, seconds) = (found.records.energy, clock.elapsed().as_secs_f64());
    let name = (*name).to_owned();
    let summary = Summary::of_answer(name, system, &found, options, energy, seconds);
    *state = found.state;
    let mut recorded = found.records.recorded;
    recorded.end(state);
    Ok(Some(Done { summary, recorded }))
}
