//! Extreme eigenpairs of large symmetric matrices and pencils, with residuals that bound their errors and counts that prove that none is missing.
//!
//! ```text
//! A φ = λ M φ,      A symmetric,  M diagonal and positive: the masses, or the identity
//! ```
//!
//! There is one solver, [`BlockLanczos`], for any operator that is self-adjoint in the inner product `xᵀMy`. [`ShiftInvert`] gives it
//! `(A − σM)⁻¹M` with a sparse factorization, and counts eigenvalues by the signs of the pivots. Where a matrix cannot be factored the
//! solver takes A itself, with a preconditioner.
//!
//! **Error bounds.** With `r = Aφ − λMφ` and `φᵀMφ = 1` there is an eigenvalue within `‖M^{-1/2} r‖` of λ (Parlett, The Symmetric Eigenvalue
//! Problem, 4.5 and 15.9).

mod lanczos;
mod shift_invert;

pub(crate) use lanczos::{BlockLanczos, End, Ritz, Search, Tolerance, probe};
pub(crate) use shift_invert::{Accuracy, Pencil, ShiftInvert, eigenpair};
pub use shift_invert::{Lowest, lowest};

use crate::linear::norm;
use rand::Rng;
use rand::rngs::Xoshiro256PlusPlus;

/// An eigenvalue with its vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpair {
    /// λ: in N/m where A is the matrix of a step, in 1/s² where it is −K and M are the masses.
    pub value: f64,
    /// x, reduced, `xᵀMx = 1`.
    pub vector: Vec<f64>,
    /// `‖M^{-1/2}(Ax − λMx)‖`: there is an eigenvalue within this distance of λ.
    pub residual: f64,
}

/// The vector divided by its length; `None` where that is zero or not finite.
pub(crate) fn unit(mut u: Vec<f64>) -> Option<Vec<f64>> {
    let length = norm(&u);
    u.iter_mut().for_each(|u| *u /= length);
    (length > 0.0 && length.is_finite()).then_some(u)
}

/// Fills a vector with independent standard normal numbers (Box and Muller 1958).
pub(crate) fn gaussian(rng: &mut Xoshiro256PlusPlus, x: &mut [f64]) {
    // In (0, 1]: the logarithm below must exist.
    let mut uniform = || ((rng.next_u64() >> 11) as f64 + 1.0) * (-53f64).exp2();
    for pair in x.chunks_mut(2) {
        let radius = (-2.0 * uniform().ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * uniform()).sin_cos();
        for (value, part) in pair.iter_mut().zip([cosine, sine]) {
            *value = radius * part;
        }
    }
}

#[cfg(test)]
mod tests;
