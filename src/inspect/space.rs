//! What `P(s) = s² M + s D + C` is in a small space, for every s at once.
//!
//! For an orthonormal V the three matrices `VᵀMV`, `VᵀDV` and `VᵀCV` are small and dense, and with them `VᵀP(s)V` is known whatever s is.
//!
//! **The root.** M > 0 and D ≥ 0, so every eigenvalue of `VᵀP(s)V` grows with s. The largest s for which it is singular is found from below:
//! with y the lowest eigenvector at one s, the root of `yᵀVᵀP(s)Vy` is the next s, not lower. It is Newton's iteration for the lowest
//! eigenvalue with the curvature in s kept, and takes a handful of steps. Along Vy the whole P(s) has that root too: it bounds from below the largest s for
//! which the whole P(s) is singular, whatever V is.

use crate::linear::{dot, norm};
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

/// What is left of a vector that is already in the space, relatively.
const NOTHING: f64 = 1e-10;

/// Steps to a root: it is reached in six or so.
const ROOT_STEPS: usize = 40;

/// `uᵀP(s)u = mass s² + damping s + constant`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curvature {
    pub mass: f64,
    pub damping: f64,
    pub constant: f64,
}

impl Curvature {
    /// The positive s at which the curvature vanishes; `None` when it is positive for every s > 0.
    pub fn root(&self) -> Option<f64> {
        let Self { mass, damping, constant } = *self;
        let discriminant = damping * damping - 4.0 * mass * constant;
        // The form without cancellation: damping ≥ 0 and constant < 0.
        (constant < 0.0).then(|| -2.0 * constant / (damping + discriminant.sqrt()))
    }
}

/// Which of the three matrices a product is wanted with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Term {
    /// M.
    Mass,
    /// D.
    Damping,
    /// C.
    Constant,
}

/// An orthonormal basis V, and the three matrices in it.
#[derive(Debug, Clone, Default)]
pub(super) struct Space {
    basis: Vec<Vec<f64>>,
    /// `VᵀMV`, `VᵀDV` and `VᵀCV`, by columns as they came.
    projected: [Vec<Vec<f64>>; 3],
}

impl Space {
    /// Vectors in it.
    pub fn len(&self) -> usize {
        self.basis.len()
    }

    /// `x = V y`.
    pub fn combine<'y>(&self, y: impl IntoIterator<Item = &'y f64>, x: &mut [f64]) {
        x.fill(0.0);
        for (v, y) in self.basis.iter().zip(y) {
            x.iter_mut().zip(v).for_each(|(x, v)| *x += y * v);
        }
    }

    /// `Vᵀx`.
    pub fn parts(&self, x: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.len(), self.basis.iter().map(|v| dot(v, x)))
    }

    /// `VᵀP(s)V`.
    pub fn matrix(&self, s: f64) -> DMatrix<f64> {
        let [m, d, c] = &self.projected;
        DMatrix::from_fn(self.len(), self.len(), |row, column| {
            let (row, column) = (row.min(column), row.max(column));
            s * s * m[column][row] + s * d[column][row] + c[column][row]
        })
    }

    /// Adds what is new of a vector; whether anything is. `product` applies one of the three matrices.
    pub fn add(&mut self, vector: &[f64], mut product: impl FnMut(Term, &[f64], &mut [f64])) -> bool {
        let mut v = vector.to_vec();
        let length = norm(&v);
        for _ in 0..2 {
            for other in &self.basis {
                let part = dot(other, &v);
                v.iter_mut().zip(other).for_each(|(v, other)| *v -= part * other);
            }
        }
        let left = norm(&v);
        if left.is_nan() || left <= NOTHING * length {
            return false;
        }
        v.iter_mut().for_each(|v| *v /= left);
        let mut image = vec![0.0; v.len()];
        for (term, columns) in [Term::Mass, Term::Damping, Term::Constant].into_iter().zip(&mut self.projected) {
            product(term, &v, &mut image);
            columns.push(self.basis.iter().chain([&v]).map(|u| dot(u, &image)).collect());
        }
        self.basis.push(v);
        true
    }

    /// The largest s for which `VᵀP(s)V` is singular, with the eigenvectors of that matrix, ascending: the first belongs to zero. `None` where it
    /// is positive definite for every s above zero.
    pub fn root(&self) -> Option<(f64, SymmetricEigen<f64, Dyn>)> {
        let mut s = 0.0;
        let mut eigen = self.eigen(s)?;
        for _ in 0..ROOT_STEPS {
            let lowest = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            let next = self.curvature(&lowest).root().filter(|next| next.is_finite() && *next > s);
            match next {
                Some(next) => s = next,
                None => break,
            }
            eigen = self.eigen(s)?;
        }
        (s > 0.0).then_some((s, eigen))
    }

    fn eigen(&self, s: f64) -> Option<SymmetricEigen<f64, Dyn>> {
        (self.len() > 0).then(|| SymmetricEigen::try_new(self.matrix(s), f64::EPSILON, 10_000)).flatten()
    }

    /// `yᵀVᵀP(s)Vy`.
    fn curvature(&self, y: &DVector<f64>) -> Curvature {
        let [mass, damping, constant] = &self.projected;
        let form = |columns: &Vec<Vec<f64>>| {
            let entry = |row: usize, column: usize| columns[row.max(column)][row.min(column)];
            (0..y.len()).map(|r| (0..y.len()).map(|c| y[r] * entry(r, c) * y[c]).sum::<f64>()).sum()
        };
        Curvature { mass: form(mass), damping: form(damping), constant: form(constant) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of diagonal matrices every root is that of a quadratic: the largest of them is found, in whatever basis, and a space without negative
    /// curvature has none.
    #[test]
    fn roots_are_those_of_quadratics() {
        let (m, d) = ([1.0, 2.0, 0.5, 3.0], [0.3, 0.0, 2.0, 0.1]);
        for (c, expected) in [
            ([-4.0, -1.0, -6.0, 5.0], Some((-2.0 + 16.0f64.sqrt()) / 1.0)),
            ([-9.0, -1.0, 1.0, 5.0], Some(0.5 * (-0.3 + (0.09f64 + 36.0).sqrt()))),
            ([0.5, 1.0, 1.0, 5.0], None),
        ] {
            let mut space = Space::default();
            let product = |term: Term, v: &[f64], y: &mut [f64]| {
                let diagonal = match term {
                    Term::Mass => m,
                    Term::Damping => d,
                    Term::Constant => c,
                };
                y.iter_mut().zip(v).zip(diagonal).for_each(|((y, v), diagonal)| *y = diagonal * v);
            };
            let mut highest = 0.0;
            for k in 0..4 {
                let vector: Vec<f64> = (0..4).map(|i| ((3 * k + 5 * i + k * i) as f64).sin()).collect();
                assert!(space.add(&vector, product));
                // It only rises as the space grows.
                let root = space.root().map_or(0.0, |(root, _)| root);
                assert!(root >= highest * (1.0 - 1e-12), "{root} {highest}");
                highest = root;
            }
            assert!(!space.add(&[1.0, 2.0, 3.0, 4.0], product), "nothing is new in all there is");
            match (space.root(), expected) {
                (Some((root, eigen)), Some(expected)) => {
                    approx::assert_relative_eq!(root, expected, max_relative = 1e-12);
                    let mut null = vec![0.0; 4];
                    space.combine(eigen.eigenvectors.column(eigen.eigenvalues.imin()).iter(), &mut null);
                    let form = |diagonal: [f64; 4]| -> f64 { null.iter().zip(diagonal).map(|(x, d)| d * x * x).sum() };
                    assert!((root * root * form(m) + root * form(d) + form(c)).abs() < 1e-12);
                }
                (None, None) => {}
                (found, expected) => panic!("{:?} instead of {expected:?}", found.map(|(root, _)| root)),
            }
        }
    }

    /// Only where something curves downwards and something else resists as s grows is there a positive root.
    #[test]
    fn without_a_sign_change_there_is_no_root() {
        let root = |mass, damping, constant| Curvature { mass, damping, constant }.root();
        assert_eq!(root(1.0, 1.0, -6.0), Some(2.0));
        assert_eq!([root(1.0, 1.0, 0.0), root(1.0, 0.0, 0.0), root(1.0, 1.0, 6.0)], [None; 3]);
        assert!(Space::default().root().is_none());
        // No inertia: it curves downwards for every s.
        let mut space = Space::default();
        let product = |term: Term, v: &[f64], y: &mut [f64]| {
            let factor = if term == Term::Constant { -1.0 } else { 0.0 };
            y.iter_mut().zip(v).for_each(|(y, v)| *y = factor * v);
        };
        assert!(space.add(&[1.0], product) && space.root().is_none());
    }
}
