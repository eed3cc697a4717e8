//! Steps of methods against their formulas, worked out for an oscillator.

use super::fixtures::{OscillationAxis, Oscillator};
use super::{AdaptiveStepper, Bdf2, ImplicitOptions, LinearBackwardEuler, Method, TimeStepper, WMethod};
use crate::linear::{SolverChoice, SolverOptions};
use crate::system::{ExternalForce, StateView, SystemBuilder};
use nalgebra::Vector3;

const OPTIONS: [(OscillationAxis, f64, f64); 3] =
    [(OscillationAxis::Along, 0.8, 1e-9), (OscillationAxis::Along, 0.0, 1e-9), (OscillationAxis::Across, 0.8, 1e-6)];

/// `x' = x̃ + τ v'`, `v' = ṽ + τ a(x', v')` from two states, with steps of three lengths.
#[test]
fn bdf2_goes_on_from_two_states() {
    for (way, damping, tolerance) in OPTIONS {
        let oscillator = Oscillator::new(way, damping, 1.05);
        let Oscillator { system, start, lambda, .. } = &oscillator;
        let (rate, square) = (-2.0 * lambda.re, lambda.norm_sqr());
        let scale = oscillator.amplitude(start).norm();
        let mut stepper = Bdf2::new(system, start, &ImplicitOptions::default()).unwrap();
        let (mut states, mut last) = (vec![start.clone()], 0.0);
        for (number, h) in [0.3, 0.2, 0.25].into_iter().enumerate() {
            let state = &states[number];
            let [x, v] = oscillator.seen(state);
            let [x0, v0] = oscillator.seen(&states[number.saturating_sub(1)]);
            let ratio = if last > 0.0 { h / last } else { 0.0 };
            let (beta, tau) = (ratio * ratio / (1.0 + 2.0 * ratio), h * (1.0 + ratio) / (1.0 + 2.0 * ratio));
            let (x1, v1) = (x + beta * (x - x0), v + beta * (v - v0));
            // v' = ṽ − τ (ω₀² (x̃ + τ v') + 2ρ v').
            let v2 = (v1 - tau * square * x1) / (1.0 + tau * (tau * square + rate));
            let x2 = x1 + tau * v2;
            let before = stepper.statistics().work;
            stepper.try_step(state, h).unwrap();
            let work = stepper.statistics().work;
            // A start has the accelerations too; then there is one correction, and the force before and after it.
            let forces = if number == 0 { 3 } else { 2 };
            assert_eq!((work.solves - before.solves, work.force_evaluations - before.force_evaluations), (1, forces));
            assert_eq!((stepper.order(), stepper.estimate_order()), (2, if number == 0 { 1 } else { 2 }));
            let mut next = state.clone();
            stepper.accept(&mut next);
            let [x, v] = oscillator.seen(&next);
            let is_near = |a: f64, b: f64| (a - b).abs() < tolerance * scale;
            assert!(is_near(x, x2) && is_near(v, v2), "{way:?} {number}: {x} {x2} {v} {v2}");
            states.push(next);
            last = h;
        }
        // Without its past the method starts with a step of backward Euler again.
        stepper.restart();
        let state = states.last().unwrap();
        let mut next = state.clone();
        stepper.step(&mut next, 0.125).unwrap();
        let expected = oscillator.motion(oscillator.amplitude(state) / (-lambda * 0.125 + 1.0));
        let found = oscillator.seen(&next);
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < tolerance * scale),
            "{way:?} {found:?} {expected:?}"
        );
        // After steps without an estimate the past says nothing about errors.
        stepper.try_step(&next, 0.0625).unwrap();
        assert_eq!(stepper.estimate_order(), 1);
    }
}

/// Grows with time: two newtons and three more a second.
#[derive(Debug)]
struct Growing;

impl ExternalForce for Growing {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().for_each(|f| f.x += 2.0 + 3.0 * at.time);
    }
}

/// A free particle of 4 kg gets the force at the start of a step, at its middle or at its end.
#[test]
fn external_forces_act_at_the_time_of_the_stage() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 4.0);
    let (system, mut start) = builder.build().unwrap();
    let system = system.with_external_force(Growing);
    start.time = 1.25;
    for (method, time) in [
        (Method::LinearBackwardEuler, 1.25),
        (Method::ForwardEuler, 1.25),
        (Method::W2, 1.5),
        (Method::ImplicitMidpoint, 1.5),
        (Method::BackwardEuler, 1.75),
        (Method::Bdf2, 1.75),
    ] {
        let mut stepper = method.stepper(&system, &start, &ImplicitOptions::default()).unwrap();
        let mut state = start.clone();
        stepper.step(&mut state, 0.5).unwrap();
        let expected = 0.5 * (2.0 + 3.0 * time) / 4.0;
        assert!((state.velocities[0].x - expected).abs() < 1e-9, "{}: {}", method.name(), state.velocities[0].x);
    }
    assert!(Method::Rodas4.stepper(&system, &start, &ImplicitOptions::default()).is_err());
}

/// Drag that takes a particle's velocity within a second.
#[derive(Debug)]
struct Air;

impl ExternalForce for Air {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().zip(at.velocities).for_each(|(f, v)| *f -= v * 4.0);
    }
}

/// Verlet's method predicts velocities for drag without dampers too: half of the velocity is left after half a second, which
/// takes an eighth from the three quarters in the middle. Where the step is halved the error falls to a quarter.
#[test]
fn verlet_predicts_the_velocity_that_external_forces_see() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 4.0);
    let (system, mut state) = builder.build().unwrap();
    let system = system.with_external_force(Air);
    state.velocities[0].x = 1.0;
    let run = |steps: u32| {
        let mut state = state.clone();
        let mut stepper = Method::Verlet.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
        (0..steps).for_each(|_| stepper.step(&mut state, 0.5 / f64::from(steps)).unwrap());
        (state.velocities[0].x, state.positions[0].x)
    };
    assert_eq!(run(1), (0.75 - 0.125, 0.5 * 0.75));
    let errors = [8, 16, 32].map(|steps| run(steps).0 - (-0.5f64).exp());
    assert!(errors.windows(2).all(|pair| (3.5..4.5).contains(&(pair[0] / pair[1]))), "{errors:?}");
}

/// Up to six steps of one length share a matrix, but none after a rejected step or one of another length.
#[test]
fn w2_reuses_its_matrix() {
    let oscillator = Oscillator::new(OscillationAxis::Along, 0.8, 1.05);
    let Oscillator { system, start, .. } = &oscillator;
    let mut stepper = WMethod::new(system, start, &ImplicitOptions::default()).unwrap();
    let mut state = start.clone();
    let mut factorizations = |stepper: &mut WMethod, h: f64, accepts: bool| {
        stepper.try_step(&state, h).unwrap();
        if accepts {
            stepper.accept(&mut state);
        } else {
            stepper.reject();
        }
        stepper.statistics().work.factorizations
    };
    let counts: Vec<u64> = (0..14).map(|_| factorizations(&mut stepper, 0.0625, true)).collect();
    assert_eq!(counts, [1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 3, 3]);
    assert_eq!(factorizations(&mut stepper, 0.03125, false), 4);
    assert_eq!(factorizations(&mut stepper, 0.03125, true), 5);
    assert_eq!(factorizations(&mut stepper, 0.03125, true), 5);
}

/// The oscillator along its spring, solved by conjugate gradients to a ten-thousandth of the last step's error: its mass, in kg, damping,
/// and `m/τ² + b/τ + κ`.
const MASS: f64 = 2.0;
const DAMPING: f64 = 0.8;

fn matrix(tau: f64) -> f64 {
    MASS / (tau * tau) + DAMPING / tau + 12.0
}

/// `10⁻⁴ ‖E‖_M √m/τ²` over the right-hand side of a displacement or a correction, for the error E of the last step.
fn tolerance(error: f64, tau: f64, solved: f64) -> f64 {
    (1e-4 * MASS.sqrt() * error.abs() * MASS.sqrt() / (tau * tau) / (matrix(tau) * solved.abs())).min(1e-4)
}

fn conjugate_gradients() -> ImplicitOptions {
    let options = ImplicitOptions::default();
    options.with_linear(SolverOptions { solver: SolverChoice::Cg, ..options.linear })
}

/// E = ½ h (v' − v) of the last step.
#[test]
fn linearised_backward_euler_solves_to_its_error() {
    let oscillator = Oscillator::new(OscillationAxis::Along, DAMPING, 1.05);
    let h = 0.25;
    let mut state = oscillator.start.clone();
    let mut stepper = LinearBackwardEuler::new(&oscillator.system, &state, &conjugate_gradients()).unwrap();
    let mut error = 0.0;
    let mut expected = 0.0f64;
    for step in 0..3 {
        let before = state.clone();
        stepper.step(&mut state, h).unwrap();
        let moved = state.positions[1].x - before.positions[1].x;
        let found = stepper.statistics().max_tolerance;
        if step == 0 {
            assert!(found > 0.0 && found < 1e-9, "{found:e}");
        } else {
            expected = expected.max(tolerance(error, h, moved));
            assert!((found / expected - 1.0).abs() < 1e-3 && expected < 1e-4, "{found:e} {expected:e}");
        }
        error = 0.5 * (moved - before.velocities[1].x * h);
    }
}

/// E = ⅓ τ (v' − v_predicted) of the last step, and a correction of the prediction.
#[test]
fn bdf2_solves_to_its_error() {
    let oscillator = Oscillator::new(OscillationAxis::Along, DAMPING, 1.05);
    let mut states = vec![oscillator.start.clone()];
    let mut stepper = Bdf2::new(&oscillator.system, &states[0], &conjugate_gradients()).unwrap();
    let (mut error, mut last) = (0.0, 0.0);
    for (number, h) in [0.25, 0.25, 0.2, 0.15].into_iter().enumerate() {
        let (state, before) = (states[number].clone(), states[number.saturating_sub(1)].clone());
        let mut next = state.clone();
        stepper.statistics_mut().max_tolerance = 0.0;
        stepper.step(&mut next, h).unwrap();
        let ratio = if last > 0.0 { h / last } else { 0.0 };
        let tau = h * (1.0 + ratio) / (1.0 + 2.0 * ratio);
        let (v, change) = (state.velocities[1].x, state.velocities[1].x - before.velocities[1].x);
        let predicted = state.positions[1].x + h * (v + 0.5 * ratio * change);
        let found = stepper.statistics().max_tolerance;
        // The first step is one of backward Euler, solved to the floor of corrections.
        let expected = if number == 0 { 1e-7 } else { tolerance(error, tau, next.positions[1].x - predicted) };
        assert!((found / expected - 1.0).abs() < 1e-3, "{number}: {found:e} {expected:e}");
        assert_eq!(expected < 1e-4, number != 1, "{number}: {expected:e}");
        error = tau / 3.0 * (next.velocities[1].x - v - ratio * change);
        states.push(next);
        last = h;
    }
}
