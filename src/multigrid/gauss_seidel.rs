//! The smoother: block Gauss–Seidel, forward before the coarse correction and backward after it.
//!
//! With A = L + D + Lᵀ a forward sweep from zero is `x = (D + L)⁻¹ b`, and a backward sweep `x += (D + Lᵀ)⁻¹ (b − A x)`: one is the
//! transpose of the other, which makes the preconditioner symmetric. Sweeps are sequential. To share them out, rows are cut
//! into domains, by their number alone; L keeps the blocks within a domain, and rows with blocks E outside are [damped](border),
//! `D̃_i = (1 + ½ c_i) D_i` with c_i so large that smoothing converges whatever the domains are.
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
//! it has. With `δ = 1 / (1 + ½ c)` and what a row has to solve for, `D̃ x = s`, that is `x = δ D⁻¹ s` and `(D̃ − D) x = (1 − δ) s`.

mod border;

use super::block::{BadPivot, Block, add_transposed_apply, apply, inverse, scaled, single, subtract_apply, zero};
use super::parallel::{for_chunks, for_each_row, for_each_sparse_row};
use super::sparse::{BlockMatrix, Pattern, Rows};
use crate::error::Result;
use border::Border;
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
    border: Border<N>,
    diagonal: Vec<Diagonal<N>>,
    /// b and the E of a backward sweep, and then what is left of it.
    rest: Vec<[f32; N]>,
}

/// D of a row.
#[derive(Debug, Clone, Copy)]
struct Diagonal<const N: usize> {
    /// D⁻¹; zero where D is not positive definite.
    inverse: Block<N, N, f32>,
    /// δ.
    damping: f32,
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
            border: Border::of(&outside),
            lower: BlockMatrix::zeros(Arc::new(lower)),
            outside: BlockMatrix::zeros(Arc::new(outside)),
            diagonal: vec![Diagonal { inverse: zero(), damping: 1.0 }; rows],
            rest: vec![[0.0; N]; rows],
        })
    }

    /// Takes over `factor·A`.
    ///
    /// # Errors
    /// The first diagonal block that is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), BadBlock> {
        let Self { domain, lower, outside, border, diagonal, .. } = self;
        let domain_of = |row: usize| row / *domain;
        for_each_sparse_row(
            &lower.pattern,
            &mut lower.values,
            diagonal,
            #[inline(always)]
            |row, lower, diagonal| {
                let mut lower = lower.iter_mut();
                let mut block = zero();
                a.visit(
                    row,
                    #[inline(always)]
                    |column, entries| {
                        if column == row {
                            block = *entries;
                        } else if column < row
                            && domain_of(column) == domain_of(row)
                            && let Some(place) = lower.next()
                        {
                            *place = single(factor, entries);
                        }
                    },
                );
                let inverse = inverse_of(&block, factor).unwrap_or(zero());
                *diagonal = Diagonal { inverse: single(1.0, &inverse), damping: 1.0 };
            },
        );
        border.update(a, factor);
        for_each_sparse_row(
            &outside.pattern,
            &mut outside.values,
            diagonal,
            #[inline(always)]
            |row, outside, diagonal| {
                let mut outside = outside.iter_mut();
                let Some(mine) = border.inverse(row) else { return };
                let mut c = 0.0;
                a.visit(
                    row,
                    #[inline(always)]
                    |column, entries| {
                        if domain_of(column) != domain_of(row)
                            && let (Some(place), Some(other)) = (outside.next(), border.inverse(column))
                        {
                            *place = single(factor, entries);
                            c += border::coupling(mine, &scaled(factor, entries), other);
                        }
                    },
                );
                diagonal.damping = (1.0 / (1.0 + 0.5 * c)) as f32;
            },
        );
        let is_missing = |diagonal: &Diagonal<N>| diagonal.inverse.iter().flatten().all(|&entry| entry == 0.0);
        let Some(row) = diagonal.iter().position(is_missing) else { return Ok(()) };
        inverse_of(&diagonal_block(a, row), factor).map(drop).map_err(|bad| BadBlock { row, bad })
    }

    /// `D⁻¹` of a row of `factor·A`.
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
                    let Diagonal { inverse, damping } = &self.diagonal[row];
                    let mut sum = b[row];
                    for (column, a) in self.lower.row(row) {
                        subtract_apply(&mut sum, a, &x[column - start]);
                    }
                    x[i] = apply(inverse, &sum).map(|x| damping * x);
                    r[i] = sum.map(|sum| (1.0 - damping) * sum);
                    let opposite = x[i].map(|x| -x);
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
        let Self { domain, lower, outside, diagonal, rest, .. } = self;
        for_each_row(
            rest,
            #[inline(always)]
            |row, rest| {
                let mut sum = b[row];
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
                    let Diagonal { inverse, damping } = &diagonal[row];
                    let solved = apply(inverse, &sum);
                    x[i] = std::array::from_fn(|k| damping * solved[k] + (1.0 - damping) * x[i][k]);
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
            + self.border.bytes()
            + size_of_val(&self.diagonal[..])
            + size_of_val(&self.rest[..])
    }
}

/// Rows of a domain.
fn domain(rows: usize) -> usize {
    rows.div_ceil((rows / LEAST_ROWS).clamp(1, MOST_DOMAINS)).max(1)
}

/// The diagonal block of a row.
#[inline(always)]
fn diagonal_block<const N: usize>(a: &impl Rows<N>, row: usize) -> Block<N, N> {
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
    block
}

/// `D⁻¹` of a row of `factor·A`.
fn inverse_of<const N: usize>(block: &Block<N, N>, factor: f64) -> std::result::Result<Block<N, N>, BadPivot> {
    let mut block = scaled(factor, block);
    for (k, row) in block.iter_mut().enumerate() {
        row[k] += LEAST_DIAGONAL;
    }
    inverse(&block)
}

#[cfg(test)]
mod tests;
