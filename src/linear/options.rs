//! Options of linear solvers.

use super::{PreconditionerKind, Tolerance};
use crate::error::{Invalid, Result};
use crate::interrupt::Interrupt;
use faer::Par;

/// Which linear solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SolverChoice {
    /// By size, by what the option promises about definiteness, and by counted effort, see [`select`](super::select).
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

/// Which linear solver, and how.
///
/// # Examples
/// ```
/// use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
///
/// let options = SolverOptions::default()
///     .with_solver(SolverChoice::CgAssembled)
///     .with_preconditioner(PreconditionerKind::Multigrid)
///     .with_tolerance(1e-8)?;
/// assert_eq!(options.solver.name(), "cg-assembled");
/// assert!(options.with_tolerance(0.0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverOptions {
    /// Which.
    pub solver: SolverChoice,
    /// For conjugate gradients; `None` chooses, by counted effort.
    pub preconditioner: Option<PreconditionerKind>,
    /// For conjugate gradients.
    pub tolerance: Tolerance,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// When to give up: iterations look at it.
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

/// What a stiffness option says about the definiteness of A.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefinitenessGuarantee {
    /// Positive definite, whatever the state.
    Definite,
    /// Replaced by one that is where it is found not to be: a solver that finds out is worth something.
    RegularizedDefinite,
    /// Nothing.
    Unknown,
}
