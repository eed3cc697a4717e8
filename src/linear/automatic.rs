//! A factorization or conjugate gradients, whichever turns out to cost less.
//!
//! What conjugate gradients cost depends on the stiffness, the step, the tolerance and the first guesses; only trying shows it. What
//! factorizations cost is in the pattern, but to analyse it costs as much as dozens of steps may. So nothing is analysed at first:
//! conjugate gradients are tried, and watched. The effort by which they exceed the factorizations that they replace is
//! added up, starting again from zero whenever it falls below:
//!
//! - as long as nothing is known of the pattern, against factorizations that fill nothing in. When this exceeds a first ordering and
//!   one of them, the particles are ordered, which shows what factorizations take at least;
//! - then against those. When it exceeds an analysis and one of them, the pattern is analysed, and what factorizations cost is known;
//! - from then on against these. When it exceeds one of them the solver changes to factorizations. Every now and then a matrix is left to conjugate gradients
//!   [again](again), and if they take less than eight tenths of the effort, so are those that follow, watched as before.
//!
//! A matrix that is refused as indefinite would have taken a part of a factorization only.
//!
//! Where the mean matrix has cost more than what became known, the next look is taken at once. Whatever a scene is like, this wastes at
//! most the cost of a first ordering, an analysis and three factorizations, one for each of them (the argument of renting or buying skis); of a lattice, whose
//! analysis takes as long as a dozen solves with multigrid, the first ordering says that it cannot pay. Every return to conjugate gradients may waste two
//! factorizations more; they become as rare as trials.
//!
//! Effort is [counted](CostModel), not timed: the same run makes the same choice, and gives the same bits, as often as it is repeated
//! and for any number of threads. (Another kind of processor rounds differently where its vector registers are wider, which may cost an
//! iteration more or less and so, where it is close, decide otherwise.)
//!
//! A factor takes memory only when the choice has fallen on it, and only as much as leaves room for everything else: one that would
//! take more than half of what the process may hold is not considered, whatever it costs.

mod again;

use super::analysis::{FactorReport, FactorSize};
use super::cost::CostModel;
use super::direct::{CholeskyGlance, CholeskyPlan, CholeskySolver};
use super::iterative::CgSolver;
use super::outcome::{Definiteness, Solution, SolveFailure};
use super::{Held, LinearSolver};
use crate::memory;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use again::Trials;
use faer::Par;
use nalgebra::Vector3;

/// Factorizations that cost more than this many force evaluations are not considered: multigrid takes about a hundred to set up and
/// to solve.
const HOPELESS: f64 = 2000.0;

/// What a factorization that is refused takes, of a whole one: it ends at the first bad pivot. A step whose first matrix is refused takes 1.15
/// (cloth 100) and 1.33 times (network 2000) what one with a single factorization takes, with all that steps do beside.
const REFUSED: f64 = 0.25;

/// What is known of factorizations.
enum Direct {
    /// Nothing.
    Unseen,
    /// The least that they take.
    Glanced(Box<CholeskyGlance>),
    /// Analysed, and without memory yet.
    Seen(Box<CholeskyPlan>),
    /// Chosen.
    Chosen(Box<CholeskySolver>),
    /// Chosen once, while conjugate gradients cost less now.
    Resting(Box<CholeskySolver>),
    /// Far too expensive, or too large.
    Hopeless,
}

/// What factorizations cost, in force evaluations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DirectCost {
    factor: f64,
    solve: f64,
}

impl DirectCost {
    fn of(size: FactorSize, costs: &CostModel) -> Self {
        Self { factor: costs.factorization(size), solve: costs.direct_solve(size) }
    }

    fn step(self) -> f64 {
        self.factor + self.solve
    }

    /// Whether a factor of so many bytes is considered.
    fn is_affordable(self, bytes: u64) -> bool {
        self.step() <= HOPELESS && fits(bytes)
    }
}

/// Whether a factor of so many bytes leaves as much room for everything else, in what the process may ever hold.
pub(super) fn fits(bytes: u64) -> bool {
    memory::limit().is_none_or(|limit| bytes <= limit / 2)
}

/// Sparse Cholesky and conjugate gradients for one system; one of them solves.
pub struct AutomaticSolver {
    iterative: CgSolver,
    direct: Direct,
    par: Par,
    costs: CostModel,
    /// Of factorizations, as far as known.
    cost: DirectCost,
    /// By how much conjugate gradients have cost more than factorizations since they last cost less.
    lost: f64,
    /// Matrices that conjugate gradients were tried on.
    tried: u64,
    /// When they are tried again where factorizations are chosen.
    trials: Trials,
}

impl AutomaticSolver {
    /// For a system; factorizations, should there be any, are shared out as `par` says.
    pub fn new(system: &System, iterative: CgSolver, par: Par) -> Self {
        let costs = CostModel::of(system);
        let cost = DirectCost { factor: costs.least_factorization(), solve: costs.least_direct_solve() };
        Self { iterative, direct: Direct::Unseen, par, costs, cost, lost: 0.0, tried: 0, trials: Trials::NONE_YET }
    }

    fn chosen(&self) -> &dyn LinearSolver {
        match &self.direct {
            Direct::Chosen(direct) => &**direct,
            _ => &self.iterative,
        }
    }

    /// The effort so far over the matrices so far.
    fn mean_effort(&self) -> f64 {
        self.iterative.effort() / self.tried.max(1) as f64
    }

    /// What may be lost before something else is tried.
    fn patience(&self) -> f64 {
        match &self.direct {
            Direct::Unseen => self.costs.glance() + self.cost.step(),
            Direct::Glanced(glance) => self.costs.analysis(glance.least()) + self.cost.step(),
            Direct::Seen(_) | Direct::Resting(_) => self.cost.step(),
            Direct::Chosen(_) | Direct::Hopeless => f64::INFINITY,
        }
    }

    /// Takes note of what factorizations cost, exactly or at least, and goes on at once where conjugate gradients have cost more in the mean.
    fn know(&mut self, direct: Direct, size: FactorSize, bytes: u64, system: &System, work: &mut Work) {
        let cost = DirectCost::of(size, &self.costs);
        if !cost.is_affordable(bytes) {
            return;
        }
        (self.direct, self.cost, self.lost) = (direct, cost, 0.0);
        if self.mean_effort() > cost.step() {
            self.reconsider(system, work);
        }
    }

    /// Out of patience: looks at the pattern, analyses it, or changes to factorizations. What cannot be had is hopeless.
    fn reconsider(&mut self, system: &System, work: &mut Work) {
        match std::mem::replace(&mut self.direct, Direct::Hopeless) {
            Direct::Unseen => {
                if let Ok(glance) = CholeskyGlance::new(system, work) {
                    let least = glance.least();
                    self.know(Direct::Glanced(Box::new(glance)), least, 8 * least.entries as u64, system, work);
                }
            }
            Direct::Glanced(glance) => {
                if let Ok(plan) = glance.plan(self.par) {
                    let (size, bytes) = (plan.size(), plan.bytes());
                    self.know(Direct::Seen(Box::new(plan)), size, bytes, system, work);
                }
            }
            // Where there is no room for the factor after all, there is nothing to consider any more.
            Direct::Seen(plan) => {
                if let Ok(direct) = plan.solver(system) {
                    self.direct = Direct::Chosen(Box::new(direct));
                }
            }
            Direct::Resting(direct) => self.direct = Direct::Chosen(direct),
            decided => self.direct = decided,
        }
    }

    /// Leaves what follows to conjugate gradients, which a trial has shown to cost less.
    fn leave(&mut self) {
        self.trials.end();
        self.direct = match std::mem::replace(&mut self.direct, Direct::Hopeless) {
            Direct::Chosen(direct) => Direct::Resting(direct),
            other => other,
        };
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
        match &self.direct {
            Direct::Seen(plan) => Some(plan.report()),
            Direct::Chosen(direct) | Direct::Resting(direct) => direct.factor(),
            Direct::Unseen | Direct::Glanced(_) | Direct::Hopeless => None,
        }
    }

    fn choice(&self) -> Option<String> {
        let name = self.name();
        let tried =
            format!("conjugate gradients took the work of {:.1} force evaluations a matrix", self.mean_effort());
        Some(match self.direct {
            Direct::Unseen => format!("{name}: {tried}, which does not pay for a look at factorizations"),
            Direct::Glanced(_) => {
                format!("{name}: {tried}, factoring and solving would take that of {:.1} at least", self.cost.step())
            }
            Direct::Seen(_) | Direct::Chosen(_) | Direct::Resting(_) => {
                format!("{name}: {tried}, factoring and solving take that of {:.1}", self.cost.step())
            }
            Direct::Hopeless => {
                format!("{name}: {tried}, factorizations are far more expensive, or too large for the memory")
            }
        })
    }

    fn place(&mut self, positions: &[Vector3<f64>]) {
        self.iterative.place(positions);
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if self.lost > self.patience() {
            self.reconsider(a.system(), work);
        }
        let before = self.iterative.effort();
        if let Direct::Chosen(direct) = &mut self.direct {
            if !self.trials.take(before, self.cost.step()) {
                return direct.take(a, work);
            }
            // What was lost before factorizations were chosen is no concern of the trial's.
            self.lost = 0.0;
        }
        self.tried += 1;
        let prepared = self.iterative.take(a, work);
        let is_refused = matches!(prepared, Err(SolveFailure::Indefinite(_)));
        let share = if is_refused { REFUSED } else { 1.0 };
        self.lost = self.lost.max(0.0) + self.iterative.effort() - before - share * self.cost.factor;
        if is_refused {
            self.trials.refused(REFUSED * self.cost.factor);
        }
        prepared
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.iterative.set_tolerance(tolerance);
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        loop {
            let before = self.iterative.effort();
            let trial = self.trials.left(before);
            if let (Direct::Chosen(direct), None) = (&mut self.direct, trial) {
                let solved = direct.solve(a, b, x, work)?;
                // A trial begins where conjugate gradients would be.
                self.iterative.remember(x);
                return Ok(solved);
            }
            self.iterative.allow(trial.unwrap_or(self.patience() + self.cost.solve - self.lost));
            let solved = self.iterative.solve(a, b, x, work);
            self.lost += self.iterative.effort() - before;
            // A factorization would have been refused too, and not whole, and nothing solved with it.
            if matches!(solved, Err(SolveFailure::Indefinite(_))) {
                self.lost += (1.0 - REFUSED) * self.cost.factor;
                self.trials.refused(REFUSED * self.cost.factor);
            } else {
                self.lost -= self.cost.solve;
            }
            match (&solved, &self.direct) {
                (Err(SolveFailure::NotConverged { .. }), Direct::Chosen(_)) => self.trials.end(),
                (Err(SolveFailure::NotConverged { .. }), Direct::Hopeless) => return solved,
                (Err(SolveFailure::NotConverged { .. }), _) => self.reconsider(a.system(), work),
                (Ok(_), Direct::Chosen(_)) => {
                    self.leave();
                    return solved;
                }
                _ => return solved,
            }
            // Conjugate gradients go on from where they were.
            if let Direct::Chosen(direct) = &mut self.direct {
                direct.take(&a, work)?;
                x.fill(0.0);
            }
        }
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests;
