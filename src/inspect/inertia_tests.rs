//! Counts of small matrices that are known by hand, by every factorization.

use super::inertia::{Inertia, InertiaCounter, InertiaMethod, definite_by_blocks, dense_signs};
use crate::assembly::SymmetricMatrix;
use crate::force::SpringGeometry;
use crate::inspect::tests::chain;
use crate::integrate::StepMatrices;
use crate::linear::PivotSigns;
use crate::linear::fixtures::{banded, noise};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::work::Work;
use faer::Par;

fn counter(a: &SymmetricMatrix) -> InertiaCounter {
    InertiaCounter::new(a.pattern(), Par::Seq).unwrap()
}

/// The count that begins with a method, and its work.
fn counted(a: &SymmetricMatrix, method: InertiaMethod) -> (Inertia, Work) {
    let mut counter = counter(a);
    counter.method = method;
    let mut work = Work::default();
    let found = counter.count(a, &mut work);
    (found, work)
}

/// A symmetric matrix of order six from its lower triangle.
fn six(entry: impl Fn(usize, usize) -> f64) -> SymmetricMatrix {
    banded(2, 1, |row, column| entry(row.max(column), row.min(column)))
}

/// Pairs `[0 v; v 0]` have one eigenvalue of each sign, and so has `[1 5; 5 2]`, whose determinant is −23.
#[test]
fn dense_factorizations_count_pivots_of_order_two() {
    let only_pairs = |row, column| if row == column + 1 && column % 2 == 0 { 1.0 + column as f64 } else { 0.0 };
    let mixed = |row, column| match (row, column) {
        (0, 0) => 7.0,
        (1, 1) => 1.0,
        (2, 1) => 5.0,
        (2, 2) => 2.0,
        (4, 3) => 3.0,
        (5, 5) => 4.0,
        _ => 0.0,
    };
    for (a, negative) in [(six(only_pairs), 3), (six(mixed), 2), (six(|r, c| (r == c) as u8 as f64), 0)] {
        let (signs, error) = dense_signs(&a);
        assert_eq!(signs, PivotSigns { negative, zero: 0, positive: 6 - negative });
        assert!(error < 1e-14, "{error}");
        let (found, work) = counted(&a, InertiaMethod::Dense);
        assert_eq!((found.negative, found.zero, found.positive), (negative, 0, 6 - negative));
        assert_eq!((found.method, work.factorizations), (InertiaMethod::Dense, if negative == 0 { 1 } else { 2 }));
        assert_eq!(found.band, 1.5 * 32.0 * 6f64.sqrt() * f64::EPSILON / 2.0);
        assert!(!found.proven, "only the sparse factorization without pivoting has a bound");
    }
}

/// `[1 1; 1 c]`, with a row of its own.
fn nearly_singular(corner: f64) -> SymmetricMatrix {
    banded(1, 0, |row, column| match (row, column) {
        (0, 0) | (0, 1) | (1, 0) | (2, 2) => 1.0,
        (1, 1) => corner,
        _ => 0.0,
    })
}

/// `[1 1; 1 1 − 2δ]` has an eigenvalue of −δ, and a norm of 2: with three rows the band is `±64 √3 u`, about 1.2e-14.
#[test]
fn what_lies_in_the_band_is_neither_negative_nor_positive() {
    for (delta, negative) in [(-3e-14, 0), (7e-15, 0), (3e-14, 1)] {
        let a = nearly_singular(1.0 - 2.0 * delta);
        let (found, work) = counted(&a, InertiaMethod::Sparse);
        let zero = usize::from(delta.abs() < 1e-14);
        assert_eq!((found.negative, found.zero, found.positive), (negative, zero, 3 - negative - zero), "{delta}");
        assert_eq!((found.method, found.is_definite()), (InertiaMethod::Sparse, delta < 0.0));
        assert_eq!(work.factorizations, if delta < 0.0 { 1 } else { 2 });
    }
}

/// Stretched springs prove it, compressed ones and none at all do not. What 2 kg give must be visible: more than a billionth of ‖A‖.
#[test]
fn blocks_prove_definiteness_where_there_are_rows() {
    for (free, rest_length, expected) in [(2, 0.5, Some(4)), (2, 1.25, None), (0, 0.5, None)] {
        let (system, state) = chain(free, rest_length);
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).unwrap().a;
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let found = definite_by_blocks(&operator, &a, 100.0);
        assert_eq!(found.map(|inertia| inertia.positive), expected);
        assert!(found.is_none_or(|inertia| inertia.method == InertiaMethod::Springs && inertia.is_definite()));
        let one = banded(1, 0, |row, column| (row == column) as u8 as f64);
        let is_visible = [5e-10, 5.1e-10].map(|mass| definite_by_blocks(&operator, &one, mass).is_some());
        assert!(free == 0 || is_visible == [false, expected.is_some()]);
    }
}

/// Pairs `[δ 1; 1 0]`, whose first pivot costs digits as long as nothing is pivoted, with one row of its own in each.
fn small_pivots(particles: usize, delta: impl Fn(usize) -> f64) -> SymmetricMatrix {
    banded(particles, 1, |row, column| match (row % 3, column % 3) {
        _ if row / 3 != column / 3 => 0.01 * noise(row, column),
        (0, 0) => delta(row / 3),
        (0, 1) | (1, 0) => 1.0,
        (2, 2) => 1.0,
        _ => 0.0,
    })
}

/// Counts have errors of less than half of the shift; where a factorization is not as good the band is widened.
#[test]
fn bands_are_as_wide_as_errors_demand() {
    let mut widened = 0;
    for k in 0..400 {
        let a = small_pivots(4 + k % 5, |p| 10f64.powf(-0.25 - 0.005 * k as f64) * (1.0 + 0.1 * p as f64));
        let (found, _) = counted(&a, InertiaMethod::Sparse);
        assert!(found.factorization_error <= found.band / 3.0, "{k}: {found:?}");
        let first = 1.5 * 32.0 * (a.order() as f64).sqrt() * f64::EPSILON / 2.0;
        widened += usize::from(found.band > first);
    }
    assert!(widened > 10, "{widened}");
}

/// A better method is tried where the error is more than half of the band.
#[test]
fn a_better_method_is_tried_where_the_error_is_too_large() {
    let a = small_pivots(6, |_| 1e-9);
    let n = a.order();
    let scale = a.norm_inf(&mut vec![0.0; n]);
    let method = |tolerance: f64| {
        let mut work = Work::default();
        let found = counter(&a).factor(&a, 0.0, scale, tolerance, InertiaMethod::Sparse, &mut work);
        (found.method, found.error)
    };
    let (sparse, error) = method(1.0);
    assert!(sparse == InertiaMethod::Sparse && error > 1e-11, "{error}");
    assert_eq!(method(2.5 * error).0, InertiaMethod::Sparse);
    for part in [1.9, 1.1, 0.6] {
        assert_eq!(method(part * error).0, InertiaMethod::Pivoted, "{part}");
    }
}

/// `[1 + τ, 1; 1, 1 + τ]` less τ has a pivot of exactly zero: it is none that proves definiteness, so the other side is factored too.
#[test]
fn a_pivot_of_zero_is_not_positive() {
    // √36 = 6; the rows of C add up to 2.
    let tau = 2.0 * 32.0 * 6.0 * f64::EPSILON / 2.0;
    let entry = |row: usize, column: usize| match (row, column) {
        (0, 0) | (1, 1) => 1.0 + tau,
        (0, 1) | (1, 0) => 1.0,
        (2, 2) => -1.0,
        _ if row == column => 1.0,
        _ => 0.0,
    };
    let a = banded(12, 0, entry);
    let (found, work) = counted(&a, InertiaMethod::Dense);
    assert_eq!((found.negative, found.zero, found.positive, work.factorizations), (1, 1, 34, 2));
}

/// Without a factorization to trust the band is doubled four times, and then nothing is decided.
#[test]
fn a_count_ends_undecided() {
    let a = six(|row, column| (row == column) as u8 as f64);
    let first = 32.0 * 6f64.sqrt() * f64::EPSILON / 2.0;
    let undecided = Inertia::undecided(6, 1.5 * 32.0 * first);
    assert_eq!(counted(&a, InertiaMethod::None), (undecided, Work::default()));
}

/// The numbers of negative, zero and positive eigenvalues of an integer matrix, exactly: by Descartes' rule, which holds with equality for a
/// characteristic polynomial that has real roots only. Its coefficients are those of Faddeev and LeVerrier, `M ← A M + c I`, `c = −tr(A M)/k`.
fn exact(a: &[[i128; 6]; 6]) -> [usize; 3] {
    let times = |m: &[[i128; 6]; 6]| -> [[i128; 6]; 6] {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| a[i][k] * m[k][j]).sum()))
    };
    let (mut m, mut coefficients) = ([[0; 6]; 6], vec![1]);
    for k in 1..=6 {
        (0..6).for_each(|i| m[i][i] += coefficients[k - 1]);
        m = times(&m);
        coefficients.push(-(0..6).map(|i| m[i][i]).sum::<i128>() / k as i128);
    }
    let changes = |mirrored: bool| {
        let sign = |(k, c): (usize, &i128)| if mirrored && k % 2 == 1 { -c.signum() } else { c.signum() };
        let signs: Vec<i128> = coefficients.iter().enumerate().map(sign).filter(|sign| *sign != 0).collect();
        signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
    };
    let zero = coefficients.iter().rev().take_while(|c| **c == 0).count();
    [changes(true), zero, changes(false)]
}

/// Random integer matrices, a third of them singular and a third nearly: what is proven is so in exact arithmetic. Three of four regular ones are
/// proven; the others need pivoting, for which there is no bound.
#[test]
fn proven_counts_are_those_of_exact_arithmetic() {
    let (mut regular, mut proven) = (0, 0);
    for seed in 0..600usize {
        let number = |row: usize, column: usize| (noise(97 * seed + row, 31 * seed + column) * 9.0).round() as i128;
        let mut a: [[i128; 6]; 6] =
            std::array::from_fn(|row| std::array::from_fn(|column| number(row.max(column), row.min(column))));
        if seed % 3 > 0 {
            // The last row and column are sums of the first two, and nearly so with a scale of 10⁴.
            let scale = if seed % 3 == 1 { 1 } else { 10_000 };
            a.iter_mut().flatten().for_each(|entry| *entry *= scale);
            (0..5).for_each(|k| a[5][k] = a[0][k] + a[1][k]);
            (0..5).for_each(|k| a[k][5] = a[5][k]);
            a[5][5] = a[5][0] + a[5][1] + i128::from(scale > 1);
        }
        let [negative, zero, positive] = exact(&a);
        let found = Inertia::of(&six(|row, column| a[row][column] as f64)).unwrap();
        if found.proven {
            assert!(found.negative <= negative && found.positive <= positive, "{a:?}: {found:?}");
            assert!(found.zero >= zero);
        }
        if zero == 0 {
            regular += 1;
            proven += usize::from(found.proven && found.zero == 0);
        }
    }
    assert!(regular > 300 && 4 * proven > 3 * regular, "{proven} of {regular}");
}

/// `[1 1; 1 1 + δ]` is definite for δ > 0 only: in steps of one unit in the last place no other is called so, and from 250 on it is proven.
#[test]
fn definite_is_proven_from_some_roundings_on() {
    for ulps in -300i32..=300 {
        let found = Inertia::of(&nearly_singular(1.0 + f64::from(ulps) * f64::EPSILON)).unwrap();
        assert!(ulps > 0 || !found.is_definite(), "{ulps}: {found:?}");
        assert!(ulps < 250 || found.is_definite() && found.proven, "{ulps}: {found:?}");
    }
}

/// All pairs of 450 particles are joined: with a thousand terms in a sum, rounding may exceed the first band, and a second, wider one proves what
/// lies far from both.
#[test]
fn a_wider_band_proves_what_the_first_does_not() {
    let a = banded(450, 449, |row, column| noise(row, column) + if row == column { 3000.0 } else { 0.0 });
    let (found, work) = counted(&a, InertiaMethod::Sparse);
    assert!(found.is_definite() && found.proven, "{found:?}");
    assert_eq!((found.method, work.factorizations), (InertiaMethod::Sparse, 2));
}
