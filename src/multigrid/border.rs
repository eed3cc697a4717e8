//! The damping of rows that have blocks outside their domain.
//!
//! With L within the domains, E outside them and `M = D + ½ S + L`, smoothing converges for certain when `M + Mᵀ − A = D + S − E` is positive
//! definite. S is block diagonal, a sum over the blocks of E, and each pair of rows must have
//!
//! ```text
//! ⎡  S_ij   −E_ij ⎤
//! ⎣ −E_ijᵀ   S_ji ⎦  ≥ 0.
//! ```
//!
//! A block of springs in tension is the negative of a positive semidefinite one: `S_ij = S_ji = −E_ij` suffices, and resists what the springs resist
//! and nothing else. That of a compressed spring, `−E_ij = k d dᵀ − m (I − d dᵀ)`, drives motions across itself: `S_ij = S_ji = −E_ij + 2m I`
//! suffices, as `S_ij ± E_ij ≥ 0` (own derivation). Any other block is bounded by the diagonal blocks `D_i = L_i L_iᵀ` of its rows,
//!
//! ```text
//! S_ij = c D_i,  S_ji = c D_j,   c = ‖L_i⁻¹ E_ij L_j⁻ᵀ‖₂,   c⁴ ≤ Σ σ⁴ = tr H²,   H = D_j⁻¹ E_ijᵀ D_i⁻¹ E_ij,
//! ```
//!
//! where σ² are the eigenvalues of H.
//!
//! For scalars S is the sum of the magnitudes of E (Baker, Falgout, Kolev and Yang 2011, "Multigrid smoothers for ultraparallel computing", section
//! 6). Taken entry by entry that would add the axial stiffness of springs to every axis, and the soft transverse motions of a cloth would hardly be
//! smoothed at the borders.

use super::block::{
    Block, add_product, add_transposed_product, inverse_of, is_definite, norm_squared, scaled, shifted, single, sum,
    zero,
};
use super::sparse::Rows;

/// Rounding error of a zero eigenvalue over the norm of its block, far below a transverse stiffness of a millionth.
const ROUNDING: f64 = 1e-12;

/// A row of `factor·A` that has blocks outside its domain, which has `length` rows from `start` on.
pub(super) struct Border {
    pub row: usize,
    pub start: usize,
    pub length: usize,
    pub factor: f64,
}

impl Border {
    /// Sets E of the row, and −½ S where `columns` has the row itself; `before` gets the blocks of L. Returns D and ½ S.
    #[inline(always)]
    pub fn update<const N: usize>(
        &self,
        a: &impl Rows<N>,
        columns: &[u32],
        outside: &mut [Block<N, N, f32>],
        mut before: impl FnMut(&Block<N, N>),
    ) -> (Block<N, N>, Block<N, N>) {
        let &Self { row, start, length, factor } = self;
        let own = columns.partition_point(|&column| (column as usize) < row);
        let mut places = outside.iter_mut().enumerate().filter(|(place, _)| *place != own);
        let (mut diagonal, mut damping) = (zero(), Damping { row, factor, resisted: zero(), bounded: 0.0 });
        a.visit(
            row,
            #[inline(always)]
            |column, block| {
                if column == row {
                    diagonal = scaled(factor, block);
                } else if !(start..start + length).contains(&column) {
                    if let Some((_, place)) = places.next() {
                        *place = single(factor, block);
                        damping.add(a, column, &scaled(factor, block));
                    }
                } else if column < row {
                    before(block);
                }
            },
        );
        let half = damping.half(&diagonal);
        if let Some(place) = outside.get_mut(own) {
            *place = single(-1.0, &half);
        }
        (diagonal, half)
    }
}

struct Damping<const N: usize> {
    row: usize,
    factor: f64,
    /// From blocks of springs.
    resisted: Block<N, N>,
    /// From other blocks, in D.
    bounded: f64,
}

impl<const N: usize> Damping<N> {
    #[inline(always)]
    fn add(&mut self, a: &impl Rows<N>, column: usize, outside: &Block<N, N>) {
        match spring_damping(outside) {
            Some(resisted) => self.resisted = sum(&self.resisted, &resisted),
            None => self.bounded += self.bound(a, column, outside),
        }
    }

    /// A bound on c; zero where D_i or D_j is not positive definite, as then the set-up fails.
    #[inline(never)]
    fn bound(&self, a: &impl Rows<N>, column: usize, outside: &Block<N, N>) -> f64 {
        let [mine, other] = [self.row, column].map(|row| inverse_of(&scaled(self.factor, &a.diagonal_block(row))));
        let (Ok(mine), Ok(other)) = (mine, other) else { return 0.0 };
        let (mut solved, mut square, mut h) = (zero(), zero(), zero());
        add_product(&mut solved, &mine, outside);
        add_transposed_product(&mut square, outside, &solved);
        add_product(&mut h, &other, &square);
        let trace = (0..N).map(|i| (0..N).map(|j| h[i][j] * h[j][i]).sum::<f64>()).sum::<f64>();
        trace.max(0.0).sqrt().sqrt()
    }

    /// ½ S, with the D of the row.
    fn half(&self, diagonal: &Block<N, N>) -> Block<N, N> {
        sum(&scaled(0.5, &self.resisted), &scaled(0.5 * self.bounded, diagonal))
    }
}

/// S of a block of springs in tension, `−E_ij`, or of a compressed one, `−E_ij + 2m I`, up to rounding.
#[inline(always)]
fn spring_damping<const N: usize>(outside: &Block<N, N>) -> Option<Block<N, N>> {
    let norm_squared = norm_squared(outside.as_flattened());
    let rounding = ROUNDING * norm_squared.sqrt();
    let is_symmetric = |r: usize| (0..r).all(|c| (outside[r][c] - outside[c][r]).abs() <= rounding);
    if !(0..N).all(is_symmetric) {
        return None;
    }
    // With eigenvalues from −shift on, twice the shift makes none smaller than its magnitude.
    let resists =
        |block: &Block<N, N>, shift: f64| is_definite(&shifted(block, shift)).then(|| shifted(block, 2.0 * shift));
    let block = scaled(-1.0, outside);
    resists(&block, rounding).or_else(|| resists(&block, pressed(&block, norm_squared) + rounding))
}

/// m of `k d dᵀ − m (I − d dᵀ)`: with `tr = k − (N−1) m` and `‖·‖² − tr²/N = (k + m)² (N−1)/N`.
fn pressed<const N: usize>(block: &Block<N, N>, norm_squared: f64) -> f64 {
    let (n, trace) = (N as f64, (0..N).map(|k| block[k][k]).sum::<f64>());
    let spread = ((norm_squared - trace * trace / n) * n / (n - 1.0).max(1.0)).max(0.0).sqrt();
    (spread - trace) / n
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `t I + (k − t) d dᵀ`, negative as beside the diagonal.
    fn spring(k: f64, t: f64) -> Block<3, 3> {
        let d = [1.0f64, 2.0, -3.0].map(|x| x / 14.0f64.sqrt());
        std::array::from_fn(|r| std::array::from_fn(|c| (t - k) * d[r] * d[c] - if r == c { t } else { 0.0 }))
    }

    #[test]
    fn springs_in_tension_are_resisted_as_they_are() {
        for (k, t) in [(5.0, 0.0), (5.0, 1e-6), (2.0, 2.0)] {
            let (found, expected) = (spring_damping(&spring(k, t)).unwrap(), scaled(-1.0, &spring(k, t)));
            let largest = norm_squared(sum(&found, &scaled(-1.0, &expected)).as_flattened()).sqrt();
            assert!(largest > 0.0 && largest < 4.0 * ROUNDING * (k + 2.0 * t), "{largest}");
        }
    }

    /// A compressed spring counts for `(k + 2m) d dᵀ + m (I − d dᵀ)`, in space, in a plane and on a line.
    #[test]
    fn compressed_springs_are_resisted_in_every_direction() {
        for (k, m) in [(5.0, 1e-6), (5.0, 1.0), (1.0, 3.0), (0.0, 2.0)] {
            let (found, expected) = (spring_damping(&spring(k, -m)).unwrap(), scaled(-1.0, &spring(k + 2.0 * m, m)));
            let difference = norm_squared(sum(&found, &scaled(-1.0, &expected)).as_flattened()).sqrt();
            assert!(difference < 10.0 * ROUNDING * (k + m), "{k} {m}: {difference}");
        }
        let plane = spring_damping(&[[-5.0, 0.0], [0.0, 2.0]]).unwrap();
        let [line] = spring_damping(&[[3.0]]).unwrap().map(|[entry]| entry);
        assert!(
            (plane[0][0] - 9.0).abs() + (plane[1][1] - 2.0).abs() + plane[0][1].abs() < 20.0 * ROUNDING * 5.0,
            "{plane:?}"
        );
        assert!((line - 3.0).abs() < 10.0 * ROUNDING * 3.0, "{line}");
    }

    #[test]
    fn other_blocks_are_no_springs() {
        let mut skew = spring(5.0, 1.0);
        skew[0][1] += 1e-6;
        let several = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]];
        for block in [spring(-5.0, 1.0), spring(-5.0, -1.0), zero(), several, skew] {
            assert_eq!(spring_damping(&block), None);
        }
    }
}
