//! One run on the way to an answer: metered, observed, and compared with others by its course.

use super::course::{Course, most_samples};
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{
    AdaptiveStepper, Adaptivity, ErrorEstimate, Monitor, MonitorOptions, Outcome, Sampling, Schedule, Statistics,
    Status, StepFailure, TimeStepper, hermite, run_adaptive_monitored, run_monitored,
};
use crate::linear::{CostModel, FactorReport, LinearSolver};
use crate::system::{State, System};
use std::cell::Cell;
use std::ops::ControlFlow;

/// What looks on while an answer is looked for.
pub trait Audience {
    /// What is kept of one run until it is known whether that is the answer.
    type Records;

    /// A run begins.
    ///
    /// # Errors
    /// What ends the search.
    fn begin(&mut self, monitor: &Monitor) -> Result<Self::Records>;

    /// The run is at a multiple of the interval asked for, or at its end.
    ///
    /// # Errors
    /// What ends the search.
    fn record(&mut self, records: &mut Self::Records, number: u64, state: &State, monitor: &Monitor) -> Result<()>;

    /// How the search gets on.
    fn progress(&mut self, _progress: &Progress<'_>) {}
}

/// Nobody.
impl Audience for () {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> Result<()> {
        Ok(())
    }
}

/// How a search gets on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress<'a> {
    /// What is being done.
    pub doing: &'a str,
    /// The part of it that is done.
    pub part: f64,
    /// What has been spent, in force evaluations.
    pub spent: f64,
    /// What is left to do at most, as far as can be seen, in force evaluations.
    pub left: f64,
}

/// A motion to be computed.
pub(super) struct Task<'a> {
    pub system: &'a System,
    pub start: &'a State,
    pub duration: f64,
    pub costs: CostModel,
    pub grid: Grid,
    pub go_on: &'a dyn Fn() -> bool,
}

/// The times at which runs are seen: multiples of a spacing, and the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    spacing: f64,
    /// Of these every so many are recorded, and every so many kept to compare runs by.
    recorded: u64,
    compared: u64,
}

/// A run is compared in at least so many places.
const FEWEST: f64 = 16.0;

impl Grid {
    pub fn new(duration: f64, interval: f64, particles: usize) -> Self {
        let recorded = (FEWEST * interval / duration).ceil().max(1.0);
        let spacing = interval / recorded;
        let samples = (duration / spacing).ceil();
        let compared = (samples / most_samples(particles) as f64).ceil().max(1.0);
        Self { spacing, recorded: recorded as u64, compared: compared as u64 }
    }
}

/// A completed run.
pub(super) struct Attempt<R> {
    pub configuration: Configuration,
    pub pace: Pace,
    pub state: State,
    pub steps: u64,
    pub statistics: Statistics,
    pub cost: f64,
    pub solver: SolverReport,
    pub course: Course,
    pub records: R,
}

/// The linear solver that a run used; `none` for a method without matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverReport {
    /// Its name.
    pub name: &'static str,
    /// Its preconditioner's.
    pub preconditioner: &'static str,
    /// Why it was chosen.
    pub choice: Option<String>,
    /// Its factor.
    pub factor: Option<FactorReport>,
}

/// How a run came out, and what it cost.
pub(super) struct Tried<R> {
    /// `None` where it did not get to the end.
    pub attempt: Option<Attempt<R>>,
    pub status: Status,
    pub cost: f64,
    /// Whether it was ended because it became too expensive.
    pub is_too_expensive: bool,
}

/// Runs a configuration as far as `limit` force evaluations go.
pub(super) fn attempt<A: Audience>(
    task: &Task<'_>,
    configuration: Configuration,
    pace: Pace,
    limit: f64,
    audience: &mut A,
    progress: &mut dyn FnMut(&mut A, f64, f64),
) -> Result<Tried<A::Records>> {
    let Configuration { method, options } = &configuration;
    let Task { system, start, duration, grid, .. } = *task;
    let mut state = start.clone();
    // A run that blows up shows in the comparison with another.
    let options_of_monitor = MonitorOptions { stops_unstable: false, ..MonitorOptions::default() };
    let mut monitor = Monitor::new(system, &state, options_of_monitor)?;
    let meter = Meter { costs: task.costs, limit, spent: Cell::new(0.0), refused: Cell::new(false), go_on: task.go_on };
    let mut watch = Watch {
        records: audience.begin(&monitor)?,
        audience,
        course: Course::default(),
        grid,
        end: start.time + duration,
        failed: None,
        progress,
        meter: &meter,
        start: start.time,
    };
    let (outcome, stepper): (Outcome, Box<dyn TimeStepper>) = match pace {
        Pace::Step(dt) => {
            let mut stepper = method.stepper(system, start, options)?;
            let mut metered = Metered { stepper: &mut *stepper, meter: &meter };
            let mut between = Between::new(grid.spacing, dt, start);
            let schedule = Schedule::duration(dt, duration);
            let outcome = run_monitored(&mut metered, &mut state, &schedule, &mut monitor, |_, state, monitor| {
                between.see(system, state, watch.end, |number, sample| watch.see(number, sample, monitor))
            });
            (outcome, stepper)
        }
        Pace::Adaptive { rtol, first_step } => {
            let mut stepper = method.adaptive_stepper(system, start, options)?.ok_or_else(|| {
                crate::Error::Unsupported(format!("{} has no error estimate for adaptive steps", method.name()))
            })?;
            let how = Adaptivity { duration, rtol, first_step, sampling: Sampling::Every(grid.spacing) };
            let mut metered = Metered { stepper: &mut *stepper, meter: &meter };
            let outcome = run_adaptive_monitored(
                &mut metered,
                system,
                &mut state,
                &how,
                &mut monitor,
                |number, state, monitor| watch.see(number, state, monitor),
            );
            (outcome, stepper)
        }
    };
    let Watch { records, course, failed, .. } = watch;
    failed.map_or(Ok(()), Err)?;
    let solver = stepper.linear_solver();
    let factor = solver.and_then(LinearSolver::factor);
    let statistics = *stepper.statistics();
    let cost = task.costs.cost(&statistics.work, factor.map(|factor| factor.size));
    let interrupted = !(task.go_on)();
    let status = if interrupted { Status::Interrupted } else { outcome.status() };
    let attempt = (status == Status::Completed).then(|| Attempt {
        configuration,
        pace,
        state,
        steps: outcome.steps,
        statistics,
        cost,
        solver: SolverReport {
            name: solver.map_or("none", LinearSolver::name),
            preconditioner: solver.and_then(LinearSolver::preconditioner).unwrap_or("none"),
            choice: solver.and_then(LinearSolver::choice),
            factor,
        },
        course,
        records,
    });
    Ok(Tried { attempt, status, cost, is_too_expensive: meter.refused.get() && !interrupted })
}

/// Records and compares.
struct Watch<'w, A: Audience> {
    audience: &'w mut A,
    records: A::Records,
    course: Course,
    grid: Grid,
    start: f64,
    end: f64,
    failed: Option<crate::Error>,
    progress: &'w mut dyn FnMut(&mut A, f64, f64),
    meter: &'w Meter<'w>,
}

impl<A: Audience> Watch<'_, A> {
    fn see(&mut self, number: u64, state: &State, monitor: &Monitor) -> ControlFlow<()> {
        let is_end = state.time >= self.end;
        if is_end || number.is_multiple_of(self.grid.compared) {
            self.course.push(state.time, &state.positions);
        }
        if is_end || number.is_multiple_of(self.grid.recorded) {
            let number = number.div_ceil(self.grid.recorded);
            self.failed = self.audience.record(&mut self.records, number, state, monitor).err();
        }
        let part = (state.time - self.start) / (self.end - self.start);
        (self.progress)(self.audience, part, self.meter.spent.get());
        let stops = self.failed.is_some() || self.meter.is_over();
        if stops { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// What a run has spent, and whether it may go on.
struct Meter<'a> {
    costs: CostModel,
    limit: f64,
    spent: Cell<f64>,
    /// Whether the limit has been reached.
    refused: Cell<bool>,
    go_on: &'a dyn Fn() -> bool,
}

impl Meter<'_> {
    fn is_over(&self) -> bool {
        if self.spent.get() > self.limit {
            self.refused.set(true);
        }
        self.refused.get() || !(self.go_on)()
    }
}

/// A stepper that refuses steps when it has cost too much, or is asked to stop: no step, however often cut, gets in the way of
/// that.
struct Metered<'a, S: ?Sized> {
    stepper: &'a mut S,
    meter: &'a Meter<'a>,
}

impl<S: TimeStepper + ?Sized> Metered<'_, S> {
    fn meter(&self) -> Result<(), StepFailure> {
        let factor = self.stepper.linear_solver().and_then(LinearSolver::factor).map(|factor| factor.size);
        self.meter.spent.set(self.meter.costs.cost(&self.stepper.statistics().work, factor));
        if self.meter.is_over() { Err(StepFailure::Tolerance) } else { Ok(()) }
    }
}

impl<S: TimeStepper + ?Sized> TimeStepper for Metered<'_, S> {
    fn name(&self) -> &'static str {
        self.stepper.name()
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        self.stepper.linear_solver()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        self.meter()?;
        self.stepper.step(state, dt)
    }

    fn restart(&mut self) {
        self.stepper.restart();
    }

    fn statistics(&self) -> &Statistics {
        self.stepper.statistics()
    }
}

impl<S: AdaptiveStepper + ?Sized> AdaptiveStepper for Metered<'_, S> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        self.meter()?;
        self.stepper.try_step(state, dt)
    }

    fn coarser_estimate(&self) -> Option<ErrorEstimate<'_>> {
        self.stepper.coarser_estimate()
    }

    fn accept(&mut self, state: &mut State) {
        self.stepper.accept(state);
    }

    fn reject(&mut self) {
        self.stepper.reject();
    }

    fn order(&self) -> u32 {
        self.stepper.order()
    }

    fn estimate_order(&self) -> u32 {
        self.stepper.estimate_order()
    }

    fn caution(&self) -> f64 {
        self.stepper.caution()
    }

    fn gains_by_equal_steps(&self) -> bool {
        self.stepper.gains_by_equal_steps()
    }

    fn largest_growth(&self) -> f64 {
        self.stepper.largest_growth()
    }

    fn interpolate(&mut self, before: &State, after: &State, time: f64, sample: &mut State) {
        self.stepper.interpolate(before, after, time, sample);
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        self.stepper.statistics_mut()
    }
}

/// States between the steps of a fixed length.
struct Between {
    spacing: f64,
    dt: f64,
    start: f64,
    count: u64,
    /// The last state before the next time to be seen, where that is needed.
    before: State,
    sample: State,
}

impl Between {
    fn new(spacing: f64, dt: f64, start: &State) -> Self {
        Self { spacing, dt, start: start.time, count: 0, before: start.clone(), sample: start.clone() }
    }

    fn next(&self) -> f64 {
        self.start + (self.count + 1) as f64 * self.spacing
    }

    fn see(
        &mut self,
        system: &System,
        state: &State,
        end: f64,
        mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let is_end = state.time >= end;
        // A time within rounding of the end is the end.
        let slack = if is_end { 1e-9 * self.spacing } else { 0.0 };
        while self.next() < state.time - slack || (self.next() == state.time && !is_end) {
            let time = self.next();
            hermite(&self.before, state, time, &mut self.sample);
            self.sample.time = time;
            self.sample.prescribe(system);
            self.count += 1;
            observe(self.count, &self.sample)?;
        }
        if is_end {
            self.count += 1;
            return observe(self.count, state);
        }
        if self.next() <= state.time + 2.0 * self.dt {
            self.before.copy_from(state);
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_record_as_asked_and_compare_often_enough() {
        let grid = Grid::new(1.0, 0.01, 10);
        assert_eq!(grid, Grid { spacing: 0.01, recorded: 1, compared: 2 });
        let grid = Grid::new(1.0, 0.25, 10);
        assert_eq!(grid, Grid { spacing: 0.0625, recorded: 4, compared: 1 });
        let grid = Grid::new(2.0, 5.0, 10);
        assert_eq!((grid.spacing, grid.compared), (0.125, 1));
    }

    /// Steps of 0.3 s on a parabola, seen every 0.25 s: cubic polynomials meet it.
    #[test]
    fn states_between_steps_are_interpolated() {
        let mut builder = crate::SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, start) = builder.build().unwrap();
        let at = |time: f64| State {
            time,
            positions: vec![nalgebra::Vector3::new(time * time, 0.0, 0.0)],
            velocities: vec![nalgebra::Vector3::new(2.0 * time, 0.0, 0.0)],
        };
        let mut between = Between::new(0.25, 0.3, &start);
        let mut seen = Vec::new();
        for step in 1..=4 {
            let time = if step == 4 { 1.0 } else { 0.3 * f64::from(step) };
            let flow = between.see(&system, &at(time), 1.0, |number, state| {
                seen.push((number, state.time));
                assert!((state.positions[0].x - state.time * state.time).abs() < 1e-15);
                ControlFlow::Continue(())
            });
            assert!(flow.is_continue());
        }
        assert_eq!(seen, [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0)]);
    }
}
