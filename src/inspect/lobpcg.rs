//! The lowest eigenpairs of a symmetric matrix that is known by its products, with a preconditioner: LOBPCG.
//!
//! The locally optimal block preconditioned conjugate gradient method of Knyazev, "Toward the optimal preconditioned eigensolver", SIAM J. Sci.
//! Comput. 23 (2001): from Ritz vectors X with residuals `R = AX − XΘ` and the directions P of the last step, the next X are the Ritz
//! vectors of the lowest Ritz values in the space of X, BR and P, with B symmetric positive definite, about A⁻¹. Basis and products are kept
//! orthonormal by two passes of Gram–Schmidt, and every product is made anew, so no digits are lost from step to step.
//!
//! **What is proven.** A Ritz value is a Rayleigh quotient and bounds the eigenvalue with its number from above; of k negative ones A has
//! at least k negative eigenvalues (Cauchy). A has an eigenvalue within ‖r‖ of each. That none lies below the first is not proven.

use crate::linear::{dot, norm};
use nalgebra::{DMatrix, SymmetricEigen};

/// `y = A x`, or `y = B x`.
pub(super) type Product<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

/// What is left of a vector that is already in the space, relatively.
const NOTHING: f64 = 1e-10;

/// Approximate eigenpairs, lowest first.
#[derive(Debug, Clone, Default)]
pub(super) struct Pairs {
    pub values: Vec<f64>,
    pub vectors: Vec<Vec<f64>>,
    /// `‖Ax − θx‖`.
    pub residuals: Vec<f64>,
}

/// An orthonormal basis with its products.
struct Space {
    vectors: Vec<Vec<f64>>,
    products: Vec<Vec<f64>>,
}

impl Space {
    /// Adds what is new of a vector; nothing where there is nothing, or it is not finite.
    fn add(&mut self, mut v: Vec<f64>, apply: &mut Product<'_>) {
        let length = norm(&v);
        for _ in 0..2 {
            for other in &self.vectors {
                let part = dot(other, &v);
                v.iter_mut().zip(other).for_each(|(v, other)| *v -= part * other);
            }
        }
        let left = norm(&v);
        if !(left > NOTHING * length && left.is_finite()) {
            return;
        }
        v.iter_mut().for_each(|v| *v /= left);
        let mut product = vec![0.0; v.len()];
        apply(&v, &mut product);
        self.vectors.push(v);
        self.products.push(product);
    }

    /// Values and coefficients of the Ritz vectors, lowest first.
    fn ritz(&self) -> Option<(Vec<f64>, DMatrix<f64>)> {
        let size = self.vectors.len();
        let entry = |row: usize, column: usize| dot(&self.vectors[row.min(column)], &self.products[row.max(column)]);
        let eigen = SymmetricEigen::try_new(DMatrix::from_fn(size, size, entry), f64::EPSILON, 10_000)?;
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let values = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        Some((values, eigen.eigenvectors.select_columns(&order)))
    }
}

/// `Σ vectors[k] y[k]` from some k on.
fn combined(vectors: &[Vec<f64>], y: &DMatrix<f64>, column: usize, from: usize) -> Vec<f64> {
    let mut sum = vec![0.0; vectors.first().map_or(0, Vec::len)];
    for (k, vector) in vectors.iter().enumerate().skip(from) {
        let part = y[(k, column)];
        sum.iter_mut().zip(vector).for_each(|(sum, v)| *sum += part * v);
    }
    sum
}

/// As many of the lowest pairs as there are start vectors, from these, in at most `longest` steps; `is_enough` looks at them before
/// every step.
pub(super) fn lowest(
    start: Vec<Vec<f64>>,
    apply: &mut Product<'_>,
    precondition: &mut Product<'_>,
    longest: usize,
    is_enough: &mut dyn FnMut(&Pairs) -> bool,
) -> Pairs {
    let mut space = Space { vectors: Vec::new(), products: Vec::new() };
    start.into_iter().for_each(|v| space.add(v, apply));
    let wanted = space.vectors.len();
    // How many vectors of the space are the last X.
    let mut kept = wanted;
    let mut pairs = Pairs::default();
    for step in 0..=longest {
        let Some((values, y)) = space.ritz() else { return pairs };
        let x: Vec<Vec<f64>> = (0..wanted).map(|k| combined(&space.vectors, &y, k, 0)).collect();
        let mut residuals: Vec<Vec<f64>> = (0..wanted).map(|k| combined(&space.products, &y, k, 0)).collect();
        for ((r, x), value) in residuals.iter_mut().zip(&x).zip(&values) {
            r.iter_mut().zip(x).for_each(|(r, x)| *r -= value * x);
        }
        let lengths: Vec<f64> = residuals.iter().map(|r| norm(r)).collect();
        if !lengths.iter().all(|length| length.is_finite()) {
            return pairs;
        }
        // What the last step added to X: nothing before the first.
        let steps: Vec<Vec<f64>> = (0..wanted).map(|k| combined(&space.vectors, &y, k, kept)).collect();
        pairs = Pairs { values: values[..wanted].to_vec(), vectors: x, residuals: lengths };
        if step == longest || wanted == 0 || is_enough(&pairs) {
            break;
        }
        space = Space { vectors: Vec::new(), products: Vec::new() };
        pairs.vectors.iter().for_each(|x| space.add(x.clone(), apply));
        kept = space.vectors.len();
        for r in residuals {
            let mut better = vec![0.0; r.len()];
            precondition(&r, &mut better);
            space.add(better, apply);
        }
        steps.into_iter().for_each(|p| space.add(p, apply));
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::{Space, lowest};
    use crate::inspect::random::gaussian;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;

    /// A diagonal of wide range, with a preconditioner that knows it to a factor of two: the first eigenvalues, one of them double, in a few
    /// steps; a range of 10⁶ without any would take thousands.
    #[test]
    fn the_lowest_pairs_of_a_diagonal() {
        let n = 500;
        let value = |k: usize| if k < 2 { -3.0 } else { 1.0 + (k as f64).powi(2) * 4.0 };
        let mut apply =
            |x: &[f64], y: &mut [f64]| y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = value(k) * x);
        let about = |k: usize| value(k).abs() * if k.is_multiple_of(2) { 1.4 } else { 0.7 };
        let mut precondition =
            |x: &[f64], y: &mut [f64]| y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = x / about(k));
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
        let start = (0..3)
            .map(|_| {
                let mut x = vec![0.0; n];
                gaussian(&mut rng, &mut x);
                x
            })
            .collect();
        let mut steps = 0;
        let found = lowest(start, &mut apply, &mut precondition, 60, &mut |pairs| {
            steps += 1;
            pairs.residuals.iter().all(|r| *r < 1e-7)
        });
        for (found, expected) in found.values.iter().zip([-3.0, -3.0, 17.0]) {
            approx::assert_relative_eq!(*found, expected, max_relative = 1e-10);
        }
        assert!(steps < 40, "{steps} steps");
    }

    /// So many steps, and as many looks before them.
    #[test]
    fn a_search_that_is_never_enough_ends() {
        let mut apply = |x: &[f64], y: &mut [f64]| {
            y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = (k * k) as f64 * x);
        };
        let (mut looks, mut residuals) = (0, 0);
        let mut precondition = |r: &[f64], z: &mut [f64]| {
            residuals += 1;
            z.copy_from_slice(r);
        };
        lowest(vec![vec![1.0; 30]], &mut apply, &mut precondition, 2, &mut |_| {
            looks += 1;
            false
        });
        assert_eq!((looks, residuals), (2, 2));
    }

    #[test]
    fn nothing_is_no_direction() {
        let mut space = Space { vectors: Vec::new(), products: Vec::new() };
        let mut apply = |x: &[f64], y: &mut [f64]| y.copy_from_slice(x);
        for vector in [[0.0; 3], [f64::INFINITY; 3], [f64::NAN; 3]] {
            space.add(vector.to_vec(), &mut apply);
            assert!(space.vectors.is_empty());
        }
        space.add(vec![3.0, 0.0, 4.0], &mut apply);
        assert_eq!(space.vectors, [[0.6, 0.0, 0.8]]);
    }
}
