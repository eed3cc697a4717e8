//! Work counted in force evaluations of the system at hand, for choosing and for reporting.
//!
//! Counts give the same choice whenever a run is repeated, and for any number of threads. Its numbers are ns a spring, a coordinate, an entry of the
//! factor or an operation, of which only ratios are used: medians over cloths, lattices and networks of 10² to 10⁵ particles on one core. They need
//! to be right within a factor of two only.

use super::options::PreconditionerKind;
use super::ordering::{FactorSize, OrderingMethod};
use crate::system::System;
use crate::work::Work;

/// The cost of operations on one system, in units of one force evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostModel {
    springs: f64,
    coordinates: f64,
    /// Entries of the lower triangle of A.
    entries: usize,
    /// A force evaluation, in ns.
    force: f64,
}

impl CostModel {
    /// The costs on a system.
    pub fn of(system: &System) -> Self {
        let (axes, springs, coordinates) = (system.dimension(), system.active_springs().len(), system.dofs().len());
        let entries = (axes + 1) * coordinates / 2 + axes * axes * springs;
        let (springs, coordinates) = (springs as f64, coordinates as f64);
        // At least a nanosecond: a system may have neither springs nor coordinates.
        let force = (5.3 * springs + 1.4 * coordinates).max(1.0);
        Self { springs, coordinates, entries, force }
    }

    /// The spring blocks of A.
    pub fn assembly(&self) -> f64 {
        8.4 * self.springs / self.force
    }

    /// A product of A with a vector, matrix-free.
    pub fn product(&self) -> f64 {
        2.0 * self.springs / self.force
    }

    /// An iteration of conjugate gradients, its preconditioner included.
    pub fn iteration(&self, preconditioner: PreconditionerKind) -> f64 {
        let cycle = if preconditioner == PreconditionerKind::Multigrid { 25.0 } else { 0.0 };
        self.product() + (3.0 + cycle) * self.coordinates / self.force
    }

    /// The coarse levels of multigrid.
    pub fn multigrid_setup(&self) -> f64 {
        350.0 * self.coordinates / self.force
    }

    /// Ordering and symbolic analysis.
    pub fn analysis(&self, size: FactorSize) -> f64 {
        (160.0 * self.springs + 6.5 * size.entries as f64) / self.force
    }

    /// Ordering and symbolic analysis without fill.
    pub fn least_analysis(&self) -> f64 {
        self.analysis(self.without_fill())
    }

    /// A numeric factorization, the assembly of the sparse matrix included.
    pub fn factorization(&self, size: FactorSize) -> f64 {
        (43.0 * self.springs + 3.5 * size.entries as f64 + 0.016 * size.flops) / self.force
    }

    /// A solve with a factor, and its residual.
    pub fn direct_solve(&self, size: FactorSize) -> f64 {
        self.product() + (19.0 * self.coordinates + 0.5 * size.entries as f64) / self.force
    }

    fn without_fill(&self) -> FactorSize {
        FactorSize { entries: self.entries, flops: 0.0, ordering: OrderingMethod::Natural }
    }

    /// The cost of some work, with the factor that was used, or without fill.
    pub fn cost(&self, work: &Work, factor: Option<FactorSize>) -> f64 {
        let size = factor.unwrap_or(self.without_fill());
        let by_blocks = work.cg_iterations.saturating_sub(work.multigrid_iterations);
        let terms = [
            (work.force_evaluations, 1.0),
            (work.assemblies, self.assembly()),
            (work.symbolic_factorizations, self.analysis(size)),
            (work.factorizations, self.factorization(size)),
            (work.solves.saturating_sub(work.iterative_solves), self.direct_solve(size)),
            // The residuals of the first guess and of the solution, and the two products of a warm start.
            (work.iterative_solves + work.warm_starts, 2.0 * self.product()),
            (by_blocks, self.iteration(PreconditionerKind::BlockJacobi)),
            (work.multigrid_iterations, self.iteration(PreconditionerKind::Multigrid)),
            (work.multigrid_setups, self.multigrid_setup()),
        ];
        terms.iter().map(|(count, each)| *count as f64 * each).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1000 springs between 200 particles: a force evaluation takes 6140 ns.
    fn model() -> CostModel {
        CostModel { springs: 1000.0, coordinates: 600.0, entries: 10_200, force: 6140.0 }
    }

    /// Without a factor the entries are those of the matrix, and nothing is multiplied.
    #[test]
    fn without_a_factor_nothing_is_filled_in() {
        let work = Work { factorizations: 1, solves: 1, ..Work::default() };
        let expected = 43_000.0 + 3.5 * 10_200.0 + 2000.0 + 11_400.0 + 5100.0;
        assert!((6140.0 * model().cost(&work, None) - expected).abs() < 1e-6);
    }
}
