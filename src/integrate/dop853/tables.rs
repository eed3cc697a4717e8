//! What follows from the coefficients.

use super::coefficients::{A, D, Row, STAGES};

/// Below this a coefficient is the rounding of one that is zero: the least of the method's is 5e-5.
const ROUNDING: f64 = 1e-12;

/// A².
pub(super) const SQUARE: [Row; STAGES] = {
    let mut square = [[0.0; STAGES]; STAGES];
    let mut i = 0;
    while i < STAGES {
        square[i] = chain(&A[i], &A);
        i += 1;
    }
    square
};

/// `row · matrix`.
pub(super) const fn chain(row: &Row, matrix: &[Row; STAGES]) -> Row {
    let mut product = [0.0; STAGES];
    let mut j = 0;
    while j < STAGES {
        let mut k = 0;
        while k < STAGES {
            product[j] += row[k] * matrix[k][j];
            k += 1;
        }
        if product[j].abs() < ROUNDING {
            product[j] = 0.0;
        }
        j += 1;
    }
    product
}

/// The sum of all coefficients.
pub(super) fn sum(row: &Row) -> f64 {
    let sum: f64 = row.iter().sum();
    if sum.abs() < ROUNDING { 0.0 } else { sum }
}

/// The weights of the stages in the interpolant at the share s of a step: `y(s) = y + h Σ w_j k_j`.
///
/// With t = 1 − s, the formula's b, the rates k_0 and k_12 at both ends and `d_i = Σ D_ij k_j`, the polynomial is
/// `y + h s (b·k + t (k_0 − b·k + s (2 b·k − k_0 − k_12 + t (d_0 + s (d_1 + t (d_2 + s d_3))))))`.
pub(super) fn weights(s: f64) -> Row {
    let t = 1.0 - s;
    let b = &A[12];
    let [d0, d1, d2, d3] = &D;
    std::array::from_fn(|j| {
        let (first, last) = (f64::from(u8::from(j == 0)), f64::from(u8::from(j == 12)));
        let inner = d0[j] + (d1[j] + (d2[j] + d3[j] * s) * t) * s;
        s * (b[j] + t * (first - b[j] + s * (2.0 * b[j] - first - last + t * inner)))
    })
}
