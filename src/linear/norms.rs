//! Inner products and error measures of vectors.

pub use super::vector::dot;

/// The Euclidean norm.
#[inline]
pub fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The largest magnitude; NaN if there is one.
pub(super) fn max_norm(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |largest, &value| if value.abs() <= largest { largest } else { value.abs() })
}

/// The normwise backward error `‖r‖/(‖A‖‖x‖ + ‖b‖)` in the maximum norm (Rigal and Gaches 1967): the smallest relative
/// change of A and b that makes x exact. Zero when everything is zero.
pub fn backward_error(residual: &[f64], matrix_norm: f64, x: &[f64], b: &[f64]) -> f64 {
    let residual = max_norm(residual);
    if residual == 0.0 { 0.0 } else { residual / (matrix_norm * max_norm(x) + max_norm(b)) }
}
