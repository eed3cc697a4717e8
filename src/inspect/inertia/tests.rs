//! Counts of small matrices that are known by hand, by every factorization.

use super::{Inertia, InertiaCounter, InertiaMethod, definite_by_blocks, dense_signs, equilibrated};
use crate::assembly::SymmetricMatrix;
use crate::force::Extensions;
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
        let mut dense = counter(&a);
        dense.method = InertiaMethod::Dense;
        let mut work = Work::default();
        let found = dense.count(&a, &mut work);
        assert_eq!((found.negative, found.zero, found.positive), (negative, 0, 6 - negative));
        assert_eq!((found.method, work.factorizations), (InertiaMethod::Dense, if negative == 0 { 1 } else { 2 }));
        assert_eq!(found.band, 1.5 * 32.0 * 6f64.sqrt() * f64::EPSILON / 2.0);
        work = Work::default();
        assert_eq!((dense.count_negative(&a, &mut work), work.factorizations), (negative, 1));
    }
}

/// `[1 1; 1 1 − 2δ]` has an eigenvalue of −δ, and a norm of 2: with three rows the band is `±64 √3 u`, about 1.2e-14.
#[test]
fn what_lies_in_the_band_is_neither_negative_nor_positive() {
    for (delta, negative) in [(-3e-14, 0), (7e-15, 0), (3e-14, 1)] {
        let a = banded(1, 0, |row, column| match (row, column) {
            (0, 0) | (0, 1) | (1, 0) | (2, 2) => 1.0,
            (1, 1) => 1.0 - 2.0 * delta,
            _ => 0.0,
        });
        let mut work = Work::default();
        let found = counter(&a).count(&a, &mut work);
        let zero = usize::from(delta.abs() < 1e-14);
        assert_eq!((found.negative, found.zero, found.positive), (negative, zero, 3 - negative - zero), "{delta}");
        assert_eq!((found.method, found.is_definite()), (InertiaMethod::Sparse, delta < 0.0));
        assert_eq!(work.factorizations, if delta < 0.0 { 1 } else { 2 });
        assert_eq!(counter(&a).count_negative(&a, &mut work), negative, "{delta}");
    }
}

/// The larger of both factorizations' errors is told, and both are far below what the band allows.
#[test]
fn the_error_is_that_of_the_worse_factorization() {
    for particles in 2..12 {
        let entry = |row: usize, column: usize| {
            noise(row, column) + if row == column { 4.0 * (-1f64).powi(row as i32) } else { 0.0 }
        };
        let a = banded(particles, 2, entry);
        let n = a.order();
        let found = counter(&a).count(&a, &mut Work::default());
        let shift = found.band / 1.5;
        let c = equilibrated(&a);
        let scale = c.norm_inf(&mut vec![0.0; n]);
        let error = |shift: f64| {
            counter(&a).factor(&c, shift * scale, scale, shift.abs(), found.method, &mut Work::default()).error
        };
        assert_eq!(found.factorization_error, error(shift).max(error(-shift)));
    }
}

/// More rows than are ever factored densely.
#[test]
fn large_matrices_are_counted_sparsely() {
    let a = banded(670, 0, |row, column| {
        if row != column {
            0.0
        } else if row % 2 == 0 {
            1.0
        } else {
            -1.0
        }
    });
    let mut work = Work::default();
    let found = counter(&a).count(&a, &mut work);
    assert_eq!((found.negative, found.zero, found.positive), (1005, 0, 1005));
    assert_eq!((found.method, work.factorizations), (InertiaMethod::Sparse, 2));
}

/// Without rows all is certain, without finite entries nothing is; neither is factored.
#[test]
fn nothing_is_factored_where_nothing_can_be_counted() {
    let mut work = Work::default();
    let none = banded(0, 0, |_, _| 0.0);
    let empty = Inertia { factorization_error: 0.0, method: InertiaMethod::Sparse, ..Inertia::undecided(0, 0.0) };
    assert_eq!(counter(&none).count(&none, &mut work), empty);
    assert_eq!(counter(&none).count_negative(&none, &mut work), 0);
    let infinite = banded(1, 0, |row, column| if row == column { -f64::INFINITY } else { 0.0 });
    assert_eq!(counter(&infinite).count(&infinite, &mut work), Inertia::undecided(3, f64::INFINITY));
    assert_eq!(counter(&infinite).count_negative(&infinite, &mut work), 0);
    assert_eq!(work, Work::default());
}

/// Stretched springs prove it, compressed ones and none at all do not.
#[test]
fn blocks_prove_definiteness_where_there_are_rows() {
    for (free, rest_length, expected) in [(2, 0.5, Some(4)), (2, 1.25, None), (0, 0.5, None)] {
        let (system, state) = chain(free, rest_length);
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).unwrap().a;
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let found = definite_by_blocks(&operator, &a, 100.0);
        assert_eq!(found.map(|inertia| inertia.positive), expected);
        assert!(found.is_none_or(|inertia| inertia.method == InertiaMethod::Springs && inertia.is_definite()));
    }
}
