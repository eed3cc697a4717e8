//! The largest eigenvalues of a symmetric operator from a block Krylov space.
//!
//! The basis V is orthonormal throughout (two passes of Gram–Schmidt against all of it). The Rayleigh–Ritz procedure takes the
//! eigenpairs (θ, y) of `VᵀBV`; the residuals `r = Bx − θx`, `x = Vy`, of the wanted pairs that have not converged extend the
//! basis, which spans the same space as block Lanczos would. A full basis is compressed to its best Ritz vectors (a thick
//! restart, Wu and Simon 2000). For symmetric B there is an eigenvalue within ‖r‖ of θ.
//!
//! Several vectors at once find an eigenvalue as often as it occurs, up to their number; fresh random vectors, which
//! [`Krylov::refresh`] adds, find it more often still.

use super::random::gaussian;
use nalgebra::{DMatrix, SymmetricEigen};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Vectors by which the basis grows at a time: the largest multiplicity that is found at once.
const BLOCK: usize = 4;

/// Steps after which a search stops, converged or not.
pub(super) const LONGEST_SEARCH: usize = 1000;

/// A Ritz pair: an approximate eigenvalue with its unit vector and what bounds its error.
#[derive(Debug, Clone)]
pub(super) struct Ritz {
    pub value: f64,
    pub vector: Vec<f64>,
    /// `‖Bx − θx‖`.
    pub residual: f64,
}

/// The search space for the `wanted` largest eigenvalues of an operator of order n.
pub(super) struct Krylov {
    n: usize,
    wanted: usize,
    /// Orthonormal columns and their products with the operator; the first `size` count.
    basis: DMatrix<f64>,
    products: DMatrix<f64>,
    /// `VᵀBV`.
    projected: DMatrix<f64>,
    size: usize,
    rng: ChaCha8Rng,
}

impl Krylov {
    /// A space spanned by random vectors.
    pub fn new(n: usize, wanted: usize, apply: &mut dyn FnMut(&[f64], &mut [f64])) -> Self {
        let wanted = wanted.min(n);
        let capacity = (2 * wanted + 12 * BLOCK).min(n);
        let zeros = |rows| DMatrix::zeros(rows, capacity);
        let (basis, products, projected) = (zeros(n), zeros(n), zeros(capacity));
        let mut space = Self { n, wanted, basis, products, projected, size: 0, rng: ChaCha8Rng::seed_from_u64(1) };
        space.refresh(apply);
        space
    }

    /// Adds random vectors, making room first.
    pub fn refresh(&mut self, apply: &mut dyn FnMut(&[f64], &mut [f64])) {
        if self.size > BLOCK && self.size + BLOCK > self.basis.ncols() {
            let (values, vectors) = self.ritz_pairs();
            self.compress(&values, &vectors);
        }
        for _ in 0..BLOCK {
            let mut fresh = vec![0.0; self.n];
            gaussian(&mut self.rng, &mut fresh);
            self.extend(fresh, apply);
        }
    }

    /// Iterates until the residuals of the wanted pairs are below `tolerance` times the largest |θ|, or `longest` steps have
    /// been taken. Returns the pairs, largest first; their residuals bound their errors.
    pub fn iterate(&mut self, tolerance: f64, longest: usize, apply: &mut dyn FnMut(&[f64], &mut [f64])) -> Vec<Ritz> {
        let mut step = 0;
        loop {
            let (values, vectors) = self.ritz_pairs();
            let scale = values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
            let count = self.wanted.min(self.size);
            let y = vectors.columns(0, count);
            let x = self.basis.columns(0, self.size) * y;
            let mut residuals = self.products.columns(0, self.size) * y;
            for (k, &value) in values.iter().take(count).enumerate() {
                residuals.column_mut(k).axpy(-value, &x.column(k), 1.0);
            }
            let is_open = |&k: &usize| residuals.column(k).norm() > tolerance * scale;
            let open: Vec<usize> = (0..count).filter(is_open).take(BLOCK).collect();
            step += 1;
            let mut grown = false;
            if self.size < self.n && step <= longest {
                if self.size + open.len() > self.basis.ncols() {
                    self.compress(&values, &vectors);
                }
                for &k in &open {
                    grown |= self.extend(residuals.column(k).as_slice().to_vec(), apply);
                }
            }
            if !grown {
                let pair = |k: usize| Ritz {
                    value: values[k],
                    vector: x.column(k).as_slice().to_vec(),
                    residual: residuals.column(k).norm(),
                };
                return (0..count).map(pair).collect();
            }
        }
    }

    /// Orthonormalises a vector against the basis and adds it with its product; not if nothing of it is left.
    fn extend(&mut self, mut vector: Vec<f64>, apply: &mut dyn FnMut(&[f64], &mut [f64])) -> bool {
        if self.size == self.basis.ncols() {
            return false;
        }
        let before = crate::linear::norm(&vector);
        for _ in 0..2 {
            for k in 0..self.size {
                let column = self.basis.column(k);
                let part = crate::linear::dot(column.as_slice(), &vector);
                for (v, b) in vector.iter_mut().zip(column.as_slice()) {
                    *v -= part * b;
                }
            }
        }
        let after = crate::linear::norm(&vector);
        // What is left of a dependent vector is rounding.
        if after.is_nan() || after <= 1e-12 * before {
            return false;
        }
        for (target, v) in self.basis.column_mut(self.size).as_mut_slice().iter_mut().zip(&vector) {
            *target = v / after;
        }
        apply(self.basis.column(self.size).as_slice(), self.products.column_mut(self.size).as_mut_slice());
        let product = self.products.column(self.size);
        for k in 0..=self.size {
            let entry = crate::linear::dot(self.basis.column(k).as_slice(), product.as_slice());
            self.projected[(k, self.size)] = entry;
            self.projected[(self.size, k)] = entry;
        }
        self.size += 1;
        true
    }

    /// Eigenpairs of `VᵀBV`, largest first.
    fn ritz_pairs(&self) -> (Vec<f64>, DMatrix<f64>) {
        if self.size == 0 {
            return (Vec::new(), DMatrix::zeros(0, 0));
        }
        let projected = self.projected.view((0, 0), (self.size, self.size)).into_owned();
        let Some(eigen) = SymmetricEigen::try_new(projected, f64::EPSILON, 10_000) else {
            return (vec![f64::NAN; self.size], DMatrix::identity(self.size, self.size));
        };
        let mut order: Vec<usize> = (0..self.size).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let values = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        (values, eigen.eigenvectors.select_columns(&order))
    }

    /// Shrinks the basis to its best Ritz vectors.
    fn compress(&mut self, values: &[f64], vectors: &DMatrix<f64>) {
        let kept = (self.wanted + BLOCK).min(self.size.saturating_sub(BLOCK)).max(1);
        let y = vectors.columns(0, kept);
        let basis = self.basis.columns(0, self.size) * y;
        let products = self.products.columns(0, self.size) * y;
        self.basis.columns_mut(0, kept).copy_from(&basis);
        self.products.columns_mut(0, kept).copy_from(&products);
        self.projected.fill(0.0);
        for (k, &value) in values.iter().take(kept).enumerate() {
            self.projected[(k, k)] = value;
        }
        self.size = kept;
    }
}
