//! The vector operations of conjugate gradients: parallel, fused where they read the same vectors, and the same to the bit
//! for any number of threads, as [inner products](crate::operator::dot) are.

use crate::operator::inner_product::{PIECE, SERIAL, both, dot_piece, middle};
use crate::registers::widely;

/// `r −= α q`; returns `rᵀr`.
pub fn descend(alpha: f64, q: &[f64], r: &mut [f64]) -> f64 {
    if r.len() <= PIECE {
        return widely(
            #[inline(always)]
            || {
                for (r, q) in r.iter_mut().zip(q) {
                    *r -= alpha * q;
                }
                dot_piece(r, r)
            },
        );
    }
    let at = middle(r.len());
    let ((q0, q1), (r0, r1)) = (q.split_at(at), r.split_at_mut(at));
    let (first, second) = both(q.len(), || descend(alpha, q0, r0), || descend(alpha, q1, r1));
    first + second
}

/// `x += α p`, then `p = z + β p`.
pub fn advance(alpha: f64, beta: f64, z: &[f64], p: &mut [f64], x: &mut [f64]) {
    if p.len() <= SERIAL {
        return widely(
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

/// `r = s b − q`; returns `rᵀr`.
pub fn subtract(s: f64, b: &[f64], q: &[f64], r: &mut [f64]) -> f64 {
    if r.len() <= PIECE {
        return widely(
            #[inline(always)]
            || {
                for ((r, b), q) in r.iter_mut().zip(b).zip(q) {
                    *r = s * b - q;
                }
                dot_piece(r, r)
            },
        );
    }
    let at = middle(r.len());
    let ((b0, b1), (q0, q1), (r0, r1)) = (b.split_at(at), q.split_at(at), r.split_at_mut(at));
    let (first, second) = both(b.len(), || subtract(s, b0, q0, r0), || subtract(s, b1, q1, r1));
    first + second
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::dot;

    fn vector(length: usize, seed: f64) -> Vec<f64> {
        (0..length).map(|i| ((i as f64 + 0.5) * seed).sin()).collect()
    }

    /// On lengths around every boundary, against the plain loops and, for the sums, their rounding bound.
    #[test]
    fn operations_agree_with_plain_loops() {
        for length in [0, 1, 15, 16, 17, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE + 5, SERIAL, SERIAL + 1, 5 * SERIAL + 7]
        {
            let (p, q, b) = (vector(length, 0.7), vector(length, 1.3), vector(length, 2.9));
            let (mut x, mut r) = (vector(length, 0.3), b.clone());
            let (x0, alpha, beta) = (x.clone(), 0.37, -1.7);
            let squares = descend(alpha, &q, &mut r);
            assert!((0..length).all(|i| r[i] == b[i] - alpha * q[i]));
            let plain: f64 = r.iter().map(|r| r * r).sum();
            let bound = length as f64 * f64::EPSILON;
            assert!((squares - plain).abs() <= bound * plain);
            assert_eq!(squares, dot(&r, &r));
            let mut direction = p.clone();
            advance(alpha, beta, &q, &mut direction, &mut x);
            assert!((0..length).all(|i| x[i] == x0[i] + alpha * p[i] && direction[i] == q[i] + beta * p[i]));
            assert_eq!(subtract(beta, &b, &q, &mut r), dot(&r, &r));
            assert!((0..length).all(|i| r[i] == beta * b[i] - q[i]));
        }
    }

    #[test]
    fn sums_are_the_same_to_the_bit_for_any_number_of_threads() {
        let (a, b) = (vector(200_001, 0.7), vector(200_001, 1.3));
        let sums = [1, 2, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| dot(&a, &b)).to_bits()
        });
        assert!(sums.iter().all(|&sum| sum == sums[0]));
    }
}
