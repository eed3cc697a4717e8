//! Symbolic analysis and memory of a sparse factorization, whatever its kind.
//!
//! faer's supernodal algorithm is used for every size: it is the faster one from about a thousand rows on, below that both take microseconds, and the
//! index of a failed pivot follows one convention only.

use super::ordering::{FactorSize, Ordering, OrderingEstimate, OrderingMethod};
use super::substitution::{Substitution, Supernode, supernodes};
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

/// Right-hand sides solved together: the factor is read once for all of them.
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

/// The time that a factorization has taken so far, in s.
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
    /// The cost by the pattern.
    #[serde(flatten)]
    pub size: FactorSize,
    /// The time so far.
    #[serde(flatten)]
    pub times: FactorTimes,
}

const FACTOR: &str = "the factor of the matrix";

/// Symbolic analysis and memory.
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
    /// Checks first that there is memory, at most 64 bytes for an entry or a row, by lowering the limit on memory until a run failed.
    pub(super) fn estimate(pattern: &BlockPattern) -> Result<OrderingEstimate> {
        memory::ensure(64 * (pattern.entries() + pattern.order()) as u64, "the analysis of the matrix")?;
        Ok(OrderingEstimate::new(pattern))
    }

    /// Orders and analyses the pattern of an estimate, without memory for the factor.
    pub(super) fn new(pattern: &BlockPattern, estimate: OrderingEstimate, par: Par) -> Result<Self> {
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let (start, estimated) = (Instant::now(), estimate.duration);
        let Ordering { method, forward, inverse } = estimate.order(pattern);
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, forward.len()));
        let symbolic = factorize_symbolic_cholesky(pattern.symbolic(), Side::Lower, ordering, params)
            .map_err(|_| Error::TooLarge { what: FACTOR, bytes: u64::MAX, room: memory::room() })?;
        // One buffer serves numeric factorization of any kind and solves.
        let scratch = symbolic
            .factorize_numeric_llt_scratch::<f64>(par, Spec::default())
            .or(symbolic.factorize_numeric_ldlt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(par, Spec::default()))
            .or(symbolic.solve_in_place_scratch::<f64>(SOLVE_COLUMNS, par));
        let analysis_seconds = (estimated + start.elapsed()).as_secs_f64();
        Ok(Self {
            ordering: method,
            times: FactorTimes { analysis_seconds, ..Default::default() },
            symbolic: Arc::new(symbolic),
            values: Vec::new(),
            memory: MemBuffer::new(StackReq::EMPTY),
            substitution: Substitution::default(),
            scratch,
            par,
        })
    }

    /// The same analysis, without memory for a factor.
    pub fn shared(&self) -> Self {
        let (times, values, substitution) = Default::default();
        let (memory, symbolic) = (MemBuffer::new(StackReq::EMPTY), self.symbolic.clone());
        Self { times, values, memory, substitution, symbolic, ..*self }
    }

    pub fn bytes(&self) -> u64 {
        let scratch = self.scratch.unaligned_bytes_required() as u64;
        8 * self.symbolic.len_val() as u64 + scratch + Substitution::bytes(&self.symbolic)
    }

    pub fn allocate(&mut self) -> Result<()> {
        let bytes = self.bytes();
        memory::ensure_with_dense_products(bytes, FACTOR)?;
        self.values = memory::filled(0.0, self.symbolic.len_val(), FACTOR)?;
        self.memory = MemBuffer::try_new(self.scratch).map_err(|_| Error::TooLarge {
            what: FACTOR,
            bytes,
            room: memory::room(),
        })?;
        self.substitution = Substitution::new(&self.symbolic);
        Ok(())
    }

    pub fn size(&self) -> FactorSize {
        // A column of h entries takes h² operations (multiply and add counted).
        let column = |h: usize| (h * h) as f64;
        let supernode = |s: Supernode| (0..s.columns).map(|c| column(s.rows() - c)).sum::<f64>();
        let flops = supernodes(&self.symbolic).map(supernode).sum();
        FactorSize { entries: self.symbolic.len_val(), flops, ordering: self.ordering }
    }

    /// The row of A that is eliminated as number k.
    pub fn row(&self, k: usize) -> usize {
        self.symbolic.perm().and_then(|perm| perm.arrays().0.get(k)).map_or(k, |&row| row as usize)
    }
}
