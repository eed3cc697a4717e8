//! A factorization or conjugate gradients, whichever turns out to cost less.
//!
//! What a factorization costs is known before the first: the pattern says it. What conjugate gradients cost depends on the
//! stiffness, the step, the tolerance and the first guesses; only trying shows it. So they are tried, and watched: the
//! effort by which they exceed the factorizations that they replace is added up, starting again from zero whenever it
//! falls below. When it exceeds the cost of one factorization the solver changes to factorizations for good. Whatever a
//! scene is like, this wastes, by the same count, at most the cost of two of them (the argument of renting or buying skis).
//!
//! Effort is counted, not timed: the same run makes the same choice, and gives the same bits, on every machine and for any
//! number of threads. The unit is a product with A. The weights are measured on cloths and lattices of 10³ to 10⁵ particles:
//! what is close is decided by them, what is not would be decided by any.

use super::LinearSolver;
use super::direct::CholeskySolver;
use super::factorization::{FactorReport, FactorSize};
use super::iterative::CgSolver;
use super::outcome::{Definiteness, Solution, SolveFailure};
use crate::operator::SystemOperator;
use crate::work::Work;
use nalgebra::Vector3;

/// Operations of a supernodal factorization in the time of one spring in a product with A.
const OPERATIONS: f64 = 200.0;

/// What assembling and storing an entry of the factor costs beside the arithmetic, in springs of a product.
const ENTRY: f64 = 1.2;

/// What an entry costs in a solve with the factor.
const SOLVED_ENTRY: f64 = 0.4;

/// Factorizations that cost more than this are not considered: multigrid takes about 200 products to set up and 200 to solve.
const HOPELESS: f64 = 4000.0;

/// What factorizations cost in products with A.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DirectCost {
    factor: f64,
    solve: f64,
}

impl DirectCost {
    fn of(size: FactorSize, springs: f64) -> Self {
        let entries = size.entries as f64 / springs;
        Self { factor: size.flops / springs / OPERATIONS + ENTRY * entries, solve: SOLVED_ENTRY * entries }
    }

    fn step(self) -> f64 {
        self.factor + self.solve
    }
}

/// Sparse Cholesky and conjugate gradients for one system; one of them solves.
pub struct AutomaticSolver {
    direct: Option<CholeskySolver>,
    iterative: CgSolver,
    cost: DirectCost,
    is_direct: bool,
    /// By how much conjugate gradients have cost more than factorizations since they last cost less.
    lost: f64,
    /// Matrices that conjugate gradients were tried on.
    tried: u64,
}

impl AutomaticSolver {
    /// For a system of so many springs that act on free coordinates.
    pub fn new(direct: CholeskySolver, iterative: CgSolver, springs: f64) -> Self {
        let cost = DirectCost::of(direct.size(), springs);
        let direct = (cost.step() <= HOPELESS).then_some(direct);
        Self { direct, iterative, cost, is_direct: false, lost: 0.0, tried: 0 }
    }

    fn chosen(&self) -> &dyn LinearSolver {
        match &self.direct {
            Some(direct) if self.is_direct => direct,
            _ => &self.iterative,
        }
    }

    /// The effort so far over the matrices so far.
    fn mean_effort(&self) -> f64 {
        self.iterative.effort() / self.tried.max(1) as f64
    }
}

impl LinearSolver for AutomaticSolver {
    fn name(&self) -> &'static str {
        self.chosen().name()
    }

    fn preconditioner(&self) -> Option<&'static str> {
        self.chosen().preconditioner()
    }

    fn factor(&self) -> Option<FactorReport> {
        self.chosen().factor()
    }

    fn choice(&self) -> Option<String> {
        let (name, factor) = (self.name(), self.cost.step());
        let tried = format!("conjugate gradients took the work of {:.0} products with A a matrix", self.mean_effort());
        Some(format!("{name}: {tried}, factoring and solving take that of {factor:.0}"))
    }

    fn place(&mut self, positions: &[Vector3<f64>]) {
        self.iterative.place(positions);
    }

    fn prepare(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.is_direct |= self.lost > self.cost.step();
        if let Some(direct) = self.direct.as_mut().filter(|_| self.is_direct) {
            return direct.prepare(a, work);
        }
        self.tried += 1;
        let before = self.iterative.effort();
        let prepared = self.iterative.prepare(a, work);
        self.lost = self.lost.max(0.0) + self.iterative.effort() - before - self.cost.factor;
        prepared
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.iterative.set_tolerance(tolerance);
    }

    fn solve(
        &mut self,
        a: &SystemOperator,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        let Self { direct, iterative, cost, lost, .. } = self;
        let Some(direct) = direct else { return iterative.solve(a, b, x, work) };
        if self.is_direct {
            return direct.solve(a, b, x, work);
        }
        let before = iterative.effort();
        iterative.allow(cost.step() + cost.solve - *lost);
        let solved = iterative.solve(a, b, x, work);
        *lost += iterative.effort() - before - cost.solve;
        if let Err(SolveFailure::NotConverged { .. }) = solved {
            self.is_direct = true;
            direct.prepare(a, work)?;
            return direct.solve(a, b, x, work);
        }
        solved
    }
}

#[cfg(test)]
mod tests;
