//! The run loop: step after step until the end, a failure, or a request to stop.

use super::schedule::SAME;
use super::{Monitor, Schedule, Status, StepFailure, TimeStepper, hermite};
use crate::system::{State, System};
use std::ops::ControlFlow;

/// The end of a run. The state is the last good one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Steps done.
    pub steps: u64,
    /// The end: `Break` where the observer asked for it.
    pub end: Result<ControlFlow<()>, RunFailure>,
}

/// A step that failed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunFailure {
    /// Its number, from 1.
    pub step: u64,
    /// The time at its start, in s.
    pub time: f64,
    /// The reason.
    pub failure: StepFailure,
}

impl Outcome {
    /// The run's status.
    pub fn status(&self) -> Status {
        match self.end {
            Ok(ControlFlow::Continue(())) => Status::Completed,
            Ok(ControlFlow::Break(())) => Status::Interrupted,
            Err(failure) => failure.failure.status(),
        }
    }

    /// A run that a step ended after `steps` good ones. Where energy was growing, growth is the cause, and the state becomes one from before.
    pub(super) fn failed(
        step: u64,
        time: f64,
        failure: StepFailure,
        steps: u64,
        state: &mut State,
        monitor: Option<&mut Monitor>,
    ) -> Self {
        let grown = monitor.as_ref().and_then(|monitor| monitor.growth());
        let steps = match monitor {
            Some(monitor) if grown.is_some() || monitor.has_overflowed() => monitor.restore(state),
            _ => steps,
        };
        Self { steps, end: Err(RunFailure { step, time, failure: grown.unwrap_or(failure) }) }
    }
}

/// Samples of a run of fixed steps at multiples of an interval and at its end, by cubic Hermite polynomials between the steps.
pub(crate) struct Sampler {
    interval: f64,
    start: f64,
    end: f64,
    count: u64,
    before: State,
    sample: State,
}

impl Sampler {
    pub fn new(start: &State, interval: f64, duration: f64) -> Self {
        let end = start.time + duration;
        Self { interval, start: start.time, end, count: 0, before: start.clone(), sample: start.clone() }
    }

    pub fn observe(
        &mut self,
        system: &System,
        state: &State,
        mut see: impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        // A sample within rounding of the end is the end.
        let slack = SAME * self.interval;
        loop {
            let time = self.start + (self.count + 1) as f64 * self.interval;
            if time > state.time || time > self.end - slack {
                break;
            }
            self.count += 1;
            hermite(&self.before, state, time, &mut self.sample);
            self.sample.time = time;
            self.sample.prescribe(system);
            see(self.count, &self.sample)?;
        }
        self.before.copy_from(state);
        if state.time >= self.end - slack { see(self.count + 1, state) } else { ControlFlow::Continue(()) }
    }
}

/// Advances `state` along the schedule. After every step `observe` sees the number of steps done and the new state, and may ask to stop.
pub fn run(
    stepper: &mut dyn TimeStepper,
    state: &mut State,
    schedule: &Schedule,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, state, schedule, None, |steps, state, _| observe(steps, state))
}

/// As [`run`], with a monitor that enters every step before `observe` sees it, and ends the run when energy appears from nowhere: the state is then
/// one from before that.
///
/// # Examples
/// ```
/// use sprung::Method;
/// use sprung::integrate::{ImplicitOptions, Monitor, MonitorOptions, Schedule, run_monitored};
/// use std::ops::ControlFlow;
///
/// # let mut builder = sprung::SystemBuilder::new();
/// # [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
/// # builder.hold(0).spring(0, 1, sprung::Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Method::Verlet.stepper(&system, &state, &ImplicitOptions::default())?;
/// let mut monitor = Monitor::new(&system, &state, MonitorOptions::ENERGY)?;
/// let schedule = Schedule::duration(1e-3, 1.0);
/// let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
/// assert_eq!(outcome.status().name(), "completed");
/// // Half of k (l − l0)²/l0 = 10 J was there at the start, and is there at the end.
/// assert!((monitor.energy().total() - 5.0).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn run_monitored(
    stepper: &mut dyn TimeStepper,
    state: &mut State,
    schedule: &Schedule,
    monitor: &mut Monitor,
    mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, state, schedule, Some(monitor), |steps, state, monitor| {
        monitor.map_or(ControlFlow::Continue(()), |monitor| observe(steps, state, monitor))
    })
}

/// Advances a state by dt seconds as a step of a run: in parts that end at the kinks of gravity and rest lengths
/// ([`TimeStepper::load_kinks`]). Between them forces are smooth in time, and no pulse passes unnoticed.
///
/// # Errors
/// The reason why a part could not be done; the state is then unchanged.
pub fn advance(stepper: &mut (impl TimeStepper + ?Sized), state: &mut State, dt: f64) -> Result<(), StepFailure> {
    let end = state.time + dt;
    let kinks = kinks_within(stepper, state.time, dt, end);
    if kinks.is_empty() {
        return stepper.step(state, dt);
    }
    let mut next = state.clone();
    for (length, end) in parts(kinks, state.time, dt, end) {
        stepper.step(&mut next, length)?;
        next.time = end;
    }
    state.copy_from(&next);
    Ok(())
}

/// The kinks of gravity and rest lengths within a step of dt seconds, apart from each other and from its ends, in s.
fn kinks_within(stepper: &(impl TimeStepper + ?Sized), start: f64, dt: f64, end: f64) -> Vec<f64> {
    let slack = SAME * dt + 4.0 * f64::EPSILON * end.abs();
    let mut last = start;
    let mut is_apart = |kink: f64| {
        let is_apart = kink > last + slack;
        last = if is_apart { kink } else { last };
        is_apart
    };
    let kinks = stepper.load_kinks();
    let from = kinks.partition_point(|&kink| kink <= start + slack);
    let within = kinks.iter().copied().skip(from).take_while(|&kink| kink < end - slack);
    within.filter(|&kink| is_apart(kink)).collect()
}

/// The parts of a step by the kinks within it: the length of each and the time of its end, in s.
fn parts(kinks: Vec<f64>, mut start: f64, dt: f64, end: f64) -> impl Iterator<Item = (f64, f64)> {
    let whole = kinks.is_empty().then_some(dt);
    kinks.into_iter().chain([end]).map(move |end| {
        let length = whole.unwrap_or(end - start);
        start = end;
        (length, end)
    })
}

fn drive(
    stepper: &mut dyn TimeStepper,
    state: &mut State,
    schedule: &Schedule,
    mut monitor: Option<&mut Monitor>,
    mut observe: impl FnMut(u64, &State, Option<&Monitor>) -> ControlFlow<()>,
) -> Outcome {
    let mut steps = schedule.first();
    // The time at which the whole schedule began, of which this may be a later part.
    let start = state.time - schedule.elapsed(steps);
    while let Some(dt) = schedule.step(steps) {
        let number = steps + 1;
        let step_end = start + schedule.elapsed(number);
        let kinks = kinks_within(stepper, state.time, dt, step_end);
        for (length, end) in parts(kinks, state.time, dt, step_end) {
            let before = state.time;
            let mut done = match &mut monitor {
                Some(monitor) => stepper.step_seen(state, length, monitor.springs()),
                None => stepper.step(state, length),
            };
            if done.as_ref().is_err_and(|failure| failure.status() == Status::Interrupted) {
                return Outcome { steps, end: Ok(ControlFlow::Break(())) };
            }
            if done.is_ok() {
                state.time = end;
                steps += u64::from(end == step_end);
                if let Some(monitor) = &mut monitor {
                    monitor.propagate(stepper, state, length);
                    done = monitor.enter(steps, state, length);
                }
            }
            if let Err(failure) = done {
                return Outcome::failed(number, before, failure, steps, state, monitor);
            }
        }
        if observe(steps, state, monitor.as_deref()).is_break() && schedule.step(steps).is_some() {
            return Outcome { steps, end: Ok(ControlFlow::Break(())) };
        }
    }
    Outcome { steps, end: Ok(ControlFlow::Continue(())) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::Method;
    use crate::integrate::fixtures::{particles, stepper};

    /// A request to stop ends the run, unless that was at its end anyway.
    #[test]
    fn observers_may_end_runs() {
        let (system, start) = particles(&[0.0]);
        for (stop, steps, status) in [(2, 2, Status::Interrupted), (4, 4, Status::Completed), (9, 4, Status::Completed)]
        {
            let mut state = start.clone();
            let mut stepper = stepper(Method::ForwardEuler, &system, &state);
            let outcome = run(&mut *stepper, &mut state, &Schedule::steps(0.5, 4), |count, _| {
                if count < stop { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            });
            assert_eq!((outcome.steps, outcome.status(), state.time), (steps, status, 0.5 * steps as f64));
        }
    }

    /// A part of a schedule goes on at its time, and by the times of the whole.
    #[test]
    fn parts_of_runs_go_on_at_their_time() {
        let (system, mut state) = particles(&[0.0]);
        state.time = 7.5;
        let mut stepper = stepper(Method::ForwardEuler, &system, &state);
        let mut times = Vec::new();
        let outcome = run(&mut *stepper, &mut state, &Schedule::steps(0.5, 4).part(1, 2), |count, state| {
            times.push((count, state.time));
            ControlFlow::Continue(())
        });
        assert_eq!((outcome.steps, outcome.status(), times), (3, Status::Completed, vec![(2, 8.0), (3, 8.5)]));
    }
}
