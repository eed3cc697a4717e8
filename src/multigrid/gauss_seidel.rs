//! The smoother: block Gauss–Seidel, forward before the coarse correction and backward after it.
//!
//! With A = L + D + Lᵀ a forward sweep from zero is `x = (D + L)⁻¹ b`, and a backward sweep `x += (D + Lᵀ)⁻¹ (b − A x)`: one is the
//! transpose of the other, which makes the preconditioner symmetric. Sweeps are sequential. To share them out, rows are cut
//! into domains, by their number alone; L keeps the blocks within a domain, and every row i adds half its sum of the
//! magnitudes of the entries E outside to its diagonal, `D̃ = D + ½ diag(Σ |E|)`. Then `M + Mᵀ − A = D + diag(Σ |E|) − E` for
//! `M = D̃ + L`, positive definite because `diag(Σ |E|) − E` is diagonally dominant: smoothing converges whatever the domains are
//! (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers for ultraparallel computing", section 6).
//!
//! The matrix is kept in single precision, times a factor that brings its entries near one. Smoothing is bound by the time
//! that reading it takes, and rounding it changes a correction by 1e-7 of itself, which conjugate gradients do not notice.

use super::block::{BadPivot, Block, apply, inverse, single, subtract_apply, zero};
use super::parallel::{for_chunks, for_each_row, for_each_sparse_row};
use super::sparse::{BlockMatrix, Pattern, Rows};
use std::sync::Arc;

/// The least rows that a domain has, and the most domains: fewer domains smooth better, more keep more threads busy.
const LEAST_ROWS: usize = 8192;
const MOST_DOMAINS: usize = 16;

/// The least that a diagonal block counts for beside the largest of the level: f32 ends at 1e38.
const LEAST_DIAGONAL: f64 = 1e-30;

/// A matrix ready for block Gauss–Seidel.
#[derive(Debug, Clone)]
pub(super) struct GaussSeidel<const N: usize> {
    /// Rows of a domain; the last may have fewer.
    domain: usize,
    matrix: BlockMatrix<N, N, f32>,
    diagonal: Vec<Diagonal<N>>,
    /// The solution before a backward sweep, for the rows of other domains.
    before: Vec<[f32; N]>,
}

/// D̃ of a row.
#[derive(Debug, Clone, Copy)]
struct Diagonal<const N: usize> {
    /// D̃⁻¹; zero where D̃ is not positive definite.
    inverse: Block<N, N, f32>,
    /// D̃ − D.
    outside: [f32; N],
}

/// A diagonal block that is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BadBlock {
    pub row: usize,
    pub bad: BadPivot,
}

impl<const N: usize> GaussSeidel<N> {
    pub fn new(pattern: Arc<Pattern>) -> Self {
        let rows = pattern.rows();
        let domains = (rows / LEAST_ROWS).clamp(1, MOST_DOMAINS);
        Self {
            domain: rows.div_ceil(domains).max(1),
            matrix: BlockMatrix::zeros(pattern),
            diagonal: vec![Diagonal { inverse: zero(), outside: [0.0; N] }; rows],
            before: vec![[0.0; N]; if domains > 1 { rows } else { 0 }],
        }
    }

    /// Takes over `factor·A`.
    ///
    /// # Errors
    /// The first diagonal block that is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), BadBlock> {
        let Self { domain, matrix, diagonal, .. } = self;
        let damped = |row: usize, visit: &mut dyn FnMut(usize, &Block<N, N>)| {
            let mut outside = [0.0; N];
            let mut block = zero();
            a.visit(row, |place, column, entries| {
                visit(place, entries);
                if column == row {
                    block = *entries;
                } else if column / *domain != row / *domain {
                    for (sum, entries) in outside.iter_mut().zip(entries) {
                        *sum += 0.5 * entries.iter().map(|entry| entry.abs()).sum::<f64>();
                    }
                }
            });
            for k in 0..N {
                block[k][k] = factor * (block[k][k] + outside[k]) + LEAST_DIAGONAL;
                for j in 0..k {
                    block[k][j] *= factor;
                }
            }
            (inverse(&block), outside)
        };
        for_each_sparse_row(&matrix.pattern, &mut matrix.values, diagonal, &|row, values, diagonal| {
            let (inverse, outside) = damped(row, &mut |place, entries| values[place] = single(factor, entries));
            let inverse = single(1.0, &inverse.unwrap_or(zero()));
            *diagonal = Diagonal { inverse, outside: outside.map(|outside| (factor * outside) as f32) };
        });
        let failed = diagonal.iter().position(|diagonal| diagonal.inverse.iter().flatten().all(|&entry| entry == 0.0));
        match failed.map(|row| (row, damped(row, &mut |_, _| {}))) {
            Some((row, (Err(bad), _))) => Err(BadBlock { row, bad }),
            _ => Ok(()),
        }
    }

    /// An estimate of `λ_max(D̃⁻¹A)`: the growth in some iterations of the power method, which `vector` starts and keeps.
    pub fn largest_eigenvalue(&self, iterations: usize, vector: &mut [[f32; N]], product: &mut [[f32; N]]) -> f64 {
        let mut growth = 1.0;
        for _ in 0..iterations {
            for_each_row(product, |row, y| {
                let mut sum = [0.0; N];
                for (column, a) in self.matrix.row(row) {
                    subtract_apply(&mut sum, a, &vector[column]);
                }
                *y = apply(&self.diagonal[row].inverse, &sum);
            });
            growth = norm(product) / norm(vector);
            let scale = (1.0 / norm(product)) as f32;
            for_each_row(vector, |row, x| *x = product[row].map(|y| y * scale));
        }
        growth
    }

    /// Columns and blocks of a row of `factor·A`.
    #[inline(always)]
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &Block<N, N, f32>)> {
        self.matrix.row(row)
    }

    /// `D̃⁻¹` of a row of `factor·A`.
    #[inline(always)]
    pub fn inverse(&self, row: usize) -> &Block<N, N, f32> {
        &self.diagonal[row].inverse
    }

    /// `x = M⁻¹ b`, a forward sweep from zero.
    pub fn forward(&self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        for_chunks(x, self.domain, |start, x| {
            for i in 0..x.len() {
                let row = start + i;
                let mut sum = b[row];
                for (column, a) in self.matrix.row(row) {
                    if column >= row {
                        break;
                    }
                    if column >= start {
                        subtract_apply(&mut sum, a, &x[column - start]);
                    }
                }
                x[i] = apply(&self.diagonal[row].inverse, &sum);
            }
        });
    }

    /// `r = b − A x` after a forward sweep from zero, from what the sweep left out: `b − (D̃ + L) x = 0`.
    pub fn residual(&self, x: &[[f32; N]], r: &mut [[f32; N]]) {
        for_each_row(r, |row, r| {
            let start = row / self.domain * self.domain;
            let mut sum: [f32; N] = std::array::from_fn(|k| self.diagonal[row].outside[k] * x[row][k]);
            for (column, a) in self.matrix.row(row) {
                if column > row || column < start {
                    subtract_apply(&mut sum, a, &x[column]);
                }
            }
            *r = sum;
        });
    }

    /// `x += M⁻ᵀ (b − A x)`, a backward sweep.
    pub fn backward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let Self { domain, matrix, diagonal, before } = self;
        before.iter_mut().zip(&*x).for_each(|(before, x)| *before = *x);
        for_chunks(x, *domain, |start, x| {
            let end = start + x.len();
            for row in (start..end).rev() {
                let Diagonal { inverse, outside } = &diagonal[row];
                let mut sum: [f32; N] = std::array::from_fn(|k| b[row][k] + outside[k] * x[row - start][k]);
                for (column, a) in matrix.row(row).rev() {
                    if column == row {
                        continue;
                    }
                    let x = if (start..end).contains(&column) { &x[column - start] } else { &before[column] };
                    subtract_apply(&mut sum, a, x);
                }
                x[row - start] = apply(inverse, &sum);
            }
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.matrix.pattern.bytes() + self.matrix.bytes() + size_of_val(&self.diagonal[..]) + size_of_val(&self.before[..])
    }
}

fn norm<const N: usize>(x: &[[f32; N]]) -> f64 {
    x.as_flattened().iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt()
}
