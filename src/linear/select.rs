//! Choosing a solver.

use super::automatic::{AutomaticSolver, LARGEST_ANALYSED, fits};
use super::{
    Application, CgSolver, CholeskyGlance, CholeskySolver, FactorSize, LdltSolver, LinearSolver, PreconditionerKind,
    Tolerance,
};
use crate::error::{Invalid, Result};
use crate::interrupt::Interrupt;
use crate::system::System;
use crate::work::Work;
use faer::Par;

/// Which linear solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SolverChoice {
    /// By size, by what the option promises about definiteness, and by counted effort, see [`select`].
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
pub enum Assurance {
    /// Positive definite, whatever the state.
    Definite,
    /// Replaced by one that is where it is found not to be: a solver that finds out is worth something.
    MadeDefinite,
    /// Nothing.
    Unknown,
}

/// Factor operations per spring up to which a matrix of which nothing is known is factored: a factorization finds out whether it is
/// definite, conjugate gradients only may.
const WORTH_PROVING: f64 = 3e5;

/// Degrees of freedom up to which `Auto` always factors: that takes about as long as a solve by conjugate gradients.
const SMALL: usize = 60;

/// Makes the solver. `Auto` factors what is small, or where a proof of definiteness is worth it, and what fits half of the memory;
/// elsewhere conjugate gradients with block Jacobi, with multigrid, or a factorization solve, whichever turns out to cost less: a matrix
/// takes at most about twice the effort that it takes the best of them.
///
/// # Errors
/// When the matrix or its factor is too large.
pub fn select(
    system: &System,
    options: &SolverOptions,
    assurance: Assurance,
    work: &mut Work,
) -> Result<Box<dyn LinearSolver>> {
    let dofs = system.dofs().len();
    let iterative = |application, factors| -> Result<Box<dyn LinearSolver>> {
        Ok(match options.preconditioner {
            Some(kind) => {
                let solver = CgSolver::new(system, kind, options.tolerance.strictest(), application)?;
                Box::new(solver.interrupted_by(options.interrupt))
            }
            None => Box::new(AutomaticSolver::new(system, options, application, factors)?),
        })
    };
    Ok(match options.solver {
        SolverChoice::Llt => Box::new(CholeskySolver::new(system, options.par, work)?),
        SolverChoice::Ldlt => Box::new(LdltSolver::new(system, options.par, work)?),
        SolverChoice::Cg => iterative(Application::MatrixFree, false)?,
        SolverChoice::CgAssembled => iterative(Application::assembled(system)?, false)?,
        SolverChoice::Auto if dofs <= SMALL => Box::new(CholeskySolver::new(system, options.par, work)?),
        SolverChoice::Auto if assurance == Assurance::Unknown => {
            let springs = system.active_springs().len().max(1) as f64;
            let is_worth = |size: FactorSize| size.flops <= WORTH_PROVING * springs;
            let glance = if dofs <= LARGEST_ANALYSED { CholeskyGlance::new(system, work).ok() } else { None };
            let plan =
                glance.filter(|glance| is_worth(glance.least())).and_then(|glance| glance.plan(options.par).ok());
            match plan.filter(|plan| is_worth(plan.size()) && fits(plan.bytes())).map(|plan| plan.solver(system)) {
                Some(Ok(direct)) => Box::new(direct),
                _ => iterative(Application::MatrixFree, false)?,
            }
        }
        SolverChoice::Auto => iterative(Application::MatrixFree, true)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::SystemBuilder;
    use nalgebra::Vector3;

    #[test]
    fn tolerances_lie_between_zero_and_one() {
        let set = |tolerance: f64| SolverOptions::default().with_tolerance(tolerance).map(|options| options.tolerance);
        for tolerance in [f64::MIN_POSITIVE, 1e-3, 1.0 - f64::EPSILON] {
            assert_eq!(set(tolerance), Ok(Tolerance::Fixed(tolerance)));
        }
        for tolerance in [0.0, 1.0, -1e-3, 2.0, f64::NAN, f64::INFINITY] {
            assert!(set(tolerance).is_err(), "{tolerance}");
        }
        assert!(Tolerance::OfMotion.check().is_ok());
    }

    /// Half a million free particles are the most that are ordered; one more, and the matrix is not even looked at, whatever is known of it.
    #[test]
    fn what_is_too_large_is_not_analysed() {
        let system = |particles: usize| {
            let mut builder = SystemBuilder::new();
            builder.positions = vec![Vector3::zeros(); particles];
            builder.velocities = builder.positions.clone();
            builder.masses = vec![1.0; particles];
            builder.build().unwrap().0
        };
        let chosen = |system: &System, assurance| {
            let mut work = Work::default();
            let solver = select(system, &SolverOptions::default(), assurance, &mut work).unwrap();
            (solver.name(), work.symbolic_factorizations, solver.choice().is_some())
        };
        let (large, too_large) = (system(500_000), system(500_001));
        assert_eq!(chosen(&large, Assurance::Unknown), ("cg", 1, true));
        for assurance in [Assurance::Definite, Assurance::MadeDefinite, Assurance::Unknown] {
            assert_eq!(chosen(&too_large, assurance), ("cg", 0, true));
        }
        // Of what is sure or made to be definite factorizations are looked at only when they may pay.
        for assurance in [Assurance::Definite, Assurance::MadeDefinite] {
            assert_eq!(chosen(&large, assurance), ("cg", 0, true));
        }
    }

    /// Of a cloth of 20² particles a proof of definiteness is worth some million operations, 300 000 a spring.
    #[cfg(feature = "scene")]
    #[test]
    fn proofs_are_worth_their_operations() {
        let (system, _) = crate::scene::builtin::cloth(20).unwrap().build().unwrap();
        let mut work = Work::default();
        let solver = select(&system, &SolverOptions::default(), Assurance::Unknown, &mut work).unwrap();
        let flops = solver.factor().unwrap().size.flops;
        assert!(flops > 4e5 && flops < WORTH_PROVING * system.springs().len() as f64, "{flops}");
        assert_eq!((solver.name(), work.symbolic_factorizations), ("llt", 1));
    }
}
