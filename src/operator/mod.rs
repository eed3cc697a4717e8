//! Matrices known by their products: the linear operator that conjugate gradients needs, and the system's own.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `matrices`.

pub(crate) mod inner_product;
mod simd;
mod spring_order;
mod stream;
mod system_operator;

pub use inner_product::dot;
pub(crate) use simd::{prefetch, prefetch_all};
pub(crate) use spring_order::group;
pub(crate) use system_operator::negative_part;
pub use system_operator::{Combination, SystemOperator};

use nalgebra::Matrix3;

/// A symmetric matrix that can be multiplied with a vector.
pub trait LinearOperator {
    /// The order n of the matrix.
    fn order(&self) -> usize;

    /// `y = A w` for vectors of length n. Implementations fill y with NaN for other lengths, which ends an iteration as not finite.
    fn apply(&self, w: &[f64], y: &mut [f64]);
}

/// A matrix whose diagonal 3×3 blocks are known, one a particle; what block Jacobi needs.
pub trait BlockDiagonal {
    /// Writes every particle's diagonal block; rows and columns of axes that are not free are zero.
    fn diagonal_blocks(&self, blocks: &mut [Matrix3<f64>]);
}
