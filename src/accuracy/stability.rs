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
pub(super) const LARGEST: usize = 30_000;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::attempt::Task;
    use crate::accuracy::requirement::Requirement;
    use crate::accuracy::samples::Grid;
    use crate::linear::CostModel;
    use crate::spring::Spring;
    use crate::system::{State, System, SystemBuilder};

    /// A particle of 1 kg between two anchors, on springs of so many newtons a metre of strain that are pressed to a half: m is their stiffness.
    fn pressed(stiffness: f64) -> (System, State) {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        let [left, middle, right] = [-1.0, 0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
        for anchor in [left, right] {
            builder.spring(anchor, middle, Spring { stiffness, rest_length: 2.0, damping: 0.0 });
            builder.hold(anchor);
        }
        builder.build().unwrap()
    }

    fn is_stable_at(stiffness: f64, h: f64, affordable: f64) -> (bool, f64) {
        let (system, start) = pressed(stiffness);
        let (duration, interval) = (1.0, 0.5);
        let (costs, grid) = (CostModel::of(&system), Grid::new(duration, interval, system.particles()));
        let task = Task { system: &system, start: &start, duration, costs, grid, go_on: &|| true };
        let (method, stiffness, solver, par) = (None, None, None, faer::Par::Seq);
        let requirement = Requirement { accuracy: 1e-2, duration, interval, par, method, stiffness, solver };
        let mut audience = ();
        let mut search = Search::new(&task, &requirement, &mut audience);
        let is_stable = is_stable(&mut search, h, &SolverOptions::default(), affordable).unwrap();
        (is_stable, search.spent())
    }

    /// Two springs of `m = ½ k` push across with k in all: A is definite for `h² k < 1`, and for `2 h² k < 1` the bound says so.
    #[test]
    fn what_pushes_across_grows() {
        for (square, expected, looks) in
            [(0.49, true, false), (0.51, true, true), (0.99, true, true), (1.01, false, true), (9.0, false, true)]
        {
            let (is_stable, cost) = is_stable_at(100.0 * square, 0.1, f64::INFINITY);
            assert_eq!((is_stable, cost > 1.0), (expected, looks), "{square} {cost}");
        }
    }

    /// Where a factorization costs too much nothing is said for what only it could tell.
    #[test]
    fn looks_have_their_price() {
        assert_eq!(is_stable_at(70.0, 0.1, 1.0), (false, 1.0));
        assert_eq!(is_stable_at(40.0, 0.1, 1.0), (true, 1.0));
    }
}
