//! Norms, error measures and the fused vector operations of conjugate gradients: parallel, and the same to the bit for any number of threads, as
//! [inner products](crate::operator::dot) are.

pub use crate::operator::dot;
use crate::operator::inner_product::{PIECE, SERIAL, both, dot_piece, middle};
use crate::registers::dispatch_simd;

/// The Euclidean norm.
#[inline]
pub fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The largest magnitude; NaN if there is one.
fn max_norm(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |largest, &value| if value.abs() <= largest { largest } else { value.abs() })
}

/// The normwise backward error `‖r‖/(‖A‖‖x‖ + ‖b‖)` in the maximum norm (Rigal and Gaches 1967): the smallest relative change of A and b that makes x
/// exact. Zero when everything is zero.
pub fn backward_error(residual: &[f64], matrix_norm: f64, x: &[f64], b: &[f64]) -> f64 {
    let residual = max_norm(residual);
    if residual == 0.0 { 0.0 } else { residual / (matrix_norm * max_norm(x) + max_norm(b)) }
}

/// The power of two that scales a right-hand side so that no product under- or overflows: 1 for norms between 1e-100 and 1e100, otherwise one that
/// makes the largest entry about 1.
pub(super) fn scaling(b: &[f64]) -> f64 {
    if (1e-100..1e100).contains(&norm(b)) {
        return 1.0;
    }
    let largest = max_norm(b);
    if largest == 0.0 || !largest.is_finite() {
        return 1.0;
    }
    // The inverse of a number below 2⁻¹⁰²² would overflow.
    (-largest.log2().round()).clamp(-1020.0, 1020.0).exp2()
}

/// Sets every r from itself and the numbers of two other vectors; returns `rᵀr`.
fn set_and_square(r: &mut [f64], a: &[f64], b: &[f64], set: impl Fn(&mut f64, f64, f64) + Copy + Sync) -> f64 {
    if r.len() <= PIECE {
        return dispatch_simd(
            #[inline(always)]
            || {
                for ((r, a), b) in r.iter_mut().zip(a).zip(b) {
                    set(r, *a, *b);
                }
                dot_piece(r, r)
            },
        );
    }
    let (length, at) = (r.len(), middle(r.len()));
    let ((a0, a1), (b0, b1), (r0, r1)) = (a.split_at(at), b.split_at(at), r.split_at_mut(at));
    let (first, second) = both(length, || set_and_square(r0, a0, b0, set), || set_and_square(r1, a1, b1, set));
    first + second
}

/// `r −= α q`; returns `rᵀr`.
pub(super) fn descend(alpha: f64, q: &[f64], r: &mut [f64]) -> f64 {
    set_and_square(
        r,
        q,
        q,
        #[inline(always)]
        |r, q, _| *r -= alpha * q,
    )
}

/// `r = s b − q`; returns `rᵀr`.
pub(super) fn subtract(s: f64, b: &[f64], q: &[f64], r: &mut [f64]) -> f64 {
    set_and_square(
        r,
        b,
        q,
        #[inline(always)]
        |r, b, q| *r = s * b - q,
    )
}

/// `x += α p`, then `p = z + β p`.
pub(super) fn advance(alpha: f64, beta: f64, z: &[f64], p: &mut [f64], x: &mut [f64]) {
    if p.len() <= SERIAL {
        return dispatch_simd(
            #[inline(always)]
            || {
                for ((x, p), z) in x.iter_mut().zip(p.iter_mut()).zip(z) {
                    *x += alpha * *p;
                    *p = z + beta * *p;
                }
            },
        );
    }
    let at = middle(p.len());
    let ((z0, z1), (p0, p1), (x0, x1)) = (z.split_at(at), p.split_at_mut(at), x.split_at_mut(at));
    rayon::join(|| advance(alpha, beta, z0, p0, x0), || advance(alpha, beta, z1, p1, x1));
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn backward_errors_are_relative_to_matrix_and_right_hand_side() {
        assert_eq!(backward_error(&[0.5, -2.0], 3.0, &[4.0, 1.0], &[-8.0, 0.0]), 0.1);
        assert_eq!(backward_error(&[0.0, 0.0], 0.0, &[0.0, 0.0], &[0.0, 0.0]), 0.0);
    }
}
