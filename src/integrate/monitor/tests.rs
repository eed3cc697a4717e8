//! A monitor along a run.

use super::work::BodyEnergy;
use super::*;
use crate::force::SpringSums;
use crate::integrate::fixtures::{monitored, scene};
use crate::integrate::{RunFailure, Schedule, Statistics, Status, Verlet};
use crate::system::fixtures::row;
use crate::system::{Axes, Constraint, Motion};
use nalgebra::Vector3;

/// A particle of 2 kg at 1 m/s, which has 1 J, and one that is held.
fn free() -> (System, State) {
    let mut builder = scene(&[([0.0; 3], 2.0), ([3.0, 0.0, 0.0], 1.0)], &[]);
    let (system, mut state) = builder.hold(1).clone().build().unwrap();
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
    let (mut stepper, mut state) = (Verlet::new(&other, &foreign).unwrap(), foreign);
    stepper.step_seen(&mut state, 0.1, monitor.springs()).unwrap();
    assert_eq!(monitor.enter(1, &state, 0.1), Err(StepFailure::ForeignState { found: 3, expected: 2 }));
}

/// A free particle on a damped spring of 12 N/m that another, which is led, draws along.
fn drawn() -> (System, State) {
    let mut builder = scene(&[([1.0, 0.0, 0.0], 3.0), ([0.0; 3], 2.0)], &[(0, 1, [6.0, 0.5, 0.7])]);
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
    failing: u64,
    statistics: Statistics,
}

impl TimeStepper for Doubling {
    fn name(&self) -> &'static str {
        "doubling"
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        if self.steps == self.failing {
            return Err(StepFailure::Tolerance);
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
    for (failing, speed, steps, [step, end], status) in [
        // 1, 4 and 16 J: three joules more are not too many, fifteen are.
        (1, 1.0, 1, [2, 1], Status::NotConverged),
        (2, 1.0, 0, [3, 0], Status::Unstable),
        // 64 J are more than twenty times all there was: the third step ends the run itself.
        (9, 1.0, 0, [3, 0], Status::Unstable),
        // Energy that is no number, found at once.
        (9, 1e154, 0, [1, 0], Status::NonFinite),
        // At rest nothing grows.
        (4, 0.0, 4, [5, 4], Status::NotConverged),
    ] {
        let mut scene = (system.clone(), start.clone());
        scene.1.velocities[0].x = speed;
        let mut stepper = Doubling { steps: 0, failing, statistics: Statistics::default() };
        let options = MonitorOptions::default();
        let (outcome, state, _) = monitored(&scene, &mut stepper, options, Schedule::steps(0.5, 9));
        let RunFailure { step: found, time, .. } = outcome.end.unwrap_err();
        assert_eq!((outcome.steps, found, outcome.status()), (steps, step, status), "{failing} {speed}");
        assert_eq!([time, state.time], [step - 1, end].map(|steps| 0.5 * steps as f64), "{failing} {speed}");
    }
}

/// Masses of 1 kg and 3 kg at 4 m/s and 0: the centre of mass goes at 1 m/s, and has 2 J of the 8 J where nothing is held.
#[test]
fn the_centre_of_mass_of_a_free_scene_is_known_by_itself() {
    for is_held in [false, true] {
        let mut builder = scene(&[([0.0, 1.0, 0.0], 1.0), ([1.0, 2.0, 0.0], 3.0)], &[]);
        builder.gravity(0.0, -10.0, 0.0);
        builder.velocities[0] = Vector3::new(4.0, 0.0, 0.0);
        if is_held {
            builder.hold(1);
        }
        let (system, state) = builder.build().unwrap();
        let sums = ParticleSums::at(&system, &state, !is_held);
        assert_eq!(sums.energy, BodyEnergy { kinetic: 8.0, gravitational: 70.0 });
        let free = EnergyBalance::new(&SpringSums::default(), &sums, BodyEnergy::default()).free();
        let expected = if is_held { (8.0, 70.0) } else { (6.0, 0.0) };
        assert_eq!((free.kinetic, free.potential), expected);
        let monitor = Monitor::new(&system, &state, MonitorOptions::ENERGY).unwrap();
        assert_eq!(monitor.indicators(&state).exchanged, expected.0);
    }
}
