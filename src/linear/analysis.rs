//! Ordering, symbolic analysis and memory of a sparse factorization, whatever its kind.
//!
//! faer's supernodal algorithm is used for every size: it is the faster one from about a thousand rows on, below that
//! both take microseconds, and only one convention for the index of a failed pivot is then in play.

use super::ordering::{Ordering, OrderingEstimate, OrderingMethod};
use super::substitution::Substitution;
use super::supernode::supernodes;
use crate::assembly::BlockPattern;
use crate::error::{Error, Result};
use crate::memory;
use crate::system::Dof;
use faer::dyn_stack::{MemBuffer, StackReq};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::{Par, Side, Spec};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Right-hand sides that are solved for together: the factor is read once for all of them.
pub const SOLVE_COLUMNS: usize = 4;

/// A pivot that is not positive (LLᵀ), or is zero or not finite (LDLᵀ).
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the pivot of {dof}, in row {row}, is not positive")]
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

impl FactorSize {
    /// What is seen at first glance: a factorization takes this at least.
    pub(super) fn least(glance: &OrderingEstimate) -> Self {
        let (entries, flops) = glance.least();
        Self { entries: entries as usize, flops, ordering: glance.method() }
    }
}

/// The time a factorization has taken so far, in s, all calls together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
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
#[non_exhaustive]
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

/// Ordering, symbolic analysis and memory, shared by all kinds.
pub struct Analysis {
    ordering: OrderingMethod,
    pub times: FactorTimes,
    pub symbolic: Arc<SymbolicCholesky<u32>>,
    /// Empty until [`allocate`](Self::allocate), as is the memory.
    pub values: Vec<f64>,
    pub memory: MemBuffer,
    pub substitution: Substitution,
    scratch: StackReq,
    pub par: Par,
}

impl Analysis {
    /// Asks for the memory that ordering and analysis take.
    pub(super) fn ensure_room(pattern: &BlockPattern) -> Result<()> {
        memory::ensure(ANALYSIS * (pattern.entries() + pattern.order()) as u64, "the analysis of the matrix")
    }

    /// A first look at what a factorization takes.
    pub(super) fn glance(pattern: &BlockPattern) -> Result<OrderingEstimate> {
        Self::ensure_room(pattern)?;
        Ok(OrderingEstimate::of(pattern))
    }

    /// Orders and analyses what was glanced at. [`allocate`](Self::allocate) must come before anything is factored.
    pub(super) fn plan(pattern: &BlockPattern, glance: OrderingEstimate, par: Par) -> Result<Self> {
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let (start, glanced) = (Instant::now(), glance.took());
        let Ordering { method, forward, inverse } = glance.order(pattern);
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, forward.len()));
        let symbolic = factorize_symbolic_cholesky(pattern.symbolic(), Side::Lower, ordering, params)
            .map_err(|_| Error::TooLarge { what: FACTOR, bytes: u64::MAX, room: memory::room() })?;
        // One buffer serves numeric factorization of any kind and solves.
        let scratch = symbolic
            .factorize_numeric_llt_scratch::<f64>(par, Spec::default())
            .or(symbolic.factorize_numeric_ldlt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.solve_in_place_scratch::<f64>(SOLVE_COLUMNS, par));
        let times =
            FactorTimes { analysis_seconds: (glanced + start.elapsed()).as_secs_f64(), ..FactorTimes::default() };
        let (memory, symbolic) = (MemBuffer::new(StackReq::EMPTY), Arc::new(symbolic));
        let (values, substitution) = Default::default();
        Ok(Self { ordering: method, times, symbolic, values, memory, substitution, scratch, par })
    }

    /// What is known of the pattern, without memory for a factor, to be [allocated](Self::allocate).
    pub fn shared(&self) -> Self {
        let (times, values, substitution) = Default::default();
        let (memory, symbolic) = (MemBuffer::new(StackReq::EMPTY), self.symbolic.clone());
        Self { times, values, memory, substitution, symbolic, ..*self }
    }

    /// Bytes of the factor and of what factoring takes beside it.
    pub fn bytes(&self) -> u64 {
        let scratch = self.scratch.unaligned_bytes_required() as u64;
        8 * self.symbolic.len_val() as u64 + scratch + Substitution::bytes(&self.symbolic)
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
        self.substitution = Substitution::new(&self.symbolic);
        Ok(())
    }

    pub fn report(&self) -> FactorReport {
        FactorReport { size: self.size(), times: self.times }
    }

    pub fn size(&self) -> FactorSize {
        FactorSize { entries: self.symbolic.len_val(), flops: flops(&self.symbolic), ordering: self.ordering }
    }

    /// `forward[k]` is the row of A that is eliminated as number k; `None` when the order is A's own.
    pub fn forward(&self) -> Option<&[u32]> {
        self.symbolic.perm().map(|perm| perm.arrays().0)
    }

    /// The row of A that the factorization calls `permuted`.
    pub fn pivot(&self, pattern: &BlockPattern, permuted: usize) -> NonPositivePivot {
        let row = self.forward().and_then(|forward| forward.get(permuted)).map_or(permuted, |&row| row as usize);
        NonPositivePivot { row, dof: pattern.dofs().dof(row) }
    }
}

/// Operations of a numeric factorization. A column of a block that has h entries takes h² (multiply and add counted).
fn flops(symbolic: &SymbolicCholesky<u32>) -> f64 {
    let column = |h: usize| (h * h) as f64;
    supernodes(symbolic).map(|s| (0..s.columns).map(|c| column(s.rows() - c)).sum::<f64>()).sum()
}
