//! Explicit sparse matrices from 3×3 particle blocks: the pattern once, the values many times.
//!
//! A [`BlockPattern`] is made once, from a [`DofMap`](crate::DofMap) and the list of particle pairs that are coupled; it owns the sparsity pattern
//! and tells the [`BlockSlot`] of every pair. A [`SymmetricMatrix`] holds values on it; adding a block through its slot neither sorts, searches nor
//! allocates. This part knows nothing of springs: bring your own blocks. [`SystemMatrix`] applies it to a system's M, G, K and A.
//!
//! [`triplets`] is the simple path that defines what an assembled matrix is: list all triplets, sort, add up. Both paths add the contributions to an
//! entry in the same order, so they agree to the bit.
//!
//! Matrices are symmetric and store the lower triangle by compressed columns with 32-bit indices.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `matrices`.

mod matrix;
mod pattern;
mod system_matrix;
pub mod triplets;
mod whole;

pub use matrix::SymmetricMatrix;
pub use pattern::{BlockPattern, BlockSlot};
pub use system_matrix::{SpringPattern, SystemMatrix, assemble_afresh};
pub use whole::{WholeColumns, WholePattern};
