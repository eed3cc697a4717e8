//! Diagonal matrices, whose eigenvalues, factors and solutions are exact, with estimates as good or bad as a test wants them.

use super::{ACCURACY, Digits, End, Known, LARGE, STEPS, Search, Side, Target, longest, upper_end};
use crate::assembly::SymmetricMatrix;
use crate::inspect::eigenpair::Eigenpair;
use crate::linear::Ldlt;
use crate::linear::fixtures::banded;
use crate::operator::LinearOperator;
use crate::work::Work;
use faer::Par;
use std::cell::Cell;

fn diagonal(n: usize, value: impl Fn(usize) -> f64) -> SymmetricMatrix {
    banded(n / 3, 0, |row, column| if row == column { value(row) } else { 0.0 })
}

fn end(value: f64, residual: f64) -> End {
    End { value, residual }
}

/// What a search finds, what it proves, and its factorizations and solves.
fn searched<T>(
    a: &SymmetricMatrix,
    within: [f64; 2],
    find: impl FnOnce(&mut Search<'_>) -> T,
) -> (T, [f64; 2], [u64; 2]) {
    let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
    let mut work = Work::default();
    let mut search = Search { within, ..Search::new(a, a, &mut factorization, &mut work) };
    let found = find(&mut search);
    let within = search.within;
    (found, within, [work.factorizations, work.solves])
}

const ANYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// ‖A‖ = 4, so a margin of 2e-6 is certified.
const MARGIN: f64 = 4.0 * ACCURACY;

/// −2, 1 and `last`.
fn three(last: f64) -> SymmetricMatrix {
    diagonal(3, |k| [-2.0, 1.0, last][k])
}

/// The largest eigenvalue of −2, 1, 4 with what is said to be known; also how far a larger matrix is proven to reach.
fn largest(found: End, within: f64, digits: Digits, above: Option<(&SymmetricMatrix, f64)>) -> (f64, f64, f64, u64) {
    let a = three(4.0);
    let ends = [end(-2.0, 0.0), end(4.0, 0.0)];
    let mut known = Known { upper_end: Some(found), digits, above, ..Known::nothing(&a) };
    let (value, within, [factorizations, _]) =
        searched(&a, [f64::NEG_INFINITY, within], |search| search.largest(&ends, &mut known));
    (value, within[1], known.above_within, factorizations)
}

/// A bound that is near enough, or any where only what is certified is wanted, spares the factorization.
#[test]
fn an_upper_end_that_is_proven_is_not_proven_again() {
    let (inf, at) = (f64::INFINITY, end(4.0, 0.0));
    assert_eq!(largest(at, 4.0 + MARGIN, Digits::All, None), (4.0, 4.0 + MARGIN, inf, 0));
    assert_eq!(largest(at, 4.0 + 1.5 * MARGIN, Digits::All, None), (4.0, 4.0 + MARGIN, inf, 1));
    assert_eq!(largest(at, 7.0, Digits::Certified, None), (4.0, 7.0, inf, 0));
    assert_eq!(largest(at, inf, Digits::Certified, None), (4.0, 4.0 + MARGIN, inf, 1));
}

/// Where a larger matrix is thought to end within half the margin, it is the one that is factored; what was thought may be wrong.
#[test]
fn a_larger_matrix_proves_both_ends() {
    let (inf, at, proven) = (f64::INFINITY, end(4.0, 0.0), 4.0 + MARGIN);
    let (near, far) = (4.0 + 0.45 * MARGIN, 4.0 + 0.55 * MARGIN);
    let larger = three(near);
    assert_eq!(largest(at, inf, Digits::All, Some((&larger, near))), (4.0, proven, proven, 1));
    assert_eq!(largest(at, inf, Digits::All, Some((&larger, far))), (4.0, proven, inf, 1));
    assert_eq!(largest(at, inf, Digits::All, Some((&three(5.0), near))), (4.0, proven, inf, 2));
}

/// An upper end that products have missed: what they leave open is proven where it is little, else the end is searched for.
#[test]
fn an_upper_end_may_be_as_uncertain_as_a_ten_thousandth() {
    let inf = f64::INFINITY;
    let found = 3.9999;
    assert_eq!(largest(end(found, 2e-4), inf, Digits::All, None), (found, found + 2e-4, inf, 2));
    // Refused at the margin; accepted at 4.08 and at the end.
    for residual in [1e-3, 1e-7, MARGIN] {
        let (value, within, _, factorizations) = largest(end(found, residual), inf, Digits::All, None);
        assert!((value - 4.0).abs() < 1e-12 && (within - 4.0 - MARGIN).abs() < 1e-12, "{value} {within}");
        assert_eq!(factorizations, 3, "{residual}");
    }
    // Refused where the residual says it ends, too.
    assert_eq!(largest(end(found, 5e-5), inf, Digits::All, None).3, 4);
}

/// From zero outwards by a part of the size, doubled until all pivots have one sign.
#[test]
fn shifts_retreat_until_they_are_beyond_the_end() {
    let ends = [end(0.0, 0.0), end(4.0, 0.0)];
    let beyond = |lowest: f64| {
        let a = diagonal(3, |k| [lowest, 1.0, 4.0][k]);
        let (shift, _, [factorizations, _]) = searched(&a, ANYWHERE, |search| search.factor_beyond(&ends, Side::Below));
        (shift, factorizations)
    };
    assert_eq!(beyond(1.0), (Some(-4e-8), 1));
    assert_eq!(beyond(-1e-7), (Some(-16e-8), 3));
}

/// A search from 0.9 takes 1 for the lowest eigenvalue. The shift then retreats from 1 by a sixteenth of the 0.1, doubled until it is
/// beyond the true end, but not by more than four times the size.
#[test]
fn a_search_that_began_inside_the_spectrum_finds_its_end() {
    let found = |lowest: f64| {
        let a = diagonal(3, |k| [lowest, 1.0, 4.0][k]);
        let ends = [end(-2.0, 0.0), end(4.0, 0.0)];
        let accuracy = [ACCURACY, f64::INFINITY];
        let target = Target { side: Side::Below, shift: 0.9, wanted: 1, due: 0, accuracy, digits: Digits::Certified };
        let (pairs, within, work) = searched(&a, ANYWHERE, |search| {
            assert!(!search.is_beyond(0.9, Side::Below));
            search.extreme(&ends, &target)
        });
        (pairs[0].value, within[0], work)
    };
    // At 0.9, at 1, then from 1 by 0.00625 to 3.2 or 12.8, and at the end; three solves fill the space, twice.
    for (lowest, factorizations) in [(-2.0, 13), (-9.0, 15)] {
        let (value, within, work) = found(lowest);
        assert!((value - lowest).abs() < 1e-10 && (within - lowest + MARGIN).abs() < 1e-10, "{value} {within}");
        assert_eq!(work, [factorizations, 6]);
    }
    let (value, within, work) = found(-20.0);
    assert!((value - 1.0).abs() < 1e-10 && within == f64::NEG_INFINITY);
    assert_eq!(work, [14, 3]);
}

/// A thousandth of λ_min is certified where that is less than a part of ‖A‖.
#[test]
fn the_low_end_of_a_definite_matrix_is_certified_relatively() {
    let a = diagonal(3, |k| [1e-6, 1.0, 4.0][k]);
    let ends = [end(0.0, 0.0), end(4.0, 0.0)];
    let (pairs, within, work) = searched(&a, ANYWHERE, |search| search.lowest(0, 1, Digits::All, &ends));
    assert!((pairs[0].value - 1e-6).abs() < 1e-15 && (within[0] / 0.999e-6 - 1.0).abs() < 1e-6);
    // Zero and the certificate; the space is filled for each.
    assert_eq!(work, [2, 6]);
}

/// −2 and otherwise 1: four random vectors and one residual hold the whole eigenvector. Six times −2: four random vectors hold no more
/// than four of them, but as many are looked for as there are.
#[test]
fn as_many_negative_eigenvalues_are_found_as_are_due() {
    let lowest = |count: usize, digits: Digits| {
        let a = diagonal(60, |k| if k < count { -2.0 } else { 1.0 + (k as f64 / 60.0) * (count > 1) as u8 as f64 });
        let ends = [end(-2.0, 0.0), end(1.0, 0.0)];
        let found = searched(&a, ANYWHERE, |search| search.lowest(count, count, digits, &ends));
        let (pairs, _, work): (Vec<Eigenpair>, _, _) = found;
        assert!(pairs.len() == count && pairs.iter().all(|pair| (pair.value + 2.0).abs() < 1e-6), "{pairs:?}");
        work
    };
    assert_eq!(lowest(1, Digits::Certified), [2, 5]);
    lowest(6, Digits::All);
}

/// Of a large matrix a bound within a hundredth of λ_min will do.
#[test]
fn a_bound_of_a_large_matrix_spares_the_certificate() {
    let a = diagonal(10_002, |k| if k == 0 { 2.0 } else { 4.0 });
    let ends = [end(2.0, 0.0), end(4.0, 0.0)];
    for (bound, work) in [(1.99, [1, 5]), (1.97, [2, 5]), (1.0, [2, 5])] {
        let within = [bound, f64::INFINITY];
        let (pairs, _, found) = searched(&a, within, |search| search.lowest(0, 1, Digits::Certified, &ends));
        assert!((pairs[0].value - 2.0).abs() < 1e-9);
        assert_eq!(found, work, "{bound}");
    }
}

struct Counted {
    order: usize,
    products: Cell<usize>,
}

impl LinearOperator for Counted {
    fn order(&self) -> usize {
        self.order
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        self.products.set(self.products.get() + 1);
        y.iter_mut().zip(w).enumerate().for_each(|(k, (y, w))| *y = k as f64 * w);
    }
}

#[test]
fn large_matrices_have_twice_as_many_products() {
    for (order, products) in [(600, 240), (LARGE - 1, 240), (LARGE, 480), (LARGE + 1, 480)] {
        let counted = Counted { order, products: Cell::new(0) };
        upper_end(&counted);
        assert_eq!(counted.products.get(), products, "{order}");
    }
}

/// −2, 1 and otherwise 4.
fn sixty() -> SymmetricMatrix {
    diagonal(60, |k| [-2.0, 1.0].get(k).copied().unwrap_or(4.0))
}

/// A search below −3 that finds −2 has the negative eigenvalue that is due. One more is not there: it is looked for once more with each of
/// those that are due.
#[test]
fn what_is_due_is_looked_for_again() {
    let solves = |wanted: usize, due: usize, lowest: f64| {
        let a = diagonal(60, |k| if k == 0 { lowest } else { 4.0 });
        let (accuracy, digits) = ([ACCURACY, f64::INFINITY], Digits::Certified);
        let target = Target { side: Side::Below, shift: -3.0, wanted, due, accuracy, digits };
        let (pairs, _, [_, solves]) = searched(&a, ANYWHERE, |search| {
            assert!(search.is_beyond(-3.0, Side::Below));
            search.search(&target, Vec::new(), 1e-3, 20)
        });
        assert!((pairs[0].value - lowest).abs() < 1e-3);
        solves
    };
    let once = solves(1, 0, -2.0);
    assert_eq!(solves(1, 1, -2.0), once);
    for lowest in [1.0, 2.0] {
        let once = solves(1, 0, lowest);
        let again = solves(1, 1, lowest);
        assert!(again >= once + 4 && again < once + 20, "{once} {again}");
    }
}

/// What is found with a shift that has been moved is told by that shift: no negative eigenvalue is missed, so none is looked for again.
#[test]
fn eigenvalues_are_told_by_the_shift_that_found_them() {
    let a = sixty();
    let ends = [end(-2.0, 0.0), end(4.0, 0.0)];
    for digits in [Digits::Certified, Digits::All] {
        let work = |due: usize| {
            let accuracy = [ACCURACY, f64::INFINITY];
            let target = Target { side: Side::Below, shift: 0.9, wanted: 1, due, accuracy, digits };
            let (pairs, _, work) = searched(&a, ANYWHERE, |search| {
                assert!(!search.is_beyond(0.9, Side::Below));
                search.extreme(&ends, &target)
            });
            assert!((pairs[0].value + 2.0).abs() < 1e-9);
            work
        };
        let first = |due: usize| {
            let accuracy = [ACCURACY, f64::INFINITY];
            let target = Target { side: Side::Below, shift: 0.9, wanted: 1, due, accuracy, digits };
            let (_, _, [_, solves]) = searched(&a, ANYWHERE, |search| {
                assert!(!search.is_beyond(0.9, Side::Below));
                search.search(&target, Vec::new(), digits.tolerance(), STEPS + 1)
            });
            solves
        };
        // The first, from inside the spectrum, looks again, the others do not.
        let ([factorizations, solves], more) = (work(0), first(1) - first(0));
        assert!(more > 0);
        assert_eq!(work(1), [factorizations, solves + more], "{digits:?}");
    }
}

#[test]
fn every_wanted_pair_adds_a_step() {
    assert_eq!((longest(20, 1), longest(5, 12)), (21, 17));
}
