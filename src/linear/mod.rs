//! Linear solvers: conjugate gradients and sparse factorizations behind one trait.
//!
//! [`Cholesky`], [`Ldlt`] and [`ConjugateGradient`] work on any [`SymmetricMatrix`](crate::assembly::SymmetricMatrix) or
//! [`LinearOperator`](crate::operator::LinearOperator). [`LinearSolver`] is what a time step uses: it takes a
//! [`SystemOperator`], does once a matrix what can be done once, and solves as often as asked.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `solvers`.

mod analysis;
mod automatic;
mod block_jacobi;
mod cg;
mod cost;
mod direct;
mod factorization;
#[cfg(test)]
pub(crate) mod fixtures;
mod iterative;
mod lagged_multigrid;
mod norms;
mod options;
mod ordering;
mod outcome;
mod pivoted;
mod preconditioner;
mod preconditioner_kind;
mod prepared;
mod select;
mod substitution;
mod supernode;
mod tolerance;
mod vector;
mod warm_start;

pub use analysis::{FactorReport, FactorSize, FactorTimes, NonPositivePivot, SOLVE_COLUMNS};
pub use block_jacobi::{BlockJacobi, DiagonalPart, NotPositiveBlock};
pub use cg::{CgOutcome, CgReport, ConjugateGradient};
pub use cost::CostModel;
pub use direct::{CholeskyEstimate, CholeskyPlan, CholeskySolver, LdltSolver};
pub use factorization::{Cholesky, FactorKind, Factorization, Ldl, Ldlt, Llt, NotFactored, SolvingKind};
pub use iterative::{Application, CgSolver};
pub use lagged_multigrid::LaggedMultigrid;
pub use norms::{backward_error, dot, norm};
pub use options::{DefinitenessGuarantee, SolverChoice, SolverOptions};
pub use ordering::OrderingMethod;
pub use outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure};
pub use pivoted::{BunchKaufman, PivotSigns, PivotedLdlt, Pivoting};
pub use preconditioner::{CustomPreconditioner, Preconditioner};
pub use preconditioner_kind::PreconditionerKind;
pub use prepared::{Held, MatrixAndSolver, Prepare, Prepared};
pub use select::select;
pub use tolerance::Tolerance;
pub use warm_start::WarmStart;

use crate::operator::SystemOperator;
use crate::work::Work;
use nalgebra::Vector3;

/// Solves `A x = b` for a sequence of matrices of one system.
///
/// A solver of your own is handed to a stepper by its `with_solver`, as the example `own_solver` does.
pub trait LinearSolver: Send {
    /// The solver's name on the command line and in files.
    fn name(&self) -> &'static str;

    /// The preconditioner's name, for a solver that has one.
    fn preconditioner(&self) -> Option<&'static str> {
        None
    }

    /// Size and times of the factorization, for a solver that factors.
    fn factor(&self) -> Option<FactorReport> {
        None
    }

    /// Why this solver, in words, for one that chooses.
    fn choice(&self) -> Option<String> {
        None
    }

    /// Says where the particles are, one position for every particle of the system, in m. A preconditioner may use it; the
    /// matrix has all that a solution needs.
    fn place(&mut self, _positions: &[Vector3<f64>]) {}

    /// Takes over a matrix: refills and factors it, or sets up the preconditioner. Says what this proved. Call
    /// [`prepare`](Prepare::prepare), whose result solves.
    ///
    /// # Errors
    /// When the matrix is found not to be positive definite by a solver that needs it, or not finite.
    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure>;

    /// How exactly an iterative solver is to solve from now on, `‖b − A x‖ ≤ tolerance·‖b‖`; others have no use for it.
    fn set_tolerance(&mut self, _tolerance: f64) {}

    /// Solves with the matrix taken over last. `b` and `x` are reduced; on entry `x` is the first guess of an iterative
    /// solver, or zero where it shall find its own.
    ///
    /// # Errors
    /// When no solution can be vouched for; `x` is then unspecified.
    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure>;

    /// Solves as [`solve`](Self::solve) does, from zero and only to `‖b − A x‖ ≤ tolerance·‖b‖`, and keeps nothing of it: no later solve may depend
    /// on it. Errors are propagated so. A solver that keeps something from one solve to the next, or has a tolerance, needs one of its own.
    ///
    /// # Errors
    /// As of [`solve`](Self::solve).
    fn solve_aside(
        &mut self,
        a: Held<'_>,
        b: &[f64],
        x: &mut [f64],
        _tolerance: f64,
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        x.fill(0.0);
        self.solve(a, b, x, work)
    }
}
