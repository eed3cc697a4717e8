//! Which pairs are moved as a whole: those that are [tight](super::tight).
//!
//! Most are told by what the smoother has. With κ the eigenvalues of `S⁻¹ 2K`, `S = D_i + D_j`, the tightness is `1/(1 − κ)` of the largest, and
//!
//! ```text
//! Σ κ² ≤ tr D_i⁻¹K D_j⁻¹K ≤ tr D_i⁻¹K · tr D_j⁻¹K
//! ```
//!
//! where springs pull: the first because twice the inverse of a sum is at most the geometric mean of the inverses (Bhatia and Grover 2012, "Norm
//! inequalities related to the matrix geometric mean").

use super::super::block::{Block, add_product, zero};
use super::super::parallel::for_each_row;
use super::super::smoother::Smoother;
use super::super::sparse::Rows;
use super::tight::Tight;

/// The least tightness: with 3 a cloth of 10⁶ particles takes as many iterations and has seven times as many pairs, with 5 it takes two
/// iterations more.
const TIGHT: f64 = 4.0;

/// The least Σκ² with which a tightness can be that: κ is 3/4, and more than rounding is left.
const LEAST: f32 = 0.56;

/// What that may come to by the inverses of a smoother whose diagonal blocks are up to half as much larger, both of them: those at the borders of domains.
const LEAST_AT_BORDERS: f32 = LEAST / (1.5 * 1.5);

/// Tells the tight pairs of `factor·A`, which the smoother has, by the later node. For every row `likely` gets a bit for each block before the diagonal, the last of its
/// bits for all from there on.
pub(super) fn search<const N: usize>(
    a: &impl Rows<N>,
    smoother: &Smoother<N>,
    likely: &mut Vec<u32>,
    found: &mut dyn FnMut([u32; 2]),
) {
    likely.resize(a.pattern().rows(), 0);
    for_each_row(
        likely,
        #[inline(always)]
        |row, likely| {
            *likely = 0;
            let (mine, mut bit) = (smoother.inverse(row), 1);
            smoother.visit_before(
                row,
                #[inline(always)]
                |column, coupling, inverse| {
                    let square = coupled(&mine, inverse, coupling);
                    let is_at_border = || [row, column].into_iter().any(|row| smoother.is_at_border(row));
                    if square > LEAST || square > LEAST_AT_BORDERS && is_at_border() {
                        *likely |= bit;
                    }
                    bit = next(bit);
                },
            );
        },
    );
    for (row, &likely) in likely.iter().enumerate().filter(|(_, likely)| **likely != 0) {
        let mut bit = 1;
        smoother.visit_before(row, |column, _, _| {
            if likely & bit != 0 && Tight::of(a, [column, row]).is_some_and(|pair| pair.tightness > TIGHT) {
                found([column, row].map(|node| node as u32));
            }
            bit = next(bit);
        });
    }
}

/// The bit after this one; after the last that one again.
fn next(bit: u32) -> u32 {
    if bit == 1 << 31 { bit } else { bit << 1 }
}

/// A bound on Σκ² of a pair, by the inverses of its diagonal blocks and a block beside the diagonal.
#[inline(always)]
fn coupled<const N: usize>(one: &Block<N, N, f32>, other: &Block<N, N, f32>, coupling: &Block<N, N, f32>) -> f32 {
    let inner = |a: &Block<N, N, f32>, b: &Block<N, N, f32>| {
        (0..N).map(|r| (0..N).map(|c| a[r][c] * b[r][c]).sum::<f32>()).sum::<f32>()
    };
    let bound = inner(one, coupling) * inner(other, coupling);
    if bound < LEAST_AT_BORDERS {
        return bound;
    }
    let (mut x, mut y) = (zero(), zero());
    add_product(&mut x, one, coupling);
    add_product(&mut y, coupling, other);
    inner(&x, &y)
}
