//! Both ends of the spectrum of A, and the condition number.
//!
//! Small matrices are diagonalised whole. Large ones are searched from three sides, each by a block Krylov method:
//!
//! - the largest eigenvalue by products with A;
//! - the lowest ones by solves with `A − σ`, σ below all of them. Where A is positive definite σ = 0 will do, and even a
//!   λ_min far below ‖A‖ is found to many digits; otherwise products with A tell where the spectrum begins, and a
//!   factorization without negative pivots proves that σ lies below it;
//! - the one nearest to zero, which decides about the condition number of an indefinite A, by solves with A itself.
//!
//! For every pair (λ, x) the residual bounds the error: A has an eigenvalue within `‖Ax − λx‖` of λ.

use super::inertia::Inertia;
use super::krylov::{Krylov, LONGEST_SEARCH, Ritz};
use crate::assembly::SymmetricMatrix;
use crate::error::Result;
use crate::linear::{Ldlt, norm};
use crate::operator::LinearOperator;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, Dyn, SymmetricEigen};

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

/// What is known of a spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// The lowest eigenpairs, ascending.
    pub lowest: Vec<Eigenpair>,
    /// The largest eigenvalue.
    pub largest: f64,
    /// `max|λ|/min|λ|`; infinite where an eigenvalue cannot be told from zero.
    pub condition: f64,
}

impl Spectrum {
    /// The lowest eigenvalue; NaN for a matrix of order zero.
    pub fn smallest(&self) -> f64 {
        self.lowest.first().map_or(f64::NAN, |pair| pair.value)
    }

    /// The pairs with a negative eigenvalue.
    pub fn negative(&self) -> &[Eigenpair] {
        &self.lowest[..self.lowest.partition_point(|pair| pair.value < 0.0)]
    }
}

/// Up to this order a matrix is diagonalised whole.
const LARGEST_DENSE: usize = 240;

/// Residuals of searches with solves, relative to the largest eigenvalue of the inverse.
const TOLERANCE: f64 = 1e-8;

/// Residual of the search with products, relative to λ_max: a bound for the relative error of λ_max, whose actual error is
/// nearer to its square.
const RESIDUAL: f64 = 1e-6;

/// The lowest `wanted` eigenpairs (all, for a small matrix), the largest eigenvalue and the condition number. `inertia` is
/// that of A. Where A has up to `wanted` negative eigenvalues, all of them are found.
///
/// # Errors
/// A matrix that is too large to factor.
pub fn spectrum(a: &SymmetricMatrix, inertia: &Inertia, wanted: usize, par: Par, work: &mut Work) -> Result<Spectrum> {
    let n = a.dofs().len();
    let mut sums = vec![0.0; n];
    if n == 0 || !a.norm_inf(&mut sums).is_finite() {
        return Ok(Spectrum { lowest: Vec::new(), largest: f64::NAN, condition: f64::NAN });
    }
    if n <= LARGEST_DENSE
        && let Some(spectrum) = dense(a, inertia)
    {
        return Ok(spectrum);
    }
    let mut search = Search { a, factorization: Ldlt::analyse(a.pattern(), par)?, work };
    search.work.symbolic_factorizations += 1;
    let largest = search.largest();
    let lowest = search.lowest(inertia.negative, wanted.clamp(1, n), largest);
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    let nearest = match () {
        () if inertia.zero > 0 => 0.0,
        () if inertia.negative == 0 => smallest,
        () => search.nearest_to_zero(),
    };
    Ok(Spectrum { condition: largest.abs().max(smallest.abs()) / nearest, lowest, largest })
}

/// λ_min alone, in N/m; NaN where A is empty or has entries that are not finite.
///
/// # Errors
/// A matrix that is too large to factor.
pub fn smallest_eigenvalue(a: &SymmetricMatrix, par: Par, work: &mut Work) -> Result<f64> {
    let n = a.dofs().len();
    if n == 0 || !a.norm_inf(&mut vec![0.0; n]).is_finite() {
        return Ok(f64::NAN);
    }
    if n <= LARGEST_DENSE
        && let Some(eigen) = diagonalise(a)
    {
        return Ok(eigen.eigenvalues.min());
    }
    let mut search = Search { a, factorization: Ldlt::analyse(a.pattern(), par)?, work };
    search.work.symbolic_factorizations += 1;
    let largest = search.largest();
    Ok(search.lowest(0, 1, largest).first().map_or(f64::NAN, |pair| pair.value))
}

fn diagonalise(a: &SymmetricMatrix) -> Option<SymmetricEigen<f64, Dyn>> {
    let n = a.dofs().len();
    let mut matrix = DMatrix::zeros(n, n);
    for (row, column, value) in a.iter() {
        matrix[(row, column)] = value;
        matrix[(column, row)] = value;
    }
    SymmetricEigen::try_new(matrix, f64::EPSILON, 100 * n)
}

/// All eigenpairs of a small matrix.
fn dense(a: &SymmetricMatrix, inertia: &Inertia) -> Option<Spectrum> {
    let n = a.dofs().len();
    let eigen = diagonalise(a)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let pair = |&k: &usize| eigenpair(a, eigen.eigenvalues[k], eigen.eigenvectors.column(k).as_slice().to_vec());
    let lowest: Vec<Eigenpair> = order.iter().map(pair).collect();
    let sizes = || lowest.iter().map(|pair| pair.value.abs());
    let nearest = if inertia.zero > 0 { 0.0 } else { sizes().fold(f64::INFINITY, f64::min) };
    let (condition, largest) = (sizes().fold(0.0, f64::max) / nearest, lowest.last()?.value);
    Some(Spectrum { lowest, largest, condition })
}

fn eigenpair(a: &SymmetricMatrix, value: f64, vector: Vec<f64>) -> Eigenpair {
    let mut product = vec![0.0; vector.len()];
    a.apply(&vector, &mut product);
    for (p, x) in product.iter_mut().zip(&vector) {
        *p -= value * x;
    }
    Eigenpair { value, residual: norm(&product), vector }
}

struct Search<'a> {
    a: &'a SymmetricMatrix,
    factorization: Ldlt,
    work: &'a mut Work,
}

impl Search<'_> {
    fn n(&self) -> usize {
        self.a.dofs().len()
    }

    fn largest(&self) -> f64 {
        let mut apply = |x: &[f64], y: &mut [f64]| self.a.apply(x, y);
        let pairs = Krylov::new(self.n(), 1, &mut apply).iterate(RESIDUAL, LONGEST_SEARCH, &mut apply);
        pairs.first().map_or(f64::NAN, |pair| pair.value)
    }

    /// The lowest pairs, by solves with `A − σ`.
    /// As many of them as Sylvester's count says are negative, `negative`, are not missed for being multiple.
    fn lowest(&mut self, negative: usize, wanted: usize, largest: f64) -> Vec<Eigenpair> {
        let Some(shift) = self.factor_below_spectrum(largest) else { return Vec::new() };
        let Self { a, factorization, work } = self;
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += 1;
            y.copy_from_slice(x);
            factorization.solve_in_place(y);
        };
        let mut space = Krylov::new(a.dofs().len(), wanted, &mut solve);
        let mut found = space.iterate(TOLERANCE, LONGEST_SEARCH, &mut solve);
        let due = negative.min(wanted);
        let missed = |pairs: &[Ritz]| pairs.iter().filter(|pair| shift + 1.0 / pair.value < 0.0).count() < due;
        for _ in 0..due {
            if !missed(&found) {
                break;
            }
            space.refresh(&mut solve);
            found = space.iterate(TOLERANCE, LONGEST_SEARCH, &mut solve);
        }
        found.into_iter().map(|pair| eigenpair(a, shift + 1.0 / pair.value, pair.vector)).collect()
    }

    /// Factors `A − σ` with a σ below the spectrum, and returns σ.
    fn factor_below_spectrum(&mut self, largest: f64) -> Option<f64> {
        self.work.factorizations += 1;
        if self.factorization.factor(self.a).is_ok() && self.factorization.is_positive() {
            return Some(0.0);
        }
        // The lowest eigenvalue of A is what λ_max − A has as its largest, from the other side.
        let mut apply = |x: &[f64], y: &mut [f64]| {
            self.a.apply(x, y);
            for (y, x) in y.iter_mut().zip(x) {
                *y = largest * x - *y;
            }
        };
        let pairs = Krylov::new(self.n(), 1, &mut apply).iterate(1e-4, LONGEST_SEARCH, &mut apply);
        let estimate = pairs.first()?;
        let lowest = largest - estimate.value;
        let mut margin = estimate.residual.max(0.05 * lowest.abs()).max(1e-8 * largest.abs());
        for _ in 0..60 {
            let shift = lowest - margin;
            let mut shifted = self.a.clone();
            shifted.shift(-shift);
            self.work.factorizations += 1;
            if self.factorization.factor(&shifted).is_ok() && self.factorization.is_positive() {
                return Some(shift);
            }
            margin *= 2.0;
        }
        None
    }

    /// The smallest |λ|, by solves with A applied twice: `A⁻²` has the eigenvalues 1/λ².
    fn nearest_to_zero(&mut self) -> f64 {
        let Self { a, factorization, work } = self;
        work.factorizations += 1;
        if factorization.factor(a).is_err() {
            return 0.0;
        }
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += 2;
            y.copy_from_slice(x);
            factorization.solve_in_place(y);
            factorization.solve_in_place(y);
        };
        let pairs = Krylov::new(a.dofs().len(), 1, &mut solve).iterate(TOLERANCE, LONGEST_SEARCH, &mut solve);
        pairs.first().map_or(f64::NAN, |pair| pair.value.abs().sqrt().recip())
    }
}
