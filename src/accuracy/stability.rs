//! Whether compressed springs make a state unstable within a step.
//!
//! A compressed spring pushes its ends across itself, with the stiffness `−m` in which `m = k (1/l₀ − 1/l) < 0` is the negative of its transverse one. What that makes grow
//! like `exp(σt)` does so within h seconds by less than e if and only if the matrix `M − h² K` is positive definite. Long implicit steps calm what grows
//! as they calm everything, and no run by itself can say what a growing motion makes of its errors.

use super::audience::Audience;
use super::search::Search;
use crate::error::Result;
use crate::force::Extensions;
use crate::linear::{CholeskySolver, LinearSolver, Prepare, SolverOptions};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::work::Work;

/// Free coordinates of a matrix that may be factored to see whether it is definite.
const LARGEST: usize = 30_000;

/// Whether the full matrix of a step of h seconds is positive definite at the start, as far as can be told for so many force evaluations.
///
/// First by a bound that takes one: with `(u_i − u_j)² ≤ 2 u_i² + 2 u_j²` it is if `2 h² Σ |m| < m_i` over the compressed springs of every particle i.
/// Then by a factorization.
pub(super) fn is_stable<A: Audience>(
    search: &mut Search<'_, A>,
    h: f64,
    linear: &SolverOptions,
    affordable: f64,
) -> Result<bool> {
    let (system, start, costs) = (search.task.system, search.task.start, search.task.costs);
    let extensions = Extensions::at(system, &start.positions)?;
    let mut across = vec![0.0; system.particles()];
    for ((_, ends, spring), at) in extensions.springs(system) {
        let pushes = -spring.stiffness_block(at, Stiffness::Full).transverse;
        ends.iter().for_each(|&p| across[p] += pushes.max(0.0));
    }
    search.spend(1.0);
    if across.iter().zip(system.masses()).all(|(across, mass)| 2.0 * h * h * across < *mass) {
        return Ok(true);
    }
    let price = costs.assembly() + costs.least_analysis() + costs.least_factorization();
    if price > affordable || system.dofs().len() > LARGEST {
        return Ok(false);
    }
    let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(h));
    let mut work = Work::default();
    let mut solver = CholeskySolver::new(system, linear.par, &mut work)?;
    let is_definite = solver.prepare(&operator, &mut work).is_ok();
    let factor = solver.factor().map(|factor| factor.size);
    search.spend(costs.cost(&work, factor));
    Ok(is_definite)
}
