//! The search without a factorization, for scenes whose factor would take too long or too much memory.
//!
//! Directions of Newton's method come from conjugate gradients with multigrid, to
//!
//! ```text
//! ‖f + K p‖ ≤ η ‖f‖,      η = min(0.1, √(largest force left / largest force that acts)),
//! ```
//!
//! which keeps the convergence superlinear (Dembo, Eisenstat and Steihaug, SIAM J. Numer. Anal. 19, 1982). Negative curvature tells that −K is not
//! positive definite. The verdict rests on the lowest eigenvalues of `−K φ = λ M φ` that a preconditioned search finds; they are not counted.

use super::Signs;
use super::search::{Iterative, NEAR, SINGULAR, Search, Solver};
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Eigenpair, Pencil, eigenpair};
use crate::error::Result;
use crate::integrate::StiffnessPolicy;
use crate::linear::{
    CgOutcome, Cholesky, ConjugateGradient, CostModel, FactorSize, Preconditioner, PreconditionerKind, norm,
};
use crate::memory;
use crate::modes::uncounted;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::rigid::rigid_motions;
use crate::spring::Stiffness;
use crate::system::System;
use faer::Par;

impl Solver {
    /// A factorization where it is worth its cost and fits the memory, else conjugate gradients with multigrid.
    pub fn new(system: &System, k: &SymmetricMatrix) -> Result<Self> {
        let costs = CostModel::of(system);
        // The matrices are nearly singular: a direction takes some hundred iterations.
        let iterative = 100.0 * costs.iteration(PreconditionerKind::Multigrid) + costs.multigrid_setup();
        let is_worth = |size: FactorSize, bytes: u64| {
            costs.factorization(size) <= iterative && memory::ensure(bytes, "a factorization").is_ok()
        };
        match Cholesky::plan_if(k.pattern(), Par::rayon(0), is_worth) {
            Some(plan) => Ok(Self::Factored(Box::new(plan.allocate()?))),
            None => Self::iterative(system),
        }
    }

    pub fn iterative(system: &System) -> Result<Self> {
        let mut method = ConjugateGradient::new(system.dofs().len(), 0.1);
        method.iteration_limit = 500;
        let preconditioner = Preconditioner::new(PreconditionerKind::Multigrid, system)?;
        Ok(Self::Iterative(Box::new(Iterative { method, preconditioner })))
    }
}

impl Search<'_> {
    /// As [`factored_step`](Search::factored_step), by conjugate gradients; shifts are in the metric of the masses.
    pub(super) fn iterative_step(&mut self) -> (Vec<f64>, bool) {
        let [first, far] = match self.options.stiffness {
            StiffnessPolicy::Always(option) => [option; 2],
            StiffnessPolicy::OnDemand | StiffnessPolicy::Progressive => [Stiffness::Full, Stiffness::Tension],
        };
        if let Some(step) = self.iterate(first, 0.0) {
            return (step, false);
        }
        let norm = Some(2.0 * self.stiffness()).filter(|norm| *norm > 0.0).unwrap_or(self.acting);
        if self.is_free
            && let Some(step) = self.iterate(first, SINGULAR * norm)
        {
            return (step, false);
        }
        let is_near = self.residual() < NEAR && first != far;
        let option = if is_near { first } else { far };
        let [mut shift, growth] = if is_near { [(0.125 * self.shift).max(1e-8 * norm), 4.0] } else { [0.0, 100.0] };
        while shift < norm {
            if let Some(step) = self.iterate(option, shift) {
                self.shift = shift;
                return (step, is_near);
            }
            shift = (shift * growth).max(1e-9 * norm);
        }
        (self.force.clone(), false)
    }

    /// p of `(−K + σ M/m̄) p = f` with an option's K and the mean mass m̄; `None` where that matrix is found not to be positive definite.
    fn iterate(&mut self, option: Stiffness, shift: f64) -> Option<Vec<f64>> {
        let (residual, system) = (self.residual(), self.system);
        let Self { solver: Solver::Iterative(solver), state, geometry, force, work, .. } = self else { return None };
        let Iterative { method, preconditioner } = &mut **solver;
        let mean = system.masses().iter().sum::<f64>() / system.particles() as f64;
        let combination = Combination { mass: shift / mean, damping: 0.0, stiffness: -1.0 };
        let a = SystemOperator::new(system, geometry, option, combination);
        preconditioner.set_positions(&state.positions);
        preconditioner.update(&a, work).ok()?;
        method.tolerance = residual.sqrt().min(0.1);
        let mut step = vec![0.0; force.len()];
        let report = method.solve(&a, preconditioner, force, &mut step);
        work.solves += 1;
        work.iterative_solves += 1;
        work.cg_iterations += report.iterations;
        work.multigrid_iterations += report.iterations;
        let is_usable =
            matches!(report.outcome, CgOutcome::Converged | CgOutcome::Stagnated | CgOutcome::IterationLimit);
        (is_usable && norm(&step).is_finite()).then_some(step)
    }

    /// The lowest eigenvalues of −K that are found, in N/m, with unit vectors: one more than there are rigid motions.
    pub(super) fn lowest_found(&mut self, a: &SymmetricMatrix) -> Result<Vec<Eigenpair>> {
        let rigid = rigid_motions(self.system, &self.state.positions).into_iter();
        let rigid: Vec<_> = rigid.map(|vector| Eigenpair { value: 0.0, vector, residual: 0.0 }).collect();
        let wanted = (1 + rigid.len()).min(a.order());
        let pairs = uncounted(self.system, &self.state, a, self.matrices.masses(), &rigid, wanted, &mut self.work)?;
        Ok(pairs.into_iter().map(|pair| eigenpair(&Pencil::of(a), pair.vector)).collect())
    }

    pub(super) fn signs_found(&mut self, a: &SymmetricMatrix, band: f64) -> Result<Signs> {
        let found = self.lowest_found(a)?;
        let negative = found.iter().filter(|pair| pair.value < -band).count();
        let zero = found.iter().filter(|pair| pair.value.abs() <= band).count();
        Ok(Signs { negative, zero, positive: a.order() - negative - zero })
    }
}
