//! Arithmetic of small dense blocks, by rows, in double or single precision.
//!
//! The products sum in local copies, which compilers vectorize.

use std::ops::{AddAssign, Mul, SubAssign};

pub(super) type Block<const R: usize, const C: usize, T = f64> = [[T; C]; R];

/// `f64` for set-up, `f32` for cycles.
pub(super) trait Real: Copy + Default + Send + Sync + Mul<Output = Self> + AddAssign + SubAssign {}

impl Real for f64 {}
impl Real for f32 {}

#[inline(always)]
pub(super) fn zero<const R: usize, const C: usize, T: Real>() -> Block<R, C, T> {
    [[T::default(); C]; R]
}

/// `C += A B`.
#[inline(always)]
pub(super) fn add_product<const R: usize, const K: usize, const C: usize, T: Real>(
    c: &mut Block<R, C, T>,
    a: &Block<R, K, T>,
    b: &Block<K, C, T>,
) {
    for (c, a) in c.iter_mut().zip(a) {
        let mut sum = *c;
        for k in 0..K {
            for j in 0..C {
                sum[j] += a[k] * b[k][j];
            }
        }
        *c = sum;
    }
}

/// `C += Aᵀ B`.
#[inline(always)]
pub(super) fn add_transposed_product<const R: usize, const K: usize, const C: usize>(
    c: &mut Block<K, C>,
    a: &Block<R, K>,
    b: &Block<R, C>,
) {
    for (k, c) in c.iter_mut().enumerate() {
        let mut sum = *c;
        for r in 0..R {
            for j in 0..C {
                sum[j] += a[r][k] * b[r][j];
            }
        }
        *c = sum;
    }
}

/// `y += A x`.
#[inline(always)]
pub(super) fn add_apply<const R: usize, const C: usize, T: Real>(y: &mut [T; R], a: &Block<R, C, T>, x: &[T; C]) {
    let mut sum = *y;
    for r in 0..R {
        for c in 0..C {
            sum[r] += a[r][c] * x[c];
        }
    }
    *y = sum;
}

/// `y −= A x`.
#[inline(always)]
pub(super) fn subtract_apply<const R: usize, const C: usize, T: Real>(y: &mut [T; R], a: &Block<R, C, T>, x: &[T; C]) {
    let mut sum = *y;
    for r in 0..R {
        for c in 0..C {
            sum[r] -= a[r][c] * x[c];
        }
    }
    *y = sum;
}

/// `y += Aᵀ x`.
#[inline(always)]
pub(super) fn add_transposed_apply<const R: usize, const C: usize, T: Real>(
    y: &mut [T; C],
    a: &Block<R, C, T>,
    x: &[T; R],
) {
    let mut sum = *y;
    for r in 0..R {
        for c in 0..C {
            sum[c] += a[r][c] * x[r];
        }
    }
    *y = sum;
}

/// `A x`.
#[inline(always)]
pub(super) fn apply<const R: usize, const C: usize, T: Real>(a: &Block<R, C, T>, x: &[T; C]) -> [T; R] {
    let mut y = [T::default(); R];
    add_apply(&mut y, a, x);
    y
}

#[inline(always)]
pub(super) fn double<const R: usize, const C: usize>(a: &Block<R, C, f32>) -> Block<R, C> {
    let mut double = zero();
    for r in 0..R {
        for c in 0..C {
            double[r][c] = f64::from(a[r][c]);
        }
    }
    double
}

#[inline(always)]
pub(super) fn scaled<const R: usize, const C: usize>(factor: f64, a: &Block<R, C>) -> Block<R, C> {
    let mut scaled = *a;
    scaled.as_flattened_mut().iter_mut().for_each(|entry| *entry *= factor);
    scaled
}

#[inline(always)]
pub(super) fn transposed<const R: usize, const C: usize>(a: &Block<R, C>) -> Block<C, R> {
    std::array::from_fn(|r| std::array::from_fn(|c| a[c][r]))
}

#[inline(always)]
pub(super) fn sum<const R: usize, const C: usize, T: Real>(a: &Block<R, C, T>, b: &Block<R, C, T>) -> Block<R, C, T> {
    let mut sum = *a;
    for (sum, &b) in sum.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
        *sum += b;
    }
    sum
}

#[inline(always)]
pub(super) fn shifted<const N: usize>(a: &Block<N, N>, shift: f64) -> Block<N, N> {
    let mut shifted = *a;
    for (k, row) in shifted.iter_mut().enumerate() {
        row[k] += shift;
    }
    shifted
}

/// Entries below this are set to zero: arithmetic with numbers below 1e-38 is slow.
pub(super) const NEGLIGIBLE: f64 = 1e-25;

/// `factor·A` in single precision, where its largest entries are about one; [`NEGLIGIBLE`] entries become zero.
#[inline(always)]
pub(super) fn single<const R: usize, const C: usize>(factor: f64, a: &Block<R, C>) -> Block<R, C, f32> {
    let mut single = zero();
    for r in 0..R {
        for c in 0..C {
            let entry = factor * a[r][c];
            single[r][c] = if entry.abs() < NEGLIGIBLE { 0.0 } else { entry as f32 };
        }
    }
    single
}

/// The block with zeros for [`NEGLIGIBLE`] entries.
#[inline(always)]
pub(super) fn without_negligible<const R: usize, const C: usize>(a: &Block<R, C, f32>) -> Block<R, C, f32> {
    let mut without_negligible = *a;
    for entry in without_negligible.as_flattened_mut() {
        if entry.abs() < NEGLIGIBLE as f32 {
            *entry = 0.0;
        }
    }
    without_negligible
}

#[inline]
pub(super) fn norm_squared(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// A pivot that is not positive; NaN or infinite where the matrix is not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BadPivot {
    pub index: usize,
    pub pivot: f64,
}

/// Whether a symmetric block is positive definite; the lower triangle is read.
#[inline(always)]
pub(super) fn is_definite<const N: usize>(a: &Block<N, N>) -> bool {
    let mut rest = *a;
    (0..N).all(|k| {
        let column: [f64; N] = std::array::from_fn(|row| rest[row][k]);
        for row in rest.iter_mut().skip(k + 1) {
            let factor = row[k] / column[k];
            row.iter_mut().zip(column).skip(k + 1).for_each(|(entry, other)| *entry -= factor * other);
        }
        column[k] > 0.0
    })
}

/// The inverse of a symmetric positive definite block, `A⁻¹ = L⁻ᵀ D⁻¹ L⁻¹` with the root-free `A = L D Lᵀ`; the lower triangle is read.
pub(super) fn inverse<const N: usize>(a: &Block<N, N>) -> Result<Block<N, N>, BadPivot> {
    // L is inverted as it is made: row i of L⁻¹ needs the rows above only.
    let mut l: Block<N, N> = zero();
    let mut l_inverse: Block<N, N> = zero();
    let mut reciprocals = [0.0; N];
    for i in 0..N {
        let mut l_times_d = a[i];
        let mut pivot = a[i][i];
        for j in 0..i {
            l_times_d[j] -= (0..j).map(|k| l_times_d[k] * l[j][k]).sum::<f64>();
            l[i][j] = l_times_d[j] * reciprocals[j];
            pivot -= l_times_d[j] * l[i][j];
        }
        if !(pivot > 0.0 && pivot < f64::INFINITY) {
            return Err(BadPivot { index: i, pivot });
        }
        reciprocals[i] = pivot.recip();
        let before = |j: usize| -(j..i).map(|k| l[i][k] * l_inverse[k][j]).sum::<f64>();
        let row = std::array::from_fn(|j| if j < i { before(j) } else { f64::from(u8::from(j == i)) });
        l_inverse[i] = row;
    }
    let mut inverse: Block<N, N> = zero();
    for i in 0..N {
        for j in 0..=i {
            let sum = (i..N).map(|k| l_inverse[k][i] * reciprocals[k] * l_inverse[k][j]).sum();
            (inverse[i][j], inverse[j][i]) = (sum, sum);
        }
    }
    Ok(inverse)
}

/// Added to diagonal blocks, whose largest of a level is about one: f32 ends at 1e38.
pub(super) const LEAST_DIAGONAL: f64 = 1e-30;

/// As [`inverse`], of the block with [`LEAST_DIAGONAL`] added.
pub(super) fn inverse_of<const N: usize>(block: &Block<N, N>) -> Result<Block<N, N>, BadPivot> {
    inverse(&shifted(block, LEAST_DIAGONAL))
}

#[cfg(test)]
mod tests {
    use super::{BadPivot, inverse, is_definite, single};

    /// NaN stays.
    #[test]
    fn negligible_entries_are_zero() {
        let [[negligible, small, large, undefined]] = single(2.0, &[[-4.9e-26, -5.1e-26, 3.0, f64::NAN]]);
        assert_eq!([negligible, small, large], [0.0, -1.02e-25, 6.0]);
        assert!(undefined.is_nan());
    }

    /// [[4, 2, 2], [2, 5, 3], [2, 3, 6]] = L Lᵀ with L = [[2], [1, 2], [1, 1, 2]]; its determinant is 64.
    #[test]
    fn the_inverse_is_that_of_the_lower_triangle() {
        let ignored = f64::NAN;
        let found = inverse(&[[4.0, ignored, ignored], [2.0, 5.0, ignored], [2.0, 3.0, 6.0]]).unwrap();
        let expected =
            [[21.0, -6.0, -4.0], [-6.0, 20.0, -8.0], [-4.0, -8.0, 16.0]].map(|row| row.map(|entry| entry / 64.0));
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }

    /// [[2, 1], [1, 1]] has the pivots 2 and ½, and with 2 beside the diagonal 2 and −1.
    #[test]
    fn definite_blocks_have_positive_pivots() {
        let ignored = f64::NAN;
        assert!(is_definite(&[[2.0, ignored], [1.0, 1.0]]));
        for not in [[[2.0, 2.0], [2.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]], [[f64::NAN, 0.0], [0.0, 1.0]]] {
            assert!(!is_definite(&not), "{not:?}");
        }
    }

    #[test]
    fn pivots_that_are_not_positive_are_returned() {
        assert_eq!(inverse(&[[1.0, 0.0], [2.0, 4.0]]), Err(BadPivot { index: 1, pivot: 0.0 }));
        assert_eq!(inverse(&[[-1.0]]), Err(BadPivot { index: 0, pivot: -1.0 }));
        assert_eq!(inverse(&[[f64::INFINITY]]), Err(BadPivot { index: 0, pivot: f64::INFINITY }));
        assert!(inverse(&[[f64::NAN]]).is_err_and(|bad| bad.pivot.is_nan()));
    }
}
