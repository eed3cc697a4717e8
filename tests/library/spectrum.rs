//! The ends of the spectrum by Krylov methods against all eigenvalues of the dense matrix.

use approx::assert_relative_eq;
use faer::Par;
use nalgebra::{DMatrix, DVector};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::assembly::SymmetricMatrix;
use sprung::inspect::{Inertia, spectrum};
use sprung::integrate::StepMatrices;
use sprung::work::Work;
use sprung::{Spring, Stiffness, SystemBuilder};

fn eigenvalues(matrix: &SymmetricMatrix) -> DVector<f64> {
    let mut dense = DMatrix::zeros(matrix.dofs().len(), matrix.dofs().len());
    for (row, column, value) in matrix.iter() {
        dense[(row, column)] = value;
        dense[(column, row)] = value;
    }
    let mut values = dense.symmetric_eigenvalues();
    values.as_mut_slice().sort_by(f64::total_cmp);
    values
}

/// A ball of `n` particles joined at random, springs with the given range of rest lengths relative to their lengths.
fn network(n: usize, rest: std::ops::Range<f64>, dt: f64, seed: u64) -> SymmetricMatrix {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut builder = SystemBuilder::new();
    for _ in 0..n {
        let mut coordinate = || rng.random::<f64>() * (n as f64).cbrt();
        let x = [coordinate(), coordinate(), coordinate()];
        builder.particle(x, 0.3 + rng.random::<f64>());
    }
    for s in 0..4 * n {
        let (i, j) = if s < n - 1 { (s, s + 1) } else { (rng.random_range(0..n), rng.random_range(0..n)) };
        if i != j {
            let length = (builder.positions[i] - builder.positions[j]).norm();
            let rest_length = length * rng.random_range(rest.clone());
            builder.spring(i, j, Spring { stiffness: 100.0, rest_length, damping: 0.1 });
        }
    }
    let (system, state) = builder.build().expect("a valid scene");
    StepMatrices::assemble(&system, &state, Stiffness::Full, dt).expect("a matrix").a
}

#[test]
fn both_ends_of_definite_and_indefinite_matrices() {
    for (rest, dt) in [(0.9..1.0, 0.01), (0.9..1.0, 3.0), (0.9..1.05, 1.0), (0.8..1.6, 0.3), (0.8..1.6, 10.0)] {
        for n in [50, 200] {
            let a = network(n, rest.clone(), dt, 5);
            let inertia = Inertia::of(&a).expect("a small matrix");
            let found = spectrum(&a, &inertia, 12, Par::Seq, &mut Work::default()).expect("a small matrix");
            let expected = eigenvalues(&a);
            let norm = expected.amax();
            assert!((found.largest - expected[expected.len() - 1]).abs() <= 1e-9 * norm, "{rest:?} {dt} {n}");
            assert_relative_eq!(found.smallest(), expected[0], epsilon = 1e-9 * norm);
            for (k, pair) in found.lowest.iter().take(12).enumerate() {
                assert!((pair.value - expected[k]).abs() <= 1e-7 * norm, "{rest:?} {dt} {n}: λ_{k} {}", pair.value);
                assert!(pair.residual <= 1e-4 * norm, "{rest:?} {dt} {n}: residual {}", pair.residual);
            }
            let nearest = expected.iter().fold(f64::INFINITY, |least, value| least.min(value.abs()));
            assert_relative_eq!(found.condition, norm / nearest, max_relative = 1e-5);
            println!("{rest:?} dt {dt} n {n}: {} negative, λ_min {:.4e}", inertia.negative, found.smallest());
        }
    }
}

/// A straight compressed chain bends alike in two directions: every negative eigenvalue is double. Three hundred separate
/// pairs have one of multiplicity six hundred.
#[test]
fn multiple_eigenvalues_are_found_as_often_as_they_occur() {
    let mut builder = SystemBuilder::new();
    for p in 0..120 {
        builder.particle([0.4 * p as f64, 0.0, 0.0], 1.0);
    }
    for p in 0..119 {
        builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 0.5, damping: 0.0 });
    }
    let (system, state) = builder.build().expect("a valid scene");
    let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.0715).expect("a matrix").a;
    let inertia = Inertia::of(&a).expect("a small matrix");
    let found = spectrum(&a, &inertia, inertia.negative, Par::Seq, &mut Work::default()).expect("a small matrix");
    assert!((4..=24).contains(&inertia.negative), "{}", inertia.negative);
    assert_eq!(found.negative().len(), inertia.negative);
    for pair in found.lowest.chunks(2) {
        assert_relative_eq!(pair[0].value, pair[1].value, epsilon = 1e-6);
    }

    let mut builder = SystemBuilder::new();
    for pair in 0..100 {
        for end in 0..2 {
            builder.particle([0.4 * end as f64, pair as f64, 0.0], 1.0);
        }
        builder.spring(2 * pair, 2 * pair + 1, Spring { stiffness: 100.0, rest_length: 0.5, damping: 0.0 });
    }
    let (system, state) = builder.build().expect("a valid scene");
    let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0).expect("a matrix").a;
    let inertia = Inertia::of(&a).expect("a small matrix");
    assert_eq!((inertia.negative, inertia.zero), (200, 0));
    let found = spectrum(&a, &inertia, 24, Par::Seq, &mut Work::default()).expect("a small matrix");
    assert_eq!(found.negative().len(), 24);
    assert!(found.lowest.iter().all(|pair| (pair.value + 99.0).abs() < 1e-6), "{:?}", found.smallest());
}
