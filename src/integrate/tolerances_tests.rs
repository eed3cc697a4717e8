//! How exactly conjugate gradients solve the equations of steps: to a ten-thousandth of what the step before was wrong by.

use super::oscillator::{Oscillator, Way};
use super::{AdaptiveStepper, Bdf2, ImplicitOptions, LinearBackwardEuler, Rodas4, TimeStepper};
use crate::linear::{SolverChoice, SolverOptions, Tolerance};

/// Of the oscillator along its spring: its mass, in kg, and `m/τ² + b/τ + κ`.
const MASS: f64 = 2.0;
const DAMPING: f64 = 0.8;

fn matrix(tau: f64) -> f64 {
    MASS / (tau * tau) + DAMPING / tau + 12.0
}

/// `10⁻⁴ ‖E‖_M √m/τ²` over the right-hand side of a displacement or a correction, as an error E of the step before asks for it.
fn asked(error: f64, tau: f64, solved: f64) -> f64 {
    (1e-4 * MASS.sqrt() * error.abs() * MASS.sqrt() / (tau * tau) / (matrix(tau) * solved.abs())).min(1e-4)
}

fn options() -> ImplicitOptions {
    let linear = SolverOptions { solver: SolverChoice::Cg, tolerance: Tolerance::Adaptive, ..SolverOptions::default() };
    ImplicitOptions::default().with_linear(linear)
}

/// E = ½ h (v' − v) of the step before.
#[test]
fn linearised_backward_euler_solves_as_its_error_asks() {
    let oscillator = Oscillator::new(Way::Along, DAMPING, 1.05);
    let h = 0.25;
    let mut state = oscillator.start.clone();
    let mut stepper = LinearBackwardEuler::new(&oscillator.system, &state, &options()).unwrap();
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
            expected = expected.max(asked(error, h, moved));
            assert!((found / expected - 1.0).abs() < 1e-3 && expected < 1e-4, "{found:e} {expected:e}");
        }
        error = 0.5 * (moved - before.velocities[1].x * h);
    }
}

/// E = ⅓ τ (v' − v_predicted) of the step before, and a correction of what was predicted.
#[test]
fn bdf2_solves_as_its_error_asks() {
    let oscillator = Oscillator::new(Way::Along, DAMPING, 1.05);
    let mut states = vec![oscillator.start.clone()];
    let mut stepper = Bdf2::new(&oscillator.system, &states[0], &options()).unwrap();
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
        // The first step is one of another kind, and its error asks for no more than the least there is.
        let expected = if number == 0 { 1e-7 } else { asked(error, tau, next.positions[1].x - predicted) };
        assert!((found / expected - 1.0).abs() < 1e-3, "{number}: {found:e} {expected:e}");
        assert_eq!(expected < 1e-4, number != 1, "{number}: {expected:e}");
        error = tau / 3.0 * (next.velocities[1].x - v - ratio * change);
        states.push(next);
        last = h;
    }
}

/// The first step is solved to the last digit, and the second knows what it is worth.
#[test]
fn rodas4_learns_from_its_first_step() {
    let oscillator = Oscillator::new(Way::Along, DAMPING, 1.05);
    let mut state = oscillator.start.clone();
    let mut stepper = Rodas4::new(&oscillator.system, &state, &options()).unwrap();
    stepper.step(&mut state, 0.25).unwrap();
    let first = stepper.statistics().max_tolerance;
    stepper.step(&mut state, 0.25).unwrap();
    let second = stepper.statistics().max_tolerance;
    assert!(first > 0.0 && first < 1e-9 && (1e-9..=1e-4).contains(&second), "{first:e} {second:e}");
}
