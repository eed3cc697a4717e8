//! The residual `b − A x` with twice the usual precision, and how large its terms are.
//!
//! In double precision the residual of a good solution is all rounding. Products and sums are therefore split without
//! error into a number and what rounding cut off (two-sum by Knuth, two-product with a fused multiply-add), and the
//! cut-off parts are added up beside: as if computed in 106 bits and rounded once (Ogita, Rump and Oishi 2005).

use super::check::worst;
use nalgebra_sparse::CscMatrix;

/// `b − A x` and `|A| |x| + |b|`.
#[derive(Debug, Clone)]
pub(super) struct Residual {
    pub values: Vec<f64>,
    pub terms: Vec<f64>,
}

impl Residual {
    /// `None` when the sizes do not fit.
    pub fn new(a: &CscMatrix<f64>, b: &[f64], x: &[f64]) -> Option<Self> {
        if a.nrows() != b.len() || a.ncols() != x.len() {
            return None;
        }
        let mut sums: Vec<(f64, f64)> = b.iter().map(|&b| (b, 0.0)).collect();
        let mut terms: Vec<f64> = b.iter().map(|b| b.abs()).collect();
        for (row, column, &value) in a.triplet_iter() {
            let product = value * x[column];
            let cut_off = value.mul_add(x[column], -product);
            let (sum, low) = &mut sums[row];
            let (next, lost) = two_sum(*sum, -product);
            *sum = next;
            *low += lost - cut_off;
            terms[row] += product.abs();
        }
        Some(Self { values: sums.into_iter().map(|(sum, low)| sum + low).collect(), terms })
    }
}

/// The rounded sum and what rounding cut off.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// The largest magnitude; NaN if there is one, zero for an empty vector.
pub(super) fn largest(values: &[f64]) -> f64 {
    worst(values.iter().map(|value| value.abs()).chain([0.0]))
}

/// The maximum norm of a matrix.
pub(super) fn norm_inf(a: &CscMatrix<f64>) -> f64 {
    let mut sums = vec![0.0; a.nrows()];
    a.triplet_iter().for_each(|(row, _, value)| sums[row] += value.abs());
    largest(&sums)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn the_residual_is_exact_where_double_precision_sees_nothing() {
        // 1 − (1 + 2⁻³⁰)(1 − 2⁻³⁰) = 2⁻⁶⁰, which a rounded product loses.
        let e = 2.0_f64.powi(-30);
        let a = CscMatrix::from(&DMatrix::from_element(1, 1, 1.0 + e));
        let residual = Residual::new(&a, &[1.0], &[1.0 - e]).unwrap();
        assert_eq!(residual.values, [2.0_f64.powi(-60)]);
        assert_eq!(1.0 - (1.0 + e) * (1.0 - e), 0.0);
        assert!(Residual::new(&a, &[1.0, 2.0], &[1.0]).is_none());
        assert!(Residual::new(&a, &[1.0], &[]).is_none());
    }
}
