//! Choosing a solver.

use super::{CgSolver, CholeskySolver, LdltSolver, LinearSolver, PreconditionerKind};
use crate::error::Result;
use crate::system::System;
use crate::work::Work;
use faer::Par;

/// Which linear solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SolverChoice {
    /// By size and by what the option promises about definiteness, see [`select`].
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverOptions {
    /// Which.
    pub solver: SolverChoice,
    /// For conjugate gradients; `None` chooses, see [`CgSolver::matrix_free`].
    pub preconditioner: Option<PreconditionerKind>,
    /// For conjugate gradients: `‖b − A x‖ ≤ tolerance·‖b‖`.
    pub tolerance: f64,
    /// Parallelism of the factorizations.
    pub par: Par,
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self { solver: SolverChoice::Auto, preconditioner: None, tolerance: 1e-10, par: Par::Seq }
    }
}

/// Factor operations per spring up to which `Auto` factors: about what conjugate gradients with multigrid cost, which is
/// proportional to the number of springs. Cloths of 10⁴ particles (3e4 per spring) are near the border; those of 10⁵
/// (1.3e5) and lattices of 10⁴ (1.3e6) iterate faster than they factor.
const FLOPS_PER_SPRING: f64 = 3e4;

/// Where an option does not promise a definite A, a factorization is worth ten times as much: it alone refuses.
const FLOPS_PER_SPRING_UNPROMISED: f64 = 3e5;

/// Degrees of freedom beyond which `Auto` does not even analyse: the analysis alone would take seconds.
const LARGEST_ANALYSED: usize = 1_500_000;

/// Makes the solver. `Auto` takes sparse Cholesky up to a cost per spring, beyond it matrix-free conjugate gradients.
/// `promised` says whether the stiffness option keeps A positive definite; where it does not, Cholesky is preferred
/// for longer, because it proves definiteness while conjugate gradients may pass over an indefinite A.
///
/// # Errors
/// When the matrix or its factor is too large.
pub fn select(
    system: &System,
    options: &SolverOptions,
    promised: bool,
    work: &mut Work,
) -> Result<Box<dyn LinearSolver>> {
    let preconditioner = options.preconditioner;
    let matrix_free = || CgSolver::matrix_free(system, preconditioner, options.tolerance).map(Box::new);
    Ok(match options.solver {
        SolverChoice::Llt => Box::new(CholeskySolver::new(system, options.par, work)?),
        SolverChoice::Ldlt => Box::new(LdltSolver::new(system, options.par, work)?),
        SolverChoice::Cg => matrix_free()?,
        SolverChoice::CgAssembled => Box::new(CgSolver::assembled(system, preconditioner, options.tolerance)?),
        SolverChoice::Auto if system.dofs().len() > LARGEST_ANALYSED => matrix_free()?,
        SolverChoice::Auto => {
            let cholesky = CholeskySolver::new(system, options.par, work)?;
            let springs = system.active_springs().len().max(1);
            let limit = if promised { FLOPS_PER_SPRING } else { FLOPS_PER_SPRING_UNPROMISED };
            if cholesky.size().flops <= limit * springs as f64 { Box::new(cholesky) } else { matrix_free()? }
        }
    })
}
