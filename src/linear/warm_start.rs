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
        if *known == 0 || [b.len(), x.len()] != [last.len(); 2] {
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
        if x.len() != self.last.len() {
            return;
        }
        std::mem::swap(&mut self.last, &mut self.second_last);
        self.last.copy_from_slice(x);
        self.known = (self.known + 1).min(2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// A diagonal matrix that counts its products.
    struct Diagonal {
        entries: Vec<f64>,
        products: Cell<usize>,
    }

    impl Diagonal {
        fn new(entries: &[f64]) -> Self {
            Self { entries: entries.into(), products: Cell::new(0) }
        }
    }

    impl LinearOperator for Diagonal {
        fn order(&self) -> usize {
            self.entries.len()
        }

        fn apply(&self, w: &[f64], y: &mut [f64]) {
            self.products.set(self.products.get() + 1);
            (0..w.len()).for_each(|i| y[i] = self.entries[i] * w[i]);
        }
    }

    fn guess(a: &Diagonal, earlier: &[[f64; 3]], b: [f64; 3]) -> Option<[f64; 3]> {
        let mut start = WarmStart::new(3);
        earlier.iter().for_each(|x| start.record(x));
        let mut x = [7.0; 3];
        let known = start.guess(a, &b, &mut x);
        assert!(known || x == [7.0; 3], "left alone");
        known.then_some(x)
    }

    /// The nearest point of the span of two solutions, by hand: with A a multiple of the identity, the projection of b/a. It
    /// does not depend on the unit of A.
    #[test]
    fn two_solutions_span_a_plane_in_any_unit() {
        for unit in [2f64.powi(-30), 1.0, 2f64.powi(30)] {
            let a = Diagonal::new(&[unit; 3]);
            let x = guess(&a, &[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], [3.0 * unit, 5.0 * unit, 4.0 * unit]);
            assert_eq!(x, Some([3.0, 5.0, 0.0]), "{unit}");
            assert_eq!(a.products.get(), 2);
        }
    }

    /// One solution spans a line, and costs one product. A second that is zero adds nothing to it.
    #[test]
    fn one_solution_spans_a_line() {
        let a = Diagonal::new(&[1.0, 2.0, 4.0]);
        assert_eq!(guess(&a, &[], [1.0; 3]), None);
        assert_eq!(a.products.get(), 0);
        // xᵀb/xᵀAx = 6/3 = 2.
        assert_eq!(guess(&a, &[[1.0, 1.0, 0.0]], [2.0, 4.0, 9.0]), Some([2.0, 2.0, 0.0]));
        assert_eq!(a.products.get(), 1);
        assert_eq!(guess(&a, &[[0.0; 3], [1.0, 1.0, 0.0]], [2.0, 4.0, 9.0]), Some([2.0, 2.0, 0.0]));
    }

    /// There is no guess where A is seen not to be positive definite, nor where it would not be finite.
    #[test]
    fn no_nearest_point_no_guess() {
        let earlier = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(guess(&Diagonal::new(&[-1.0; 3]), &earlier, [1.0; 3]), None);
        assert_eq!(guess(&Diagonal::new(&[-1.0; 3]), &earlier[..1], [1.0; 3]), None);
        assert_eq!(guess(&Diagonal::new(&[1.0; 3]), &earlier, [f64::INFINITY, 1.0, 1.0]), None);
        assert_eq!(guess(&Diagonal::new(&[0.0; 3]), &earlier, [1.0; 3]), None);
    }
}
