//! The solver against closed forms, and against all eigenvalues of dense matrices.

use super::{BlockLanczos, End, Pencil, Search, ShiftInvert, Tolerance, gaussian, largest, lowest, probe, unit};
use crate::assembly::SymmetricMatrix;
use crate::linear::fixtures::banded;
use crate::linear::{Ldlt, dot, norm};
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, SymmetricEigen};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};

/// `Y = D X` of a diagonal.
fn diagonal(n: usize, value: impl Fn(usize) -> f64) -> impl FnMut(&[f64], &mut [f64]) {
    move |x, y| {
        for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
            y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = value(k) * x);
        }
    }
}

/// A chain of unit springs between walls: the eigenvalues are `2 − 2 cos(jπ/(n + 1))`.
fn chain(x: &[f64], y: &mut [f64]) {
    for (k, y) in y.iter_mut().enumerate() {
        let beside = [k.checked_sub(1), Some(k + 1)].map(|k| k.and_then(|k| x.get(k)).copied().unwrap_or(0.0));
        *y = 2.0 * x[k] - beside[0] - beside[1];
    }
}

fn of_norm(part: f64) -> Tolerance {
    Tolerance { of_value: 0.0, of_norm: part }
}

/// At every end, as often as they occur, with residuals that are what they say; in the inner product of masses as in the ordinary one.
#[test]
fn outermost_eigenvalues_of_a_diagonal() {
    let n = 300;
    let value = |k: usize| match k {
        17 | 200 => 9.0,
        3 => 7.0,
        30 | 31 => -12.0,
        50 => -8.0,
        _ => (k as f64 * 0.37).sin() * 5.0 - 1.0,
    };
    let masses: Vec<f64> = (0..n).map(|k| 0.5 + (k % 7) as f64).collect();
    for inner in [None, Some(&masses[..])] {
        for (end, expected) in
            [(End::Highest, [9.0, 9.0, 7.0]), (End::Lowest, [-12.0, -12.0, -8.0]), (End::Farthest, [-12.0, -12.0, 9.0])]
        {
            let mut apply = diagonal(n, value);
            let mut space = BlockLanczos::from(n, inner, Search::new(end, 3, 4), 1, [], &mut apply);
            let pairs = space.iterate(of_norm(1e-9), 200, &mut apply, None);
            for (pair, expected) in pairs.iter().zip(expected) {
                assert!((pair.value - expected).abs() < 1e-9, "{end:?} {} {expected}", pair.value);
                let mass = |k: usize| inner.map_or(1.0, |masses| masses[k]);
                let squared = |part: &dyn Fn(usize) -> f64| (0..n).map(|k| mass(k) * part(k).powi(2)).sum::<f64>();
                assert!((squared(&|k| pair.vector[k]) - 1.0).abs() < 1e-12);
                let residual = squared(&|k| (value(k) - pair.value) * pair.vector[k]).sqrt();
                assert!((residual - pair.residual).abs() < 1e-12 && residual < 12.1e-9, "{residual}");
                let image = (0..n).map(|k| (pair.image[k] - value(k) * pair.vector[k]).abs()).fold(0.0, f64::max);
                assert!(image < 1e-12);
            }
        }
    }
}

/// A diagonal of wide range, with a preconditioner that knows it to a factor of two: the first eigenvalues, one of them double, in a few steps; a
/// range of 10⁶ without any would take hundreds.
#[test]
fn preconditioned_residuals_lead_to_the_low_end() {
    let n = 500;
    let value = |k: usize| if k < 2 { -3.0 } else { 1.0 + (k as f64).powi(2) * 4.0 };
    let about = |k: usize| value(k).abs() * if k.is_multiple_of(2) { 1.4 } else { 0.7 };
    let mut products = 0;
    let mut apply = |x: &[f64], y: &mut [f64]| {
        products += x.len() / n;
        diagonal(n, value)(x, y);
    };
    let mut precondition = diagonal(n, |k| 1.0 / about(k));
    let search = Search { end: End::Lowest, wanted: 3, block: 3, capacity: 16 };
    let mut space = BlockLanczos::from(n, None, search, 5, [], &mut apply);
    let found = space.iterate(Tolerance { of_value: 1e-8, of_norm: 0.0 }, 60, &mut apply, Some(&mut precondition));
    for (found, expected) in found.iter().zip([-3.0, -3.0, 17.0]) {
        approx::assert_relative_eq!(found.value, expected, max_relative = 1e-10);
    }
    assert!(products < 120, "{products} products");
}

/// So many blocks, and no more. A full space keeps its best vectors and a block; one that is all there is keeps all.
#[test]
fn spaces_are_as_large_as_they_may_be() {
    let n = 200;
    let mut apply = diagonal(n, |k| (k * k) as f64);
    for longest in [0, 1, 30] {
        let mut space = BlockLanczos::from(
            n,
            None,
            Search { end: End::Lowest, wanted: 2, block: 2, capacity: 9 },
            1,
            [],
            &mut apply,
        );
        let mut products = 0;
        let mut counted = |x: &[f64], y: &mut [f64]| {
            products += x.len() / n;
            diagonal(n, |k| (k * k) as f64)(x, y);
        };
        assert_eq!(space.iterate(of_norm(0.0), longest, &mut counted, None).len(), 2);
        assert_eq!(products, 2 * longest);
    }
    let search = Search::new(End::Highest, 2, 4);
    let mut tiny = BlockLanczos::from(3, None, search, 1, [], &mut diagonal(3, |k| k as f64));
    tiny.refresh(&mut diagonal(3, |k| k as f64));
    let found = tiny.iterate(of_norm(1e-12), 9, &mut diagonal(3, |k| k as f64), None);
    assert!(found.len() == 3 && (found[0].value - 2.0).abs() < 1e-12 && found[2].value.abs() < 1e-12);
}

#[test]
fn nothing_is_no_direction() {
    let mut apply = diagonal(20, |_| 1.0);
    for vector in [[0.0; 20], [f64::INFINITY; 20], [f64::NAN; 20]] {
        let mut space = BlockLanczos::from(20, None, Search::new(End::Highest, 1, 4), 1, [&vector[..]], &mut apply);
        assert!((space.iterate(of_norm(1e-9), 10, &mut apply, None)[0].value - 1.0).abs() < 1e-12);
    }
    assert_eq!(unit(vec![3.0, 4.0]), Some(vec![0.6, 0.8]));
    for vector in [vec![], vec![0.0; 3], vec![f64::INFINITY, 1.0], vec![f64::NAN]] {
        assert_eq!(unit(vector), None);
    }
}

/// A chain, whose eigenvalues are known: Ritz values lie inside the spectrum, within their residuals of an end or of another eigenvalue, and are
/// exact from all of the space. What is not finite has no ends.
#[test]
fn probes_come_near_both_ends() {
    let n = 40;
    let exact = |j: usize| 2.0 - 2.0 * (std::f64::consts::PI * j as f64 / (n + 1) as f64).cos();
    for steps in [1, 2, 7, 20, 40, 60] {
        let [low, high] = probe(n, None, steps, &mut chain).unwrap();
        assert!(low.value >= exact(1) - 1e-13 && high.value <= exact(n) + 1e-13, "{steps}");
        for ritz in [low, high] {
            let distance = (1..=n).map(|j| (exact(j) - ritz.value).abs()).fold(f64::INFINITY, f64::min);
            assert!(distance <= ritz.residual + 1e-13 && (norm(&ritz.vector) - 1.0).abs() < 1e-12);
            assert!(steps < n || ritz.residual < 1e-12);
        }
    }
    assert!(probe(3, None, 3, &mut |_: &[f64], y: &mut [f64]| y.fill(f64::NAN)).is_none());
    assert!(probe(0, None, 3, &mut |_: &[f64], _: &mut [f64]| ()).is_none());
}

/// The largest eigenvalue of a chain, of random diagonals with gaps from wide to none, and of a multiple of the identity, from below and as near as
/// the residual and the gap promise; the recurrence goes on without harm after the value has converged.
#[test]
fn the_largest_eigenvalue_comes_from_three_terms() {
    let n = 400;
    let exact = 2.0 + 2.0 * (std::f64::consts::PI / (n + 1) as f64).cos();
    for (tolerance, most) in [(1e-3, 1e-3), (1e-6, 6e-9), (0.0, 1e-11)] {
        let found = largest(n, tolerance, 1000, &mut chain);
        assert!(found <= exact + 1e-11 && exact - found <= most, "{tolerance}: {} off", exact - found);
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
    for gap in [1.0, 1e-2, 1e-6, 0.0] {
        let drawn: Vec<f64> = (0..n).map(|_| -3.0 + rng.next_u32() as f64 / u32::MAX as f64).collect();
        let value = |k: usize| if k == 0 { -2.0 + gap } else { drawn[k] };
        let exact = (0..n).map(value).fold(f64::NEG_INFINITY, f64::max);
        let found = largest(n, 1e-9, 1000, &mut diagonal(n, value));
        assert!((found - exact).abs() <= 1e-9, "{gap}: {found} {exact}");
    }
    assert!((largest(n, 1e-9, 1000, &mut diagonal(n, |_| 5.0)) - 5.0).abs() < 1e-13);
    assert!(largest(n, 1e-9, 1000, &mut diagonal(n, |_| 0.0)).abs() < 1e-300);
    assert!(largest(n, 1e-9, 1000, &mut diagonal(n, |_| f64::NAN)).is_nan());
    assert!(largest(0, 1e-9, 1000, &mut |_: &[f64], _: &mut [f64]| ()).is_nan());
}

/// A dense pencil with chosen eigenvalues: `A = M^{1/2} Q Λ Qᵀ M^{1/2}`.
fn pencil(rng: &mut Xoshiro256PlusPlus, values: &[f64]) -> (SymmetricMatrix, Vec<f64>) {
    let n = values.len();
    let mut q = DMatrix::zeros(n, n);
    gaussian(rng, q.as_mut_slice());
    let q = q.qr().q();
    let masses: Vec<f64> = (0..n).map(|_| 10f64.powf((rng.next_u32() % 2000) as f64 / 1000.0 - 1.0)).collect();
    let dense = &q * DMatrix::from_diagonal(&nalgebra::DVector::from_column_slice(values)) * q.transpose();
    let entry = |r: usize, c: usize| 0.5 * (dense[(r, c)] + dense[(c, r)]) * (masses[r] * masses[c]).sqrt();
    (banded(n / 3, n, entry), masses)
}

/// Random pencils, with zero eigenvalues and multiple ones, more than a block at a time too, against the eigenvalues of the dense matrix: none is
/// missed, each is as near as its residual says, and the vectors are orthonormal.
#[test]
fn no_eigenvalue_of_a_random_pencil_is_missed() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    for case in 0..500 {
        let n = 3 * if case % 10 == 0 { 20 + rng.next_u32() as usize % 11 } else { 1 + rng.next_u32() as usize % 9 };
        let kinds = 1 + rng.next_u32() as usize % n;
        let drawn: Vec<f64> = (0..kinds)
            .map(|_| match rng.next_u32() % 4 {
                0 => 0.0,
                _ => 20.0 * (rng.next_u32() as f64 / u32::MAX as f64 - 0.3),
            })
            .collect();
        let values: Vec<f64> = (0..n).map(|_| drawn[rng.next_u32() as usize % kinds]).collect();
        let (a, masses) = pencil(&mut rng, &values);
        let masses = (case % 3 != 0).then_some(&masses[..]);
        let dense = DMatrix::from(&a.to_csc());
        let root = |r: usize, c: usize| masses.map_or(1.0, |m| (m[r] * m[c]).sqrt());
        let dense = DMatrix::from_fn(n, n, |r, c| dense[(r, c)] / root(r, c));
        let mut expected: Vec<f64> = SymmetricEigen::new(dense).eigenvalues.iter().copied().collect();
        expected.sort_by(f64::total_cmp);
        let size = expected.iter().fold(1e-300f64, |size, value| size.max(value.abs()));
        let count = 1 + rng.next_u32() as usize % n.min(14);
        let found = lowest(&a, masses, count, Par::Seq, &mut Work::default()).unwrap();
        assert_eq!((found.pairs.len(), found.complete), (count, true), "case {case}: {count} of {n}");
        for (k, (pair, expected)) in found.pairs.iter().zip(&expected).enumerate() {
            assert!((pair.value - expected).abs() <= 1e-10 * size, "case {case}, {k}: {} {expected}", pair.value);
            assert!(pair.residual <= 1e-6 * size, "case {case}, {k}: {}", pair.residual);
            for other in &found.pairs[..=k] {
                let weighted: Vec<f64> = match masses {
                    Some(masses) => pair.vector.iter().zip(masses).map(|(x, mass)| x * mass).collect(),
                    None => pair.vector.clone(),
                };
                let inner = dot(&other.vector, &weighted);
                let is_same = std::ptr::eq(other, pair);
                assert!((inner - f64::from(u8::from(is_same))).abs() < 1e-6, "case {case}: {inner}");
            }
        }
    }
}

/// Two hundred pairs of rows: every eigenvalue but the highest is double or occurs a hundred times, and far more are wanted than a block finds.
#[test]
fn what_a_block_does_not_find_a_count_does() {
    let a = banded(100, 0, |r, c| {
        if r != c {
            0.0
        } else if r < 100 {
            -3.0
        } else {
            1.0 + (r / 2) as f64
        }
    });
    let found = lowest(&a, None, 24, Par::Seq, &mut Work::default()).unwrap();
    assert!(found.complete && found.pairs.iter().all(|pair| (pair.value + 3.0).abs() < 1e-12));
    let found = lowest(&a, None, 104, Par::Seq, &mut Work::default()).unwrap();
    assert!(found.complete);
    let beyond: Vec<f64> = found.pairs[100..].iter().map(|pair| pair.value).collect();
    for (found, expected) in beyond.iter().zip([51.0, 51.0, 52.0, 52.0]) {
        approx::assert_relative_eq!(*found, expected, max_relative = 1e-9);
    }
}

/// `[10⁻²⁰ 1; 1 0]` has a first pivot that all but vanishes: nothing near zero is taken for an eigenvalue.
#[test]
fn pivots_that_vanish_are_no_eigenvalues() {
    let a = banded(40, 0, |r, c| match (r % 3, c % 3) {
        _ if r / 3 != c / 3 => 0.0,
        (0, 0) => 1e-20,
        (0, 1) | (1, 0) => 1.0 + (r / 3) as f64,
        (2, 2) => 0.25 + (r / 3) as f64,
        _ => 0.0,
    });
    let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
    let mut work = Work::default();
    let nearest = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut work).nearest_to_zero();
    approx::assert_relative_eq!(nearest, 0.25, max_relative = 1e-6);
}

#[test]
fn masses_are_checked() {
    let a = banded(1, 0, |r, c| f64::from(u8::from(r == c)));
    for masses in [&[1.0][..], &[1.0, 0.0, 1.0], &[1.0, f64::NAN, 1.0], &[f64::INFINITY, 1.0, 1.0]] {
        assert!(lowest(&a, Some(masses), 1, Par::Seq, &mut Work::default()).is_err());
    }
    assert_eq!(lowest(&a, None, 0, Par::Seq, &mut Work::default()).unwrap().pairs.len(), 0);
    assert_eq!(lowest(&a, None, 9, Par::Seq, &mut Work::default()).unwrap().pairs.len(), 3);
    let none = banded(0, 0, |_, _| 0.0);
    assert!(lowest(&none, None, 2, Par::Seq, &mut Work::default()).unwrap().pairs.is_empty());
    let infinite = banded(1, 0, |r, c| if r == c { f64::INFINITY } else { 0.0 });
    assert!(!lowest(&infinite, None, 1, Par::Seq, &mut Work::default()).unwrap().complete);
}
