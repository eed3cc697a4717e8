//! The inertia of A, counted from a sparse factorization, against all eigenvalues of the dense matrix.

use nalgebra::{DMatrix, DVector};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::assembly::{BlockPattern, SymmetricMatrix};
use sprung::inspect::Inertia;
use sprung::integrate::StepMatrices;
use sprung::system::{Axes, Constraint, Motion};
use sprung::{DofMap, Spring, State, Stiffness, System, SystemBuilder};
use std::sync::Arc;

/// A scene of 2 to 60 particles with anything in it: one to three dimensions, masses and stiffnesses over three decades,
/// stretched and compressed springs, pins and rollers, damping.
fn random_scene(rng: &mut ChaCha8Rng) -> (System, State) {
    let n = rng.random_range(2..=60);
    let dimension = rng.random_range(1..=3);
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    let decade = |rng: &mut ChaCha8Rng, decades: f64| 10f64.powf(decades * (rng.random::<f64>() - 0.5));
    for _ in 0..n {
        let mut x = [0.0; 3];
        for c in x.iter_mut().take(dimension) {
            *c = rng.random::<f64>() * (n as f64).cbrt();
        }
        let mass = decade(rng, 3.0);
        builder.particle(x, mass);
    }
    for s in 0..rng.random_range(n - 1..4 * n) {
        let (i, j) = if s < n - 1 { (s, s + 1) } else { (rng.random_range(0..n), rng.random_range(0..n)) };
        let length = (builder.positions[i] - builder.positions[j]).norm();
        if i != j && length > 1e-3 {
            let rest_length = length * (0.5 + 1.5 * rng.random::<f64>());
            let damping = if rng.random_bool(0.3) { decade(rng, 2.0) } else { 0.0 };
            builder.spring(i, j, Spring { stiffness: 100.0 * decade(rng, 3.0), rest_length, damping });
        }
    }
    if rng.random_bool(0.5) {
        let axes = Axes::of(&[rng.random_range(0..3usize), rng.random_range(0..3usize)]);
        builder.constrain(Constraint { particles: vec![rng.random_range(0..n)], axes, motion: Motion::Held });
        builder.hold(rng.random_range(0..n));
    }
    builder.build().expect("a valid scene")
}

fn eigenvalues(matrix: &SymmetricMatrix) -> DVector<f64> {
    if matrix.dofs().is_empty() {
        return DVector::zeros(0);
    }
    let mut dense = DMatrix::zeros(matrix.dofs().len(), matrix.dofs().len());
    for (row, column, value) in matrix.iter() {
        dense[(row, column)] = value;
        dense[(column, row)] = value;
    }
    dense.symmetric_eigenvalues()
}

#[test]
fn equals_the_dense_count_on_a_thousand_random_scenes() {
    let mut rng = ChaCha8Rng::seed_from_u64(20111007);
    let (mut decided, mut indefinite, mut negative_eigenvalues) = (0, 0, 0);
    for case in 0..1000 {
        let (system, state) = random_scene(&mut rng);
        let dt = 10f64.powf(-4.0 + 6.0 * rng.random::<f64>());
        let option = Stiffness::ALL[if case % 4 == 3 { rng.random_range(1..3) } else { 0 }];
        let a = StepMatrices::assemble(&system, &state, option, dt).expect("a matrix").a;
        let inertia = Inertia::of(&a).expect("a small matrix");
        let values = eigenvalues(&a);
        let n = values.len();
        assert_eq!(inertia.negative + inertia.zero + inertia.positive, n, "case {case}");
        assert!(inertia.band < 1e-11, "case {case}: {inertia:?}");
        assert!(inertia.factorization_error <= inertia.band, "case {case}: {inertia:?}");

        // The dense eigenvalues have errors of their own, of about n u‖A‖.
        let uncertain = 4.0 * n as f64 * f64::EPSILON * values.amax();
        let surely_negative = values.iter().filter(|&&v| v < -uncertain).count();
        let surely_positive = values.iter().filter(|&&v| v > uncertain).count();
        assert!(inertia.negative + inertia.zero >= surely_negative, "case {case}: {inertia:?}");
        assert!(inertia.positive + inertia.zero >= surely_positive, "case {case}: {inertia:?}");
        if surely_negative + surely_positive == n && inertia.zero == 0 {
            assert_eq!((inertia.negative, inertia.positive), (surely_negative, surely_positive), "case {case}");
            decided += 1;
            indefinite += usize::from(inertia.negative > 0);
            negative_eigenvalues += inertia.negative;
        }
    }
    println!("{decided} decided, {indefinite} indefinite, {negative_eigenvalues} negative eigenvalues");
    assert!(decided >= 990, "{decided} of 1000 decided");
    assert!(indefinite >= 250, "{indefinite} of 1000 indefinite");
}

/// A free body's −K: translations and, at rest, rotations have no stiffness.
#[test]
fn counts_the_rigid_motions_of_a_free_body_as_zeros() {
    let (system, state) = tetrahedron();
    let k = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0).expect("a matrix").k;
    let inertia = Inertia::of(&k).expect("a small matrix");
    assert_eq!((inertia.negative, inertia.zero, inertia.positive), (6, 6, 0));
}

fn tetrahedron() -> (System, State) {
    let mut builder = SystemBuilder::new();
    for (x, mass) in
        [[0.0, 0.0, 0.0], [1.1, 0.1, 0.0], [0.4, 0.9, 0.1], [0.5, 0.3, 0.8]].into_iter().zip([1.0, 2.0, 0.7, 1.3])
    {
        builder.particle(x, mass);
    }
    for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
        let length = (builder.positions[i] - builder.positions[j]).norm();
        builder.spring(i, j, Spring { stiffness: 80.0, rest_length: length, damping: 0.0 });
    }
    builder.build().expect("a valid scene")
}

/// Entries from 1e-12 to 1e12: signs that an absolute band relative to ‖A‖ could not tell.
#[test]
fn tells_signs_in_a_badly_scaled_matrix() {
    let mut builder = SystemBuilder::new();
    for p in 0..8 {
        builder.particle([p as f64, 0.1 * (p * p) as f64, 0.0], 10f64.powi(6 - 3 * (p % 5)));
    }
    for p in 0..7 {
        let length = (builder.positions[p] - builder.positions[p + 1]).norm();
        let spring = Spring { stiffness: 10f64.powi(3 * (p as i32 % 4) - 6), rest_length: 0.9 * length, damping: 0.0 };
        builder.spring(p, p + 1, spring);
    }
    let (system, state) = builder.build().expect("a valid scene");
    let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 1e-3).expect("a matrix").a;
    let inertia = Inertia::of(&a).expect("a small matrix");
    assert_eq!((inertia.negative, inertia.zero, inertia.positive), (0, 0, 24));
    assert!(inertia.is_definite());
}

/// `[0 1; 1 0]` has no LDLᵀ factorization without pivoting, at any size.
#[test]
fn survives_pivots_that_vanish() {
    for particles in [2, 40, 900] {
        let dofs = DofMap::unconstrained(particles);
        let pairs: Vec<[usize; 2]> = (0..particles / 2).map(|p| [2 * p, 2 * p + 1]).collect();
        let pattern = Arc::new(BlockPattern::new(&dofs, pairs.iter().copied()).expect("a pattern"));
        let mut matrix = SymmetricMatrix::zeros(pattern.clone());
        for [i, j] in pairs {
            let slot = pattern.slot(i, j).expect("in the pattern");
            matrix.add_block(slot, &nalgebra::Matrix3::identity());
        }
        let inertia = Inertia::of(&matrix).expect("a small matrix");
        assert_eq!((inertia.negative, inertia.zero, inertia.positive), (3 * particles / 2, 0, 3 * particles / 2));
    }
}

#[test]
fn decides_nothing_about_a_matrix_that_is_not_finite() {
    let pattern =
        Arc::new(BlockPattern::new(&DofMap::unconstrained(3), [[0, 1], [1, 2]].into_iter()).expect("a pattern"));
    let mut matrix = SymmetricMatrix::zeros(pattern);
    matrix.shift(1.0);
    matrix.add_to_diagonal(1, f64::NAN);
    let inertia = Inertia::of(&matrix).expect("a small matrix");
    assert_eq!((inertia.negative, inertia.zero, inertia.positive), (0, 9, 0));
    assert!(!inertia.is_definite());
}

#[test]
fn of_nothing_is_empty() {
    let pattern = Arc::new(BlockPattern::new(&DofMap::unconstrained(0), std::iter::empty()).expect("a pattern"));
    let inertia = Inertia::of(&SymmetricMatrix::zeros(pattern)).expect("a matrix");
    assert_eq!((inertia.negative, inertia.zero, inertia.positive), (0, 0, 0));
}
