//! A monitor along a run.

use super::energy_balance::{EnergyBalance, ParticleSums};
use super::work::BodyEnergy;
use super::{Balance, Monitor, MonitorOptions};
use crate::force::{Energy, SpringSums};
use crate::integrate::{Outcome, Schedule, Statistics, Status, StepFailure, TimeStepper, Verlet, run_monitored};
use crate::spring::Spring;
use crate::system::fixtures::row;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// A particle of 2 kg at 1 m/s, which has 1 J, and one that is held.
fn free() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([3.0, 0.0, 0.0], 1.0);
    builder.hold(1);
    let (system, mut state) = builder.build().unwrap();
    state.velocities[0].x = 1.0;
    (system, state)
}

/// The same with another kinetic energy, in J, at a time.
fn with(state: &State, kinetic: f64, time: f64) -> State {
    let mut state = State { time, ..state.clone() };
    state.velocities[0] = Vector3::new(0.0, kinetic.sqrt(), 0.0);
    state
}

/// Three steps with five joules from nowhere end a run, where they are to; the last state from before is put back, with its account.
#[test]
fn energy_from_nowhere_ends_a_run() {
    let (system, start) = free();
    for stops in [true, false] {
        let options = MonitorOptions { stops_unstable: stops, ..MonitorOptions::default() };
        let mut monitor = Monitor::new(&system, &start, options).unwrap();
        let enter = |monitor: &mut Monitor, steps: u64, kinetic| {
            monitor.enter(steps, &with(&start, kinetic, steps as f64), 1.0)
        };
        assert_eq!(enter(&mut monitor, 1, 1.25), Ok(()));
        assert_eq!((monitor.growth(), monitor.last.time), (None, 1.0));
        assert_eq!(enter(&mut monitor, 2, 6.25), Ok(()));
        assert_eq!(monitor.growth().is_some(), stops);
        assert_eq!(enter(&mut monitor, 3, 6.25), Ok(()));
        let last = enter(&mut monitor, 4, 6.25);
        assert_eq!(last.is_err(), stops);
        if let Err(StepFailure::Unstable { gained, exchanged }) = last {
            assert!((gained - 5.25).abs() < 1e-12 && (exchanged - 1.0).abs() < 1e-12, "{gained} {exchanged}");
        }
        let mut state = with(&start, 6.25, 4.0);
        assert_eq!((monitor.restore(&mut state), state), (1, with(&start, 1.25, 1.0)));
        assert!((monitor.energy().total() - 1.25).abs() < 1e-12);
    }
}

/// A state of another system is no state of the run.
#[test]
fn states_of_other_systems_are_refused() {
    let ((system, start), (other, foreign)) = (free(), row(3));
    assert!(Monitor::new(&system, &foreign, MonitorOptions::default()).is_err());
    let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
    let mut stepper = Verlet::new(&other, &foreign).unwrap();
    let mut state = foreign.clone();
    let see = |_: u64, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = run_monitored(&mut stepper, &mut state, &Schedule::steps(0.1, 2), &mut monitor, see);
    assert_eq!(outcome.end.unwrap_err().failure, StepFailure::ForeignState { found: 3, expected: 2 });
}

/// A free particle on a damped spring of 12 N/m that another, which is led, draws along.
fn drawn() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.particle([0.0; 3], 2.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping: 0.7 });
    let motion = Motion::Velocity(Vector3::new(0.3, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    let (system, mut state) = builder.build().unwrap();
    state.time = 2.0;
    state.prescribe(&system);
    state.positions[1] = state.positions[0] - Vector3::x();
    (system, state)
}

/// After a step of h seconds that brings the free particle to a velocity by a steady acceleration.
fn after(system: &System, state: &State, h: f64, v: f64) -> State {
    let mut next = State { time: state.time + h, ..state.clone() };
    next.prescribe(system);
    next.positions[1].x += 0.5 * h * (state.velocities[1].x + v);
    next.velocities[1].x = v;
    next
}

/// Between the ends of a step work and dissipation grow with time, and not beyond them; the end has what it was entered with.
#[test]
fn accounts_between_steps_are_in_proportion_to_time() {
    let (system, start) = drawn();
    let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
    let energy = Energy { kinetic: 1.0, elastic: 2.0, gravitational: 0.0 };
    // Before the first step nothing went anywhere.
    let initial = monitor.initial().total();
    assert_eq!(monitor.balance_between(2.0, &energy), Balance { imbalance: 3.0 - initial, ..Balance::default() });
    let first = after(&system, &start, 0.25, 0.5);
    monitor.enter(1, &first, 0.25).unwrap();
    let before = monitor.balance();
    let second = after(&system, &first, 0.5, 0.25);
    monitor.enter(2, &second, 0.5).unwrap();
    let now = monitor.balance();
    assert!(before.work > 0.1 && now.work > before.work + 0.1);
    assert!(before.dissipated > 1e-3 && now.dissipated > before.dissipated + 1e-3);
    for (time, share) in [(2.25, 0.0), (2.375, 0.25), (2.625, 0.75), (2.75, 1.0), (2.0, 0.0), (3.0, 1.0)] {
        let found = monitor.balance_between(time, &energy);
        let work = before.work + share * (now.work - before.work);
        let dissipated = before.dissipated + share * (now.dissipated - before.dissipated);
        for (found, expected) in
            [(found.work, work), (found.dissipated, dissipated), (found.imbalance, 3.0 - initial - work + dissipated)]
        {
            assert!((found - expected).abs() < 1e-14, "{time}: {found} {expected}");
        }
    }
    assert_eq!(monitor.energy_at(&second), (monitor.energy(), now));
    let between = after(&system, &first, 0.125, 0.4);
    let energy = Energy::of(&system, &between);
    assert_eq!(monitor.energy_at(&between), (energy, monitor.balance_between(2.375, &energy)));
}

/// Doubles the velocities in every step, and fails after some.
struct Doubling {
    steps: u64,
    failing: (u64, StepFailure),
    statistics: Statistics,
}

impl TimeStepper for Doubling {
    fn name(&self) -> &'static str {
        "doubling"
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        if self.steps == self.failing.0 {
            return Err(self.failing.1);
        }
        self.steps += 1;
        state.time += dt;
        state.velocities.iter_mut().for_each(|v| *v *= 2.0);
        Ok(())
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

/// If a step fails while energy grows, growth is the cause, and the state is one from before; else it is the last one.
#[test]
fn failures_of_growing_runs_are_reported_as_growth() {
    let (system, start) = free();
    let run = |failing: (u64, StepFailure), speed: f64| {
        let mut state = start.clone();
        state.velocities[0].x = speed;
        let mut stepper = Doubling { steps: 0, failing, statistics: Statistics::default() };
        let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
        let schedule = Schedule::steps(0.5, 9);
        let see = |_: u64, _: &State, _: &Monitor| ControlFlow::Continue(());
        (run_monitored(&mut stepper, &mut state, &schedule, &mut monitor, see), state)
    };
    let reported = |outcome: &Outcome| {
        let failure = outcome.end.unwrap_err();
        (outcome.steps, failure.step, failure.time, outcome.status())
    };
    // 1, 4 and 16 J: three joules more are not too many, fifteen are.
    let (outcome, state) = run((1, StepFailure::Tolerance), 1.0);
    assert_eq!((reported(&outcome), state.time), ((1, 2, 0.5, Status::NotConverged), 0.5));
    let (outcome, state) = run((2, StepFailure::Tolerance), 1.0);
    assert_eq!((reported(&outcome), state.time), ((0, 3, 1.0, Status::Unstable), 0.0));
    // 64 J are more than twenty times all there was: the third step ends the run itself.
    let (outcome, state) = run((9, StepFailure::Tolerance), 1.0);
    assert_eq!((reported(&outcome), state.time), ((0, 3, 1.0, Status::Unstable), 0.0));
    // Energy that is no number, found at once.
    let (outcome, state) = run((9, StepFailure::Tolerance), 1e154);
    assert_eq!((reported(&outcome), state.time), ((0, 1, 0.0, Status::NonFinite), 0.0));
    // At rest nothing grows.
    let (outcome, state) = run((4, StepFailure::Tolerance), 0.0);
    assert_eq!((reported(&outcome), state.time), ((4, 5, 2.0, Status::NotConverged), 2.0));
}

fn body(kinetic: f64, gravitational: f64) -> BodyEnergy {
    BodyEnergy { kinetic, gravitational }
}

/// Masses of 1 kg and 3 kg at 4 m/s and 0: the centre of mass goes at 1 m/s, and has 2 J of the 8 J where nothing is held.
#[test]
fn the_centre_of_mass_of_a_free_scene_is_known_by_itself() {
    for is_held in [false, true] {
        let mut builder = SystemBuilder::new();
        builder.gravity(0.0, -10.0, 0.0);
        builder.particle([0.0, 1.0, 0.0], 1.0);
        builder.particle([1.0, 2.0, 0.0], 3.0);
        builder.velocities[0] = Vector3::new(4.0, 0.0, 0.0);
        if is_held {
            builder.hold(1);
        }
        let (system, state) = builder.build().unwrap();
        let sums = ParticleSums::at(&system, &state, !is_held);
        assert_eq!(sums.energy, body(8.0, 70.0));
        let free = EnergyBalance::new(&SpringSums::default(), &sums, BodyEnergy::default()).free();
        let expected = if is_held { (8.0, 70.0) } else { (6.0, 0.0) };
        assert_eq!((free.kinetic, free.potential), expected);
        let monitor = Monitor::new(&system, &state, MonitorOptions::ENERGY).unwrap();
        assert_eq!(monitor.indicators(&state).exchanged, expected.0);
    }
}
