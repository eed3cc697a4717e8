//! Inner products and error measures of vectors.

pub use crate::operator::dot;

/// The Euclidean norm.
#[inline]
pub fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The largest magnitude; NaN if there is one.
pub(super) fn max_norm(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |largest, &value| if value.abs() <= largest { largest } else { value.abs() })
}

/// Right-hand sides between these have squares, and products with a few digits to spare, that neither over- nor underflow.
const PLAIN: std::ops::Range<f64> = 1e-100..1e100;

/// The power of two by which to multiply a right-hand side before `A x = b` is solved, and to divide the solution after: 1 for
/// those of an ordinary size, else one that makes the largest entry about 1. Powers of two round nothing.
pub(super) fn scaling(b: &[f64]) -> f64 {
    // The norm tells, and costs less than a search for the largest.
    if PLAIN.contains(&norm(b)) {
        return 1.0;
    }
    let largest = max_norm(b);
    if largest == 0.0 || !largest.is_finite() {
        return 1.0;
    }
    // Of a number below 2⁻¹⁰²² the inverse would overflow: such numbers get as near to 1 as they can.
    (-largest.log2().round()).clamp(-1020.0, 1020.0).exp2()
}

/// The normwise backward error `‖r‖/(‖A‖‖x‖ + ‖b‖)` in the maximum norm (Rigal and Gaches 1967): the smallest relative
/// change of A and b that makes x exact. Zero when everything is zero.
///
/// # Examples
/// ```
/// use sprung::linear::backward_error;
///
/// // 2 x = 1, solved as x = 0.5 + 1e-17: as good as a solution can be.
/// let x = 0.5 + 1e-17;
/// assert!(backward_error(&[1.0 - 2.0 * x], 2.0, &[x], &[1.0]) <= f64::EPSILON);
/// ```
pub fn backward_error(residual: &[f64], matrix_norm: f64, x: &[f64], b: &[f64]) -> f64 {
    let residual = max_norm(residual);
    if residual == 0.0 { 0.0 } else { residual / (matrix_norm * max_norm(x) + max_norm(b)) }
}

#[cfg(test)]
mod tests {
    use super::scaling;

    /// A power of two, and only where it is needed.
    #[test]
    fn right_hand_sides_are_scaled_to_about_one() {
        for plain in [0.0, 1e-99, 1.0, -0.9e100, f64::INFINITY, f64::NAN] {
            assert_eq!(scaling(&[plain]), 1.0, "{plain}");
        }
        for odd in [1e-101, -3e-160, 1e-306, 1e101, 1.7e308] {
            let s = scaling(&[odd, 0.5 * odd]);
            assert!((1e-3..=20.0).contains(&(s * odd).abs()), "{odd}: {s}");
            assert_eq!(s.log2().fract(), 0.0);
            assert_eq!(s * odd / s, odd);
        }
        assert!(scaling(&[5e-324]).is_finite() && scaling(&[]) == 1.0);
    }

    /// 2 against 3·4 + 8.
    #[test]
    fn backward_errors_are_of_the_matrix_and_the_right_hand_side() {
        assert_eq!(super::backward_error(&[0.5, -2.0], 3.0, &[4.0, 1.0], &[-8.0, 0.0]), 0.1);
        assert_eq!(super::backward_error(&[0.0, 0.0], 0.0, &[0.0, 0.0], &[0.0, 0.0]), 0.0);
    }
}
