//! Small matrices with vanishing pivots and no vanishing eigenvalues, and what is factored and solved for them.

use super::BESIDE;
use crate::assembly::SymmetricMatrix;
use crate::inspect::search::Search;
use crate::linear::Ldlt;
use crate::linear::fixtures::banded;
use crate::work::Work;
use faer::Par;

/// The smallest |λ| as it is found, the factorizations and the solves.
fn nearest(a: &SymmetricMatrix, size: f64) -> (f64, [u64; 2]) {
    let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
    let mut work = Work::default();
    let found = Search::new(a, a, &mut factorization, &mut work).nearest_to_zero(size);
    (found, [work.factorizations, work.solves])
}

/// `scale` times a matrix of 2×2 blocks `[d v; v d]`, whose eigenvalues are d ± v, and of single entries 5 after each.
fn pairs(scale: f64, blocks: &[[f64; 2]]) -> SymmetricMatrix {
    banded(blocks.len(), 0, |row, column| {
        let [d, v] = blocks[row / 3];
        scale
            * match (row % 3, column % 3) {
                (0, 0) | (1, 1) => d,
                (0, 1) | (1, 0) => v,
                (2, 2) => 5.0,
                _ => 0.0,
            }
    })
}

/// A solve to try it, and two for each of the three vectors that fill the space.
#[test]
fn a_matrix_that_solves_is_factored_once() {
    let a = banded(1, 0, |row, column| if row == column { [-2.0, 1.5, 4.0][row] } else { 0.0 });
    let (found, work) = nearest(&a, 4.0);
    assert!((found - 1.5).abs() < 1e-12);
    assert_eq!(work, [1, 7]);
}

/// A pivot of zero: a matrix beside it is factored, on one side or the other, and each solve refined three times.
#[test]
fn where_a_pivot_vanishes_a_matrix_beside_is_factored() {
    for scale in [1.0, 2f64.powi(-20), 2f64.powi(20)] {
        let size = 5.0 * scale;
        let (found, work) = nearest(&pairs(scale, &[[0.0, 2.0]]), size);
        assert!((found / (2.0 * scale) - 1.0).abs() < 1e-8, "{found} {scale}");
        assert_eq!(work, [2, 28]);
        // The pivot of the second block vanishes on that side.
        let (found, [factorizations, _]) = nearest(&pairs(scale, &[[0.0, 2.0], [BESIDE * size / scale, 3.0]]), size);
        assert!((found / (2.0 * scale) - 1.0).abs() < 1e-8, "{found} {scale}");
        assert_eq!(factorizations, 3);
    }
}

#[test]
fn a_matrix_that_cannot_be_factored_may_be_singular() {
    let beside = BESIDE * 4.0;
    let (found, work) = nearest(&pairs(1.0, &[[0.0, 2.0], [beside, 3.0], [-beside, 3.0]]), 4.0);
    assert_eq!((found, work), (0.0, [4, 0]));
}

/// A solve may be wrong by 10⁻⁷ of a right-hand side, which is 55 long here: a first pivot of 10⁻⁹ costs half of the digits, and that is enough.
#[test]
fn a_solve_to_half_of_the_digits_will_do() {
    let mut blocks = vec![[0.5, 2.0]; 1000];
    blocks[500][0] = 1e-9;
    let (found, [factorizations, _]) = nearest(&pairs(1.0, &blocks), 5.0);
    assert!((found - 1.5).abs() < 1e-6, "{found}");
    assert_eq!(factorizations, 1);
}

/// A solution 10¹⁰ times as long as its right-hand side cannot be better than its own rounding, whatever the size of the matrix.
#[test]
fn a_long_solution_may_be_wrong_by_its_rounding() {
    for scale in [2f64.powi(-20), 1.0, 2f64.powi(20)] {
        let (found, [factorizations, _]) = nearest(&pairs(scale, &[[1.0 + 1e-10, 1.0]]), 5.0 * scale);
        assert!((found / (1e-10 * scale) - 1.0).abs() < 1e-4, "{found}");
        assert_eq!(factorizations, 1, "{scale}");
    }
}

/// Three hundred eigenvalues from 1 on, a hundredth apart, every other one negative.
#[test]
fn the_nearest_of_many_is_found_to_many_digits() {
    let value = |k: usize| (1.0 + 0.01 * k as f64) * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
    let a = banded(100, 0, |row, column| if row == column { value(row) } else { 0.0 });
    let (found, _) = nearest(&a, 4.0);
    assert!((found - 1.0).abs() < 1e-8, "{found}");
}
