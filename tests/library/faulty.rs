//! A product with a fault.

use nalgebra_sparse::CscMatrix;
use sprung::operator::LinearOperator;

/// A matrix with a fault, as an operator.
pub struct Faulty(pub CscMatrix<f64>);

impl LinearOperator for Faulty {
    fn order(&self) -> usize {
        self.0.nrows()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (row, column, value) in self.0.triplet_iter() {
            y[row] += value * w[column];
        }
    }
}
