//! Options of linear solvers.

use crate::error::{Invalid, Result};
use crate::interrupt::Interrupt;
use faer::Par;

/// A linear solver by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SolverChoice {
    /// By size, the [guarantee](DefinitenessGuarantee) of the stiffness option and counted effort, see [`select`](super::select).
    Auto,
    /// Sparse Cholesky.
    Llt,
    /// Sparse LDLᵀ.
    Ldlt,
    /// Matrix-free conjugate gradients.
    Cg,
    /// Conjugate gradients on the assembled matrix.
    CgAssembled,
}

impl SolverChoice {
    /// Every choice.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Llt, Self::Ldlt, Self::Cg, Self::CgAssembled];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Llt => "llt",
            Self::Ldlt => "ldlt",
            Self::Cg => "cg",
            Self::CgAssembled => "cg-assembled",
        }
    }
}

/// A preconditioner by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PreconditionerKind {
    /// The identity.
    None,
    /// The diagonal of A.
    Jacobi,
    /// The 3×3 diagonal block of every particle.
    BlockJacobi,
    /// Algebraic multigrid, see [`multigrid`](crate::multigrid).
    Multigrid,
}

impl PreconditionerKind {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::None, Self::Jacobi, Self::BlockJacobi, Self::Multigrid];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Jacobi => "jacobi",
            Self::BlockJacobi => "block-jacobi",
            Self::Multigrid => "multigrid",
        }
    }
}

/// The relative residual to which iterative methods solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// `‖b − A x‖ ≤ tolerance·‖b‖`.
    Fixed(f64),
    /// A ten-thousandth of the error in time of a step, but at least [`STRICT`](Self::STRICT), which is used where a stepper has no error estimate.
    Adaptive,
}

impl Tolerance {
    /// The default, which makes solvers comparable digit by digit.
    pub const STRICT: f64 = 1e-10;

    /// The smallest relative residual in use.
    pub fn strictest(self) -> f64 {
        match self {
            Self::Fixed(tolerance) => tolerance,
            Self::Adaptive => Self::STRICT,
        }
    }

    /// Checks the range of the tolerance.
    ///
    /// # Errors
    /// [`Invalid`] for a tolerance that does not lie between 0 and 1.
    pub fn check(self) -> Result<(), Invalid> {
        let strictest = self.strictest();
        if strictest > 0.0 && strictest < 1.0 {
            return Ok(());
        }
        Err(Invalid::new("tolerance", strictest, "must lie between 0 and 1"))
    }
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::Fixed(Self::STRICT)
    }
}

/// A linear solver and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverOptions {
    /// The solver.
    pub solver: SolverChoice,
    /// The preconditioner of conjugate gradients; `None` chooses by counted effort.
    pub preconditioner: Option<PreconditionerKind>,
    /// The tolerance of conjugate gradients.
    pub tolerance: Tolerance,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// Ends iterations when requested.
    pub interrupt: Interrupt,
}

impl SolverOptions {
    /// With this solver.
    #[must_use]
    pub fn with_solver(self, solver: SolverChoice) -> Self {
        Self { solver, ..self }
    }

    /// With this preconditioner of conjugate gradients.
    #[must_use]
    pub fn with_preconditioner(self, preconditioner: PreconditionerKind) -> Self {
        Self { preconditioner: Some(preconditioner), ..self }
    }

    /// With conjugate gradients that stop at `‖b − A x‖ ≤ tolerance·‖b‖`.
    ///
    /// # Errors
    /// [`Invalid`] for a tolerance that does not lie between 0 and 1.
    pub fn with_tolerance(self, tolerance: f64) -> Result<Self, Invalid> {
        let tolerance = Tolerance::Fixed(tolerance);
        tolerance.check()?;
        Ok(Self { tolerance, ..self })
    }
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self {
            solver: SolverChoice::Auto,
            preconditioner: None,
            tolerance: Tolerance::default(),
            par: Par::Seq,
            interrupt: Interrupt::NEVER,
        }
    }
}

/// The definiteness of A under a stiffness option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefinitenessGuarantee {
    /// Positive definite in every state.
    Definite,
    /// Replaced by a definite matrix once it is found to be indefinite, which a factorization can tell.
    RegularizedDefinite,
    /// None.
    Unknown,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_lie_between_zero_and_one() {
        let fine = [1e-300, f64::MIN_POSITIVE, 0.999, 1.0 - f64::EPSILON].map(|tolerance| (tolerance, true));
        let wrong = [0.0, 1.0, -1e-3, 2.0, f64::NAN, f64::INFINITY].map(|tolerance| (tolerance, false));
        for (tolerance, is_fine) in fine.into_iter().chain(wrong) {
            assert_eq!(Tolerance::Fixed(tolerance).check().is_ok(), is_fine, "{tolerance}");
            let options = SolverOptions::default().with_tolerance(tolerance).ok().map(|options| options.tolerance);
            assert_eq!(options, is_fine.then_some(Tolerance::Fixed(tolerance)), "{tolerance}");
        }
        assert!(Tolerance::Adaptive.check().is_ok());
    }
}
