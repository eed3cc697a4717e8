//! Rows of a domain that have blocks outside it, and how much more they get on the diagonal.
//!
//! With L within the domains, E outside them and `M = D + ½ S + L`, smoothing converges for certain when
//! `M + Mᵀ − A = D + S − E` is positive definite. S is block diagonal, a sum over the blocks of E, and each pair of rows must have
//!
//! ```text
//! ⎡  S_ij   −E_ij ⎤
//! ⎣ −E_ijᵀ   S_ji ⎦  ≥ 0.
//! ```
//!
//! A block of springs that pull is the negative of a positive semidefinite one: `S_ij = S_ji = −E_ij` does, and resists what the springs
//! resist and nothing else. Any other block is bounded by the diagonal blocks `D_i = L_i L_iᵀ` of its rows,
//!
//! ```text
//! S_ij = c D_i,  S_ji = c D_j,   c = ‖L_i⁻¹ E_ij L_j⁻ᵀ‖₂,   c⁴ ≤ Σ σ⁴ = tr H²,   H = D_j⁻¹ E_ijᵀ D_i⁻¹ E_ij,
//! ```
//!
//! where σ² are the eigenvalues of H.
//!
//! For scalars S is the sum of the magnitudes of E (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers for ultraparallel computing",
//! section 6). Taken entry by entry, that adds what springs resist along themselves to every axis: where a cloth is not parallel to the
//! axes, motions across it, a thousand times softer, are then hardly smoothed at the borders. A falling cloth of 250² took 34
//! iterations, where it takes 18.

use super::super::block::{Block, add_product, add_transposed_product, is_definite, scaled, sum, zero};
use super::super::sparse::Rows;
use super::{diagonal_block, inverse_of};

/// What rounding may make of a zero eigenvalue, over the sum of all. It adds nothing to what springs resist across, some millionth of what they do along.
const ROUNDING: f64 = 1e-12;

/// S of one row of `factor·A`, as it is summed up.
pub(super) struct Damping<const N: usize> {
    row: usize,
    factor: f64,
    /// Of blocks that are the negative of a positive semidefinite one.
    resisted: Block<N, N>,
    /// Of others, in D.
    bounded: f64,
}

impl<const N: usize> Damping<N> {
    /// Of a row without any block outside.
    pub fn of(row: usize, factor: f64) -> Self {
        Self { row, factor, resisted: zero(), bounded: 0.0 }
    }

    /// Takes note of a block outside.
    #[inline(always)]
    pub fn couple(&mut self, a: &impl Rows<N>, column: usize, outside: &Block<N, N>) {
        match resisted(outside) {
            Some(resisted) => self.resisted = sum(&self.resisted, &resisted),
            None => self.bounded += self.bound(a, column, outside),
        }
    }

    /// A bound on c; none where D_i or D_j is not positive definite, for then there is no smoother.
    #[inline(never)]
    fn bound(&self, a: &impl Rows<N>, column: usize, outside: &Block<N, N>) -> f64 {
        let [mine, other] = [self.row, column].map(|row| inverse_of(&scaled(self.factor, &diagonal_block(a, row))));
        let (Ok(mine), Ok(other)) = (mine, other) else { return 0.0 };
        let (mut solved, mut square, mut h) = (zero(), zero(), zero());
        add_product(&mut solved, &mine, outside);
        add_transposed_product(&mut square, outside, &solved);
        add_product(&mut h, &other, &square);
        let trace = (0..N).map(|i| (0..N).map(|j| h[i][j] * h[j][i]).sum::<f64>()).sum::<f64>();
        // Rounding may make what is nothing negative.
        trace.max(0.0).sqrt().sqrt()
    }

    /// ½ S, with the D of the row.
    pub fn half(&self, diagonal: &Block<N, N>) -> Block<N, N> {
        sum(&scaled(0.5, &self.resisted), &scaled(0.5 * self.bounded, diagonal))
    }
}

/// `−E_ij`, if it is symmetric and positive semidefinite, up to rounding and with that on its diagonal.
#[inline(always)]
fn resisted<const N: usize>(outside: &Block<N, N>) -> Option<Block<N, N>> {
    let trace = -(0..N).map(|k| outside[k][k]).sum::<f64>();
    let is_symmetric = |r: usize| (0..r).all(|c| (outside[r][c] - outside[c][r]).abs() <= ROUNDING * trace);
    if !(0..N).all(is_symmetric) {
        return None;
    }
    let mut block = scaled(-1.0, outside);
    let add_rounding = |block: &mut Block<N, N>| (0..N).for_each(|k| block[k][k] += ROUNDING * trace);
    add_rounding(&mut block);
    // Eigenvalues from −ROUNDING on: with twice as much, none is smaller than what it was in magnitude.
    is_definite(&block).then(|| {
        add_rounding(&mut block);
        block
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `t I + (k − t) d dᵀ`, negative as beside the diagonal.
    fn spring(k: f64, t: f64) -> Block<3, 3> {
        let d = [1.0f64, 2.0, -3.0].map(|x| x / 14.0f64.sqrt());
        std::array::from_fn(|r| std::array::from_fn(|c| (t - k) * d[r] * d[c] - if r == c { t } else { 0.0 }))
    }

    /// A spring that resists along itself alone has two eigenvalues that are zero or what rounding makes of them. One that is pressed,
    /// one that pushes, no spring, and a block that is not symmetric are none of these.
    #[test]
    fn springs_that_pull_are_resisted_as_they_are() {
        for (k, t) in [(5.0, 0.0), (5.0, 1e-6), (2.0, 2.0)] {
            let (found, expected) = (resisted(&spring(k, t)).unwrap(), scaled(-1.0, &spring(k, t)));
            let difference = sum(&found, &scaled(-1.0, &expected));
            let largest = difference.as_flattened().iter().fold(0.0, |largest, entry| f64::max(largest, entry.abs()));
            assert!(largest > 0.0 && largest < 3.0 * ROUNDING * (k + 2.0 * t), "{largest}");
        }
        let mut skew = spring(5.0, 1.0);
        skew[0][1] += 1e-6;
        for block in [spring(5.0, -1e-6), spring(-5.0, 1.0), spring(-5.0, -1.0), zero(), skew] {
            assert_eq!(resisted(&block), None);
        }
    }
}
