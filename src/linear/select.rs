//! Choosing a solver.

use super::automatic::{AutomaticSolver, LARGEST_ANALYSED, fits};
use super::options::{DefinitenessGuarantee, SolverChoice, SolverOptions};
use super::{Application, CgSolver, CholeskyEstimate, CholeskySolver, FactorSize, LdltSolver, LinearSolver};
use crate::error::Result;
use crate::system::System;
use crate::work::Work;

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
    assurance: DefinitenessGuarantee,
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
        SolverChoice::Auto if assurance == DefinitenessGuarantee::Unknown => {
            let springs = system.active_springs().len().max(1) as f64;
            let is_worth = |size: FactorSize| size.flops <= WORTH_PROVING * springs;
            let glance = if dofs <= LARGEST_ANALYSED { CholeskyEstimate::new(system, work).ok() } else { None };
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
    use crate::linear::Tolerance;
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
        assert!(Tolerance::Adaptive.check().is_ok());
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
        assert_eq!(chosen(&large, DefinitenessGuarantee::Unknown), ("cg", 1, true));
        for assurance in [
            DefinitenessGuarantee::Definite,
            DefinitenessGuarantee::RegularizedDefinite,
            DefinitenessGuarantee::Unknown,
        ] {
            assert_eq!(chosen(&too_large, assurance), ("cg", 0, true));
        }
        // Of what is sure or made to be definite factorizations are looked at only when they may pay.
        for assurance in [DefinitenessGuarantee::Definite, DefinitenessGuarantee::RegularizedDefinite] {
            assert_eq!(chosen(&large, assurance), ("cg", 0, true));
        }
    }

    /// Of a cloth of 20² particles a proof of definiteness is worth some million operations, 300 000 a spring.
    #[cfg(feature = "scene")]
    #[test]
    fn proofs_are_worth_their_operations() {
        let (system, _) = crate::scene::builtin::cloth(20).unwrap().build().unwrap();
        let mut work = Work::default();
        let solver = select(&system, &SolverOptions::default(), DefinitenessGuarantee::Unknown, &mut work).unwrap();
        let flops = solver.factor().unwrap().size.flops;
        assert!(flops > 4e5 && flops < WORTH_PROVING * system.springs().len() as f64, "{flops}");
        assert_eq!((solver.name(), work.symbolic_factorizations), ("llt", 1));
    }
}
