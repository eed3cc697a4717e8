//! Arithmetic of small dense blocks, by rows.

/// An R × C block.
pub(super) type Block<const R: usize, const C: usize> = [[f64; C]; R];

/// The zero block.
pub(super) const fn zero<const R: usize, const C: usize>() -> Block<R, C> {
    [[0.0; C]; R]
}

/// `C += A B`.
#[inline(always)]
pub(super) fn add_product<const R: usize, const K: usize, const C: usize>(
    c: &mut Block<R, C>,
    a: &Block<R, K>,
    b: &Block<K, C>,
) {
    for (c, a) in c.iter_mut().zip(a) {
        for (a, b) in a.iter().zip(b) {
            for (c, b) in c.iter_mut().zip(b) {
                *c += a * b;
            }
        }
    }
}

/// `C += Aᵀ B`.
#[inline(always)]
pub(super) fn add_transposed_product<const R: usize, const K: usize, const C: usize>(
    c: &mut Block<K, C>,
    a: &Block<R, K>,
    b: &Block<R, C>,
) {
    for (a, b) in a.iter().zip(b) {
        for (c, a) in c.iter_mut().zip(a) {
            for (c, b) in c.iter_mut().zip(b) {
                *c += a * b;
            }
        }
    }
}

/// `y += A x`.
#[inline(always)]
pub(super) fn add_apply<const R: usize, const C: usize>(y: &mut [f64; R], a: &Block<R, C>, x: &[f64; C]) {
    for (y, a) in y.iter_mut().zip(a) {
        for (a, x) in a.iter().zip(x) {
            *y += a * x;
        }
    }
}

/// `y −= A x`.
#[inline(always)]
pub(super) fn subtract_apply<const R: usize, const C: usize>(y: &mut [f64; R], a: &Block<R, C>, x: &[f64; C]) {
    for (y, a) in y.iter_mut().zip(a) {
        for (a, x) in a.iter().zip(x) {
            *y -= a * x;
        }
    }
}

/// `y += Aᵀ x`.
#[inline(always)]
pub(super) fn add_transposed_apply<const R: usize, const C: usize>(y: &mut [f64; C], a: &Block<R, C>, x: &[f64; R]) {
    for (a, x) in a.iter().zip(x) {
        for (y, a) in y.iter_mut().zip(a) {
            *y += a * x;
        }
    }
}

/// `A x`.
#[inline(always)]
pub(super) fn apply<const R: usize, const C: usize>(a: &Block<R, C>, x: &[f64; C]) -> [f64; R] {
    let mut y = [0.0; R];
    add_apply(&mut y, a, x);
    y
}

/// `Σ x_i²`.
#[inline]
pub(super) fn norm_squared<const N: usize>(x: &[f64; N]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// A pivot that is not positive; `f64::NAN` or infinite where the matrix is not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BadPivot {
    pub index: usize,
    pub pivot: f64,
}

/// The inverse of a symmetric positive definite block, through its Cholesky factor; the lower triangle is read.
pub(super) fn inverse<const N: usize>(a: &Block<N, N>) -> Result<Block<N, N>, BadPivot> {
    // L is inverted as it is made: row i of L⁻¹ needs the rows above only.
    let mut l = zero::<N, N>();
    let mut l_inverse = zero::<N, N>();
    for i in 0..N {
        for j in 0..i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = (a[i][j] - sum) / l[j][j];
        }
        let pivot = a[i][i] - norm_squared(&l[i]);
        if !(pivot > 0.0 && pivot.is_finite()) {
            return Err(BadPivot { index: i, pivot });
        }
        l[i][i] = pivot.sqrt();
        for j in 0..i {
            let sum: f64 = (j..i).map(|k| l[i][k] * l_inverse[k][j]).sum();
            l_inverse[i][j] = -sum / l[i][i];
        }
        l_inverse[i][i] = 1.0 / l[i][i];
    }
    let mut inverse = zero();
    add_transposed_product(&mut inverse, &l_inverse, &l_inverse);
    Ok(inverse)
}
