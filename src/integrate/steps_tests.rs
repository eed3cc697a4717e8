//! Steps of methods against their formulas.

use super::fixtures::{scene, stepper};
use super::*;
use crate::linear::SolverChoice;
use crate::spring::Spring;
use crate::system::fixtures::{pulled_with_kinks, tethered};
use crate::system::{ExternalForce, StateView};

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
    let (system, mut start) = scene(&[([0.0; 3], 4.0)], &[]).build().unwrap();
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
        let mut state = start.clone();
        stepper(method, &system, &start).step(&mut state, 0.5).unwrap();
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
    let (system, mut state) = scene(&[([0.0; 3], 4.0)], &[]).build().unwrap();
    let system = system.with_external_force(Air);
    state.velocities[0].x = 1.0;
    let run = |steps: u32| {
        let mut state = state.clone();
        let mut stepper = stepper(Method::Verlet, &system, &state);
        (0..steps).for_each(|_| stepper.step(&mut state, 0.5 / f64::from(steps)).unwrap());
        (state.velocities[0].x, state.positions[0].x)
    };
    assert_eq!(run(1), (0.75 - 0.125, 0.5 * 0.75));
    let errors = [8, 16, 32].map(|steps| run(steps).0 - (-0.5f64).exp());
    assert!(errors.windows(2).all(|pair| (3.5..4.5).contains(&(pair[0] / pair[1]))), "{errors:?}");
}

/// Steps that end at kinks and steps that are cut there give the same bits. Verlet's method has one force evaluation for each of seven substeps, one
/// at the start and one after each of three kinks.
#[test]
fn explicit_steps_are_cut_at_kinks() {
    let (system, start) = pulled_with_kinks();
    for (method, forces) in [(Method::Verlet, 7 + 1 + 3), (Method::Dop853, 7 * 12)] {
        let run = |steps: &[f64]| {
            let mut state = start.clone();
            let mut stepper = stepper(method, &system, &state);
            steps.iter().for_each(|&h| stepper.step(&mut state, h).unwrap());
            (state, stepper.statistics().work.force_evaluations)
        };
        let cut = run(&[0.125, 0.25, 0.25, 0.25]);
        assert_eq!(run(&[0.125; 7]), cut, "{}", method.name());
        assert_eq!((cut.0.positions[0], cut.0.velocities[0]), (Vector3::new(0.25, 0.0, 0.0), Vector3::zeros()));
        assert_eq!(cut.1, forces, "{}", method.name());
    }
}

/// A particle of 2 kg, damped, on a spring of 12 N/m to a held one, in motion along it.
fn oscillator() -> (System, State) {
    let (system, mut start) = tethered(0.9, MASS, Spring { stiffness: 6.0, rest_length: 0.5, damping: DAMPING });
    start.velocities[1].x = 0.5;
    (system, start)
}

/// Up to six steps of one length share a matrix, but none after a rejected step or one of another length.
#[test]
fn w2_reuses_its_matrix() {
    let (system, mut state) = oscillator();
    let mut stepper = WMethod::new(&system, &state, &ImplicitOptions::default()).unwrap();
    let mut factorizations = |h: f64, accepts: bool| {
        stepper.try_step(&state, h).unwrap();
        if accepts {
            stepper.accept(&mut state)
        } else {
            stepper.reject()
        }
        stepper.statistics().work.factorizations
    };
    let counts = [(); 14].map(|()| factorizations(0.0625, true));
    assert_eq!(counts, [1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 3, 3]);
    assert_eq!([false, true, true].map(|accepts| factorizations(0.03125, accepts)), [4, 5, 5]);
}

/// In kg, and in N·s/m.
const MASS: f64 = 2.0;
const DAMPING: f64 = 0.8;

/// `10⁻⁴ ‖E‖_M √m/τ²` over the right-hand side of a displacement or a correction `(m/τ² + b/τ + κ) d`, for the error E of the last step.
fn tolerance(error: f64, tau: f64, solved: f64) -> f64 {
    let matrix = MASS / (tau * tau) + DAMPING / tau + 12.0;
    (1e-4 * MASS.sqrt() * error.abs() * MASS.sqrt() / (tau * tau) / (matrix * solved.abs())).min(1e-4)
}

fn conjugate_gradients() -> ImplicitOptions {
    let linear = ImplicitOptions::default().linear.with_solver(SolverChoice::Cg);
    ImplicitOptions { linear, ..ImplicitOptions::default() }
}

/// Conjugate gradients solve to a ten-thousandth of E = ½ h (v' − v) of the last step.
#[test]
fn linearised_backward_euler_solves_to_its_error() {
    let ((system, mut state), h) = (oscillator(), 0.25);
    let mut stepper = LinearBackwardEuler::new(&system, &state, &conjugate_gradients()).unwrap();
    let (mut error, mut expected) = (0.0, 0.0f64);
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
    let (system, start) = oscillator();
    let mut states = vec![start];
    let mut stepper = Bdf2::new(&system, &states[0], &conjugate_gradients()).unwrap();
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
