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

/// The high end alone, from so many products that the eigenvalues of the tridiagonal matrix would take longer: a bound from below, as every
/// Ritz value is. NaN where a product is not finite.
pub(super) fn upper_end(n: usize, steps: usize, apply: &mut Product<'_>) -> End {
    let Some(tridiagonal) = recurrence(n, steps, apply, &mut |_, _| ()) else {
        return End { value: f64::NAN, residual: f64::NAN };
    };
    let value = tridiagonal.largest();
    End { value, residual: tridiagonal.beta * tridiagonal.last_entry(value) }
}

/// The Ritz vector of the low end, a unit vector, from twice so many products: the recurrence is run again to add up its vectors,
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
                // Zero is taken for a little less: the next one is positive then, as one of both must be.
                if pivot == 0.0 {
                    pivot = -f64::MIN_POSITIVE;
                }
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

    /// The size of the last entry of the unit eigenvector of the largest eigenvalue, by inverse iteration from a little above it, where all
    /// pivots are negative.
    fn last_entry(&self, largest: f64) -> f64 {
        let Self { alphas, betas, .. } = self;
        let count = alphas.len();
        let scale = alphas.iter().zip(betas).fold(0.0f64, |scale, (alpha, beta)| scale.max(alpha.abs() + beta.abs()));
        let shift = largest + 1e-14 * scale;
        let mut pivots = Vec::with_capacity(count);
        for (k, alpha) in alphas.iter().enumerate() {
            let below = pivots.last().map_or(0.0, |pivot| betas[k - 1] * betas[k - 1] / pivot);
            pivots.push((alpha - shift - below).min(-f64::MIN_POSITIVE));
        }
        let mut x = vec![1.0; count];
        for _ in 0..3 {
            for k in 1..count {
                x[k] -= betas[k - 1] / pivots[k - 1] * x[k - 1];
            }
            x.iter_mut().zip(&pivots).for_each(|(x, pivot)| *x /= pivot);
            for k in (1..count).rev() {
                x[k - 1] -= betas[k - 1] / pivots[k - 1] * x[k];
            }
            let length = norm(&x);
            x.iter_mut().for_each(|x| *x /= length);
        }
        x.last().map_or(f64::NAN, |last| last.abs())
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
        assert!((upper_end(n, n, &mut { chain }).value - expected).abs() < 1e-12);
        for steps in [1, 2, 7, 20] {
            let [_, high] = lanczos_ends(n, steps, chain);
            assert!((upper_end(n, steps, &mut { chain }).value - high.value).abs() < 1e-13);
        }
        assert_eq!(upper_end(3, 3, &mut |x: &[f64], y: &mut [f64]| y.copy_from_slice(x)).value, 1.0);
        assert!(upper_end(3, 3, &mut |_: &[f64], y: &mut [f64]| y.fill(f64::NAN)).value.is_nan());
    }

    /// `[2 2; 2 5]` has the eigenvalues 1 and 6, `[100.04 0.02; 0.02 100.01]` 100 and 100.05; what lies outside the space does not count.
    #[test]
    fn the_largest_eigenvalue_is_found_to_the_last_bit() {
        let of =
            |alphas: &[f64], betas: &[f64]| Tridiagonal { alphas: alphas.to_vec(), betas: betas.to_vec(), beta: 0.5 };
        assert_eq!(of(&[2.0, 5.0], &[2.0, 0.5]).largest(), 6.0);
        assert!((of(&[100.04, 100.01], &[0.02, 0.5]).largest() - 100.05).abs() < 1e-12);
        assert_eq!(of(&[-3.0], &[0.5]).largest(), -3.0);
        // Bisection begins at 2, where the first pivot vanishes.
        assert!((of(&[2.0; 3], &[1.0, 1.0, 0.5]).largest() - 2.0 - 2f64.sqrt()).abs() < 1e-14);
    }

    /// Of eigenvectors known in closed form, whatever the size of the matrix.
    #[test]
    fn the_last_entry_is_that_of_the_eigenvector() {
        for scale in [1.0, 2.0f64.powi(-60), 2.0f64.powi(60)] {
            let last = |alphas: &[f64], betas: &[f64]| {
                let times = |values: &[f64]| values.iter().map(|value| scale * value).collect();
                let tridiagonal = Tridiagonal { alphas: times(alphas), betas: times(betas), beta: 0.0 };
                tridiagonal.last_entry(tridiagonal.largest())
            };
            // (1, 2)/√5, (1, √2, 1)/2 and (1, 1)/√2.
            assert!((last(&[2.0, 5.0], &[2.0, 0.5]) - 0.8f64.sqrt()).abs() < 1e-12);
            assert!((last(&[2.0, 2.0, 2.0], &[1.0, 1.0, 0.5]) - 0.5).abs() < 1e-12);
            assert!((last(&[0.0, 0.0], &[2.0, 0.5]) - 0.5f64.sqrt()).abs() < 1e-12);
            // Hardly coupled: the angle is half of atan(2β/5).
            let beta = 5.5e-7;
            let angle = 0.5 * f64::atan(2.0 * beta / 5.0);
            assert!((last(&[6.0, 1.0], &[beta, 0.5]) / angle.sin() - 1.0).abs() < 1e-6);
            // Of (1, 1)/√2 with the eigenvalue 7 a third row takes part in the ratio of β to the distance, 6.
            let beta = 1e-5;
            let expected = beta / (6.0 * 2f64.sqrt());
            assert!((last(&[6.0, 6.0, 1.0], &[1.0, beta, 0.5]) / expected - 1.0).abs() < 1e-6);
            // (1, 2)/√5 with the eigenvalue 6.
            let expected = beta * 0.8f64.sqrt() / 5.0;
            assert!((last(&[2.0, 5.0, 1.0], &[2.0, beta, 0.5]) / expected - 1.0).abs() < 1e-6);
        }
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

    /// The residual of the upper end, by inverse iteration with the tridiagonal matrix and by all of its eigenvectors.
    #[test]
    fn the_residual_of_the_upper_end_is_the_same_by_bisection() {
        let (n, scale) = (400, 3.0);
        let mut apply = |x: &[f64], y: &mut [f64]| {
            for (k, y) in y.iter_mut().enumerate() {
                let beside = |l: Option<usize>| l.and_then(|l| x.get(l)).copied().unwrap_or(0.0);
                *y = scale * (2.0 * x[k] - beside(k.checked_sub(1)) - beside(Some(k + 1)));
            }
        };
        let largest = scale * (2.0 + 2.0 * (std::f64::consts::PI / (n as f64 + 1.0)).cos());
        for steps in [5, 40, 120] {
            let [_, whole] = lanczos_ends(n, steps, &mut apply);
            let alone = upper_end(n, steps, &mut apply);
            approx::assert_relative_eq!(alone.value, whole.value, max_relative = 1e-13);
            approx::assert_relative_eq!(alone.residual, whole.residual, max_relative = 1e-4, epsilon = 1e-9);
            assert!(alone.value <= largest * (1.0 + 1e-14) && largest - alone.value <= alone.residual, "{alone:?}");
        }
    }
}
