//! The largest definite and the largest stable step against closed forms, and against runs just below and just above.

use approx::assert_relative_eq;
use faer::Par;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::assembly::SymmetricMatrix;
use sprung::inspect::{CriticalSteps, Inertia, LargestStep, Property};
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StepMatrices, TimeStepper};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::f64::consts::PI;

fn largest(system: &System, state: &State, requirement: Property, option: Stiffness) -> LargestStep {
    CriticalSteps::new(system, state, Par::Seq).expect("a small system").largest_step(requirement, option)
}

fn definite(system: &System, state: &State) -> f64 {
    largest(system, state, Property::Definite, Stiffness::Full).dt().expect("a limit")
}

fn negative(system: &System, state: &State, dt: f64) -> usize {
    let a = StepMatrices::assemble(system, state, Stiffness::Full, dt).expect("a matrix").a;
    let inertia = Inertia::of(&a).expect("a small matrix");
    assert_eq!(inertia.zero, 0);
    inertia.negative
}

/// dt = √(μ/(k(1/l − 1/l0))), μ = m₁m₂/(m₁ + m₂), whatever the damping.
#[test]
fn of_one_compressed_spring() {
    for damping in [0.0, 0.3, 40.0] {
        let (m1, m2, k, l, l0) = (1.3, 0.4, 120.0, 0.7, 1.1);
        let mut builder = SystemBuilder::new();
        builder.particle([0.2, 0.1, -0.3], m1);
        let n = Vector3::new(2.0, -1.0, 2.0) / 3.0;
        let end = Vector3::new(0.2, 0.1, -0.3) + n * l;
        builder.particle(end.into(), m2);
        builder.spring(0, 1, Spring { stiffness: k, rest_length: l0, damping });
        let (system, state) = builder.build().expect("a valid scene");
        let expected = (m1 * m2 / (m1 + m2) / (k * (1.0 / l - 1.0 / l0))).sqrt();
        let dt = definite(&system, &state);
        assert_relative_eq!(dt, expected, max_relative = 1e-12);
        assert_eq!(negative(&system, &state, expected * (1.0 - 1e-6)), 0);
        assert_eq!(negative(&system, &state, expected * (1.0 + 1e-6)), 2);
        for option in [Stiffness::Tension, Stiffness::Axial] {
            assert_eq!(largest(&system, &state, Property::Definite, option), LargestStep::Every);
            assert_eq!(largest(&system, &state, Property::Stable, option), LargestStep::Every);
        }
        let stable = largest(&system, &state, Property::Stable, Stiffness::Full).dt();
        assert_eq!(stable, Some(dt), "no step is called stable beyond the definite one");
    }
}

/// dt = √(m/(c(2 + 2cos(π/n)))), c = k(1/l − 1/l0).
#[test]
fn of_a_straight_free_chain() {
    for n in [2, 3, 10, 57] {
        let (mass, stiffness, l, rest_length) = (0.6, 300.0, 0.45, 0.5);
        let mut builder = SystemBuilder::new();
        for p in 0..n {
            builder.particle([l * p as f64, 0.0, 0.0], mass);
        }
        for p in 0..n - 1 {
            builder.spring(p, p + 1, Spring { stiffness, rest_length, damping: 0.2 });
        }
        let (system, state) = builder.build().expect("a valid scene");
        let c = stiffness * (1.0 / l - 1.0 / rest_length);
        let expected = (mass / (c * (2.0 + 2.0 * (PI / n as f64).cos()))).sqrt();
        assert_relative_eq!(definite(&system, &state), expected, max_relative = 1e-9);
        assert_eq!(negative(&system, &state, expected * (1.0 - 1e-6)), 0, "n = {n}");
        assert_eq!(negative(&system, &state, expected * (1.0 + 1e-6)), 2, "n = {n}");
    }
}

/// Where nothing is compressed, or compression cannot bend anything, every step is definite.
#[test]
fn has_no_limit_where_k_is_semidefinite() {
    let (system, state) = taut_chain(5, 1.3);
    assert_eq!(largest(&system, &state, Property::Definite, Stiffness::Full), LargestStep::Every);
    assert_eq!(largest(&system, &state, Property::Stable, Stiffness::Full), LargestStep::Every);
    assert_eq!(largest(&system, &state, Property::Stable, Stiffness::Tension), LargestStep::Every);

    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([0.5, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
    let (system, state) = builder.build().expect("a valid scene");
    assert_eq!(largest(&system, &state, Property::Definite, Stiffness::Full), LargestStep::Every);
}

/// n equal masses between walls on a line, links `stretch` times as long as at rest.
fn taut_chain(n: usize, stretch: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for p in 0..n + 2 {
        builder.particle([0.7 * stretch * p as f64, 0.0, 0.0], 0.9);
    }
    builder.hold(0).hold(n + 1);
    for p in 0..=n {
        builder.spring(p, p + 1, Spring { stiffness: 210.0, rest_length: 0.7, damping: 0.5 });
    }
    builder.build().expect("a valid scene")
}

/// 2/ω of the fastest transverse mode, ω = 2√(κ/m) sin(nπ/(2(n+1))), κ = k(1/l0 − 1/l).
fn taut_chain_limit(n: usize, stretch: f64) -> f64 {
    let kappa = 210.0 * (1.0 / 0.7 - 1.0 / (0.7 * stretch));
    1.0 / ((kappa / 0.9).sqrt() * (n as f64 * PI / (2.0 * (n as f64 + 1.0))).sin())
}

#[test]
fn of_stretched_chains_without_their_transverse_terms() {
    for n in [1, 2, 7, 30] {
        for stretch in [1.02, 1.4, 2.0] {
            let (system, state) = taut_chain(n, stretch);
            let stable = largest(&system, &state, Property::Stable, Stiffness::Axial).dt().expect("a limit");
            assert_relative_eq!(stable, taut_chain_limit(n, stretch), max_relative = 1e-9);
            assert_eq!(largest(&system, &state, Property::Definite, Stiffness::Axial), LargestStep::Every);
        }
    }
}

/// The largest deviation in 2,000 steps relative to the initial one, from the alternating motion of the fastest mode.
fn growth(n: usize, stretch: f64, dt: f64) -> f64 {
    let (system, mut state) = taut_chain(n, stretch);
    let amplitude = 1e-6;
    for p in 1..=n {
        // x₋₁ = −x₀ is the mode of the root z = −1, with v = (x₀ − x₋₁)/dt.
        let shape = amplitude * (p as f64 * n as f64 * PI / (n as f64 + 1.0)).sin();
        state.positions[p].y = shape;
        state.velocities[p].y = 2.0 * shape / dt;
    }
    let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Axial.into(), linear };
    let mut stepper = LinearBackwardEuler::new(&system, &state, &options).expect("a small system");
    let mut largest = 0.0f64;
    for _ in 0..2000 {
        stepper.step(&mut state, dt).expect("an exact solve of a definite matrix");
        largest = state.positions.iter().map(|x| x.y.abs()).fold(largest, f64::max);
    }
    largest / amplitude
}

/// Relative distances to the limit at which z = −(1 ± √(8ε)): 1e-6 grows by cosh(2000 √(8e-6)) = 143.
#[test]
fn are_where_runs_begin_to_grow() {
    for (n, stretch) in [(1, 1.4), (2, 1.1), (7, 2.0)] {
        let (system, state) = taut_chain(n, stretch);
        let stable = largest(&system, &state, Property::Stable, Stiffness::Axial).dt().expect("a limit");
        let below = growth(n, stretch, stable * (1.0 - 1e-6));
        let above = growth(n, stretch, stable * (1.0 + 1e-6));
        println!("n = {n}: {below:.3} below, {above:.1} above");
        assert!(below < 1.5, "n = {n}: grew to {below} below the limit");
        assert!(above > 50.0, "n = {n}: grew only to {above} above the limit");
    }
}

/// A search takes tens of factorizations, not hundreds.
#[test]
fn cost_few_factorizations() {
    let n = 40;
    let mut builder = SystemBuilder::new();
    for p in 0..n * n {
        let (i, j) = (p / n, p % n);
        let wiggle = 0.02 * ((7 * i + 13 * j) % 11) as f64;
        builder.particle([0.1 * i as f64, 0.1 * j as f64, 0.1 * wiggle], 0.01);
    }
    for p in 0..n * n {
        for (q, inside) in [(p + 1, p % n + 1 < n), (p + n, p + n < n * n), (p + n + 1, p % n + 1 < n && p + n < n * n)]
        {
            if inside {
                let length = (builder.positions[p] - builder.positions[q]).norm();
                let rest_length = length * (0.97 + 0.01 * ((3 * p + q) % 7) as f64);
                builder.spring(p, q, Spring { stiffness: 50.0, rest_length, damping: 0.01 });
            }
        }
    }
    let (system, state) = builder.build().expect("a valid scene");
    let mut steps = CriticalSteps::new(&system, &state, Par::Seq).expect("a small system");
    for (requirement, option) in [(Property::Definite, Stiffness::Full), (Property::Stable, Stiffness::Axial)] {
        let before = steps.work.factorizations;
        let LargestStep::UpTo { dt, refused } = steps.largest_step(requirement, option) else { panic!("no limit") };
        let spent = steps.work.factorizations - before;
        println!("{requirement:?} {option:?}: {dt} s, {:.1e} from refused, {spent} factorizations", refused / dt - 1.0);
        assert!(refused > dt && refused / dt - 1.0 < 1e-11);
        assert!(spent <= 8, "{spent} factorizations");
    }
}

/// A random damped body in three dimensions, one particle held, springs with rest lengths in the given range relative to
/// their lengths.
fn random_body(rng: &mut ChaCha8Rng, rest: std::ops::Range<f64>) -> (System, State) {
    let n = rng.random_range(3..9);
    let mut builder = SystemBuilder::new();
    for _ in 0..n {
        let mut coordinate = || 2.0 * rng.random::<f64>();
        let x = [coordinate(), coordinate(), coordinate()];
        builder.particle(x, 0.3 + rng.random::<f64>());
    }
    builder.hold(0);
    for s in 0..4 * n {
        let (i, j) = if s < n - 1 { (s, s + 1) } else { (rng.random_range(0..n), rng.random_range(0..n)) };
        if i != j {
            let rest_length = (builder.positions[i] - builder.positions[j]).norm() * rng.random_range(rest.clone());
            builder.spring(i, j, Spring { stiffness: 100.0, rest_length, damping: 3.0 * rng.random::<f64>() });
        }
    }
    builder.build().expect("a valid scene")
}

fn dense(matrix: &SymmetricMatrix) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(matrix.dofs().len(), matrix.dofs().len());
    for (row, column, value) in matrix.iter() {
        dense[(row, column)] = value;
        dense[(column, row)] = value;
    }
    dense
}

#[test]
fn definite_steps_are_sharp_on_random_damped_bodies() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut limited = 0;
    for _ in 0..100 {
        let (system, state) = random_body(&mut rng, 0.8..1.5);
        let Some(dt) = largest(&system, &state, Property::Definite, Stiffness::Full).dt() else { continue };
        limited += 1;
        assert_eq!(negative(&system, &state, dt * (1.0 - 1e-7)), 0);
        assert!(negative(&system, &state, dt * (1.0 + 1e-7)) > 0);
    }
    assert!(limited > 80, "{limited} limited");
}

/// The spectral radius of one linearised step, (x, x₋) ↦ (x₊, x), as a matrix of its own.
fn spectral_radius(system: &System, state: &State, option: Stiffness, dt: f64) -> f64 {
    let full = StepMatrices::assemble(system, state, Stiffness::Full, dt).expect("matrices");
    let dropped = StepMatrices::assemble(system, state, option, dt).expect("matrices");
    let (a, m, k) = (dense(&dropped.a), DMatrix::from_diagonal(&DVector::from_vec(full.m)), dense(&full.k));
    let n = a.nrows();
    // A (x₊ − x) = M (x − x₋)/dt² + K x.
    let lu = a.lu();
    let forward = lu.solve(&(&m / (dt * dt) + k)).expect("A is definite") + DMatrix::identity(n, n);
    let backward = lu.solve(&(m / (-dt * dt))).expect("A is definite");
    let mut step = DMatrix::zeros(2 * n, 2 * n);
    step.view_mut((0, 0), (n, n)).copy_from(&forward);
    step.view_mut((0, n), (n, n)).copy_from(&backward);
    step.view_mut((n, 0), (n, n)).fill_with_identity();
    step.complex_eigenvalues().iter().map(|z| z.norm()).fold(0.0, f64::max)
}

#[test]
fn stable_steps_are_those_of_the_amplification_matrix_on_random_damped_bodies() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut limited = 0;
    for case in 0..60 {
        // Stretched only: −K is positive definite, and growth can only come from the method.
        let (system, state) = random_body(&mut rng, 0.4..1.0);
        for option in [Stiffness::Full, Stiffness::Tension] {
            assert_eq!(largest(&system, &state, Property::Stable, option), LargestStep::Every);
            assert!(spectral_radius(&system, &state, option, 10.0) < 1.0);
        }
        let Some(dt) = largest(&system, &state, Property::Stable, Stiffness::Axial).dt() else { continue };
        limited += 1;
        let [below, above] =
            [1.0 - 1e-3, 1.0 + 1e-3].map(|r| spectral_radius(&system, &state, Stiffness::Axial, r * dt));
        assert!(below <= 1.0 + 1e-9 && above > 1.0 + 1e-6, "case {case}: {below} below, {above} above");
    }
    assert!(limited > 50, "{limited} limited");
}
