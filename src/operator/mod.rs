//! Matrices known by their products: the linear operator that conjugate gradients needs, and the system's own.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `matrices`.

pub(crate) mod inner_product;
pub(crate) mod lanes;
mod prefetch;
mod stream;
mod system_operator;

pub use inner_product::dot;
pub(crate) use prefetch::{prefetch, prefetch_all};
pub(crate) use stream::row_shares;
pub(crate) use system_operator::negative_part;
pub use system_operator::{Combination, Margins, SurelyDefinite, SystemOperator};

use nalgebra::Matrix3;

/// A symmetric matrix that can be multiplied with a vector.
pub trait LinearOperator {
    /// The order n of the matrix.
    fn order(&self) -> usize;

    /// `y = A w` for vectors of length n.
    fn apply(&self, w: &[f64], y: &mut [f64]);

    /// `y = A w`; returns `wᵀ y`, which is `wᵀ A w`, to the bit as [`dot`] computes it. Implement it where the product has parts of both at hand; `room` is
    /// for what is summed up on the way, and to be handed in again, so that nothing is allocated.
    fn apply_and_dot(&self, w: &[f64], y: &mut [f64], room: &mut Vec<f64>) -> f64 {
        let _ = room;
        self.apply(w, y);
        dot(w, y)
    }
}

/// A matrix whose diagonal 3×3 blocks are known, one a particle; what block Jacobi needs.
pub trait BlockDiagonal {
    /// Writes every particle's diagonal block; rows and columns of axes that are not free are zero.
    fn diagonal_blocks(&self, blocks: &mut [Matrix3<f64>]);
}
