//! Sparse factorizations `A = L B Lᵀ` by faer: analysed once, refactored for every matrix.
//!
//! One type for all [kinds](FactorKind), which differ in B and in how pivots are chosen: what a kind adds is its call of faer and
//! what can be asked of its factors. Single right-hand sides are solved for by `linear/substitution.rs`, several at once by faer.

use super::analysis::{Analysis, FactorReport, FactorSize, NonPositivePivot, SOLVE_COLUMNS};
use super::ordering::OrderingEstimate;
use super::substitution::Diagonal;
use super::supernode::supernodes;
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result, check_length};
use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::ldlt::factor::LdltError;
use faer::linalg::cholesky::llt::factor::LltError;
use faer::mat::MatMut;
use faer::sparse::linalg::cholesky::{LdltRef, LltRef};
use faer::{Conj, Par, Side, Spec};
use std::time::Instant;

/// A sparse factorization of symmetric matrices on one pattern.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::faer::Par;
/// use sprung::integrate::StepMatrices;
/// use sprung::linear::{Cholesky, Ldlt};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let short = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1)?;
/// let mut cholesky = Cholesky::analyse(short.a.pattern(), Par::Seq)?;
/// cholesky.factor(&short.a)?;
/// let mut x = short.b.clone();
/// cholesky.solve_in_place(&mut x)?;
/// assert!((x[0] - 10.0 / 110.0).abs() < 1e-15);
///
/// // A step of a second: 1 − 10 N/m across the compressed spring.
/// let long = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?;
/// assert!(cholesky.factor(&long.a).is_err());
/// let mut ldlt = Ldlt::analyse(long.a.pattern(), Par::Seq)?;
/// ldlt.factor(&long.a)?;
/// assert_eq!(ldlt.pivots().filter(|(_, d)| *d < 0.0).count(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Factorization<K> {
    pub(super) analysis: Analysis,
    pub(super) kind: K,
}

/// Sparse Cholesky factorization `A = L Lᵀ`: exists if and only if A is positive definite (to rounding).
pub type Cholesky = Factorization<Llt>;

/// Sparse factorization `A = L D Lᵀ` without pivoting: D may have either sign, so A may be indefinite, but then nothing
/// keeps the rounding errors small. Check the residual.
pub type Ldlt = Factorization<Ldl>;

/// What B is, and how pivots are chosen: [`Llt`], [`Ldl`] or [`BunchKaufman`](super::BunchKaufman).
pub trait FactorKind: kind::Numeric {}

impl<K: kind::Numeric> FactorKind for K {}

/// A kind whose factors solve.
pub trait SolvingKind: FactorKind + kind::Solve {}

impl<K: kind::Solve> SolvingKind for K {}

/// What faer has to be told; nobody else can make a kind.
pub(super) mod kind {
    use super::{Analysis, Diagonal, SymmetricMatrix};

    pub trait Numeric: Sized {
        /// For matrices of an order.
        fn of_order(n: usize) -> Self;

        /// Factors; the index of a refused pivot, in the order of elimination.
        fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize>;
    }

    pub trait Solve: Numeric {
        /// What factors have on their diagonal.
        const DIAGONAL: Diagonal;

        /// `X ← A⁻¹ X` for at most [`SOLVE_COLUMNS`](super::SOLVE_COLUMNS) columns.
        fn solve(analysis: &mut Analysis, x: faer::MatMut<'_, f64>);
    }
}

/// `A = L Lᵀ`.
pub struct Llt;

/// `A = L D Lᵀ`, D diagonal, pivots in the order of elimination.
pub struct Ldl;

impl kind::Numeric for Llt {
    fn of_order(_: usize) -> Self {
        Self
    }

    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        let (plain, stack) = (Default::default(), MemStack::new(memory));
        let done =
            symbolic.factorize_numeric_llt(values, a.as_faer(), Side::Lower, plain, *par, stack, Spec::default());
        done.map(|_| ()).map_err(|LltError::NonPositivePivot { index }| index)
    }
}

impl kind::Numeric for Ldl {
    fn of_order(_: usize) -> Self {
        Self
    }

    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        let (plain, stack) = (Default::default(), MemStack::new(memory));
        let done =
            symbolic.factorize_numeric_ldlt(values, a.as_faer(), Side::Lower, plain, *par, stack, Spec::default());
        done.map(|_| ()).map_err(|LdltError::ZeroPivot { index }| index)
    }
}

impl kind::Solve for Llt {
    const DIAGONAL: Diagonal = Diagonal::Roots;

    fn solve(analysis: &mut Analysis, x: MatMut<'_, f64>) {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
    }
}

impl kind::Solve for Ldl {
    const DIAGONAL: Diagonal = Diagonal::Pivots;

    fn solve(analysis: &mut Analysis, x: MatMut<'_, f64>) {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        LdltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
    }
}

impl<K: FactorKind> Factorization<K> {
    /// As [`analyse`](Self::analyse), without the memory for the factor: [`allocate`](Self::allocate) must come before
    /// anything is factored.
    pub(super) fn plan(pattern: &BlockPattern, glance: OrderingEstimate, par: Par) -> Result<Self> {
        Ok(Self { analysis: Analysis::plan(pattern, glance, par)?, kind: K::of_order(pattern.order()) })
    }

    /// Takes the memory for the factor.
    pub(super) fn allocate(&mut self) -> Result<()> {
        self.analysis.allocate()
    }

    /// Bytes of the factor and of what factoring takes beside it.
    pub(super) fn bytes(&self) -> u64 {
        self.analysis.bytes()
    }

    /// Orders (approximate minimum degree or nested dissection, whichever costs less) and analyses a pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn analyse(pattern: &BlockPattern, par: Par) -> Result<Self> {
        let mut factorization = Self::plan(pattern, Analysis::glance(pattern)?, par)?;
        factorization.allocate()?;
        Ok(factorization)
    }

    /// Another one on the pattern that `analysed` knows, with memory of its own: nothing is analysed again.
    ///
    /// # Errors
    /// When the factor does not fit the memory.
    pub fn sharing<L: FactorKind>(analysed: &Factorization<L>) -> Result<Self> {
        let analysis = analysed.analysis.shared();
        let kind = K::of_order(analysis.symbolic.nrows());
        let mut factorization = Self { analysis, kind };
        factorization.allocate()?;
        Ok(factorization)
    }

    /// Entries and operations of a numeric factorization.
    pub fn size(&self) -> FactorSize {
        self.analysis.size()
    }

    /// The size and the times so far.
    pub fn report(&self) -> FactorReport {
        self.analysis.report()
    }

    /// Factors, timed; the index of a refused pivot, in the order of elimination.
    pub(super) fn run(&mut self, a: &SymmetricMatrix) -> Result<(), usize> {
        let start = Instant::now();
        let done = self.kind.factor(&mut self.analysis, a);
        self.analysis.times.factor_seconds += start.elapsed().as_secs_f64();
        done
    }
}

impl<K: SolvingKind> Factorization<K> {
    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// The first pivot that is not positive (LLᵀ), or is exactly zero or not finite (LDLᵀ).
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        self.run(a).map_err(|index| self.analysis.pivot(a.pattern(), index))
    }

    /// `A⁻¹ b` with the last factored matrix.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a vector whose length is not the order of A.
    pub fn solve(&mut self, b: &[f64]) -> Result<Vec<f64>> {
        let mut x = b.to_vec();
        self.solve_in_place(&mut x)?;
        Ok(x)
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a vector whose length is not the order of A.
    pub fn solve_in_place(&mut self, x: &mut [f64]) -> Result<()> {
        check_length("x", x.len(), self.analysis.symbolic.nrows())?;
        self.substitute(x);
        Ok(())
    }

    /// `X ← A⁻¹ X` for a matrix stored by columns, each as long as A: [`SOLVE_COLUMNS`] at a time.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a length that is no multiple of the order of A.
    pub fn solve_columns_in_place(&mut self, x: &mut [f64]) -> Result<()> {
        let n = self.analysis.symbolic.nrows();
        check_length("x", x.len(), x.len() / n.max(1) * n)?;
        self.substitute_columns(n, x);
        Ok(())
    }

    /// As [`solve_in_place`](Self::solve_in_place), for a vector of the right length.
    pub(crate) fn substitute(&mut self, x: &mut [f64]) {
        self.substitute_columns(x.len(), x);
    }

    /// As [`solve_columns_in_place`](Self::solve_columns_in_place), for columns of the right length n.
    pub(crate) fn substitute_columns(&mut self, n: usize, x: &mut [f64]) {
        let start = Instant::now();
        for x in x.chunks_mut((SOLVE_COLUMNS * n).max(1)) {
            let Analysis { symbolic, values, substitution, .. } = &mut self.analysis;
            match x.len() / n.max(1) {
                1 => substitution.solve(symbolic, values, K::DIAGONAL, x),
                columns => K::solve(&mut self.analysis, MatMut::from_column_major_slice_mut(x, n, columns)),
            }
        }
        self.analysis.times.solve_seconds += start.elapsed().as_secs_f64();
    }
}

impl SymmetricMatrix {
    /// The Cholesky factorization, analysed and computed. For several matrices on one pattern see [`Factorization::analyse`].
    ///
    /// # Errors
    /// A matrix that is not positive definite, or whose factor does not fit the memory.
    pub fn cholesky(&self) -> Result<Cholesky, NotFactored> {
        let mut factorization = Cholesky::analyse(self.pattern(), Par::Seq)?;
        factorization.factor(self)?;
        Ok(factorization)
    }

    /// The factorization L D Lᵀ, analysed and computed: of an indefinite matrix too.
    ///
    /// # Errors
    /// A pivot that is zero or not finite; a factor that does not fit the memory.
    pub fn ldlt(&self) -> Result<Ldlt, NotFactored> {
        let mut factorization = Ldlt::analyse(self.pattern(), Par::Seq)?;
        factorization.factor(self)?;
        Ok(factorization)
    }
}

/// Why a matrix has no factorization.
#[derive(Debug, thiserror::Error)]
pub enum NotFactored {
    /// The factor does not fit the memory.
    #[error(transparent)]
    TooLarge(#[from] Error),
    /// A pivot was refused: for Cholesky, the matrix is not positive definite.
    #[error(transparent)]
    Pivot(#[from] NonPositivePivot),
}

impl Factorization<Ldl> {
    /// The pivots D of the last factored matrix with the rows of A they belong to, in the order of elimination.
    pub fn pivots(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let forward = self.analysis.forward();
        supernodes(&self.analysis.symbolic).flat_map(move |s| {
            (0..s.columns).map(move |c| {
                let permuted = s.first + c;
                let row = forward.map_or(permuted, |forward| forward[permuted] as usize);
                (row, self.analysis.values[s.diagonal(c)])
            })
        })
    }

    /// Rows and columns of the stored entries of L below its diagonal, the zeros inside supernodes included, numbered in the order of
    /// elimination.
    pub fn pattern(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        supernodes(&self.analysis.symbolic).flat_map(|s| {
            (0..s.columns).flat_map(move |c| {
                let triangle = c + 1..s.columns;
                let rows = triangle.map(move |r| s.first + r).chain(s.below.iter().map(|&row| row as usize));
                rows.map(move |row| (row, s.first + c))
            })
        })
    }

    /// Whether all pivots of the last factored matrix are positive. `L√D` is then its Cholesky factor: the matrix is
    /// positive definite, to rounding.
    pub fn is_positive(&self) -> bool {
        self.pivots().all(|(_, d)| d > 0.0)
    }

    /// A direction of negative curvature of the last factored matrix: `u = L⁻ᵀ e_j/d_j`, for which `uᵀAu = 1/d_j`, with j
    /// the most negative pivot. Returns whether there is one that fits the length of u; not normalised.
    pub fn negative_direction(&mut self, u: &mut [f64]) -> bool {
        if u.len() != self.analysis.symbolic.nrows() {
            return false;
        }
        let pivots = supernodes(&self.analysis.symbolic).flat_map(|s| (0..s.columns).map(move |c| (s, c)));
        let worst = pivots
            .map(|(s, c)| (self.analysis.values[s.diagonal(c)], s, c))
            .filter(|(d, ..)| *d < 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, s, c)) = worst else { return false };
        // A⁻¹ (L e_j) = L⁻ᵀ D⁻¹ e_j: a column of L and one ordinary solve.
        let forward = self.analysis.forward();
        let row = |permuted: usize| forward.map_or(permuted, |forward| forward[permuted] as usize);
        u.fill(0.0);
        u[row(s.first + c)] = 1.0;
        let column = &self.analysis.values[s.diagonal(c) + 1..s.values + (c + 1) * s.rows()];
        let (top, bottom) = column.split_at(s.columns - c - 1);
        for (at, value) in (s.first + c + 1..).zip(top) {
            u[row(at)] = *value;
        }
        for (&at, value) in s.below.iter().zip(bottom) {
            u[row(at as usize)] = *value;
        }
        self.substitute(u);
        true
    }
}

#[cfg(test)]
mod tests;
