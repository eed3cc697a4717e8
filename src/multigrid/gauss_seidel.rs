//! The smoother: block Gauss–Seidel, forward before the coarse correction and backward after it.
//!
//! With A = L + D + Lᵀ a forward sweep from zero is `x = (D + L)⁻¹ b`, and a backward sweep `x += (D + Lᵀ)⁻¹ (b − A x)`: one is the
//! transpose of the other, which makes the preconditioner symmetric. Sweeps are sequential. To share them out, rows are cut
//! into domains, by their number alone; L keeps the blocks within a domain, and every row i adds half its sum of the
//! magnitudes of the entries E outside to its diagonal, `D̃ = D + ½ diag(Σ |E|)`. Then `M + Mᵀ − A = D + diag(Σ |E|) − E` for
//! `M = D̃ + L`, positive definite because `diag(Σ |E|) − E` is diagonally dominant: smoothing converges whatever the domains are
//! (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers for ultraparallel computing", section 6).
//!
//! Smoothing takes the time of reading the matrix, so little of it is kept, and in single precision, times a factor that brings
//! its entries near one: rounding changes a correction by 1e-7 of itself, which conjugate gradients do not notice. Of the two
//! triangles one is kept. A sweep reads each of its blocks once and uses it twice, for its row and, transposed, for its
//! column: a forward sweep leaves the residual behind as it goes,
//!
//! ```text
//! r = b − A x = (D̃ − D) x − Lᵀ x − E x,
//! ```
//!
//! and a backward sweep takes L x of the old x from the rows that it has not reached yet and Lᵀ x of the new x from those that
//! it has.

use super::block::{BadPivot, Block, add_transposed_apply, apply, inverse, single, subtract_apply, zero};
use super::parallel::{for_chunks, for_each_row, for_each_sparse_row};
use super::sparse::{BlockMatrix, Pattern, Rows};
use crate::error::Result;
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
    /// L.
    lower: BlockMatrix<N, N, f32>,
    /// E.
    outside: BlockMatrix<N, N, f32>,
    diagonal: Vec<Diagonal<N>>,
    /// b, the D̃ − D and E of a backward sweep, and then what is left of it.
    rest: Vec<[f32; N]>,
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
    /// For matrices of a pattern.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(pattern: &Pattern) -> Result<Self> {
        Self::with_domains(pattern, domain(pattern.rows()))
    }

    /// With so many rows a domain.
    fn with_domains(pattern: &Pattern, domain: usize) -> Result<Self> {
        let rows = pattern.rows();
        let part = |belongs: &dyn Fn(usize, usize) -> bool| {
            Pattern::build(rows, |row, columns| {
                columns.extend(pattern.columns(row).iter().filter(|&&column| belongs(row, column as usize)));
            })
        };
        let lower = part(&|row, column| column < row && column / domain == row / domain)?;
        let outside = part(&|row, column| column / domain != row / domain)?;
        Ok(Self {
            domain,
            lower: BlockMatrix::zeros(Arc::new(lower)),
            outside: BlockMatrix::zeros(Arc::new(outside)),
            diagonal: vec![Diagonal { inverse: zero(), outside: [0.0; N] }; rows],
            rest: vec![[0.0; N]; rows],
        })
    }

    /// Takes over `factor·A`.
    ///
    /// # Errors
    /// The first diagonal block that is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), BadBlock> {
        let Self { domain, lower, outside, diagonal, .. } = self;
        let domain_of = |row: usize| row / *domain;
        for_each_sparse_row(
            &lower.pattern,
            &mut lower.values,
            diagonal,
            #[inline(always)]
            |row, lower, diagonal| {
                let mut lower = lower.iter_mut();
                let mut magnitudes = [0.0; N];
                let mut block = zero();
                a.visit(
                    row,
                    #[inline(always)]
                    |column, entries| {
                        if column == row {
                            block = *entries;
                        } else if domain_of(column) != domain_of(row) {
                            for (sum, entries) in magnitudes.iter_mut().zip(entries) {
                                *sum += 0.5 * factor * entries.iter().map(|entry| entry.abs()).sum::<f64>();
                            }
                        } else if column < row
                            && let Some(place) = lower.next()
                        {
                            *place = single(factor, entries);
                        }
                    },
                );
                let inverse = damped(&block, factor, &magnitudes).unwrap_or(zero());
                *diagonal = Diagonal { inverse: single(1.0, &inverse), outside: magnitudes.map(|sum| sum as f32) };
            },
        );
        for_each_sparse_row(
            &outside.pattern,
            &mut outside.values,
            diagonal,
            #[inline(always)]
            |row, outside, _| {
                let mut outside = outside.iter_mut();
                if outside.len() > 0 {
                    a.visit(
                        row,
                        #[inline(always)]
                        |column, entries| {
                            if domain_of(column) != domain_of(row)
                                && let Some(place) = outside.next()
                            {
                                *place = single(factor, entries);
                            }
                        },
                    );
                }
            },
        );
        let is_missing = |diagonal: &Diagonal<N>| diagonal.inverse.iter().flatten().all(|&entry| entry == 0.0);
        let Some(row) = diagonal.iter().position(is_missing) else { return Ok(()) };
        let mut block = zero();
        a.visit(
            row,
            #[inline(always)]
            |column, entries| {
                if column == row {
                    block = *entries;
                }
            },
        );
        let magnitudes = diagonal[row].outside.map(f64::from);
        damped(&block, factor, &magnitudes).map(drop).map_err(|bad| BadBlock { row, bad })
    }

    /// `D̃⁻¹` of a row of `factor·A`.
    #[inline(always)]
    pub fn inverse(&self, row: usize) -> &Block<N, N, f32> {
        &self.diagonal[row].inverse
    }

    /// `x = M⁻¹ b`, a forward sweep from zero, and `r = b − A x`.
    pub fn forward(&self, b: &[[f32; N]], x: &mut [[f32; N]], r: &mut [[f32; N]]) {
        for_chunks(
            x,
            r,
            self.domain,
            #[inline(always)]
            |start, x, r| {
                for i in 0..x.len() {
                    let row = start + i;
                    let Diagonal { inverse, outside } = &self.diagonal[row];
                    let mut sum = b[row];
                    for (column, a) in self.lower.row(row) {
                        subtract_apply(&mut sum, a, &x[column - start]);
                    }
                    x[i] = apply(inverse, &sum);
                    let mut opposite = [0.0; N];
                    for k in 0..N {
                        r[i][k] = outside[k] * x[i][k];
                        opposite[k] = -x[i][k];
                    }
                    for (column, a) in self.lower.row(row) {
                        add_transposed_apply(&mut r[column - start], a, &opposite);
                    }
                }
            },
        );
        if self.outside.values.is_empty() {
            return;
        }
        for_each_row(
            r,
            #[inline(always)]
            |row, r| {
                for (column, a) in self.outside.row(row) {
                    subtract_apply(r, a, &x[column]);
                }
            },
        );
    }

    /// `x += M⁻ᵀ (b − A x)`, a backward sweep.
    pub fn backward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let Self { domain, lower, outside, diagonal, rest } = self;
        for_each_row(
            rest,
            #[inline(always)]
            |row, rest| {
                let mut sum: [f32; N] = std::array::from_fn(|k| b[row][k] + diagonal[row].outside[k] * x[row][k]);
                for (column, a) in outside.row(row) {
                    subtract_apply(&mut sum, a, &x[column]);
                }
                *rest = sum;
            },
        );
        for_chunks(
            x,
            rest,
            *domain,
            #[inline(always)]
            |start, x, rest| {
                for i in (0..x.len()).rev() {
                    let row = start + i;
                    let mut sum = rest[i];
                    for (column, a) in lower.row(row) {
                        subtract_apply(&mut sum, a, &x[column - start]);
                    }
                    x[i] = apply(&diagonal[row].inverse, &sum);
                    let opposite = x[i].map(|x| -x);
                    for (column, a) in lower.row(row) {
                        add_transposed_apply(&mut rest[column - start], a, &opposite);
                    }
                }
            },
        );
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let patterns = self.lower.pattern.bytes() + self.outside.pattern.bytes();
        patterns
            + self.lower.bytes()
            + self.outside.bytes()
            + size_of_val(&self.diagonal[..])
            + size_of_val(&self.rest[..])
    }
}

/// Rows of a domain.
fn domain(rows: usize) -> usize {
    rows.div_ceil((rows / LEAST_ROWS).clamp(1, MOST_DOMAINS)).max(1)
}

/// `D̃⁻¹` of a row of `factor·A`.
fn damped<const N: usize>(
    block: &Block<N, N>,
    factor: f64,
    magnitudes: &[f64; N],
) -> std::result::Result<Block<N, N>, BadPivot> {
    let mut damped = *block;
    for k in 0..N {
        for entry in &mut damped[k] {
            *entry *= factor;
        }
        damped[k][k] += magnitudes[k] + LEAST_DIAGONAL;
    }
    inverse(&damped)
}

#[cfg(test)]
mod tests;
