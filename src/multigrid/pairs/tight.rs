//! How tight a pair is, and along which direction.
//!
//! With S what two nodes resist one by one and T what they resist together,
//!
//! ```text
//! S = D_i + D_j,   T = A_CC = D_i + D_j − 2K,
//! ```
//!
//! D their diagonal blocks and K what couples them, the tightness along u is `uᵀ S u / uᵀ T u`: so many sweeps, about, Gauss–Seidel takes for what moves both along u. The largest is the largest eigenvalue of
//! `T⁻¹ S`, u its eigenvector, or near enough, as every u will do: what the power method makes of how the pair gives way to a force along
//! the axis along which it is softest.

use super::super::block::{Block, apply, inverse, sum, transposed, zero};
use super::super::sparse::Rows;

/// Steps of the power method. With ρ the ratio of the two largest tightnesses (1 − ρ) ρ¹⁶ of the largest are missing then, a
/// fortieth at most, times tan² of the angle between u and where it starts from.
const STEPS: usize = 8;

/// What rounding leaves of places in single precision counts as many times more in the forces between both as they are tight, and is to be a small part of
/// them. Without a limit two of 240 random systems, of stiffnesses 10⁶ apart and without any across springs, took more than five times the iterations.
const MOST: f64 = 1e3;

/// A pair that is positive definite together, and not too tight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tight<const N: usize> {
    pub tightness: f64,
    /// u, with `uᵀ T u = 1`.
    pub along: [f64; N],
}

impl<const N: usize> Tight<N> {
    /// Of two nodes.
    pub fn of(a: &impl Rows<N>, [one, other]: [usize; 2]) -> Option<Self> {
        let (mut apart, mut coupling) = (zero(), zero());
        for row in [one, other] {
            a.visit(row, |column, block| {
                if column == row {
                    apart = sum(&apart, block);
                } else if column == one {
                    coupling = sum(block, &transposed(block));
                }
            });
        }
        Self::between(&apart, &sum(&apart, &coupling))
    }

    fn between(apart: &Block<N, N>, together: &Block<N, N>) -> Option<Self> {
        let inverse = inverse(together).ok()?;
        let softest = (0..N).max_by(|&one, &other| inverse[one][one].total_cmp(&inverse[other][other]))?;
        let mut along: [f64; N] = std::array::from_fn(|axis| inverse[axis][softest]);
        for _ in 0..STEPS {
            let next = apply(&inverse, &apply(apart, &along));
            let largest = next.iter().fold(0.0, |largest, u| f64::max(largest, u.abs()));
            along = next.map(|u| u / largest);
        }
        let resisted = |block: &Block<N, N>| along.iter().zip(apply(block, &along)).map(|(u, f)| u * f).sum::<f64>();
        let [apart, together] = [apart, together].map(resisted);
        let tightness = apart / together;
        // Nothing of this holds where numbers are not finite.
        (together > 0.0 && tightness < MOST).then(|| Self { tightness, along: along.map(|u| u / together.sqrt()) })
    }
}
