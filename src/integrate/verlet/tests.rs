use super::Verlet;
use crate::error::DegenerateSpring;
use crate::integrate::substeps::drawn_with_jerks;
use crate::integrate::{Monitor, MonitorOptions, SpringVisitor, StepFailure, TimeStepper};
use crate::spring::{Spring, SpringLaw, Tension};
use crate::system::{State, StateView, System, SystemBuilder};
use nalgebra::Vector3;

/// A particle on a spring along the first axis, of this frequency and damping ratio, away from rest by 0.1 m.
fn oscillator(frequency: f64, ratio: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.1, 0.0, 0.0], 1.0);
    builder.hold(0);
    let stiffness = 2.0 * frequency * frequency;
    builder.spring(0, 1, Spring { stiffness, rest_length: 2.0, damping: 2.0 * ratio * frequency });
    builder.build().unwrap()
}

/// A step by hand: κ = 5 N/m and b = 2 N·s/m on 1 kg, from x = 0.1 m and v = −0.3 m/s, h = 0.2 s.
#[test]
fn a_step_is_the_one_of_the_formulas() {
    let (system, mut state) = oscillator(5f64.sqrt(), 1.0 / 5f64.sqrt());
    state.velocities[1].x = -0.3;
    let mut stepper = Verlet::new(&system, &state).unwrap();
    let (mut x, mut v) = (0.1, -0.3);
    let force = |x: f64, v: f64| -5.0 * x - 2.0 * v;
    let (mut a, h) = (force(x, v), 0.2);
    for _ in 0..3 {
        let half = v + 0.5 * h * a;
        x += h * half;
        let b = force(x, v + h * a);
        (v, a) = (half + 0.5 * h * b, b);
        stepper.step(&mut state, h).unwrap();
        assert!((state.positions[1].x - 2.0 - x).abs() < 1e-14 && (state.velocities[1].x - v).abs() < 1e-14);
    }
    assert_eq!(stepper.statistics().work.force_evaluations, 4);
}

/// Just below `hω = 2(√(1 + 4ζ²) − 2ζ)` motions stay bounded, just above they grow.
#[test]
fn stability_has_its_limit() {
    for ratio in [0.0, 0.05, 0.25, 0.5, 1.0, 2.0f64] {
        let limit = 2.0 * ((1.0 + 4.0 * ratio * ratio).sqrt() - 2.0 * ratio);
        for (part, is_stable) in [(0.98, true), (1.02, false)] {
            let (system, mut state) = oscillator(10.0, ratio);
            state.positions[1].x = 2.0 + 1e-9;
            let mut stepper = Verlet::new(&system, &state).unwrap();
            let mut largest = 0.0f64;
            for _ in 0..1000 {
                stepper.step(&mut state, part * limit / 10.0).unwrap();
                largest = largest.max((state.positions[1].x - 2.0).abs());
                if largest > 1e-6 {
                    break;
                }
            }
            assert_eq!(largest < 1e-6, is_stable, "{ratio} {part}: {largest:e}");
        }
    }
}

/// A force is kept for the next step, but not where the state has been changed in between, in place or in speed, nor over
/// a step that failed, nor past a kink.
#[test]
fn forces_are_kept_as_long_as_they_are_right() {
    let (system, start) = oscillator(3.0, 0.2);
    let mut stepper = Verlet::new(&system, &start).unwrap();
    let mut state = start.clone();
    let mut evaluations = 0;
    let mut step = |state: &mut State, stepper: &mut Verlet, dt: f64, expected: u64| {
        let mut afresh = state.clone();
        let outcome = stepper.step(state, dt);
        evaluations += expected;
        assert_eq!(stepper.statistics().work.force_evaluations, evaluations);
        if outcome.is_ok() {
            Verlet::new(&system, state).unwrap().step(&mut afresh, dt).unwrap();
            assert!((afresh.positions[1] - state.positions[1]).norm() < 1e-4, "{afresh:?} {state:?}");
        }
        outcome
    };
    step(&mut state, &mut stepper, 0.01, 2).unwrap();
    step(&mut state, &mut stepper, 0.01, 1).unwrap();
    step(&mut state, &mut stepper, 0.02, 1).unwrap();
    state.velocities[1].x += 0.5;
    step(&mut state, &mut stepper, 0.01, 2).unwrap();
    state.positions[1].x += 0.1;
    step(&mut state, &mut stepper, 0.01, 2).unwrap();
    stepper.restart();
    step(&mut state, &mut stepper, 0.01, 2).unwrap();
    let before = state.clone();
    assert_eq!(step(&mut state, &mut stepper, 1e300, 1), Err(StepFailure::NonFinite));
    assert_eq!(state, before);
    step(&mut state, &mut stepper, 0.01, 2).unwrap();
}

/// A damped particle drawn by another that starts, turns and stops with jerks: with steps that end at the kinks as with steps
/// that are cut there, to the bit the same.
#[test]
fn steps_are_cut_at_kinks() {
    let (system, start) = drawn_with_jerks();
    let run = |steps: &[f64]| {
        let mut state = start.clone();
        let mut stepper = Verlet::new(&system, &state).unwrap();
        steps.iter().for_each(|&h| stepper.step(&mut state, h).unwrap());
        (state, stepper.statistics().work.force_evaluations)
    };
    let (cut, forces) = run(&[0.125, 0.25, 0.25, 0.25]);
    assert_eq!(run(&[0.125; 7]), (cut.clone(), forces));
    // One for each of seven pieces, one at the start and one after each of three kinks.
    assert_eq!(forces, 7 + 1 + 3);
    assert_eq!(cut.positions[0], Vector3::new(0.25, 0.0, 0.0));
    assert_eq!(cut.velocities[0], Vector3::zeros());
}

/// Pulls by a newton, whatever the length.
#[derive(Debug)]
struct Steady;

impl SpringLaw for Steady {
    fn tension(&self, _: usize, _: &Spring, _: f64) -> Tension {
        Tension { force: 1.0, slope: 0.5 }
    }

    fn energy(&self, _: usize, _: &Spring, length: f64) -> f64 {
        length
    }
}

/// Whoever watches changes nothing, even where it cannot compute the forces.
#[test]
fn steps_are_the_same_when_they_are_seen() {
    let (system, start) = oscillator(5.0, 0.1);
    for system in [system.clone(), system.with_spring_law(Steady)] {
        let (mut seen, mut alone) = (start.clone(), start.clone());
        let mut steppers = [(); 2].map(|()| Verlet::new(&system, &start).unwrap());
        let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
        for steps in 1..=3 {
            steppers[0].step_seen(&mut seen, 0.01, monitor.springs()).unwrap();
            monitor.enter(steps, &seen, 0.01).unwrap();
            steppers[1].step(&mut alone, 0.01).unwrap();
        }
        assert_eq!(seen, alone);
    }
}

/// Counts what it sees.
struct Count(u32);

impl SpringVisitor for Count {
    fn computes_forces(&self, _: &System) -> bool {
        false
    }

    fn set_force(&mut self, _: &StateView<'_>, _: f64, _: &mut [Vector3<f64>]) -> Result<(), DegenerateSpring> {
        unreachable!("it cannot compute forces")
    }

    fn see(&mut self, _: &StateView<'_>, dt: f64) {
        assert_eq!(dt, 0.5);
        self.0 += 1;
    }
}

/// However many pieces a step is cut into, who watches sees its end alone, with the length of the whole.
#[test]
fn a_step_is_seen_once() {
    let (system, mut state) = drawn_with_jerks();
    let (mut stepper, mut count) = (Verlet::new(&system, &state).unwrap(), Count(0));
    for steps in 1..=2 {
        stepper.step_seen(&mut state, 0.5, &mut count).unwrap();
        assert_eq!(count.0, steps);
    }
    assert!(stepper.statistics().work.force_evaluations > 4);
}

/// Keeps when it was asked to look, and over how long a step.
#[derive(Default)]
struct Looks(Vec<[f64; 2]>);

impl SpringVisitor for Looks {
    fn computes_forces(&self, _: &System) -> bool {
        false
    }

    fn set_force(&mut self, _: &StateView<'_>, _: f64, _: &mut [Vector3<f64>]) -> Result<(), DegenerateSpring> {
        Ok(())
    }

    fn see(&mut self, at: &StateView<'_>, dt: f64) {
        self.0.push([at.time, dt]);
    }
}

/// Wherever a step is cut, its end is what is looked at.
#[test]
fn steps_are_seen_once() {
    let (system, mut state) = drawn_with_jerks();
    let mut stepper = Verlet::new(&system, &state).unwrap();
    let mut looks = Looks::default();
    stepper.step_seen(&mut state, 0.875, &mut looks).unwrap();
    assert_eq!(looks.0, [[0.875; 2]]);
    assert!(stepper.statistics().work.force_evaluations > 4);
}
