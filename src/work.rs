//! Counters of work, which do not depend on the machine.

use serde::{Deserialize, Serialize};

/// The number of times each expensive operation was done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Evaluations of f_el (with f_d and gravity where the method needs them).
    pub force_evaluations: u64,
    /// Computations of the spring blocks of A, assembled or not.
    pub assemblies: u64,
    /// Orderings and symbolic analyses.
    pub symbolic_factorizations: u64,
    /// Numeric factorizations, refused ones included.
    pub factorizations: u64,
    /// Linear systems solved, failed ones included.
    pub solves: u64,
    /// Solves by conjugate gradients.
    pub iterative_solves: u64,
    /// Products with A inside conjugate gradients.
    pub cg_iterations: u64,
    /// Iterations without a preconditioner.
    pub plain_iterations: u64,
    /// Iterations preconditioned with multigrid.
    pub multigrid_iterations: u64,
    /// Solves by conjugate gradients that started from earlier solutions.
    pub warm_starts: u64,
    /// Set-ups of the coarse levels of multigrid, refused ones included.
    pub multigrid_setups: u64,
    /// Newton iterations of nonlinear methods.
    pub newton_iterations: u64,
}

impl Work {
    /// Adds the counters of another computation.
    pub fn add(&mut self, other: &Self) {
        // The pattern names every counter: a forgotten one does not compile.
        macro_rules! add {
            ($($counter:ident)*) => {
                let Self { $($counter),* } = *other;
                $(self.$counter += $counter;)*
            };
        }
        add! {
            force_evaluations assemblies symbolic_factorizations factorizations solves iterative_solves
            cg_iterations plain_iterations multigrid_iterations warm_starts multigrid_setups newton_iterations
        }
    }
}
