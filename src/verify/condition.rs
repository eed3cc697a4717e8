//! How far an error of the data is amplified: the condition number and what it implies, estimated with a few solves.

use super::force_error::U;
use super::residual::{largest, norm_inf};
use nalgebra_sparse::CscMatrix;

/// How much too low the estimate may be: Higham (2002, §15) reports a factor of 3 as the worst in practice.
pub(super) const ESTIMATE_FACTOR: f64 = 3.0;

/// Estimates the 1-norm `‖B‖₁ = max ‖B x‖₁/‖x‖₁` of a matrix known by its products with B and Bᵀ: always a lower bound,
/// nearly always within a factor of 3 (Hager 1984, Higham 1988).
///
/// A climb over the corners `± e_j` of the unit ball: where ‖B x‖₁ is largest its gradient `Bᵀ sign(B x)` points to the
/// next one. A last vector of alternating signs catches matrices that are built to fool the climb.
///
/// # Examples
/// ```
/// use sprung::verify::one_norm_estimate;
///
/// // Of a diagonal matrix, known by its products: the largest entry.
/// let product = |x: &mut [f64]| x.iter_mut().zip([1.0, -7.0, 3.0]).for_each(|(x, a)| *x *= a);
/// assert_eq!(one_norm_estimate(3, product, product), 7.0);
/// ```
pub fn one_norm_estimate(
    order: usize,
    mut product: impl FnMut(&mut [f64]),
    mut transposed: impl FnMut(&mut [f64]),
) -> f64 {
    let norm = |x: &[f64]| x.iter().map(|x| x.abs()).sum::<f64>();
    let n = order as f64;
    let mut x = vec![1.0 / n; order];
    product(&mut x);
    let mut estimate = norm(&x);
    let mut last = usize::MAX;
    for _ in 0..5 {
        x.iter_mut().for_each(|x| *x = if *x < 0.0 { -1.0 } else { 1.0 });
        transposed(&mut x);
        let steepest = x.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map(|(index, _)| index);
        let Some(steepest) = steepest.filter(|&index| index != last) else { break };
        last = steepest;
        x.fill(0.0);
        x[steepest] = 1.0;
        product(&mut x);
        let next = norm(&x);
        if next <= estimate {
            break;
        }
        estimate = next;
    }
    for (i, x) in x.iter_mut().enumerate() {
        let size = 1.0 + i as f64 / (n - 1.0).max(1.0);
        *x = if i % 2 == 0 { size } else { -size };
    }
    product(&mut x);
    super::check::worst([estimate, 2.0 * norm(&x) / (3.0 * n)])
}

/// Condition of a symmetric matrix in the 1-norm, from its entries and a solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Condition {
    /// `‖A‖₁`, exact.
    pub norm: f64,
    /// `‖A⁻¹‖₁`, estimated from below.
    pub inverse_norm: f64,
}

impl Condition {
    /// Estimates with about five solves `x ← A⁻¹ x`.
    pub fn estimate(a: &CscMatrix<f64>, solve: &mut dyn FnMut(&mut [f64])) -> Self {
        let solve = std::cell::RefCell::new(solve);
        let product = |x: &mut [f64]| (solve.borrow_mut())(x);
        Self { norm: norm_inf(a), inverse_norm: one_norm_estimate(a.ncols(), product, product) }
    }

    /// `κ = ‖A‖₁ ‖A⁻¹‖₁`.
    pub fn number(&self) -> f64 {
        self.norm * self.inverse_norm
    }
}

/// Bound of `‖δx‖∞` for the solution of `A x = b` with a residual of at most `residual` in each component: `‖ |A⁻¹| r
/// ‖∞`, estimated as the 1-norm of `diag(r) A⁻¹`, times 3 as the estimate is from below.
///
/// Unlike `κ(A)` times the relative residual it does not suffer from badly scaled rows.
pub fn forward_bound(residual: &[f64], solve: &mut dyn FnMut(&mut [f64])) -> f64 {
    let solve = std::cell::RefCell::new(solve);
    let weigh = |x: &mut [f64]| x.iter_mut().zip(residual).for_each(|(x, r)| *x *= r);
    let product = |x: &mut [f64]| {
        (solve.borrow_mut())(x);
        weigh(x);
    };
    let transposed = |x: &mut [f64]| {
        weigh(x);
        (solve.borrow_mut())(x);
    };
    if largest(residual) == 0.0 {
        return 0.0;
    }
    ESTIMATE_FACTOR * one_norm_estimate(residual.len(), product, transposed) * (1.0 + residual.len() as f64 * U)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn estimate(b: &DMatrix<f64>) -> f64 {
        let times = |b: DMatrix<f64>| {
            move |x: &mut [f64]| {
                let y = &b * DVector::from_column_slice(x);
                x.copy_from_slice(y.as_slice());
            }
        };
        one_norm_estimate(b.ncols(), times(b.clone()), times(b.transpose()))
    }

    #[test]
    fn the_estimate_is_a_lower_bound_within_a_factor_of_three() {
        for seed in 0..40 {
            let n = 1 + seed as usize % 9;
            let b = DMatrix::from_vec(n, n, crate::verify::reduced::random_vector(n * n, seed));
            let exact = b.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
            let found = estimate(&b);
            assert!(found <= exact * 1.000001 && found >= exact / 3.0, "{found} of {exact}");
        }
        assert!(estimate(&DMatrix::from_element(2, 2, f64::NAN)).is_nan());
        assert_eq!(forward_bound(&[], &mut |_| {}), 0.0);
        assert_eq!(forward_bound(&[0.0], &mut |_| {}), 0.0);
    }

    /// A matrix that fools the climb: `B x` of the even vector and of every corner that the climb tries is small beside that of the alternating
    /// vector `(1, −1 − 1/(n − 1), 1 + 2/(n − 1), …)`, of which two thirds over n are the estimate (Higham 1988).
    #[test]
    fn the_last_vector_alternates() {
        for n in 2..7 {
            let z: Vec<f64> = (0..n)
                .map(|i| (1.0 + f64::from(i) / (f64::from(n) - 1.0)) * if i % 2 == 0 { 1.0 } else { -1.0 })
                .collect();
            let mut seen = Vec::new();
            let nothing = |x: &mut [f64]| x.fill(0.0);
            let product = |x: &mut [f64]| {
                seen = x.to_vec();
                x.fill(3.0);
            };
            let found = one_norm_estimate(n as usize, product, nothing);
            for (seen, expected) in seen.iter().zip(&z) {
                assert!((seen - expected).abs() < 1e-15, "{seen} {expected}");
            }
            assert!((found - 3.0 * f64::from(n)).abs() < 1e-12);
            let large =
                one_norm_estimate(n as usize, |x| if x[1] < -0.9 { x.fill(90.0) } else { x.fill(0.0) }, nothing);
            assert!((large - 60.0).abs() < 1e-12, "{large}");
        }
    }

    /// The climb follows signs, of which that of zero is positive: from (1, 1) the gradient of ‖B x‖₁ for B = (1, 0; −1, 1) is Bᵀ(1, 1).
    #[test]
    fn the_climb_follows_signs() {
        let mut signs = Vec::new();
        let product = |x: &mut [f64]| (x[0], x[1], x[2]) = (x[0], x[1] - x[0], x[2] - 2.0 * x[0]);
        let found = one_norm_estimate(3, product, |x: &mut [f64]| {
            signs.push(x.to_vec());
            (x[0], x[1], x[2]) = (x[0] - x[1] - 2.0 * x[2], x[1], x[2]);
        });
        assert_eq!((signs[0].as_slice(), found), (&[1.0, 1.0, -1.0][..], 4.0));
    }

    /// Three times ‖diag(r) A⁻¹‖₁, a little more for rounding, also where one of the residuals is zero.
    #[test]
    fn forward_bounds_weigh_the_residual() {
        let halved = |x: &mut [f64]| x.iter_mut().for_each(|x| *x *= 0.5);
        let bound = forward_bound(&[0.0, 8.0, 2.0], &mut { halved });
        assert!(bound > 12.0 && bound < 12.0 * (1.0 + 1e-12), "{bound}");
    }
}
