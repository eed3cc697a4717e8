//! Sparse factorizations `A = L Lᵀ` and `A = L D Lᵀ` by faer: analysed once, refactored for every matrix.
//!
//! faer's supernodal algorithm is used for every size: it is the faster one from about a thousand rows on, below that
//! both take microseconds, and only one convention for the index of a failed pivot is then in play.

use super::ordering::{Ordering, OrderingMethod};
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result};
use crate::memory;
use crate::system::Dof;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::ldlt::factor::LdltError;
use faer::linalg::cholesky::llt::factor::LltError;
use faer::mat::MatMut;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::{Conj, Par, Side, Spec};
use serde::Serialize;
use std::time::Instant;

/// Right-hand sides that are solved for together: the factor is read once for all of them.
pub const SOLVE_COLUMNS: usize = 4;

/// A pivot that is not positive (LLᵀ), or is zero or not finite (LDLᵀ).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NonPositivePivot {
    /// The row of A, not of the permuted matrix.
    pub row: usize,
    /// Its coordinate.
    pub dof: Dof,
}

/// What a factorization costs, known from the pattern alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FactorSize {
    /// Stored values of L, the zeros inside supernodes included.
    pub entries: usize,
    /// Floating-point operations of a numeric factorization.
    pub flops: f64,
    /// How the rows were ordered.
    pub ordering: OrderingMethod,
}

/// The time a factorization has taken so far, in s, all calls together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FactorTimes {
    /// Ordering and symbolic analysis, once.
    pub analysis_seconds: f64,
    /// Numeric factorizations.
    pub factor_seconds: f64,
    /// Solves.
    pub solve_seconds: f64,
}

/// Size and times of a factorization.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FactorReport {
    /// What it costs.
    #[serde(flatten)]
    pub size: FactorSize,
    /// What it has taken.
    #[serde(flatten)]
    pub times: FactorTimes,
}

/// What an error calls the factor.
const FACTOR: &str = "the factor of the matrix";

/// Bytes that ordering and analysis hold at most for an entry or a row of the matrix: lists of its pattern in both orders and its
/// graph's coarser copies. Found by lowering the limit on memory until a run failed.
const ANALYSIS: u64 = 64;

/// Ordering, symbolic analysis and memory, shared by both factorizations.
pub(super) struct Analysis {
    ordering: OrderingMethod,
    times: FactorTimes,
    pub symbolic: SymbolicCholesky<u32>,
    /// Empty until [`allocate`](Self::allocate), as is the memory.
    pub values: Vec<f64>,
    pub memory: MemBuffer,
    scratch: StackReq,
    pub par: Par,
}

impl Analysis {
    /// Orders and analyses, and takes the memory for the factor.
    pub fn new(pattern: &BlockPattern, par: Par) -> Result<Self> {
        let mut analysis = Self::plan(pattern, par)?;
        analysis.allocate()?;
        Ok(analysis)
    }

    /// Orders and analyses. [`allocate`](Self::allocate) must come before anything is factored.
    pub fn plan(pattern: &BlockPattern, par: Par) -> Result<Self> {
        memory::ensure(ANALYSIS * (pattern.entries() + pattern.order()) as u64, "the analysis of the matrix")?;
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let start = Instant::now();
        let Ordering { method, forward, inverse } = Ordering::of(pattern);
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, forward.len()));
        let symbolic = factorize_symbolic_cholesky(pattern.symbolic(), Side::Lower, ordering, params)
            .map_err(|_| Error::TooLarge { what: FACTOR, bytes: u64::MAX, room: memory::room() })?;
        // One buffer serves numeric factorization of any kind and solves.
        let scratch = symbolic
            .factorize_numeric_llt_scratch::<f64>(par, Spec::default())
            .or(symbolic.factorize_numeric_ldlt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.solve_in_place_scratch::<f64>(SOLVE_COLUMNS, par));
        let times = FactorTimes { analysis_seconds: start.elapsed().as_secs_f64(), ..FactorTimes::default() };
        let memory = MemBuffer::new(StackReq::EMPTY);
        Ok(Self { ordering: method, times, symbolic, values: Vec::new(), memory, scratch, par })
    }

    /// Bytes of the factor and of what factoring takes beside it.
    pub fn bytes(&self) -> u64 {
        8 * self.symbolic.len_val() as u64 + self.scratch.unaligned_bytes_required() as u64
    }

    /// Takes the memory for the factor.
    ///
    /// # Errors
    /// [`Error::TooLarge`] when it does not fit.
    pub fn allocate(&mut self) -> Result<()> {
        memory::ensure_with_dense_products(self.bytes(), FACTOR)?;
        self.values = memory::filled(0.0, self.symbolic.len_val(), FACTOR)?;
        let bytes = self.bytes();
        self.memory = MemBuffer::try_new(self.scratch).map_err(|_| Error::TooLarge {
            what: FACTOR,
            bytes,
            room: memory::room(),
        })?;
        Ok(())
    }

    fn report(&self) -> FactorReport {
        FactorReport { size: self.size(), times: self.times }
    }

    fn size(&self) -> FactorSize {
        FactorSize { entries: self.symbolic.len_val(), flops: flops(&self.symbolic), ordering: self.ordering }
    }

    /// `forward[k]` is the row of A that is eliminated as number k; `None` when the order is A's own.
    pub fn forward(&self) -> Option<&[u32]> {
        self.symbolic.perm().map(|perm| perm.arrays().0)
    }

    /// The row of A that the factorization calls `permuted`.
    fn pivot(&self, pattern: &BlockPattern, permuted: usize) -> NonPositivePivot {
        let row = self.forward().and_then(|forward| forward.get(permuted)).map_or(permuted, |&row| row as usize);
        NonPositivePivot { row, dof: pattern.dofs().dof(row) }
    }
}

/// A dense block of L: a trapezoid whose first `columns` rows are a triangle.
#[derive(Clone, Copy)]
pub(super) struct Supernode<'a> {
    /// Its first column in L.
    pub first: usize,
    pub columns: usize,
    /// The rows below the triangle, in the order of elimination.
    pub below: &'a [u32],
    /// Where its values start, by columns.
    pub values: usize,
}

impl Supernode<'_> {
    pub fn rows(&self) -> usize {
        self.columns + self.below.len()
    }

    /// Position of the diagonal entry of a column among the factor's values; the column's entries below follow it.
    pub fn diagonal(&self, column: usize) -> usize {
        self.values + column * self.rows() + column
    }
}

pub(super) fn supernodes(symbolic: &SymbolicCholesky<u32>) -> impl Iterator<Item = Supernode<'_>> + '_ {
    let supernodal = match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(supernodal) => Some(supernodal),
        SymbolicCholeskyRaw::Simplicial(_) => None,
    };
    supernodal.into_iter().flat_map(|supernodal| {
        (0..supernodal.n_supernodes()).map(move |s| {
            let first = supernodal.supernode_begin()[s] as usize;
            let columns = supernodal.supernode_end()[s] as usize - first;
            let below = supernodal.supernode(s).pattern();
            Supernode { first, columns, below, values: supernodal.col_ptr_for_val()[s] as usize }
        })
    })
}

/// Operations of a numeric factorization. A column of a block that has h entries takes h² (multiply and add counted).
fn flops(symbolic: &SymbolicCholesky<u32>) -> f64 {
    let column = |h: usize| (h * h) as f64;
    supernodes(symbolic).map(|s| (0..s.columns).map(|c| column(s.rows() - c)).sum::<f64>()).sum()
}

/// Sparse Cholesky factorization `A = L Lᵀ`: exists if and only if A is positive definite (to rounding).
pub struct Cholesky(Analysis);

impl Cholesky {
    /// As [`analyse`](Self::analyse), without the memory for the factor: [`allocate`](Self::allocate) must come before
    /// anything is factored.
    pub(super) fn plan(pattern: &BlockPattern, par: Par) -> Result<Self> {
        Analysis::plan(pattern, par).map(Self)
    }

    /// Takes the memory for the factor.
    pub(super) fn allocate(&mut self) -> Result<()> {
        self.0.allocate()
    }

    /// Bytes of the factor and of what factoring takes beside it.
    pub(super) fn bytes(&self) -> u64 {
        self.0.bytes()
    }

    /// Orders (approximate minimum degree or nested dissection, whichever costs less) and analyses a pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn analyse(pattern: &BlockPattern, par: Par) -> Result<Self> {
        Analysis::new(pattern, par).map(Self)
    }

    /// Entries and operations of a numeric factorization.
    pub fn size(&self) -> FactorSize {
        self.0.size()
    }

    /// The size and the times so far.
    pub fn report(&self) -> FactorReport {
        self.0.report()
    }

    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// The first pivot that is not positive.
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        let Analysis { symbolic, values, memory, par, times, .. } = &mut self.0;
        let start = Instant::now();
        let stack = MemStack::new(memory);
        let regularization = Default::default();
        let done = symbolic
            .factorize_numeric_llt(values, a.as_faer(), Side::Lower, regularization, *par, stack, Spec::default())
            .map(|_| ());
        times.factor_seconds += start.elapsed().as_secs_f64();
        done.map_err(|LltError::NonPositivePivot { index }| self.0.pivot(a.pattern(), index))
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    pub fn solve_in_place(&mut self, x: &mut [f64]) {
        let Analysis { symbolic, values, memory, par, times, .. } = &mut self.0;
        let start = Instant::now();
        let rows = x.len();
        let x = MatMut::from_column_major_slice_mut(x, rows, 1);
        LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
        times.solve_seconds += start.elapsed().as_secs_f64();
    }
}

/// Sparse factorization `A = L D Lᵀ` without pivoting: D may have either sign, so A may be indefinite, but then nothing
/// keeps the rounding errors small. Check the residual.
pub struct Ldlt(Analysis);

impl Ldlt {
    /// As [`Cholesky::analyse`].
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn analyse(pattern: &BlockPattern, par: Par) -> Result<Self> {
        Analysis::new(pattern, par).map(Self)
    }

    /// Entries and operations of a numeric factorization.
    pub fn size(&self) -> FactorSize {
        self.0.size()
    }

    /// The size and the times so far.
    pub fn report(&self) -> FactorReport {
        self.0.report()
    }

    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// A pivot that is exactly zero, or not finite.
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        let Analysis { symbolic, values, memory, par, times, .. } = &mut self.0;
        let start = Instant::now();
        let stack = MemStack::new(memory);
        let regularization = Default::default();
        let done = symbolic
            .factorize_numeric_ldlt(values, a.as_faer(), Side::Lower, regularization, *par, stack, Spec::default())
            .map(|_| ());
        times.factor_seconds += start.elapsed().as_secs_f64();
        done.map_err(|LdltError::ZeroPivot { index }| self.0.pivot(a.pattern(), index))
    }

    /// The pivots D of the last factored matrix with the rows of A they belong to, in the order of elimination.
    pub fn pivots(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let forward = self.0.forward();
        supernodes(&self.0.symbolic).flat_map(move |s| {
            (0..s.columns).map(move |c| {
                let permuted = s.first + c;
                let row = forward.map_or(permuted, |forward| forward[permuted] as usize);
                (row, self.0.values[s.diagonal(c)])
            })
        })
    }

    /// Rows and columns of the stored entries of L below its diagonal, the zeros inside supernodes included, numbered in the order of
    /// elimination.
    pub fn pattern(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        supernodes(&self.0.symbolic).flat_map(|s| {
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
    /// the most negative pivot. Returns whether there is one; not normalised.
    pub fn negative_direction(&mut self, u: &mut [f64]) -> bool {
        let pivots = supernodes(&self.0.symbolic).flat_map(|s| (0..s.columns).map(move |c| (s, c)));
        let worst = pivots
            .map(|(s, c)| (self.0.values[s.diagonal(c)], s, c))
            .filter(|(d, ..)| *d < 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, s, c)) = worst else { return false };
        // A⁻¹ (L e_j) = L⁻ᵀ D⁻¹ e_j: a column of L and one ordinary solve.
        let forward = self.0.forward();
        let row = |permuted: usize| forward.map_or(permuted, |forward| forward[permuted] as usize);
        u.fill(0.0);
        u[row(s.first + c)] = 1.0;
        let column = &self.0.values[s.diagonal(c) + 1..s.values + (c + 1) * s.rows()];
        let (top, bottom) = column.split_at(s.columns - c - 1);
        for (at, value) in (s.first + c + 1..).zip(top) {
            u[row(at)] = *value;
        }
        for (&at, value) in s.below.iter().zip(bottom) {
            u[row(at as usize)] = *value;
        }
        self.solve_in_place(u);
        true
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    pub fn solve_in_place(&mut self, x: &mut [f64]) {
        self.solve_columns_in_place(x.len(), x);
    }

    /// `X ← A⁻¹ X` for a matrix of n rows, n the order of A, stored by columns: [`SOLVE_COLUMNS`] at a time.
    pub fn solve_columns_in_place(&mut self, n: usize, x: &mut [f64]) {
        let Analysis { symbolic, values, memory, par, times, .. } = &mut self.0;
        let start = Instant::now();
        for x in x.chunks_mut((SOLVE_COLUMNS * n).max(1)) {
            let columns = x.len() / n.max(1);
            let x = MatMut::from_column_major_slice_mut(x, n, columns);
            let factor = LdltRef::new(symbolic, values);
            factor.solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
        }
        times.solve_seconds += start.elapsed().as_secs_f64();
    }
}

#[cfg(test)]
mod tests;
