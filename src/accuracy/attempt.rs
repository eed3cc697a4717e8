//! One run on the way to an answer: metered, observed, and compared with others by its course.

use super::audience::Audience;
use super::course::{Course, LAST_PART};
use super::metered::{Meter, Metered};
use super::own::Own;
use super::samples::{Between, Grid};
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{
    Adaptivity, Dop853, Method, Monitor, MonitorOptions, Outcome, Sampling, Schedule, Statistics, Status, TimeStepper,
    run_adaptive_monitored, run_equal_monitored, run_monitored, run_steps_monitored, steps_between_kinks,
};
use crate::linear::{CostModel, FactorReport, LinearSolver};
use crate::system::{State, System};
use std::ops::ControlFlow;

/// A motion to be computed.
pub(super) struct Task<'a> {
    pub system: &'a System,
    pub start: &'a State,
    pub duration: f64,
    pub costs: CostModel,
    pub grid: Grid,
    pub go_on: &'a dyn Fn() -> bool,
}

impl Task<'_> {
    /// When prescribed paths bend on the way, in s.
    pub fn kinks(&self) -> impl Iterator<Item = f64> {
        let (prescribed, start) = (self.system.prescribed(), self.start.time);
        let kinks = std::iter::successors(prescribed.next_kink(start), |kink| prescribed.next_kink(*kink));
        kinks.take_while(move |kink| *kink < start + self.duration)
    }

    /// Whether a prescribed path bends on the way.
    pub fn has_kinks(&self) -> bool {
        self.kinks().next().is_some()
    }
}

/// What a run is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// To be the answer, perhaps: what is recorded of it is as exact as its steps.
    Answer,
    /// To compare the next one with, by the last part of its way. What the method takes to tell states between its steps it is spared before that.
    Comparison,
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
    /// How many springs have passed the length zero on a straight line.
    pub reversed: usize,
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
    /// What steps have estimated of their errors, added up, in m.
    pub local_errors: f64,
    /// The amplitude of what the energy that appeared or vanished would be in vibrations of one radian a step, relative to the extent.
    pub strayed: f64,
    /// What the run says of its error.
    pub own: Own,
}

/// How far the ends of a spring get past each other in a step at least, in its lengths, in a run in which they pass each other on a line: half of
/// what they move then is longer than what is left between them, at one end of the step.
const PASSING: f64 = 0.1;

/// Runs a configuration as far as `limit` force evaluations go. No step of the runs that this one is compared with is above `longest`, in s.
pub(super) fn attempt<A: Audience>(
    task: &Task<'_>,
    configuration: Configuration,
    pace: Pace,
    purpose: Purpose,
    [limit, longest]: [f64; 2],
    audience: &mut A,
    progress: &mut dyn FnMut(&mut A, f64, f64),
) -> Result<Tried<A::Records>> {
    let Configuration { method, options } = &configuration;
    let Task { system, start, duration, grid, .. } = *task;
    let mut state = start.clone();
    // A run that blows up shows in the comparison with another.
    let paths = *method == Method::Bdf2;
    let options_of_monitor = MonitorOptions { stops_unstable: false, paths, ..MonitorOptions::LEDGER };
    let mut monitor = Monitor::new(system, &state, options_of_monitor)?;
    let meter = Meter::new(task.costs, limit, task.go_on);
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
        // Its long steps need its own interpolant.
        Pace::Step(dt) if *method == Method::Dop853 => {
            let mut stepper = Box::new(Dop853::new(system, start)?);
            let exact_from = match purpose {
                Purpose::Answer => f64::NEG_INFINITY,
                Purpose::Comparison => start.time + (1.0 - LAST_PART) * duration,
            };
            let mut metered = Metered { stepper: &mut *stepper, meter: &meter, exact_from };
            let sampling = Sampling::Every(grid.spacing);
            let see = |number, state: &State, monitor: &Monitor| watch.see(number, state, monitor);
            let lengths = [dt, longest, duration];
            let outcome = run_equal_monitored(&mut metered, system, &mut state, lengths, sampling, &mut monitor, see);
            (outcome, stepper)
        }
        Pace::Step(dt) => {
            let mut stepper = method.stepper(system, start, options)?;
            let mut metered = Metered::exact(&mut *stepper, &meter);
            let mut between = Between::new(grid.spacing, dt, start);
            let see = |_, state: &State, monitor: &Monitor| {
                between.see(system, state, watch.end, |number, sample| watch.see(number, sample, monitor))
            };
            let outcome = if task.has_kinks() {
                let span = [start.time, start.time + duration];
                let steps = steps_between_kinks(system.prescribed(), span, [dt, longest]);
                run_steps_monitored(&mut metered, &mut state, steps, &mut monitor, see)
            } else {
                run_monitored(&mut metered, &mut state, &Schedule::duration(dt, duration), &mut monitor, see)
            };
            (outcome, stepper)
        }
        Pace::Adaptive { rtol, first_step } => {
            let mut stepper = method.adaptive_stepper(system, start, options)?.ok_or_else(|| {
                crate::Error::Unsupported(format!("{} has no error estimate for adaptive steps", method.name()))
            })?;
            let how = Adaptivity { duration, rtol, first_step, sampling: Sampling::Every(grid.spacing), part_of: None };
            let mut metered = Metered::exact(&mut *stepper, &meter);
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
    let figures = monitor.figures(&state);
    let strayed = (figures.lost_way + figures.gained_way) / figures.steps.max(1) as f64;
    let status = if interrupted { Status::Interrupted } else { outcome.status() };
    let passes = figures.reach > PASSING;
    let reversed = if passes { course.reversed(system.pairs(), &start.positions) } else { 0 };
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
        reversed,
        records,
    });
    let is_too_expensive = meter.has_refused() && !interrupted;
    let (local_errors, own) = (meter.local_errors(), Own::of(&figures, *method));
    Ok(Tried { attempt, status, cost, is_too_expensive, local_errors, strayed, own })
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
        (self.progress)(self.audience, part, self.meter.spent());
        let stops = self.failed.is_some() || self.meter.is_over();
        if stops { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::price::of;
    use crate::system::fixtures::oscillator;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;

    /// A path bends at 1 s, 2 s and 4 s. From 0.5 s on a motion of half a second does not come to the first, nor one from the last on to any.
    #[test]
    fn kinks_count_where_the_motion_passes_them() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        let offsets = [0.0, 1.0, 0.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![1.0, 2.0, 4.0], offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, state) = &builder.build().unwrap();
        let grid = Grid::new(1.0, 0.5, 2);
        for (time, duration, expected) in [
            (0.5, 0.5, false),
            (0.5, 0.75, true),
            (2.0, 1.0, false),
            (2.0, 2.0, false),
            (2.0, 2.5, true),
            (4.0, 9.0, false),
        ] {
            let start = &State { time, ..state.clone() };
            let task = Task { system, start, duration, costs: CostModel::of(system), grid, go_on: &|| true };
            assert_eq!(task.has_kinks(), expected, "{time} {duration}");
        }
    }

    /// Eight steps of DOP853, seen twice in each. A run to compare with is as exact in the two steps of the last quarter, to the bit, and is
    /// spared the three evaluations of the interpolant in the six before, in which a cubic polynomial takes its place.
    #[test]
    fn runs_to_compare_with_are_exact_where_they_are_compared() {
        let (system, start) = &oscillator();
        let go_on = || true;
        let grid = Grid::new(4.0, 0.25, 2);
        let task = Task { system, start, duration: 4.0, costs: CostModel::of(system), grid, go_on: &go_on };
        let [answer, comparison] = [Purpose::Answer, Purpose::Comparison].map(|purpose| {
            let bounds = [f64::INFINITY, 0.5];
            let tried =
                attempt(&task, of(Method::Dop853), Pace::Step(0.5), purpose, bounds, &mut (), &mut |_, _, _| {});
            tried.unwrap().attempt.unwrap()
        });
        let spared = answer.statistics.work.force_evaluations - comparison.statistics.work.force_evaluations;
        assert_eq!((answer.steps, spared), (8, 18));
        assert_eq!(answer.state, comparison.state);
        let difference = answer.course.compared_with(&comparison.course, &start.positions);
        assert_eq!((difference.envelope(), difference.first_beyond(0.0)), (0.0, Some(0.25)));
        assert!(difference.largest() < 1e-3, "{difference:?}");
    }

    /// Twenty steps of a vibration: what appeared and vanished of its energy counts by its amplitude, for one step.
    #[test]
    fn runs_stray_by_what_appears_and_vanishes_in_a_step() {
        let (system, start) = &oscillator();
        let go_on = || true;
        let grid = Grid::new(4.0, 0.5, 2);
        let task = Task { system, start, duration: 4.0, costs: CostModel::of(system), grid, go_on: &go_on };
        for (method, loses, gains) in [(Method::BackwardEuler, true, false), (Method::ForwardEuler, false, true)] {
            let tried = attempt(
                &task,
                of(method),
                Pace::Step(0.2),
                Purpose::Answer,
                [f64::INFINITY, 0.2],
                &mut (),
                &mut |_, _, _| {},
            )
            .unwrap();
            let mut state = start.clone();
            let mut monitor = Monitor::new(system, &state, MonitorOptions::default()).unwrap();
            let mut stepper = method.stepper(system, &state, &Default::default()).unwrap();
            for step in 1..=20 {
                stepper.step(&mut state, 0.2).unwrap();
                monitor.enter(step, &state, 0.2, None).unwrap();
            }
            let figures = monitor.figures(&state);
            assert_eq!((figures.lost_way > 0.1, figures.gained_way > 0.1), (loses, gains), "{}", method.name());
            let expected = (figures.lost_way + figures.gained_way) / 20.0;
            assert!((tried.strayed / expected - 1.0).abs() < 1e-9, "{}: {:e}", method.name(), tried.strayed);
        }
    }
}
