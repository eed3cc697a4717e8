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
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Evidence {
    /// A factorization met a pivot that is not positive at this coordinate.
    Pivot(Dof),
    /// The diagonal block of a particle, seen when the preconditioner was set up, is not positive definite.
    DiagonalBlock(Dof),
    /// A coarse matrix of multigrid, `Pᵀ A P`, is not positive definite.
    CoarseLevel {
        /// The level, from 1.
        level: usize,
        /// A coordinate of a particle in the aggregate at which it showed.
        dof: Dof,
    },
    /// Conjugate gradients met a direction p with `pᵀAp ≤ 0`.
    NegativeCurvature {
        /// Iteration in which it was met, from 0.
        iteration: u64,
        /// `pᵀAp/pᵀp`, in N/m.
        rayleigh_quotient: f64,
    },
    /// As above, by another library that does not return the direction.
    Curvature {
        /// Iteration in which it was met, from 0.
        iteration: u64,
    },
    /// Reported by a solver without details.
    Reported,
}

impl SolveFailure {
    /// Returned by a custom solver for a matrix that is not positive definite, so that
    /// [`OnDemand`](crate::integrate::StiffnessPolicy::OnDemand) goes on with a regularized one.
    pub const INDEFINITE: Self = Self::Indefinite(Evidence::Reported);
}

impl std::fmt::Display for Evidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Pivot(dof) => write!(f, "the pivot of {dof} is not positive"),
            Self::DiagonalBlock(dof) => write!(f, "the diagonal block at {dof} is not positive definite"),
            Self::CoarseLevel { level, dof } => {
                write!(f, "coarse level {level} of multigrid is not positive definite near {dof}")
            }
            Self::Reported => f.write_str("the solver found it so"),
            Self::Curvature { iteration } => {
                write!(f, "conjugate gradients met negative curvature in iteration {iteration}")
            }
            Self::NegativeCurvature { iteration, rayleigh_quotient } => {
                write!(
                    f,
                    "conjugate gradients met negative curvature in iteration {iteration}, pᵀAp/pᵀp = {rayleigh_quotient:.3e} N/m"
                )
            }
        }
    }
}

/// The reason why conjugate gradients ended above the tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NotConverged {
    /// Rounding keeps the true residual from falling.
    Stagnated,
    /// The iteration limit.
    IterationLimit,
    /// The preconditioner is not positive definite, or could not be set up.
    Preconditioner,
}

impl std::fmt::Display for NotConverged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Stagnated => "stagnated",
            Self::IterationLimit => "reached its iteration limit",
            Self::Preconditioner => "were given a preconditioner that failed",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_what_stopped_conjugate_gradients() {
        let message =
            |reason| SolveFailure::NotConverged { iterations: 7, relative_residual: 1.25e-3, reason }.to_string();
        let end = "after 7 iterations at a relative residual of 1.250e-3";
        assert_eq!(message(NotConverged::Stagnated), format!("conjugate gradients stagnated {end}"));
        let expected = format!("conjugate gradients reached its iteration limit {end}");
        assert_eq!(message(NotConverged::IterationLimit), expected);
    }
}
