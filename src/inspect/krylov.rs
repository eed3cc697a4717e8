//! The largest eigenvalues of a symmetric operator from a block Krylov space.
//!
//! The basis V is orthonormal throughout (two passes of Gram–Schmidt against all of it). The Rayleigh–Ritz procedure takes the
//! eigenpairs (θ, y) of `VᵀBV`; the residuals `r = Bx − θx`, `x = Vy`, of the wanted pairs that have not converged extend the
//! basis, which spans the same space as block Lanczos would. A full basis is compressed to its best Ritz vectors (a thick
//! restart, Wu and Simon 2000). For symmetric B there is an eigenvalue within ‖r‖ of θ.
//!
//! The basis grows by several vectors at once, whose products with B cost little more than one's where B is a factorization.
//! They find an eigenvalue as often as it occurs, up to their number; fresh random vectors, which [`Krylov::refresh`] adds, find it
//! more often still.

use super::random::gaussian;
use crate::linear::norm;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// Vectors by which the basis grows at a time: the largest multiplicity that is found at once.
const BLOCK: usize = crate::linear::SOLVE_COLUMNS;

/// `Y = B X` for matrices of n rows and up to [`BLOCK`] columns, stored by columns.
pub(super) type Product<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

/// How much larger than the first the residuals of the other pairs may be.
const OTHERS: f64 = 10.0;

/// A Ritz pair: an approximate eigenvalue θ with a unit vector, `Bx` for the Ritz vector x.
#[derive(Debug, Clone)]
pub(super) struct Ritz {
    pub value: f64,
    pub vector: Vec<f64>,
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
    rng: Xoshiro256PlusPlus,
}

impl Krylov {
    /// A space spanned by random vectors.
    pub fn new(n: usize, wanted: usize, apply: &mut Product<'_>) -> Self {
        let mut space = Self::empty(n, wanted);
        space.refresh(apply);
        space
    }

    /// A space that begins with vectors, at least one and not more than wanted, and random ones.
    pub fn from_vectors(n: usize, wanted: usize, start: &[Vec<f64>], apply: &mut Product<'_>) -> Self {
        let mut space = Self::empty(n, wanted);
        if !start.is_empty() {
            space.extend(DMatrix::from_fn(n, start.len(), |row, column| start[column][row]), apply);
        }
        space.refresh(apply);
        space
    }

    fn empty(n: usize, wanted: usize) -> Self {
        let wanted = wanted.min(n);
        let capacity = (2 * wanted + 12 * BLOCK).min(n);
        let zeros = |rows| DMatrix::zeros(rows, capacity);
        let (basis, products, projected) = (zeros(n), zeros(n), zeros(capacity));
        Self { n, wanted, basis, products, projected, size: 0, rng: Xoshiro256PlusPlus::seed_from_u64(1) }
    }

    /// Adds random vectors, making room first.
    pub fn refresh(&mut self, apply: &mut Product<'_>) {
        if self.size > BLOCK && self.size + BLOCK > self.basis.ncols() {
            let (values, vectors) = self.ritz_pairs();
            self.compress(&values, &vectors);
        }
        let mut fresh = DMatrix::zeros(self.n, BLOCK);
        gaussian(&mut self.rng, fresh.as_mut_slice());
        self.extend(fresh, apply);
    }

    /// Iterates until the first residual is below `tolerance` times the largest |θ| and the others of the wanted pairs below
    /// its [`OTHERS`]-fold, or `longest` steps have been taken. Returns the pairs, largest first.
    pub fn iterate(&mut self, tolerance: f64, longest: usize, apply: &mut Product<'_>) -> Vec<Ritz> {
        let mut step = 0;
        loop {
            let (values, vectors) = self.ritz_pairs();
            let scale = values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
            let count = self.wanted.max(BLOCK).min(self.size);
            let y = vectors.columns(0, count);
            let x = self.basis.columns(0, self.size) * y;
            let mut residuals = self.products.columns(0, self.size) * y;
            for (k, &value) in values.iter().take(count).enumerate() {
                residuals.column_mut(k).axpy(-value, &x.column(k), 1.0);
            }
            let norms: Vec<f64> = residuals.column_iter().map(|column| column.norm()).collect();
            let is_open = |k: usize| norms[k] > scale * tolerance * if k == 0 { 1.0 } else { OTHERS };
            step += 1;
            let mut grown = false;
            if (0..self.wanted.min(count)).any(is_open) && self.size < self.n && step <= longest {
                let open: Vec<usize> = (0..count).filter(|&k| is_open(k)).take(BLOCK).collect();
                if self.size + open.len() > self.basis.ncols() {
                    self.compress(&values, &vectors);
                }
                grown = self.extend(residuals.select_columns(&open), apply);
            }
            if !grown {
                // Bx instead of x: one more step of inverse iteration, for nothing.
                let pair = |k: usize| {
                    let mut vector: Vec<f64> = (residuals.column(k) + x.column(k) * values[k]).as_slice().to_vec();
                    let length = norm(&vector);
                    vector.iter_mut().for_each(|x| *x /= length);
                    Ritz { value: values[k], vector }
                };
                return (0..self.wanted.min(count)).map(pair).collect();
            }
        }
    }

    /// Orthonormalises columns against the basis and adds them with their products; those of which nothing is left are
    /// passed over. Says whether any was added.
    fn extend(&mut self, mut columns: DMatrix<f64>, apply: &mut Product<'_>) -> bool {
        let before = self.size;
        let lengths: Vec<f64> = columns.column_iter().map(|column| column.norm()).collect();
        for _ in 0..2 {
            let basis = self.basis.columns(0, before);
            let parts = basis.tr_mul(&columns);
            columns.gemm(-1.0, &basis, &parts, 1.0);
        }
        for (column, length) in columns.column_iter().zip(lengths) {
            self.add(column.into_owned(), before, length);
        }
        if self.size == before {
            return false;
        }
        let range = before * self.n..self.size * self.n;
        apply(&self.basis.as_slice()[range.clone()], &mut self.products.as_mut_slice()[range]);
        let added = self.size - before;
        let projected = self.basis.columns(0, self.size).tr_mul(&self.products.columns(before, added));
        self.projected.view_mut((0, before), (self.size, added)).copy_from(&projected);
        self.projected.view_mut((before, 0), (added, self.size)).copy_from(&projected.transpose());
        true
    }

    /// Orthonormalises a vector against the columns from `first` on and adds it, unless what is left of its `length` is rounding.
    fn add(&mut self, mut vector: DVector<f64>, first: usize, length: f64) {
        if self.size == self.basis.ncols() {
            return;
        }
        for _ in 0..2 {
            for k in first..self.size {
                let part = self.basis.column(k).dot(&vector);
                vector.axpy(-part, &self.basis.column(k), 1.0);
            }
        }
        let left = vector.norm();
        // A NaN fails this test too.
        if left > 1e-12 * length {
            self.basis.column_mut(self.size).axpy(left.recip(), &vector, 0.0);
            self.size += 1;
        }
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

#[cfg(test)]
mod tests {
    use super::Krylov;

    /// Sizes of a space as random vectors are added, four at a time.
    fn sizes(n: usize, wanted: usize, refreshes: usize) -> Vec<usize> {
        let mut apply = |x: &[f64], y: &mut [f64]| {
            for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
                y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = k as f64 * x);
            }
        };
        let mut space = Krylov::new(n, wanted, &mut apply);
        let next = |_| {
            space.refresh(&mut apply);
            space.size
        };
        (0..refreshes).map(next).collect()
    }

    /// A full space keeps its best vectors, four more than are wanted, where it has as many; one that has room for no second block keeps all.
    #[test]
    fn a_full_space_makes_room() {
        // 2·2 + 12·4 = 52 columns, which thirteen blocks fill.
        assert_eq!(sizes(200, 2, 13), [8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 10]);
        // 2·1 + 12·4 = 50: twelve blocks, and no room for another.
        assert_eq!(sizes(200, 1, 13), [8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 9, 13]);
        assert_eq!(sizes(6, 1, 2), [6, 6]);
    }

    #[test]
    fn nothing_is_no_direction() {
        let mut apply = |x: &[f64], y: &mut [f64]| y.copy_from_slice(x);
        let mut space = Krylov::from_vectors(20, 1, &[vec![0.0; 20]], &mut apply);
        assert_eq!(space.size, 4);
        assert!((space.iterate(1e-9, 10, &mut apply)[0].value - 1.0).abs() < 1e-12);
    }
}
