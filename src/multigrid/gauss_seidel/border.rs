//! Rows of a domain that have blocks outside it, and how much they have to be damped.
//!
//! With L within the domains, E outside them and `M = D̃ + L`, smoothing converges for certain when
//! `M + Mᵀ − A = 2 D̃ − D − E` is positive definite. Measured by the diagonal blocks `D_i = L_i L_iᵀ` of A, a block of E is
//! `Ê_ij = L_i⁻¹ E_ij L_j⁻ᵀ`; with
//!
//! ```text
//! D̃_i = (1 + ½ c_i) D_i,   c_i = Σ_j ‖Ê_ij‖₂,   2 D̃ − D − E = D + diag(c_i D_i) − E,
//! ```
//!
//! and `diag(c_i) − Ê` is diagonally dominant by blocks, thus positive semidefinite. The norm is bounded by `‖Ê‖₂⁴ ≤ Σ σ⁴ = tr H²` with
//! `H = D_j⁻¹ E_ijᵀ D_i⁻¹ E_ij`, whose eigenvalues are the squares of the singular values σ of Ê.
//!
//! Adding the sums of the magnitudes of E to the diagonal instead, `D̃ = D + ½ diag(Σ |E|)` (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers
//! for ultraparallel computing", section 6, for scalars), does as much for convergence. But it adds what springs resist along
//! themselves to every axis: where a cloth is not parallel to the axes, motions across it, a thousand times softer, are then hardly smoothed
//! at the borders. That made a falling cloth of 250² need 34 iterations where 18 do.

use super::super::block::{Block, add_product, add_transposed_product, zero};
use super::super::parallel::for_each_row;
use super::super::sparse::{Pattern, Rows};
use super::{diagonal_block, inverse_of};

/// The rows with blocks outside their domain. Their columns are such rows, too.
#[derive(Debug, Clone)]
pub(super) struct Border<const N: usize> {
    /// Ascending.
    rows: Vec<u32>,
    /// D⁻¹ of each, in double precision: what is stiff is hardly seen in it beside what is soft.
    inverses: Vec<Block<N, N>>,
}

impl<const N: usize> Border<N> {
    /// Of the pattern of E.
    pub fn of(outside: &Pattern) -> Self {
        let is_border = |row: &u32| !outside.row(*row as usize).is_empty();
        let rows: Vec<u32> = (0..outside.rows() as u32).filter(is_border).collect();
        let inverses = vec![zero(); rows.len()];
        Self { rows, inverses }
    }

    /// Takes over `factor·A`; zero where D is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) {
        let Self { rows, inverses } = self;
        for_each_row(
            inverses,
            #[inline(always)]
            |at, inverse| {
                *inverse = inverse_of(&diagonal_block(a, rows[at] as usize), factor).unwrap_or(zero());
            },
        );
    }

    /// D⁻¹ of a row, if it is one of them.
    pub fn inverse(&self, row: usize) -> Option<&Block<N, N>> {
        let at = self.rows.binary_search(&(row as u32)).ok()?;
        self.inverses.get(at)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.rows[..]) + size_of_val(&self.inverses[..])
    }
}

/// A bound on `‖Ê_ij‖₂`, from D_i⁻¹, E_ij and D_j⁻¹.
#[inline(always)]
pub(super) fn coupling<const N: usize>(mine: &Block<N, N>, outside: &Block<N, N>, other: &Block<N, N>) -> f64 {
    let (mut e, mut h, mut seen) = (zero(), zero(), zero());
    add_product(&mut e, mine, outside);
    add_transposed_product(&mut seen, outside, &e);
    add_product(&mut h, other, &seen);
    let trace = (0..N).map(|i| (0..N).map(|j| h[i][j] * h[j][i]).sum::<f64>()).sum::<f64>();
    // H² has no negative eigenvalues, but rounding errors where they are nothing.
    trace.max(0.0).sqrt().sqrt()
}
