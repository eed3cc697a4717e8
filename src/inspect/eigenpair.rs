//! An eigenvalue, its vector, and how near both are.

use crate::linear::{dot, norm};
use crate::operator::LinearOperator;

/// An eigenvalue with its unit vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpair {
    /// λ, in N/m.
    pub value: f64,
    /// x, reduced, `‖x‖ = 1`.
    pub vector: Vec<f64>,
    /// `‖Ax − λx‖`: A has an eigenvalue within this distance of λ.
    pub residual: f64,
}

/// A unit vector with its Rayleigh quotient.
pub(super) fn eigenpair(a: &dyn LinearOperator, vector: Vec<f64>) -> Eigenpair {
    let mut product = vec![0.0; vector.len()];
    a.apply(&vector, &mut product);
    let value = dot(&vector, &product);
    for (p, x) in product.iter_mut().zip(&vector) {
        *p -= value * x;
    }
    Eigenpair { value, residual: norm(&product), vector }
}

/// A vector made one of length one; `None` where it has none.
pub(super) fn unit(mut u: Vec<f64>) -> Option<Vec<f64>> {
    let length = norm(&u);
    u.iter_mut().for_each(|u| *u /= length);
    (length > 0.0 && length.is_finite()).then_some(u)
}
