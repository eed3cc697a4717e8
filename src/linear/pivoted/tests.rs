use super::*;
use crate::linear::fixtures::{banded, noise};
use crate::operator::LinearOperator;
use faer::Par;

fn factored(a: &SymmetricMatrix, pivoting: Pivoting) -> PivotedLdlt {
    let mut factorization = PivotedLdlt::analyse(a.pattern(), Par::Seq).unwrap();
    factorization.factor(a, pivoting);
    factorization
}

fn blocks_of_two(factorization: &PivotedLdlt) -> usize {
    let mut blocks = 0;
    for s in supernodes(&factorization.analysis.symbolic) {
        factorization.for_each_block(s, |_, block| blocks += usize::from(matches!(block, Block::Two(_))));
    }
    blocks
}

/// The largest `|A W − L B Lᵀ W|` for two columns W of numbers up to one.
fn error(a: &SymmetricMatrix, factorization: &PivotedLdlt) -> f64 {
    let w: Vec<[f64; 2]> = (0..a.order()).map(|row| [noise(row, 1), noise(2, row)]).collect();
    let mut y = vec![[f64::NAN; 2]; w.len()];
    factorization.multiply(&w, &mut y);
    let mut error = 0.0;
    for column in 0..2 {
        let mut exact = vec![0.0; w.len()];
        a.apply(&w.iter().map(|w| w[column]).collect::<Vec<_>>(), &mut exact);
        assert!(y.iter().all(|y| y[column].is_finite()));
        error = exact.iter().zip(&y).fold(error, |error, (exact, y)| f64::max(error, (exact - y[column]).abs()));
    }
    error
}

/// Zero, and what is not a number, has no sign.
#[test]
fn pivots_are_counted_by_sign() {
    let mut signs = PivotSigns::default();
    [0.0, -0.0, f64::NAN, 3.0, f64::INFINITY, -1e-300].iter().for_each(|&pivot| signs.count(pivot));
    assert_eq!(signs, PivotSigns { negative: 1, zero: 3, positive: 2 });
}

/// Eigenvalues by hand: `[2 1; 1 3]` has determinant 5 and trace 5, `[-2 1; 1 -3]` the opposite eigenvalues, `[1 1; 1 1]` has
/// 0 and 2, `[0 1; 1 0]` has ±1, `[1 2; 2 3]` has determinant −1. What counts is the ratio of the entries, even where their
/// products or sums overflow.
#[test]
fn pairs_are_counted_by_the_signs_of_their_eigenvalues() {
    for ([a, b, c], [negative, zero, positive]) in [
        ([2.0, 1.0, 3.0], [0, 0, 2]),
        ([-2.0, 1.0, -3.0], [2, 0, 0]),
        ([1.0, 1.0, 1.0], [0, 1, 1]),
        ([-1.0, 1.0, -1.0], [1, 1, 0]),
        ([0.0, 1.0, 0.0], [1, 0, 1]),
        ([1.0, 2.0, 3.0], [1, 0, 1]),
        ([1.5e308, 1e308, 1.5e308], [0, 0, 2]),
        ([3e-300, 2e-300, -3e-300], [1, 0, 1]),
    ] {
        let mut signs = PivotSigns::default();
        signs.count_pair(a, b, c);
        assert_eq!(signs, PivotSigns { negative, zero, positive }, "[{a} {b}; {b} {c}]");
    }
}

/// `[0 B; Bᵀ 0]` with an invertible B has as many positive eigenvalues as negative ones; no pivot on its diagonal is of use.
#[test]
fn a_zero_diagonal_takes_blocks_of_order_two() {
    let b = [[2.0, 1.0, 0.5], [0.25, 3.0, 1.0], [1.0, 0.5, 4.0]];
    let a =
        banded(2, 1, |row, column| if row / 3 == column / 3 { 0.0 } else { b[row.min(column)][row.max(column) - 3] });
    let factorization = factored(&a, Pivoting::InSupernodes);
    assert_eq!(factorization.signs(), PivotSigns { negative: 3, zero: 0, positive: 3 });
    assert_eq!(blocks_of_two(&factorization), 3);
    assert!(error(&a, &factorization) < 1e-14);
}

/// `L B Lᵀ` is A to rounding: of a definite matrix without pivoting, and of an indefinite one, with a small diagonal, with it. Many
/// supernodes with rows below them, and one alone.
#[test]
fn products_of_the_factors_are_those_of_the_matrix() {
    for (particles, reach) in [(1, 0), (4, 3), (60, 2)] {
        let a = banded(particles, reach, |row, column| noise(row, column) + if row == column { 20.0 } else { 0.0 });
        let factorization = factored(&a, Pivoting::None);
        assert_eq!(supernodes(&factorization.analysis.symbolic).count() > 1, particles > 4);
        assert!(error(&a, &factorization) < 1e-13);
        assert_eq!(factorization.signs(), PivotSigns { negative: 0, zero: 0, positive: 3 * particles });
        let a = banded(particles, reach, |row, column| noise(row, column) * if row == column { 0.1 } else { 1.0 });
        let factorization = factored(&a, Pivoting::InSupernodes);
        assert!(blocks_of_two(&factorization) > 0);
        assert!(error(&a, &factorization) < 1e-11, "{}", error(&a, &factorization));
        let PivotSigns { negative, zero, positive } = factorization.signs();
        assert_eq!([zero, negative + positive], [0, 3 * particles]);
    }
}

/// A factorization knows nothing of the one before: blocks of order 2 do not stay where the next matrix has none.
#[test]
fn a_matrix_is_factored_whatever_came_before() {
    let coupled = banded(2, 1, |row, column| if row == column { 0.0 } else { 1.0 });
    let diagonal = banded(2, 1, |row, column| if row == column { 2.0 - row as f64 % 2.0 * 5.0 } else { 0.0 });
    let mut factorization = factored(&coupled, Pivoting::InSupernodes);
    assert!(blocks_of_two(&factorization) > 0);
    factorization.factor(&diagonal, Pivoting::InSupernodes);
    assert_eq!(factorization.signs(), PivotSigns { negative: 3, zero: 0, positive: 3 });
    assert_eq!(error(&diagonal, &factorization), 0.0);
}
