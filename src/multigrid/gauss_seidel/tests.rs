//! Sweeps over several domains against dense matrices.

use super::super::block::BadPivot;
use super::super::sparse::{BlockMatrix, Pattern};
use super::{BadBlock, GaussSeidel, LEAST_DIAGONAL, damped, domain};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

const ROWS: usize = 7;
const ORDER: usize = 2 * ROWS;

/// Seven rows of 2 × 2 blocks, every row coupled to the next and to the third after it; domains of three rows: 0–2, 3–5, and 6.
fn matrix() -> BlockMatrix<2, 2> {
    let is_coupled = |i: usize, j: usize| matches!(i.abs_diff(j), 0 | 1 | 3);
    let pattern = Pattern::build(ROWS, |row, columns| {
        columns.extend((0..ROWS).filter(|&column| is_coupled(row, column)).map(|column| column as u32));
    });
    let mut matrix = BlockMatrix::zeros(Arc::new(pattern.unwrap()));
    for row in 0..ROWS {
        for position in matrix.pattern.row(row) {
            let column = matrix.pattern.columns(row)[position - matrix.pattern.row(row).start] as usize;
            for r in 0..2 {
                for c in 0..2 {
                    // Symmetric: the same for (row, r) and (column, c) in either order.
                    let (i, j) = (2 * row + r, 2 * column + c);
                    matrix.values[position][r][c] =
                        if i == j { 20.0 + i as f64 } else { ((i.min(j) * 5 + i.max(j) * 3) % 7) as f64 - 3.5 };
                }
            }
        }
    }
    matrix
}

fn dense(matrix: &BlockMatrix<2, 2>) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(ORDER, ORDER);
    for row in 0..ROWS {
        for (column, block) in matrix.row(row) {
            (0..4).for_each(|at| dense[(2 * row + at / 2, 2 * column + at % 2)] = block[at / 2][at % 2]);
        }
    }
    dense
}

fn vector(blocks: &[[f32; 2]]) -> DVector<f64> {
    DVector::from_iterator(ORDER, blocks.as_flattened().iter().map(|&entry| f64::from(entry)))
}

fn assert_near(found: &[[f32; 2]], expected: &DVector<f64>) {
    assert!((vector(found) - expected).amax() <= 1e-5 * expected.amax(), "{found:?} {expected}");
}

#[test]
fn sweeps_over_domains_are_their_formulas() {
    const FACTOR: f64 = 0.25;
    let matrix = matrix();
    let a = FACTOR * dense(&matrix);
    let within = |r: usize, c: usize| r / 6 == c / 6;
    // D̃ = D + ½ diag(Σ |E|), M = D̃ + L.
    let m = DMatrix::from_fn(ORDER, ORDER, |r, c| {
        let outside: f64 = (0..ORDER).filter(|&c| !within(r, c)).map(|c| a[(r, c)].abs()).sum();
        match () {
            () if r == c => a[(r, c)] + 0.5 * outside,
            () if r / 2 == c / 2 || (c < r && within(r, c)) => a[(r, c)],
            () => 0.0,
        }
    });
    let inverse = m.try_inverse().unwrap();

    let mut smoother = GaussSeidel::<2>::with_domains(&matrix.pattern, 3).unwrap();
    smoother.update(&matrix, FACTOR).unwrap();
    let b: Vec<[f32; 2]> = (0..ROWS).map(|row| [1.0 + row as f32, -2.0 * row as f32]).collect();
    let (mut x, mut r) = (vec![[9.0; 2]; ROWS], vec![[9.0; 2]; ROWS]);
    smoother.forward(&b, &mut x, &mut r);
    let expected = &inverse * vector(&b);
    assert_near(&x, &expected);
    assert_near(&r, &(vector(&b) - &a * &expected));

    let mut x: Vec<[f32; 2]> = (0..ROWS).map(|row| [0.5 - row as f32, 0.25]).collect();
    let expected = vector(&x) + inverse.transpose() * (vector(&b) - &a * vector(&x));
    smoother.backward(&b, &mut x);
    assert_near(&x, &expected);
}

/// In row 4 the block is [[1, 2], [2, 1]], whose second pivot is 1 − 2².
#[test]
fn the_first_block_that_is_not_definite_is_named() {
    let mut matrix = matrix();
    let diagonal = |row: usize| {
        let of_row = matrix.pattern.row(row);
        of_row.start + matrix.pattern.columns(row).iter().position(|&column| column == row as u32).unwrap()
    };
    let places = [4, 5].map(diagonal);
    for place in places {
        matrix.values[place] = [[1.0, 2.0], [2.0, 1.0]];
    }
    let mut smoother = GaussSeidel::<2>::with_domains(&matrix.pattern, ROWS).unwrap();
    let bad = BadPivot { index: 1, pivot: -3.0 };
    assert_eq!(smoother.update(&matrix, 1.0), Err(BadBlock { row: 4, bad }));
}

#[test]
fn domains_have_eight_thousand_rows_and_are_sixteen_at_most() {
    let found = [0, 1, 8191, 16_383, 16_384, 16_385, 24_576, 131_072, 200_000].map(domain);
    assert_eq!(found, [1, 1, 8191, 16_383, 8192, 8193, 8192, 8192, 12_500]);
}

/// A row without any entry gets a diagonal, however small.
#[test]
fn empty_rows_are_not_refused() {
    let found = damped(&[[0.0, 0.0], [0.0, 2.0]], 1.0, &[0.0, 1.0]).unwrap();
    assert!((found[0][0] * LEAST_DIAGONAL - 1.0).abs() < 1e-12 && (found[1][1] * 3.0 - 1.0).abs() < 1e-12, "{found:?}");
}

/// Of ten couplings four lie within a domain: these are kept once, the others for both of their rows. Offsets take 8 bytes, column numbers and
/// single numbers 4; every row has an inverse and two sums, and two numbers to work with.
#[test]
fn memory_is_that_of_both_parts() {
    let smoother = GaussSeidel::<2>::with_domains(&matrix().pattern, 3).unwrap();
    let part = |blocks: usize| 8 * 8 + blocks * (4 + 4 * 4);
    assert_eq!(smoother.bytes(), part(4) + part(12) + 7 * (4 + 2) * 4 + 7 * 2 * 4);
}
