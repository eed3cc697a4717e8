//! First guesses from earlier solutions.
//!
//! Motion is smooth, so the solution of a step lies near the span of the last two, of which the extrapolation `2 δx₁ − δx₂` is
//! one point. The point nearest to the solution in the energy norm `‖e‖_A`, the norm in which conjugate gradients measure, is
//! `x = Σ α_i δx_i` with
//!
//! ```text
//! Σ_j (δx_iᵀ A δx_j) α_j = δx_iᵀ b
//! ```
//!
//! for the A and b at hand (Fischer 1998, "Projection techniques for iterative solution of Ax = b with successive right-hand
//! sides"). It is never farther than zero, whatever the earlier solutions are, and costs two products with A.

use super::norms::dot;
use crate::operator::LinearOperator;

/// The last two solutions.
#[derive(Debug, Clone)]
pub struct WarmStart {
    last: Vec<f64>,
    second_last: Vec<f64>,
    product: Vec<f64>,
    known: usize,
}

impl WarmStart {
    /// For vectors of length n; nothing is known yet.
    pub fn new(order: usize) -> Self {
        let zeros = || vec![0.0; order];
        Self { last: zeros(), second_last: zeros(), product: zeros(), known: 0 }
    }

    /// Sets x to the best guess there is; leaves it alone, and returns `false`, where there is none.
    pub fn guess(&mut self, a: &impl LinearOperator, b: &[f64], x: &mut [f64]) -> bool {
        let Self { last, second_last, product, known } = self;
        if *known == 0 {
            return false;
        }
        a.apply(last, product);
        let (a11, a12) = (dot(last, product), dot(second_last, product));
        let (b1, b2) = (dot(last, b), dot(second_last, b));
        let mut coefficients = [b1 / a11, 0.0];
        if *known > 1 {
            a.apply(second_last, product);
            let a22 = dot(second_last, product);
            let determinant = a11 * a22 - a12 * a12;
            // Two solutions that hardly differ in direction span one dimension only.
            if determinant > 1e-12 * a11 * a22 {
                coefficients = [(b1 * a22 - b2 * a12) / determinant, (b2 * a11 - b1 * a12) / determinant];
            }
        }
        // Where A is not positive definite there is no nearest point.
        if !(a11 > 0.0 && coefficients.iter().all(|c| c.is_finite())) {
            return false;
        }
        for ((x, last), second_last) in x.iter_mut().zip(&*last).zip(&*second_last) {
            *x = coefficients[0] * last + coefficients[1] * second_last;
        }
        true
    }

    /// Takes note of a solution.
    pub fn record(&mut self, x: &[f64]) {
        std::mem::swap(&mut self.last, &mut self.second_last);
        self.last.copy_from_slice(x);
        self.known = (self.known + 1).min(2);
    }
}
