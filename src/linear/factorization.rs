//! Sparse factorizations `A = L Lᵀ` and `A = L D Lᵀ` by faer: analysed once, refactored for every matrix.
//!
//! faer's supernodal algorithm is used for every size: it is the faster one from about a thousand rows on, below that
//! both take microseconds, and only one convention for the index of a failed pivot is then in play.

use super::ordering::{Ordering, OrderingMethod};
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result};
use crate::system::Dof;
use faer::dyn_stack::{MemBuffer, MemStack};
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

/// Operations below which a factorization runs on one thread: there a second one gains nothing (the parallelism is
/// inside the dense blocks), and handing work over allocates.
const PARALLEL_FLOPS: f64 = 1e9;

/// A pivot that is not positive (LLᵀ), or is zero or not finite (LDLᵀ).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NonPositivePivot {
    /// The row of A, not of the permuted matrix.
    pub row: usize,
    /// Its coordinate.
    pub dof: Dof,
}

/// What a factorization costs, known from the pattern alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FactorSize {
    /// Stored values of L, the zeros inside supernodes included.
    pub entries: usize,
    /// Floating-point operations of a numeric factorization.
    pub flops: f64,
    /// How the rows were ordered.
    pub ordering: OrderingMethod,
}

/// Ordering, symbolic analysis and memory, shared by both factorizations.
struct Analysis {
    ordering: OrderingMethod,
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
    memory: MemBuffer,
    par: Par,
}

impl Analysis {
    fn new(pattern: &BlockPattern, par: Par) -> Result<Self> {
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let Ordering { method, forward, inverse } = Ordering::of(pattern);
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, forward.len()));
        let symbolic = factorize_symbolic_cholesky(pattern.symbolic(), Side::Lower, ordering, params)
            .map_err(|error| Error::Usage(format!("the matrix is too large to factor: {error:?}")))?;
        let par = if flops(&symbolic) < PARALLEL_FLOPS { Par::Seq } else { par };
        let values = vec![0.0; symbolic.len_val()];
        // One buffer serves numeric factorization of either kind and solves.
        let scratch = symbolic
            .factorize_numeric_llt_scratch::<f64>(par, Spec::default())
            .or(symbolic.factorize_numeric_ldlt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.solve_in_place_scratch::<f64>(1, par));
        let memory = MemBuffer::try_new(scratch)
            .map_err(|_| Error::Usage("the matrix is too large to factor: out of memory".into()))?;
        Ok(Self { ordering: method, symbolic, values, memory, par })
    }

    fn size(&self) -> FactorSize {
        FactorSize { entries: self.values.len(), flops: flops(&self.symbolic), ordering: self.ordering }
    }

    /// The row of A that the factorization calls `permuted`.
    fn pivot(&self, pattern: &BlockPattern, permuted: usize) -> NonPositivePivot {
        let forward = self.symbolic.perm().map(|perm| perm.arrays().0);
        let row = forward.and_then(|forward| forward.get(permuted)).map_or(permuted, |&row| row as usize);
        NonPositivePivot { row, dof: pattern.dofs().dof(row) }
    }
}

/// A dense block of L: a trapezoid whose first `columns` rows are a triangle.
struct Supernode {
    /// Its first column in L.
    first: usize,
    columns: usize,
    rows: usize,
    /// Where its values start, by columns.
    values: usize,
}

fn supernodes(symbolic: &SymbolicCholesky<u32>) -> impl Iterator<Item = Supernode> + '_ {
    let supernodal = match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(supernodal) => Some(supernodal),
        SymbolicCholeskyRaw::Simplicial(_) => None,
    };
    supernodal.into_iter().flat_map(|supernodal| {
        (0..supernodal.n_supernodes()).map(move |s| {
            let first = supernodal.supernode_begin()[s] as usize;
            let columns = supernodal.supernode_end()[s] as usize - first;
            let below = supernodal.col_ptr_for_row_idx();
            let rows = columns + (below[s + 1] - below[s]) as usize;
            Supernode { first, columns, rows, values: supernodal.col_ptr_for_val()[s] as usize }
        })
    })
}

/// Operations of a numeric factorization. A column of a block that has h entries takes h² (multiply and add counted).
fn flops(symbolic: &SymbolicCholesky<u32>) -> f64 {
    let column = |h: usize| (h * h) as f64;
    supernodes(symbolic).map(|s| (0..s.columns).map(|c| column(s.rows - c)).sum::<f64>()).sum()
}

/// Sparse Cholesky factorization `A = L Lᵀ`: exists if and only if A is positive definite (to rounding).
pub struct Cholesky(Analysis);

impl Cholesky {
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

    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// The first pivot that is not positive.
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        let Analysis { symbolic, values, memory, par, .. } = &mut self.0;
        let stack = MemStack::new(memory);
        let regularization = Default::default();
        let done = symbolic
            .factorize_numeric_llt(values, a.as_faer(), Side::Lower, regularization, *par, stack, Spec::default())
            .map(|_| ());
        done.map_err(|LltError::NonPositivePivot { index }| self.0.pivot(a.pattern(), index))
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    pub fn solve_in_place(&mut self, x: &mut [f64]) {
        let Analysis { symbolic, values, memory, par, .. } = &mut self.0;
        let rows = x.len();
        let x = MatMut::from_column_major_slice_mut(x, rows, 1);
        LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
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

    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// A pivot that is exactly zero, or not finite.
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        let Analysis { symbolic, values, memory, par, .. } = &mut self.0;
        let stack = MemStack::new(memory);
        let regularization = Default::default();
        let done = symbolic
            .factorize_numeric_ldlt(values, a.as_faer(), Side::Lower, regularization, *par, stack, Spec::default())
            .map(|_| ());
        done.map_err(|LdltError::ZeroPivot { index }| self.0.pivot(a.pattern(), index))
    }

    /// The pivots D of the last factored matrix with the rows of A they belong to, in the order of elimination.
    pub fn pivots(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let forward = self.0.symbolic.perm().map(|perm| perm.arrays().0);
        supernodes(&self.0.symbolic).flat_map(move |s| {
            (0..s.columns).map(move |c| {
                let permuted = s.first + c;
                let row = forward.map_or(permuted, |forward| forward[permuted] as usize);
                (row, self.0.values[s.values + c * s.rows + c])
            })
        })
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    pub fn solve_in_place(&mut self, x: &mut [f64]) {
        let Analysis { symbolic, values, memory, par, .. } = &mut self.0;
        let rows = x.len();
        let x = MatMut::from_column_major_slice_mut(x, rows, 1);
        LdltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
    }
}
