//! Linear solvers for symmetric sparse systems `A x = b`.
//!
//! A time step uses a [`LinearSolver`]: it is updated for a [`SystemOperator`] and then solves any number of right-hand sides. [`CgSolver`],
//! [`CholeskySolver`] and [`LdltSolver`] implement the trait, and [`select`] creates the one that [`SolverOptions`] ask for. The default, `auto`,
//! chooses by cost between a Cholesky factorization and conjugate gradients.
//!
//! The methods themselves, [`ConjugateGradient`], [`Cholesky`] and [`Ldlt`], work without a time step on any
//! [`LinearOperator`](crate::operator::LinearOperator) or [`SymmetricMatrix`](crate::assembly::SymmetricMatrix).
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `solvers`.

mod analysis;
mod automatic;
mod block_jacobi;
mod bunch_kaufman;
mod certificate;
mod cg;
mod cg_solver;
mod cost;
mod direct;
mod factorization;
mod lagged_multigrid;
mod options;
mod ordering;
mod outcome;
mod preconditioner;
mod prepared;
mod substitution;
mod vector;

pub use analysis::{FactorReport, FactorTimes, NonPositivePivot, SOLVE_COLUMNS};
pub use automatic::select;
pub use block_jacobi::{BlockJacobi, DiagonalPart, NotPositiveBlock};
pub use bunch_kaufman::{BunchKaufman, PivotSigns, PivotedLdlt, Pivoting};
pub use cg::{CgOutcome, CgReport, ConjugateGradient};
pub use cg_solver::{CgSolver, WarmStart};
pub use cost::CostModel;
pub use direct::{CholeskyPlan, CholeskySolver, LdltSolver};
pub use factorization::{Cholesky, FactorKind, Factorization, Ldl, Ldlt, Llt, NotFactored, SolvingKind};
pub use lagged_multigrid::LaggedMultigrid;
pub use options::{DefinitenessGuarantee, PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
pub use ordering::{FactorSize, OrderingMethod};
pub use outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure, Solved};
pub use preconditioner::{CustomPreconditioner, Preconditioner};
pub use prepared::{MatrixAndSolver, Prepare, Prepared, PreparedMatrix};
pub use vector::{backward_error, dot, norm};

use crate::operator::SystemOperator;
use crate::work::Work;
use nalgebra::Vector3;

/// Solves `A x = b` for a sequence of matrices of one system. The example `own_solver` hands a custom solver to a stepper by `with_solver`.
pub trait LinearSolver: Send {
    /// The solver's name on the command line and in files.
    fn name(&self) -> &'static str;

    /// The preconditioner's name, if there is one.
    fn preconditioner(&self) -> Option<&'static str> {
        None
    }

    /// Size and times of the factorization, if there is one.
    fn factor(&self) -> Option<FactorReport> {
        None
    }

    /// The reason for the method in use, for a solver that chooses.
    fn choice(&self) -> Option<String> {
        None
    }

    /// Sets the positions of all particles, in m, which a preconditioner may use.
    fn set_positions(&mut self, _positions: &[Vector3<f64>]) {}

    /// Factors a matrix, or sets up its preconditioner, and returns what this proves. Call [`prepare`](Prepare::prepare), whose result solves.
    ///
    /// # Errors
    /// A matrix that is found not to be positive definite by a solver that needs it, or not finite.
    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure>;

    /// Sets the tolerance of an iterative solver, `‖b − A x‖ ≤ tolerance·‖b‖`.
    fn set_tolerance(&mut self, _tolerance: f64) {}

    /// Solves with the matrix of the last update. `b` and `x` are reduced; on entry `x` is the first guess of an iterative solver, or zero to let it
    /// choose its own.
    ///
    /// # Errors
    /// A solution that does not meet the tolerance; `x` is then unspecified.
    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved;

    /// Solves from zero to `‖b − A x‖ ≤ tolerance·‖b‖` without a trace: later solves must not depend on it. The default suits solvers without a
    /// tolerance that keep nothing between solves.
    ///
    /// # Errors
    /// As for [`solve`](Self::solve).
    fn solve_aside(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], _tolerance: f64, work: &mut Work) -> Solved {
        x.fill(0.0);
        self.solve(a, b, x, work)
    }
}

#[cfg(test)]
pub(crate) mod fixtures;
