//! The smoother: block Gauss–Seidel, forward before the coarse correction and backward after it.
//!
//! With A = L + D + Lᵀ a forward sweep from zero is `x = (D + L)⁻¹ b`, and a backward sweep `x += (D + Lᵀ)⁻¹ (b − A x)`: one is the
//! transpose of the other, which makes the preconditioner symmetric. Sweeps are sequential. To share them out, rows are cut
//! into domains, by their number alone; L keeps the blocks within a domain, and every row i adds half its sum of the
//! magnitudes of the entries E outside to its diagonal, `D̃ = D + ½ diag(Σ |E|)`. Then `M + Mᵀ − A = D + diag(Σ |E|) − E` for
//! `M = D̃ + L`, positive definite because `diag(Σ |E|) − E` is diagonally dominant: smoothing converges whatever the domains are
//! (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers for ultraparallel computing", section 6).

use super::block::{BadPivot, Block, apply, inverse, subtract_apply, zero};
use super::parallel::{for_chunks, for_each_row};
use super::sparse::BlockMatrix;

/// The least rows that a domain has, and the most domains: fewer domains smooth better, more keep more threads busy.
const LEAST_ROWS: usize = 8192;
const MOST_DOMAINS: usize = 16;

/// Block Gauss–Seidel for matrices of one size.
#[derive(Debug, Clone)]
pub(super) struct GaussSeidel<const N: usize> {
    /// Rows of a domain; the last may have fewer.
    domain: usize,
    /// D̃⁻¹.
    pub inverses: Vec<Block<N, N>>,
    /// D̃ − D.
    outside: Vec<[f64; N]>,
    /// The solution before a backward sweep, for the rows of other domains.
    before: Vec<[f64; N]>,
}

/// A diagonal block that is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BadBlock {
    pub row: usize,
    pub bad: BadPivot,
}

impl<const N: usize> GaussSeidel<N> {
    pub fn new(rows: usize) -> Self {
        let domains = (rows / LEAST_ROWS).clamp(1, MOST_DOMAINS);
        let outside = if domains > 1 { rows } else { 0 };
        Self {
            domain: rows.div_ceil(domains).max(1),
            inverses: vec![zero(); rows],
            outside: vec![[0.0; N]; outside],
            before: vec![[0.0; N]; outside],
        }
    }

    /// Inverts the diagonal blocks of a matrix.
    ///
    /// # Errors
    /// The first block that is not positive definite.
    pub fn update(&mut self, a: &BlockMatrix<N, N>) -> Result<(), BadBlock> {
        let domain = self.domain;
        for_each_row(&mut self.outside, |row, outside| {
            *outside = [0.0; N];
            for (_, block) in a.row(row).filter(|(column, _)| column / domain != row / domain) {
                for (sum, entries) in outside.iter_mut().zip(block) {
                    *sum += 0.5 * entries.iter().map(|entry| entry.abs()).sum::<f64>();
                }
            }
        });
        let outside = &self.outside;
        let damped = |row: usize| {
            let diagonal = a.row(row).find(|&(column, _)| column == row);
            let mut block = diagonal.map_or(zero(), |(_, block)| *block);
            for (k, outside) in outside.get(row).into_iter().flatten().enumerate() {
                block[k][k] += outside;
            }
            inverse(&block)
        };
        // An inverse has a positive diagonal: zero marks the rows without one.
        for_each_row(&mut self.inverses, |row, inverse| *inverse = damped(row).unwrap_or(zero()));
        let failed = self.inverses.iter().position(|inverse| N > 0 && inverse[0][0] == 0.0);
        match failed.map(|row| (row, damped(row))) {
            Some((row, Err(bad))) => Err(BadBlock { row, bad }),
            _ => Ok(()),
        }
    }

    /// `x = M⁻¹ b`, a forward sweep from zero.
    pub fn forward(&self, a: &BlockMatrix<N, N>, b: &[[f64; N]], x: &mut [[f64; N]]) {
        for_chunks(x, self.domain, |start, x| {
            for i in 0..x.len() {
                let row = start + i;
                let mut sum = b[row];
                for (column, a) in a.row(row) {
                    if column >= row {
                        break;
                    }
                    if column >= start {
                        subtract_apply(&mut sum, a, &x[column - start]);
                    }
                }
                x[i] = apply(&self.inverses[row], &sum);
            }
        });
    }

    /// `r = b − A x` after a forward sweep from zero, from what the sweep left out: `b − (D̃ + L) x = 0`.
    pub fn residual(&self, a: &BlockMatrix<N, N>, x: &[[f64; N]], r: &mut [[f64; N]]) {
        for_each_row(r, |row, r| {
            *r = [0.0; N];
            if let Some(outside) = self.outside.get(row) {
                *r = std::array::from_fn(|k| outside[k] * x[row][k]);
            }
            let start = row / self.domain * self.domain;
            for (column, a) in a.row(row).rev() {
                if column > row || column < start {
                    subtract_apply(r, a, &x[column]);
                }
            }
        });
    }

    /// `x += M⁻ᵀ (b − A x)`, a backward sweep.
    pub fn backward(&mut self, a: &BlockMatrix<N, N>, b: &[[f64; N]], x: &mut [[f64; N]]) {
        let Self { domain, inverses, outside, before, .. } = self;
        before.iter_mut().zip(&*x).for_each(|(before, x)| *before = *x);
        for_chunks(x, *domain, |start, x| {
            let end = start + x.len();
            for row in (start..end).rev() {
                let mut sum = b[row];
                if let Some(outside) = outside.get(row) {
                    let x = &x[row - start];
                    sum = std::array::from_fn(|k| sum[k] + outside[k] * x[k]);
                }
                for (column, a) in a.row(row) {
                    if column == row {
                        continue;
                    }
                    let x = if (start..end).contains(&column) { &x[column - start] } else { &before[column] };
                    subtract_apply(&mut sum, a, x);
                }
                x[row - start] = apply(&inverses[row], &sum);
            }
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.inverses[..]) + size_of_val(&self.outside[..]) + size_of_val(&self.before[..])
    }
}
