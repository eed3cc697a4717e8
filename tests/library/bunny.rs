//! A real mesh: 100 steps at 1/60 s with every solver under every option, compared step by step and at the end.

use nalgebra::Vector3;
use sprung::assembly::SymmetricMatrix;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StepMatrices, TimeStepper};
use sprung::linear::{Cholesky, SolverChoice, SolverOptions, Tolerance, norm};
use sprung::operator::LinearOperator;
use sprung::{Scene, State, Stiffness, System};

const STEPS: usize = 100;
const DT: f64 = 1.0 / 60.0;
const TOLERANCE: f64 = 1e-12;
const UNIT_ROUNDOFF: f64 = 0.5 * f64::EPSILON;

/// Held against sparse Cholesky.
const OTHERS: [SolverChoice; 3] = [SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled];

fn bunny() -> (System, State) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/verification/scenes/bunny.toml");
    Scene::load(path).unwrap().build().unwrap()
}

fn stepper<'s>(
    system: &'s System,
    state: &State,
    stiffness: Stiffness,
    solver: SolverChoice,
) -> LinearBackwardEuler<'s> {
    let linear = SolverOptions { solver, tolerance: Tolerance::Fixed(TOLERANCE), ..Default::default() };
    LinearBackwardEuler::new(system, state, &ImplicitOptions { stiffness: stiffness.into(), linear }).unwrap()
}

/// The largest distance of a particle between two states, in m.
fn distance(a: &State, b: &State) -> f64 {
    a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// The displacement of a step, reduced.
fn displacement(system: &System, from: &State, to: &State) -> Vec<f64> {
    // v = δx/dt keeps more digits than the difference of positions.
    let full: Vec<Vector3<f64>> = to.velocities.iter().map(|v| v * (to.time - from.time)).collect();
    let mut reduced = vec![0.0; system.dofs().len()];
    system.dofs().gather(&full, &mut reduced);
    reduced
}

/// A lower bound of κ₂(A): `‖Ax‖/‖x‖` and `‖A⁻¹x‖/‖x‖` after some power iterations, which never exceed the norms.
fn condition_at_least(a: &SymmetricMatrix, iterations: usize) -> f64 {
    let n = a.order();
    let mut cholesky = Cholesky::analyse(a.pattern(), faer::Par::Seq).unwrap();
    cholesky.factor(a).unwrap();
    let power = |apply: &mut dyn FnMut(&mut Vec<f64>)| {
        let mut x: Vec<f64> = (0..n).map(|i| (1.0 + i as f64).sin()).collect();
        let mut growth = 0.0;
        for _ in 0..iterations {
            let before = norm(&x);
            x.iter_mut().for_each(|x| *x /= before);
            apply(&mut x);
            growth = norm(&x);
        }
        growth
    };
    let largest = power(&mut |x| {
        let mut y = vec![0.0; n];
        a.apply(x, &mut y);
        *x = y;
    });
    largest * power(&mut |x| cholesky.solve_in_place(x).unwrap())
}

#[test]
fn every_solver_gives_the_same_motion_under_full() {
    compare(Stiffness::Full);
}

#[test]
fn every_solver_gives_the_same_motion_under_tension() {
    compare(Stiffness::Tension);
}

#[test]
fn every_solver_gives_the_same_motion_under_axial() {
    compare(Stiffness::Axial);
}

fn compare(option: Stiffness) {
    let (system, start) = bunny();
    assert_eq!((system.particles(), system.springs().len()), (1839, 5511));
    let mut reference = stepper(&system, &start, option, SolverChoice::Llt);
    let mut others = OTHERS.map(|solver| (solver, stepper(&system, &start, option, solver)));
    let mut alone = OTHERS.map(|solver| (stepper(&system, &start, option, solver), start.clone()));

    // A disturbance of 1e-13 m, in directions without pattern.
    let mut disturbed = start.clone();
    for (p, x) in disturbed.positions.iter_mut().enumerate() {
        *x += Vector3::from_fn(|axis, _| 1e-13 * ((3 * p + axis) as f64 * 0.754_877).sin().signum());
    }
    disturbed.prescribe(&system);
    let mut disturbed_stepper = stepper(&system, &start, option, SolverChoice::Llt);

    let mut state = start.clone();
    let (mut worst_ratio, mut condition) = (0.0, 0.0);
    for step in 0..STEPS {
        // κ changes slowly along the run; bounded below, it makes the bound on the solvers stricter, never laxer.
        if step % 20 == 0 {
            condition = condition_at_least(&StepMatrices::assemble(&system, &state, option, DT).unwrap().a, 30);
        }
        let from = state.clone();
        reference.step(&mut state, DT).unwrap_or_else(|failure| panic!("{option:?} step {step}: {failure}"));
        let expected = displacement(&system, &from, &state);
        for (solver, stepper) in &mut others {
            let mut to = from.clone();
            stepper.step(&mut to, DT).unwrap();
            let found = displacement(&system, &from, &to);
            let difference: Vec<f64> = found.iter().zip(&expected).map(|(f, e)| f - e).collect();
            let bound = condition * (TOLERANCE + 30.0 * UNIT_ROUNDOFF);
            let ratio = norm(&difference) / norm(&expected) / bound;
            assert!(ratio <= 1.0, "{option:?} {solver:?} step {step}: {ratio} of κ (tol + 30 u), κ = {condition}");
            worst_ratio = f64::max(worst_ratio, ratio);
        }
        for (stepper, state) in &mut alone {
            stepper.step(state, DT).unwrap();
        }
        disturbed_stepper.step(&mut disturbed, DT).unwrap();
    }

    let growth = distance(&state, &disturbed);
    let apart = alone.iter().map(|(_, end)| distance(&state, end)).fold(0.0, f64::max);
    println!(
        "bunny {}: κ ≈ {condition:.2e}, worst step {worst_ratio:.1e} of its bound; 1e-13 grew to {growth:.2e} m, \
             solvers end {apart:.2e} m apart",
        option.name()
    );
    assert!(apart <= 100.0 * growth, "{option:?}: {apart} against {growth}");
    for (stepper, _) in &alone {
        let work = stepper.statistics().work;
        let expected =
            if stepper.linear_solver().is_some_and(|solver| solver.name().starts_with("cg")) { 0 } else { 1 };
        assert_eq!((work.symbolic_factorizations, work.solves), (expected, STEPS as u64));
    }
}
