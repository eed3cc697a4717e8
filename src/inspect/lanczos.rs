//! Where a spectrum ends, roughly, by a short Lanczos recurrence.
//!
//! `β_k q_{k+1} = A q_k − α_k q_k − β_{k−1} q_{k−1}` makes A tridiagonal. Without any reorthogonalisation the eigenvalues of the
//! tridiagonal matrix still approach the ends of the spectrum first, and `β_k |s_k|`, s_k the last entry of an eigenvector, still
//! estimates the distance to an eigenvalue of A (Paige 1971). Nothing is proven by this; it tells where to try.

use super::random::gaussian;
use crate::linear::{dot, norm};
use nalgebra::{DMatrix, Dyn, SymmetricEigen};
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
    let unknown = End { value: f64::NAN, residual: f64::NAN };
    let Some(tridiagonal) = recurrence(n, steps, &mut apply, &mut |_, _| ()) else { return [unknown; 2] };
    let Some(eigen) = tridiagonal.eigen() else { return [unknown; 2] };
    let last = eigen.eigenvalues.len() - 1;
    let end = |k: usize| {
        let residual = tridiagonal.beta * eigen.eigenvectors[(last, k)].abs();
        End { value: eigen.eigenvalues[k], residual }
    };
    [end(eigen.eigenvalues.imin()), end(eigen.eigenvalues.imax())]
}

/// The largest eigenvalue from at most `steps` products: a bound from below, as every Ritz value is. NaN where a product is not finite.
pub(super) fn lanczos_largest(n: usize, steps: usize, apply: &mut Product<'_>) -> f64 {
    recurrence(n, steps, apply, &mut |_, _| ()).map_or(f64::NAN, |tridiagonal| tridiagonal.largest())
}

/// The Ritz vector of the low end, not normalised, from twice so many products: the recurrence is run again to add up its vectors,
/// so that none is kept. `None` where a product is not finite.
pub(super) fn lowest_vector(n: usize, steps: usize, apply: &mut Product<'_>) -> Option<Vec<f64>> {
    let eigen = recurrence(n, steps, apply, &mut |_, _| ())?.eigen()?;
    let parts = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let mut lowest = vec![0.0; n];
    recurrence(n, parts.len(), apply, &mut |k, q| {
        let part = parts.get(k).copied().unwrap_or(0.0);
        lowest.iter_mut().zip(q).for_each(|(lowest, q)| *lowest += part * q);
    })?;
    let length = norm(&lowest);
    lowest.iter_mut().for_each(|lowest| *lowest /= length);
    length.is_finite().then_some(lowest)
}

/// `y = A x`.
type Product<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

/// What A is in the space of a recurrence.
struct Tridiagonal {
    alphas: Vec<f64>,
    betas: Vec<f64>,
    /// The length of what the last product had outside the space.
    beta: f64,
}

impl Tridiagonal {
    /// The largest eigenvalue, by bisection: as many pivots of `T − x` are positive as eigenvalues lie above x.
    fn largest(&self) -> f64 {
        let Self { alphas, betas, .. } = self;
        let beside = |k: usize| k.checked_sub(1).and_then(|k| betas.get(k)).copied().unwrap_or(0.0).abs();
        let ends = |k: usize| beside(k) + if k + 1 < alphas.len() { betas[k].abs() } else { 0.0 };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (k, alpha) in alphas.iter().enumerate() {
            (low, high) = (low.min(alpha - ends(k)), high.max(alpha + ends(k)));
        }
        let exceeds = |x: f64| {
            let mut pivot = -1.0;
            (0..alphas.len()).any(|k| {
                pivot = alphas[k] - x - beside(k) * beside(k) / pivot;
                pivot > 0.0
            })
        };
        loop {
            let middle = low.midpoint(high);
            if middle <= low || middle >= high {
                return high;
            }
            if exceeds(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
    }

    fn eigen(&self) -> Option<SymmetricEigen<f64, Dyn>> {
        let size = self.alphas.len();
        let tridiagonal = DMatrix::from_fn(size, size, |r, c| match r.abs_diff(c) {
            0 => self.alphas[r],
            1 => self.betas[r.min(c)],
            _ => 0.0,
        });
        SymmetricEigen::try_new(tridiagonal, f64::EPSILON, 100 * size)
    }
}

/// The recurrence from a random vector, always the same; `visit` sees every q. `None` where a product is not finite, or there is none.
fn recurrence(
    n: usize,
    steps: usize,
    apply: &mut Product<'_>,
    visit: &mut dyn FnMut(usize, &[f64]),
) -> Option<Tridiagonal> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    let mut q = vec![0.0; n];
    gaussian(&mut rng, &mut q);
    let length = norm(&q);
    q.iter_mut().for_each(|q| *q /= length);
    let (mut before, mut next) = (vec![0.0; n], vec![0.0; n]);
    let (mut alphas, mut betas) = (Vec::new(), Vec::new());
    let mut beta = 0.0;
    for step in 0..steps.min(n) {
        visit(step, &q);
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
    (!alphas.is_empty() && beta.is_finite()).then_some(Tridiagonal { alphas, betas, beta })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the eigenvalues of the whole matrix: of a chain of springs, whose eigenvalues are known, and of one that falls apart.
    #[test]
    fn both_ways_to_the_largest_eigenvalue_agree() {
        let n = 40;
        let chain = |x: &[f64], y: &mut [f64]| {
            for (k, y) in y.iter_mut().enumerate() {
                let beside = [k.checked_sub(1), Some(k + 1)].map(|k| k.and_then(|k| x.get(k)).copied().unwrap_or(0.0));
                *y = 2.0 * x[k] - beside[0] - beside[1];
            }
        };
        let expected = 2.0 + 2.0 * (std::f64::consts::PI / (n + 1) as f64).cos();
        assert!((lanczos_largest(n, n, &mut { chain }) - expected).abs() < 1e-12);
        for steps in [1, 2, 7, 20] {
            let [_, high] = lanczos_ends(n, steps, chain);
            assert!((lanczos_largest(n, steps, &mut { chain }) - high.value).abs() < 1e-13);
        }
        assert_eq!(lanczos_largest(3, 3, &mut |x: &[f64], y: &mut [f64]| y.copy_from_slice(x)), 1.0);
        assert!(lanczos_largest(3, 3, &mut |_: &[f64], y: &mut [f64]| y.fill(f64::NAN)).is_nan());
    }

    /// The vector is that of the value, and its curvature as low.
    #[test]
    fn the_lowest_vector_has_the_lowest_curvature() {
        let n = 200;
        let diagonal = |x: &[f64], y: &mut [f64]| {
            y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = (k as f64 - 3.0) * x);
        };
        let lowest = lowest_vector(n, 80, &mut { diagonal }).unwrap();
        let curvature: f64 = (0..n).map(|k| (k as f64 - 3.0) * lowest[k] * lowest[k]).sum();
        assert!((norm(&lowest) - 1.0).abs() < 1e-12 && (curvature + 3.0).abs() < 1e-6, "{curvature}");
    }
}
