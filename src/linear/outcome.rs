//! Outcomes of updates and solves.

use crate::system::Dof;

/// The definiteness of a matrix, as far as preparing a solver has proved it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Definiteness {
    /// A Cholesky factorization exists, or all pivots of LDLᵀ are positive: positive definite to rounding.
    Positive,
    /// LDLᵀ has this many negative pivots.
    Indefinite {
        /// Number of negative pivots; by Sylvester's law the number of negative eigenvalues.
        negative: usize,
        /// A coordinate whose pivot is negative.
        dof: Dof,
    },
    /// Not examined: conjugate gradients may still meet negative curvature.
    Unknown,
}

/// A solution that the solver vouches for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// `‖b − A x‖/‖b‖`, recomputed from x with the matrix-free product; zero for b = 0.
    pub relative_residual: f64,
}

/// The result of a solve.
pub type Solved = Result<Solution, SolveFailure>;

/// The failure of a solve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveFailure {
    /// A is not positive definite.
    #[error("the system matrix is not positive definite: {0}")]
    Indefinite(Evidence),
    /// Conjugate gradients did not reach the tolerance.
    #[error(
        "conjugate gradients {reason} after {iterations} iterations at a relative residual of {relative_residual:.3e}"
    )]
    NotConverged {
        /// Iterations done.
        iterations: u64,
        /// The true relative residual at the end.
        relative_residual: f64,
        /// The reason.
        reason: NotConverged,
    },
    /// The factorization of an indefinite matrix lost too many digits.
    #[error("the LDLᵀ solution cannot be trusted: its backward error is {backward_error:.3e}")]
    Untrusted {
        /// `‖b − A x‖/(‖A‖‖x‖ + ‖b‖)` in the maximum norm, after refinement.
        backward_error: f64,
    },
    /// The matrix, the right-hand side or the solution has an infinite or undefined entry.
    #[error("the linear system has entries that are not finite")]
    NonFinite,
    /// The solver has no matrix: none was prepared, or the last one failed.
    #[error("no matrix is prepared")]
    Unprepared,
    /// A right-hand side or a solution does not have one number for every row.
    #[error("a vector of {found} entries for a matrix of {expected} rows")]
    WrongLength {
        /// Rows of the matrix.
        expected: usize,
        /// Entries of the vector.
        found: usize,
    },
    /// A stop was requested.
    #[error("interrupted")]
    Interrupted,
}

/// The evidence that A is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Evidence {
    /// A factorization met a pivot that is not positive at this coordinate.
    #[error("the pivot of {0} is not positive")]
    Pivot(Dof),
    /// The diagonal block of a particle, seen when the preconditioner was set up, is not positive definite.
    #[error("the diagonal block at {0} is not positive definite")]
    DiagonalBlock(Dof),
    /// A coarse matrix of multigrid, `Pᵀ A P`, is not positive definite.
    #[error("coarse level {level} of multigrid is not positive definite near {dof}")]
    CoarseLevel {
        /// The level, from 1.
        level: usize,
        /// A coordinate of a particle in the aggregate at which it showed.
        dof: Dof,
    },
    /// Conjugate gradients met a direction p with `pᵀAp ≤ 0`.
    #[error(
        "conjugate gradients met negative curvature in iteration {iteration}, pᵀAp/pᵀp = {rayleigh_quotient:.3e} N/m"
    )]
    NegativeCurvature {
        /// Iteration in which it was met, from 0.
        iteration: u64,
        /// `pᵀAp/pᵀp`, in N/m.
        rayleigh_quotient: f64,
    },
    /// As above, by another library that does not return the direction.
    #[error("conjugate gradients met negative curvature in iteration {iteration}")]
    Curvature {
        /// Iteration in which it was met, from 0.
        iteration: u64,
    },
    /// Reported by a solver without details.
    #[error("the solver found it so")]
    Reported,
}

impl SolveFailure {
    /// Returned by a custom solver for a matrix that is not positive definite, so that [`OnDemand`](crate::integrate::StiffnessPolicy::OnDemand) goes
    /// on with a regularized one.
    pub const INDEFINITE: Self = Self::Indefinite(Evidence::Reported);
}

/// The reason why conjugate gradients ended above the tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotConverged {
    /// Rounding keeps the true residual from falling.
    #[error("stagnated")]
    Stagnated,
    /// The iteration limit.
    #[error("reached its iteration limit")]
    IterationLimit,
    /// The preconditioner is not positive definite, or could not be set up.
    #[error("were given a preconditioner that failed")]
    Preconditioner,
}
