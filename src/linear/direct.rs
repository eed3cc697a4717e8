//! The sparse factorizations as a time step's solvers: refill, refactor, solve, and measure the residual.

use super::analysis::{Analysis, FactorReport, FactorSize, NonPositivePivot};
use super::factorization::{Cholesky, Ldlt};
use super::norms::{backward_error, norm, scaling};
use super::ordering::OrderingEstimate;
use super::outcome::{Definiteness, Evidence, Solution, SolveFailure};
use super::{Held, LinearSolver};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::operator::{LinearOperator, SystemOperator};
use crate::system::System;
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// Backward error up to which an LDLᵀ solution is accepted: well above the 30 units in the last place of a stable solve,
/// and a hundred times below the default tolerance of conjugate gradients, which it must not undercut.
const TRUSTED_BACKWARD_ERROR: f64 = 1e-12;

/// Rounds of iterative refinement that an LDLᵀ solution gets to reach it.
const REFINEMENTS: usize = 3;

/// The assembled matrix and the residual of its solutions.
#[derive(Debug)]
struct Assembled {
    matrix: SystemMatrix,
    residual: Vec<f64>,
    /// The right-hand side times a power of two that keeps its products from under- and overflow, and that power.
    scaled: Vec<f64>,
    factor: f64,
}

impl Assembled {
    fn new(system: &System, pattern: Arc<SpringPattern>) -> Result<Self> {
        let zeros = || vec![0.0; system.dofs().len()];
        Ok(Self { matrix: SystemMatrix::try_zeros(pattern)?, residual: zeros(), scaled: zeros(), factor: 1.0 })
    }

    /// Takes over a right-hand side.
    fn scale(&mut self, b: &[f64]) {
        self.factor = scaling(b);
        for (scaled, b) in self.scaled.iter_mut().zip(b) {
            *scaled = b * self.factor;
        }
    }

    /// Gives the solution for the scaled right-hand side the size of that for the one taken over.
    fn unscale(&self, x: &mut [f64]) {
        if self.factor != 1.0 {
            x.iter_mut().for_each(|x| *x /= self.factor);
        }
    }

    /// `r = b − A x` with the matrix-free product, which shares no entry of the assembled matrix.
    fn set_residual(&mut self, a: &SystemOperator, x: &[f64]) {
        a.apply(x, &mut self.residual);
        for (r, b) in self.residual.iter_mut().zip(&self.scaled) {
            *r = b - *r;
        }
    }

    fn solution(&self) -> Result<Solution, SolveFailure> {
        let residual = norm(&self.residual);
        let relative_residual = if residual == 0.0 { 0.0 } else { residual / norm(&self.scaled) };
        if relative_residual.is_finite() { Ok(Solution { relative_residual }) } else { Err(SolveFailure::NonFinite) }
    }
}

/// A sparse Cholesky factorization of which only is known what it takes at least, from a first ordering: a small part of the analysis.
pub struct CholeskyEstimate {
    pattern: Arc<SpringPattern>,
    glance: OrderingEstimate,
}

impl CholeskyEstimate {
    /// Orders the system's particles; counts one symbolic factorization, whether the analysis follows or not.
    ///
    /// # Errors
    /// When the matrix does not fit 32-bit indices, or its ordering the memory.
    pub fn new(system: &System, work: &mut Work) -> Result<Self> {
        work.symbolic_factorizations += 1;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let glance = Analysis::glance(pattern.pattern())?;
        Ok(Self { pattern, glance })
    }

    /// Entries and operations of the factor, at least. Where a nested dissection may gain, which is tried in the analysis, as if it gained
    /// as much as it ever does.
    pub fn least(&self) -> FactorSize {
        FactorSize::least(&self.glance)
    }

    /// Analyses the pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices, or its analysis the memory.
    pub fn plan(self, par: Par) -> Result<CholeskyPlan> {
        let Self { pattern, glance } = self;
        // The glance may be old, and memory taken since.
        Analysis::ensure_room(pattern.pattern())?;
        let factorization = Cholesky::plan(pattern.pattern(), glance, par)?;
        Ok(CholeskyPlan { pattern, factorization })
    }
}

/// A sparse Cholesky factorization that is known but has no memory yet: what it would take can be asked.
pub struct CholeskyPlan {
    pattern: Arc<SpringPattern>,
    factorization: Cholesky,
}

impl CholeskyPlan {
    /// Analyses the system's pattern and counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices, or its analysis the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        CholeskyEstimate::new(system, work)?.plan(par)
    }

    /// Entries and operations of the factor.
    pub fn size(&self) -> FactorSize {
        self.factorization.size()
    }

    /// Size, and times so far.
    pub fn report(&self) -> FactorReport {
        self.factorization.report()
    }

    /// Bytes that the factor, its work space and the matrix take.
    pub fn bytes(&self) -> u64 {
        self.factorization.bytes() + 8 * self.pattern.pattern().entries() as u64
    }

    /// The solver, with its memory.
    ///
    /// # Errors
    /// [`Error::TooLarge`](crate::Error::TooLarge) when the factor does not fit the memory.
    pub fn solver(mut self, system: &System) -> Result<CholeskySolver> {
        self.factorization.allocate()?;
        Ok(CholeskySolver { assembled: Assembled::new(system, self.pattern)?, factorization: self.factorization })
    }
}

/// Sparse Cholesky.
pub struct CholeskySolver {
    assembled: Assembled,
    factorization: Cholesky,
}

impl CholeskySolver {
    /// Analyses the system's pattern; counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        CholeskyPlan::new(system, par, work)?.solver(system)
    }

    /// Entries and operations of the factor.
    pub fn size(&self) -> FactorSize {
        self.factorization.size()
    }
}

impl LinearSolver for CholeskySolver {
    fn name(&self) -> &'static str {
        "llt"
    }

    fn factor(&self) -> Option<FactorReport> {
        Some(self.factorization.report())
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.assembled.matrix.refill(a);
        work.factorizations += 1;
        match self.factorization.factor(self.assembled.matrix.matrix()) {
            Ok(()) => Ok(Definiteness::Positive),
            Err(pivot) => Err(refused(&self.assembled.matrix, pivot)),
        }
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        work.solves += 1;
        self.assembled.scale(b);
        x.copy_from_slice(&self.assembled.scaled);
        self.factorization.substitute(x);
        self.assembled.set_residual(&a, x);
        self.assembled.unscale(x);
        self.assembled.solution()
    }
}

/// Sparse LDLᵀ; accepts an indefinite A, refines, and refuses solutions whose backward error stays large.
pub struct LdltSolver {
    assembled: Assembled,
    factorization: Ldlt,
    correction: Vec<f64>,
    matrix_norm: f64,
}

impl LdltSolver {
    /// Analyses the system's pattern; counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        let assembled = Assembled::new(system, Arc::new(SpringPattern::of_stiffness(system)?))?;
        let factorization = Ldlt::analyse(assembled.matrix.matrix().pattern(), par)?;
        work.symbolic_factorizations += 1;
        let correction = vec![0.0; system.dofs().len()];
        Ok(Self { assembled, factorization, correction, matrix_norm: 0.0 })
    }
}

impl LinearSolver for LdltSolver {
    fn name(&self) -> &'static str {
        "ldlt"
    }

    fn factor(&self) -> Option<FactorReport> {
        Some(self.factorization.report())
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.assembled.matrix.refill(a);
        self.matrix_norm = self.assembled.matrix.matrix().norm_inf(&mut self.correction);
        work.factorizations += 1;
        let matrix = self.assembled.matrix.matrix();
        self.factorization.factor(matrix).map_err(|pivot| refused(&self.assembled.matrix, pivot))?;
        let mut negative = self.factorization.pivots().filter(|&(_, d)| d < 0.0);
        Ok(match negative.next() {
            None => Definiteness::Positive,
            Some((row, _)) => Definiteness::Indefinite { negative: 1 + negative.count(), dof: matrix.dofs().dof(row) },
        })
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        work.solves += 1;
        self.assembled.scale(b);
        x.copy_from_slice(&self.assembled.scaled);
        self.factorization.substitute(x);
        self.assembled.set_residual(&a, x);
        let error_of =
            |assembled: &Assembled, norm, x: &[f64]| backward_error(&assembled.residual, norm, x, &assembled.scaled);
        let mut error = error_of(&self.assembled, self.matrix_norm, x);
        for _ in 0..REFINEMENTS {
            if error <= TRUSTED_BACKWARD_ERROR {
                break;
            }
            self.correction.copy_from_slice(&self.assembled.residual);
            self.factorization.substitute(&mut self.correction);
            for (x, c) in x.iter_mut().zip(&self.correction) {
                *x += c;
            }
            self.assembled.set_residual(&a, x);
            error = error_of(&self.assembled, self.matrix_norm, x);
        }
        self.assembled.unscale(x);
        let solution = self.assembled.solution()?;
        if error <= TRUSTED_BACKWARD_ERROR {
            Ok(solution)
        } else {
            Err(SolveFailure::Untrusted { backward_error: error })
        }
    }
}

/// A refused pivot means an indefinite matrix only if the matrix is finite.
fn refused(matrix: &SystemMatrix, pivot: NonPositivePivot) -> SolveFailure {
    if matrix.matrix().values().iter().all(|value| value.is_finite()) {
        SolveFailure::Indefinite(Evidence::Pivot(pivot.dof))
    } else {
        SolveFailure::NonFinite
    }
}

#[cfg(test)]
mod tests;
