//! Extreme eigenpairs of large symmetric matrices and pencils, with residuals that bound their errors and counts that prove that none is missing.
//!
//! ```text
//! A φ = λ M φ,      A symmetric,  M diagonal and positive: the masses, or the identity
//! ```
//!
//! There is one solver, `BlockLanczos`, for any operator B that is self-adjoint in the inner product `⟨x, y⟩ = xᵀMy`: `(A − σM)⁻¹M` by a sparse
//! factorization (`ShiftInvert`), or A itself, preconditioned, where it cannot be factored.
//!
//! **Block Lanczos** with full reorthogonalisation, locking and thick restarts. The basis V grows by a block of vectors at a time and is kept
//! orthonormal, `VᵀMV = I`, by two passes of Gram–Schmidt. The Rayleigh–Ritz procedure takes from `H = VᵀMBV`
//!
//! ```text
//! H y = θ y,   x = V y,   r = B x − θ x,      |θ − λ| ≤ ‖r‖_M  for some eigenvalue λ of B,
//! ```
//!
//! and the residuals of the pairs that have not converged extend V. As long as none has, V spans the Krylov space of the first block (Grimes, Lewis
//! and Simon, SIAM J. Matrix Anal. Appl. 15, 1994); converged pairs stay in V and are *locked*. A full basis is compressed to its best Ritz vectors
//! (Wu and Simon, SIAM J. Matrix Anal. Appl. 22, 2000). A block of k finds eigenvalues up to k-fold at once; random vectors, which
//! `BlockLanczos::refresh` adds, find more.
//!
//! **Preconditioned**, with T about B⁻¹, the vectors `T r` extend V: Davidson's method. Its space holds those of LOBPCG (Knyazev, SIAM J. Sci.
//! Comput. 23, 2001), so that its Ritz values are no worse, step by step.

mod enclosure;
mod shift_invert;

pub(crate) use enclosure::{enclosures, gamma};
pub(crate) use shift_invert::{Accuracy, Pencil, ShiftInvert, eigenpair};
pub use shift_invert::{Lowest, lowest};

use crate::linear::{dot, norm};
use crate::multigrid::Multigrid;
use crate::operator::{LinearOperator, SystemOperator};
use crate::work::Work;
use nalgebra::{DMatrix, DMatrixView, DVector, SymmetricEigen, Vector3};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};

/// An eigenvalue with its vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpair {
    /// λ: in N/m where A is the matrix of a step, in 1/s² where it is −K and M are the masses.
    pub value: f64,
    /// x, reduced, `xᵀMx = 1`.
    pub vector: Vec<f64>,
    /// `‖M^{-1/2}(Ax − λMx)‖`: there is an eigenvalue within this distance of λ (Parlett, The Symmetric Eigenvalue Problem, 4.5 and 15.9).
    pub residual: f64,
}

/// `u/‖u‖`; `None` where ‖u‖ is zero or not finite.
pub(crate) fn unit(mut u: Vec<f64>) -> Option<Vec<f64>> {
    let length = norm(&u);
    u.iter_mut().for_each(|u| *u /= length);
    (length > 0.0 && length.is_finite()).then_some(u)
}

/// `M⁻¹A X` for matrices stored by columns, with the diagonal of M (`None` for the identity).
pub(crate) fn scaled_products<'a>(
    a: &'a dyn LinearOperator,
    masses: Option<&'a [f64]>,
) -> impl FnMut(&[f64], &mut [f64]) + 'a {
    let n = a.order().max(1);
    move |x, y| {
        for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
            a.apply(x, y);
            divide(y, masses);
        }
    }
}

fn divide(y: &mut [f64], masses: Option<&[f64]>) {
    if let Some(masses) = masses {
        y.iter_mut().zip(masses).for_each(|(y, mass)| *y /= mass);
    }
}

/// `A x`.
pub(crate) fn product(a: &dyn LinearOperator, x: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; x.len()];
    a.apply(x, &mut product);
    product
}

/// Multigrid for a matrix that cannot be factored, where there is the memory for it and the matrix is positive definite.
pub(crate) fn multigrid_for(a: &SystemOperator<'_>, positions: &[Vector3<f64>]) -> Option<Multigrid> {
    let mut multigrid = Multigrid::new(a.system()).ok()?;
    multigrid.set_positions(positions);
    multigrid.refill(a).ok()?;
    multigrid.rebuild(a).ok()?;
    Some(multigrid)
}

/// Multigrid for A as a preconditioner of M⁻¹A, with the diagonal of M (`None` for the identity); without it residuals stay as they are.
pub(crate) fn preconditioner<'a>(
    mut multigrid: Option<&'a mut Multigrid>,
    masses: Option<&'a [f64]>,
    work: &'a mut Work,
) -> impl FnMut(&[f64], &mut [f64]) + 'a {
    move |r, z| {
        let Some(multigrid) = &mut multigrid else { return z.copy_from_slice(r) };
        work.multigrid_iterations += 1;
        let mut weighted = r.to_vec();
        if let Some(masses) = masses {
            weighted.iter_mut().zip(masses).for_each(|(r, mass)| *r *= mass);
        }
        multigrid.apply(&weighted, z);
    }
}

/// Fills a vector with independent standard normal numbers (Box and Muller 1958).
pub(crate) fn gaussian(rng: &mut Xoshiro256PlusPlus, x: &mut [f64]) {
    // In (0, 1]: the logarithm below must exist.
    let mut uniform = || ((rng.next_u64() >> 11) as f64 + 1.0) * (-53f64).exp2();
    for pair in x.chunks_mut(2) {
        let radius = (-2.0 * uniform().ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * uniform()).sin_cos();
        for (value, part) in pair.iter_mut().zip([cosine, sine]) {
            *value = radius * part;
        }
    }
}

/// `Y = B X` for matrices stored by columns.
pub(crate) type Product<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    Lowest,
    Highest,
    Farthest,
}

impl End {
    /// Least for the value that is wanted most.
    fn rank(self, value: f64) -> f64 {
        match self {
            Self::Lowest => value,
            Self::Highest => -value,
            Self::Farthest => -value.abs(),
        }
    }
}

/// The residual at which a pair has converged: the larger of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tolerance {
    /// Relative to its |θ|.
    pub of_value: f64,
    /// Relative to the largest |θ|, which is about ‖B‖.
    pub of_norm: f64,
}

/// An approximate eigenpair of B.
#[derive(Debug, Clone)]
pub(crate) struct Ritz {
    pub value: f64,
    /// x, `xᵀMx = 1`.
    pub vector: Vec<f64>,
    /// `Bx`: for an inverse B the vector after one more step of inverse iteration.
    pub image: Vec<f64>,
    /// `‖Bx − θx‖_M`.
    pub residual: f64,
}

impl From<Ritz> for Eigenpair {
    fn from(ritz: Ritz) -> Self {
        Self { value: ritz.value, vector: ritz.vector, residual: ritz.residual }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Search {
    pub end: End,
    pub wanted: usize,
    /// Vectors by which the basis grows at a time.
    pub block: usize,
    /// Vectors in the basis at most.
    pub capacity: usize,
}

impl Search {
    /// With room for twelve blocks beside twice the wanted vectors.
    pub fn new(end: End, wanted: usize, block: usize) -> Self {
        Self { end, wanted, block, capacity: 2 * wanted + 12 * block }
    }
}

/// A search space for eigenvalues at one end of the spectrum of an operator of order n.
pub(crate) struct BlockLanczos<'m> {
    n: usize,
    /// The diagonal of M; `None` for the identity.
    masses: Option<&'m [f64]>,
    search: Search,
    /// V and BV by columns, of which the first `size` count, and H.
    basis: DMatrix<f64>,
    products: DMatrix<f64>,
    projected: DMatrix<f64>,
    size: usize,
    rng: Xoshiro256PlusPlus,
}

impl<'m> BlockLanczos<'m> {
    /// The space of some vectors and a block of random ones.
    pub fn from<'v>(
        n: usize,
        masses: Option<&'m [f64]>,
        search: Search,
        seed: u64,
        vectors: impl IntoIterator<Item = &'v [f64]>,
        apply: &mut Product<'_>,
    ) -> Self {
        let (wanted, capacity) = (search.wanted.min(n), search.capacity.min(n));
        let zeros = |rows| DMatrix::zeros(rows, capacity);
        let (basis, products, projected) = (zeros(n), zeros(n), zeros(capacity));
        let rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let search = Search { wanted, ..search };
        let mut space = Self { n, masses, search, basis, products, projected, size: 0, rng };
        let columns: Vec<_> = vectors.into_iter().map(DVector::from_column_slice).collect();
        if !columns.is_empty() {
            space.extend(DMatrix::from_columns(&columns), apply);
        }
        space.refresh(apply);
        space
    }

    pub fn refresh(&mut self, apply: &mut Product<'_>) {
        let Search { block, .. } = self.search;
        if self.size > block && self.is_full_with(block) {
            let (values, vectors) = self.ritz_pairs();
            self.compress(&values, &vectors);
        }
        let mut fresh = DMatrix::zeros(self.n, block);
        gaussian(&mut self.rng, fresh.as_mut_slice());
        self.extend(fresh, apply);
    }

    /// Iterates until all wanted pairs have converged, for `longest` blocks at most, and returns them, most wanted first; at least as many as a block
    /// has.
    pub fn iterate(
        &mut self,
        tolerance: Tolerance,
        longest: usize,
        apply: &mut Product<'_>,
        mut precondition: Option<&mut Product<'_>>,
    ) -> Vec<Ritz> {
        let Search { wanted, block, .. } = self.search;
        let mut left = longest;
        loop {
            let (values, y) = self.ritz_pairs();
            let norm = values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
            let count = wanted.max(block).min(self.size);
            let x = self.basis.columns(0, self.size) * y.columns(0, count);
            let image = self.products.columns(0, self.size) * y.columns(0, count);
            let mut residuals = image.clone();
            for (k, &value) in values.iter().take(count).enumerate() {
                residuals.column_mut(k).axpy(-value, &x.column(k), 1.0);
            }
            let lengths: Vec<f64> = residuals.column_iter().map(|r| self.norm(r.as_slice())).collect();
            let Tolerance { of_value, of_norm } = tolerance;
            let is_open = |k: &usize| lengths[*k] > (of_value * values[*k].abs()).max(of_norm * norm);
            let mut has_grown = false;
            if (0..wanted.min(count)).any(|k| is_open(&k)) && self.size < self.n && left > 0 {
                left -= 1;
                let open: Vec<usize> = (0..count).filter(is_open).take(block).collect();
                if self.is_full_with(open.len()) {
                    self.compress(&values, &y);
                }
                let mut added = residuals.select_columns(&open);
                if let Some(precondition) = &mut precondition {
                    let residuals = added.clone();
                    for (r, z) in residuals.as_slice().chunks(self.n).zip(added.as_mut_slice().chunks_mut(self.n)) {
                        precondition(r, z);
                    }
                }
                has_grown = self.extend(added, apply);
            }
            if !has_grown {
                let pair = |k: usize| Ritz {
                    value: values[k],
                    vector: x.column(k).as_slice().to_vec(),
                    image: image.column(k).as_slice().to_vec(),
                    residual: lengths[k],
                };
                return (0..count).map(pair).collect();
            }
        }
    }

    /// So many vectors more need room, and the basis is not one of the whole space.
    fn is_full_with(&self, added: usize) -> bool {
        self.size + added > self.basis.ncols() && self.basis.ncols() < self.n
    }

    /// `MX`, where M is not the identity.
    fn weighted(&self, mut columns: DMatrix<f64>) -> DMatrix<f64> {
        let Some(masses) = self.masses else { return columns };
        for mut column in columns.column_iter_mut() {
            column.iter_mut().zip(masses).for_each(|(x, mass)| *x *= mass);
        }
        columns
    }

    /// `‖x‖_M`.
    fn norm(&self, x: &[f64]) -> f64 {
        match self.masses {
            Some(masses) => x.iter().zip(masses).map(|(x, mass)| mass * x * x).sum::<f64>().sqrt(),
            None => norm(x),
        }
    }

    /// Orthonormalises columns against the basis and adds them with their products; returns `false` where all are in the space already.
    fn extend(&mut self, mut columns: DMatrix<f64>, apply: &mut Product<'_>) -> bool {
        let before = self.size;
        let lengths: Vec<f64> = columns.column_iter().map(|column| self.norm(column.as_slice())).collect();
        // A second pass where the first has left little (Kahan and Parlett: twice is enough).
        let mut longest = lengths.clone();
        for _ in 0..2 {
            let basis = self.basis.columns(0, before);
            let parts = transposed_product(&basis, &self.weighted(columns.clone()));
            columns.gemm(-1.0, &basis, &parts, 1.0);
            let left: Vec<f64> = columns.column_iter().map(|column| self.norm(column.as_slice())).collect();
            if left.iter().zip(&longest).all(|(left, before)| *left > 0.5 * before) {
                break;
            }
            longest = left;
        }
        for (column, length) in columns.column_iter().zip(lengths) {
            self.add(column.into_owned(), before, length);
        }
        let added = self.size - before;
        if added == 0 {
            return false;
        }
        let range = before * self.n..self.size * self.n;
        apply(&self.basis.as_slice()[range.clone()], &mut self.products.as_mut_slice()[range]);
        let images = self.weighted(self.products.columns(before, added).into_owned());
        let projected = transposed_product(&self.basis.columns(0, self.size), &images);
        self.projected.view_mut((0, before), (self.size, added)).copy_from(&projected);
        self.projected.view_mut((before, 0), (added, self.size)).copy_from(&projected.transpose());
        true
    }

    /// Orthonormalises a vector, orthogonal to the columns before `first`, against those from there on, and adds it, unless the rest is rounding of
    /// its `length` or there is no room.
    fn add(&mut self, mut vector: DVector<f64>, first: usize, length: f64) {
        if self.size == self.basis.ncols() {
            return;
        }
        let before = self.norm(vector.as_slice());
        self.subtract(&mut vector, first);
        // A small rest has lost its orthogonality to the others (Daniel, Gragg, Kaufman and Stewart 1976).
        if self.norm(vector.as_slice()) < 0.5 * before {
            self.subtract(&mut vector, 0);
        }
        let left = self.norm(vector.as_slice());
        if left > 1e-12 * length && left.is_finite() {
            self.basis.column_mut(self.size).axpy(left.recip(), &vector, 0.0);
            self.size += 1;
        }
    }

    /// Two passes of Gram–Schmidt against the columns from `first` on.
    fn subtract(&self, vector: &mut DVector<f64>, first: usize) {
        for k in (first..self.size).chain(first..self.size) {
            let column = self.basis.column(k);
            let part = match self.masses {
                Some(masses) => column.iter().zip(&*vector).zip(masses).map(|((a, b), mass)| a * b * mass).sum(),
                None => column.dot(vector),
            };
            vector.axpy(-part, &column, 1.0);
        }
    }

    fn ritz_pairs(&self) -> (Vec<f64>, DMatrix<f64>) {
        let projected = self.projected.view((0, 0), (self.size, self.size)).into_owned();
        let is_finite = projected.iter().all(|entry| entry.is_finite());
        let eigen = (is_finite && self.size > 0).then(|| SymmetricEigen::try_new(projected, f64::EPSILON, 10_000));
        let Some(eigen) = eigen.flatten() else {
            return (vec![f64::NAN; self.size], DMatrix::identity(self.size, self.size));
        };
        let mut order: Vec<usize> = (0..self.size).collect();
        let rank = |k: usize| self.search.end.rank(eigen.eigenvalues[k]);
        order.sort_by(|&a, &b| rank(a).total_cmp(&rank(b)));
        let values = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        (values, eigen.eigenvectors.select_columns(&order))
    }

    fn compress(&mut self, values: &[f64], y: &DMatrix<f64>) {
        let Search { wanted, block, .. } = self.search;
        let count = (wanted + block).min(self.size.saturating_sub(block)).max(1);
        let basis = self.basis.columns(0, self.size) * y.columns(0, count);
        let products = self.products.columns(0, self.size) * y.columns(0, count);
        self.basis.columns_mut(0, count).copy_from(&basis);
        self.products.columns_mut(0, count).copy_from(&products);
        self.projected.fill(0.0);
        (0..count).for_each(|k| self.projected[(k, k)] = values[k]);
        self.size = count;
    }
}

/// `AᵀB` of tall matrices, by rows that fit the cache.
fn transposed_product(a: &DMatrixView<'_, f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    const ROWS: usize = 256;
    let mut product = DMatrix::zeros(a.ncols(), b.ncols());
    for first in (0..a.nrows()).step_by(ROWS) {
        let rows = ROWS.min(a.nrows() - first);
        product += a.rows(first, rows).tr_mul(&b.rows(first, rows));
    }
    product
}

/// The largest eigenvalue of B, from below, by the recurrence of Lanczos:
///
/// ```text
/// β_{j+1} v_{j+1} = B v_j − α_j v_j − β_j v_{j−1},   T = tridiag(β, α, β),   T s = θ s,   x = Σ s_j v_j,
/// ‖B x − θ x‖ = β_{m+1} |s_m|
/// ```
///
/// The vectors lose their orthogonality as values converge, which repeats these values and spoils none (Paige, J. Inst. Math. Appl. 18, 1976); θ
/// exceeds the largest eigenvalue by rounding of `m` operations at most, `m u ‖B‖`. Ends with a residual of at most `tolerance`, or after `longest`
/// products.
pub(crate) fn largest(n: usize, tolerance: f64, longest: usize, apply: &mut Product<'_>) -> f64 {
    let mut start = vec![0.0; n];
    gaussian(&mut Xoshiro256PlusPlus::seed_from_u64(3), &mut start);
    let Some(mut v) = unit(start) else { return f64::NAN };
    let (mut before, mut product) = (vec![0.0; n], vec![0.0; n]);
    let (mut alpha, mut beta, mut theta) = (Vec::new(), vec![0.0], f64::NEG_INFINITY);
    for _ in 0..longest {
        apply(&v, &mut product);
        let (along, back) = (dot(&product, &v), beta[beta.len() - 1]);
        for ((p, v), before) in product.iter_mut().zip(&v).zip(&before) {
            *p -= along * v + back * before;
        }
        let next = norm(&product);
        alpha.push(along);
        if !next.is_finite() {
            return f64::NAN;
        }
        let last;
        (theta, last) = largest_of_tridiagonal(&alpha, &beta, theta);
        if next * last <= tolerance {
            break;
        }
        beta.push(next);
        std::mem::swap(&mut before, &mut v);
        v.iter_mut().zip(&product).for_each(|(v, p)| *v = p / next);
    }
    theta
}

/// The largest eigenvalue of `T = tridiag(β, α, β)`, no smaller than `floor`, and the last entry of its eigenvector. By bisection: θ is above the
/// spectrum as long as all pivots of θ − T, from its last row on, are positive,
///
/// ```text
/// d_m = θ − α_m,   d_j = θ − α_j − β_{j+1}²/d_{j+1},   s_{j−1} = s_j d_j/β_j.
/// ```
fn largest_of_tridiagonal(alpha: &[f64], beta: &[f64], floor: f64) -> (f64, f64) {
    let last_entry = |theta: f64| {
        let (mut subtracted, mut entry, mut squares) = (0.0, 1.0f64, 0.0);
        for (alpha, beta) in alpha.iter().zip(beta).rev() {
            let pivot = theta - alpha - subtracted;
            if pivot <= 0.0 {
                return None;
            }
            squares += entry * entry;
            entry *= pivot / beta;
            subtracted = beta * beta / pivot;
        }
        Some(squares.sqrt().recip())
    };
    let largest = |of: &[f64]| of.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let size = largest(alpha) + 2.0 * largest(&beta[..alpha.len()]);
    let [mut low, mut high] = [floor.max(-size), size * (1.0 + 1e-9) + f64::MIN_POSITIVE];
    while high - low > 1e-15 * size {
        let middle = low.midpoint(high);
        if middle <= low || middle >= high {
            break;
        }
        match last_entry(middle) {
            Some(_) => high = middle,
            None => low = middle,
        }
    }
    (high, last_entry(high).unwrap_or(1.0))
}

/// The lowest and the highest Ritz pair of the Krylov space of a random vector, from at most `steps` products: rough ends of the spectrum of B.
/// `None` where a product is not finite.
pub(crate) fn probe(n: usize, masses: Option<&[f64]>, steps: usize, apply: &mut Product<'_>) -> Option<[Ritz; 2]> {
    let search = Search { end: End::Lowest, wanted: 1, block: 1, capacity: steps };
    let mut space = BlockLanczos::from(n, masses, search, 2, [], apply);
    while space.size > 0 && space.size < space.basis.ncols() {
        let product = space.products.columns(space.size - 1, 1).into_owned();
        if !space.extend(product, apply) {
            break;
        }
    }
    let (values, y) = space.ritz_pairs();
    let pair = |k: usize| {
        let y = y.columns(k, 1);
        let vector = space.basis.columns(0, space.size) * y;
        let image = space.products.columns(0, space.size) * y;
        let residual = space.norm((&image - &vector * values[k]).as_slice());
        let (vector, image) = (vector.as_slice().to_vec(), image.as_slice().to_vec());
        Ritz { value: values[k], vector, image, residual }
    };
    let is_known = values.first().is_some_and(|value| value.is_finite());
    is_known.then(|| [pair(0), pair(values.len() - 1)])
}

#[cfg(test)]
mod tests;
