//! Sweeps over several domains against dense matrices.

use super::super::block::{BadPivot, LEAST_DIAGONAL, inverse_of};
use super::super::sparse::{BlockMatrix, Pattern};
use super::{GaussSeidel, domain};
use nalgebra::{DMatrix, DVector, Matrix2};
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

/// The same couplings by springs: their blocks `k d dᵀ + t (I − d dᵀ)` on the diagonal of both rows, with a mass, and their negatives beside it.
/// Every third is pressed: its t is negative.
fn springs() -> BlockMatrix<2, 2> {
    let mut matrix = matrix();
    let spring = |row: usize, column: usize| {
        let (i, j) = (row.min(column) as f64, row.max(column) as f64);
        let d = nalgebra::Vector2::new((i + 0.3 * j).cos(), (i + 0.3 * j).sin());
        let t = if (row + column).is_multiple_of(3) { -2e-3 * (1.0 + i) } else { 1e-3 * (1.0 + i) };
        (10.0 + j - t) * d * d.transpose() + t * Matrix2::identity()
    };
    for row in 0..ROWS {
        let columns: Vec<usize> = matrix.pattern.columns(row).iter().map(|&column| column as usize).collect();
        let others = || columns.iter().filter(|&&column| column != row);
        let diagonal = others().fold(0.01 * Matrix2::identity(), |sum, &column| sum + spring(row, column));
        for (position, &column) in matrix.pattern.row(row).zip(&columns) {
            let block = if column == row { diagonal } else { -spring(row, column) };
            matrix.values[position] = [0, 1].map(|r| [0, 1].map(|c| block[(r, c)]));
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

/// The 2 × 2 block of two rows.
fn block(a: &DMatrix<f64>, row: usize, column: usize) -> Matrix2<f64> {
    a.fixed_view::<2, 2>(2 * row, 2 * column).into()
}

/// `D̃_i = D_i + ½ Σ_j S_ij` with `S_ij = −E_ij + 2m I` where that is symmetric, −m its least eigenvalue or m = 0, and otherwise `(σ₁⁴ + σ₂⁴)^¼ D_i`,
/// σ the singular values of `L_i⁻¹ E_ij L_j⁻ᵀ`.
fn damped_diagonal(a: &DMatrix<f64>) -> Vec<Matrix2<f64>> {
    let root = |row: usize| block(a, row, row).cholesky().unwrap().l().try_inverse().unwrap();
    let more = |row: usize, column: usize| {
        let e = block(a, row, column);
        if (e - e.transpose()).amax() < 1e-12 {
            return -e + 2.0 * e.symmetric_eigenvalues().max().max(0.0) * Matrix2::identity();
        }
        let measured = root(row) * e * root(column).transpose();
        let norm = measured.singular_values().iter().map(|s| s.powi(4)).sum::<f64>().powf(0.25);
        norm * block(a, row, row)
    };
    let outside = |row: usize| (0..ROWS).filter(move |column| row / 3 != column / 3);
    let sum = |row: usize| outside(row).fold(Matrix2::zeros(), |sum, column| sum + more(row, column));
    (0..ROWS).map(|row| block(a, row, row) + 0.5 * sum(row)).collect()
}

/// `M = D̃ + L`.
fn splitting(a: &DMatrix<f64>, diagonal: &[Matrix2<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(ORDER, ORDER, |r, c| match () {
        () if r / 2 == c / 2 => diagonal[r / 2][(r % 2, c % 2)],
        () if c < r && r / 6 == c / 6 => a[(r, c)],
        () => 0.0,
    })
}

/// A sweep is never too long: `M + Mᵀ − A` is positive definite however large the blocks outside are. Without damping it is not.
#[test]
fn smoothing_converges_whatever_the_domains_are() {
    let cases = [(matrix(), 0.5, false), (matrix(), 10.0, true), (matrix(), -10.0, true)];
    for (matrix, times, is_needed) in cases.into_iter().chain([(springs(), 1.0, false), (springs(), 3.0, true)]) {
        let outside = |r: usize, c: usize| if r / 6 == c / 6 { 1.0 } else { times };
        let a = dense(&matrix);
        let a = DMatrix::from_fn(ORDER, ORDER, |r, c| outside(r, c) * a[(r, c)]);
        let undamped: Vec<_> = (0..ROWS).map(|row| block(&a, row, row)).collect();
        let [damped, undamped] = [damped_diagonal(&a), undamped].map(|diagonal| {
            let m = splitting(&a, &diagonal);
            (&m + m.transpose() - &a).symmetric_eigenvalues().min()
        });
        assert!(damped > 0.0 && (undamped < 0.0) == is_needed, "{times}: {damped} {undamped}");
    }
}

/// Smoothing does not depend on the axes, which may differ from row to row where blocks are not those of springs.
#[test]
fn axes_do_not_matter() {
    assert_axes_do_not_matter(&springs(), &|_| 0.3);
    assert_axes_do_not_matter(&matrix(), &|row| 0.3 + row as f64);
}

fn assert_axes_do_not_matter(matrix: &BlockMatrix<2, 2>, angle: &dyn Fn(usize) -> f64) {
    let axes: Vec<Matrix2<f64>> = (0..ROWS).map(|row| nalgebra::Rotation2::new(angle(row)).into_inner()).collect();
    let mut turned = matrix.clone();
    for row in 0..ROWS {
        for position in matrix.pattern.row(row) {
            let column = matrix.pattern.columns(row)[position - matrix.pattern.row(row).start] as usize;
            let entries = Matrix2::from_fn(|r, c| matrix.values[position][r][c]);
            let entries = axes[row] * entries * axes[column].transpose();
            turned.values[position] = [0, 1].map(|r| [0, 1].map(|c| entries[(r, c)]));
        }
    }
    let turn = |x: &[[f32; 2]]| -> Vec<[f32; 2]> {
        let turn = |(axes, x): (&Matrix2<f64>, &[f32; 2])| {
            (axes * nalgebra::Vector2::from(x.map(f64::from))).map(|x| x as f32)
        };
        axes.iter().zip(x).map(turn).map(<[f32; 2]>::from).collect()
    };
    let b: Vec<[f32; 2]> = (0..ROWS).map(|row| [1.0 + row as f32, -2.0 * row as f32]).collect();
    let smoothed = |matrix: &BlockMatrix<2, 2>, b: &[[f32; 2]]| {
        let mut smoother = GaussSeidel::<2>::with_domains(&matrix.pattern, 3).unwrap();
        smoother.update(matrix, 1.0).unwrap();
        let (mut x, mut r) = (vec![[0.0; 2]; ROWS], vec![[0.0; 2]; ROWS]);
        smoother.forward(b, &mut x, &mut r);
        smoother.backward(&r, &mut x);
        x
    };
    assert_near(&smoothed(&turned, &turn(&b)), &vector(&turn(&smoothed(matrix, &b))));
}

#[test]
fn sweeps_over_domains_are_their_formulas() {
    [matrix(), springs()].iter().for_each(assert_sweeps_are_their_formulas);
}

fn assert_sweeps_are_their_formulas(matrix: &BlockMatrix<2, 2>) {
    const FACTOR: f64 = 0.25;
    let a = FACTOR * dense(matrix);
    let m = splitting(&a, &damped_diagonal(&a));
    let inverse = m.try_inverse().unwrap();

    let mut smoother = GaussSeidel::<2>::with_domains(&matrix.pattern, 3).unwrap();
    smoother.update(matrix, FACTOR).unwrap();
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

/// In row 4 the block is [[1, 2], [2, 1]], whose second pivot is 1 − 2². At the border of a domain, where springs add to the diagonal, it is refused
/// too.
#[test]
fn the_first_block_that_is_not_definite_is_named() {
    for (mut matrix, domain) in [(matrix(), ROWS), (matrix(), 3), (springs(), 3)] {
        let diagonal = |row: usize| {
            let of_row = matrix.pattern.row(row);
            of_row.start + matrix.pattern.columns(row).iter().position(|&column| column == row as u32).unwrap()
        };
        let places = [4, 5].map(diagonal);
        for place in places {
            matrix.values[place] = [[1.0, 2.0], [2.0, 1.0]];
        }
        let mut smoother = GaussSeidel::<2>::with_domains(&matrix.pattern, domain).unwrap();
        let bad = BadPivot { index: 1, pivot: -3.0 };
        assert_eq!(smoother.update(&matrix, 1.0), Err((4, bad)));
    }
}

#[test]
fn domains_have_eight_thousand_rows_and_are_sixteen_at_most() {
    let found = [0, 1, 8191, 16_383, 16_384, 16_385, 24_576, 131_072, 200_000].map(domain);
    assert_eq!(found, [1, 1, 8191, 16_383, 8192, 8193, 8192, 8192, 12_500]);
}

/// A row without any entry gets a diagonal, however small.
#[test]
fn empty_rows_are_not_refused() {
    let found = inverse_of(&[[0.0, 0.0], [0.0, 4.0]]).unwrap();
    assert!((found[0][0] * LEAST_DIAGONAL - 1.0).abs() < 1e-12 && (found[1][1] * 4.0 - 1.0).abs() < 1e-12, "{found:?}");
}

/// Eight rows in a line, in domains of four: the fourth and the fifth alone have a block outside, and a diagonal one.
#[test]
fn rows_inside_a_domain_have_nothing_outside() {
    let rows = 8;
    let line = Pattern::build(rows, |row, columns| {
        columns.extend((row.saturating_sub(1)..rows.min(row + 2)).map(|column| column as u32));
    });
    let smoother = GaussSeidel::<2>::with_domains(&line.unwrap(), 4).unwrap();
    let outside = &smoother.outside.pattern;
    let columns: Vec<&[u32]> = (0..rows).map(|row| outside.columns(row)).collect();
    assert_eq!(columns, [&[][..], &[], &[], &[3, 4], &[3, 4], &[], &[], &[]]);
}
