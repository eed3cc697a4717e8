//! Where a spectrum ends, roughly, by a short Lanczos recurrence.
//!
//! `β_k q_{k+1} = A q_k − α_k q_k − β_{k−1} q_{k−1}` makes A tridiagonal. Without any reorthogonalisation the eigenvalues of the
//! tridiagonal matrix still approach the ends of the spectrum first, and `β_k |s_k|`, s_k the last entry of an eigenvector, still
//! estimates the distance to an eigenvalue of A (Paige 1971). Nothing is proven by this; it tells where to try.

use super::random::gaussian;
use crate::linear::{dot, norm};
use nalgebra::{DMatrix, SymmetricEigen};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// An estimate of an end of a spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct End {
    pub value: f64,
    /// The estimated distance to an eigenvalue.
    pub residual: f64,
}

/// The low and the high end, from at most `steps` products. NaN where a product is not finite.
pub(crate) fn lanczos_ends(n: usize, steps: usize, mut apply: impl FnMut(&[f64], &mut [f64])) -> [End; 2] {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    let mut q = vec![0.0; n];
    gaussian(&mut rng, &mut q);
    let length = norm(&q);
    q.iter_mut().for_each(|q| *q /= length);
    let (mut before, mut next) = (vec![0.0; n], vec![0.0; n]);
    let (mut alphas, mut betas) = (Vec::new(), Vec::new());
    let mut beta = 0.0;
    for _ in 0..steps.min(n) {
        apply(&q, &mut next);
        let alpha = dot(&q, &next);
        for ((next, q), before) in next.iter_mut().zip(&q).zip(&before) {
            *next -= alpha * q + beta * before;
        }
        beta = norm(&next);
        alphas.push(alpha);
        betas.push(beta);
        // An invariant space: its eigenvalues are exact, and more of it is rounding.
        if beta <= 1e-12 * alpha.abs() || !beta.is_finite() {
            break;
        }
        std::mem::swap(&mut before, &mut q);
        for (q, next) in q.iter_mut().zip(&next) {
            *q = next / beta;
        }
    }
    let size = alphas.len();
    let unknown = End { value: f64::NAN, residual: f64::NAN };
    if size == 0 || !beta.is_finite() {
        return [unknown; 2];
    }
    let tridiagonal = DMatrix::from_fn(size, size, |r, c| match r.abs_diff(c) {
        0 => alphas[r],
        1 => betas[r.min(c)],
        _ => 0.0,
    });
    let Some(eigen) = SymmetricEigen::try_new(tridiagonal, f64::EPSILON, 100 * size) else { return [unknown; 2] };
    let end = |k: usize| End { value: eigen.eigenvalues[k], residual: beta * eigen.eigenvectors[(size - 1, k)].abs() };
    [end(eigen.eigenvalues.imin()), end(eigen.eigenvalues.imax())]
}
