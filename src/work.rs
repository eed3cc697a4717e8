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
        let Self {
            force_evaluations,
            assemblies,
            symbolic_factorizations,
            factorizations,
            solves,
            iterative_solves,
            cg_iterations,
            plain_iterations,
            multigrid_iterations,
            warm_starts,
            multigrid_setups,
            newton_iterations,
        } = *other;
        self.force_evaluations += force_evaluations;
        self.assemblies += assemblies;
        self.symbolic_factorizations += symbolic_factorizations;
        self.factorizations += factorizations;
        self.solves += solves;
        self.iterative_solves += iterative_solves;
        self.cg_iterations += cg_iterations;
        self.plain_iterations += plain_iterations;
        self.multigrid_iterations += multigrid_iterations;
        self.warm_starts += warm_starts;
        self.multigrid_setups += multigrid_setups;
        self.newton_iterations += newton_iterations;
    }
}

#[cfg(test)]
mod tests {
    use super::Work;

    #[test]
    fn every_counter_is_added() {
        let counted = |number: u64| Work {
            force_evaluations: number,
            assemblies: 2 * number,
            symbolic_factorizations: 3 * number,
            factorizations: 4 * number,
            solves: 5 * number,
            iterative_solves: 6 * number,
            cg_iterations: 7 * number,
            multigrid_iterations: 8 * number,
            warm_starts: 9 * number,
            multigrid_setups: 10 * number,
            newton_iterations: 11 * number,
            plain_iterations: 12 * number,
        };
        let mut work = counted(5);
        work.add(&counted(2));
        assert_eq!(work, counted(7));
    }
}
