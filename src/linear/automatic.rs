//! Conjugate gradients with block Jacobi, conjugate gradients with multigrid, or a Cholesky factorization: whichever costs less.
//!
//! What iterations a matrix takes is known only when they have been done, and what factorizations cost only when the pattern has been analysed. So
//! block Jacobi comes first and may spend on a matrix what the cheaper of the other two would (the argument of renting or buying skis: never more than
//! twice the better choice). Then that one takes over, from where the iterations are, and for the matrices that follow. Multigrid in turn may spend
//! what a factorization would. Motions change: block Jacobi is tried again after [`FIRST_TRIAL`] matrices, and after twice as many each time that it has
//! spent too much.
//!
//! The pattern is analysed when block Jacobi first spends too much, or has spent [`LOOK`] times what an analysis costs at least. A factor takes memory
//! only when it is chosen, and no more than half of what the process may hold.
//!
//! Effort is [counted](CostModel), not timed: the same run makes the same choice whenever it is repeated, and for any number of threads.

use super::analysis::{FactorReport, FactorSize};
use super::cost::CostModel;
use super::direct::{CholeskyEstimate, CholeskyPlan, CholeskySolver};
use super::iterative::{Application, CgSolver};
use super::options::SolverOptions;
use super::outcome::{Definiteness, NotConverged, Solution, SolveFailure};
use super::preconditioner::Preconditioner;
use super::preconditioner_kind::PreconditionerKind;
use super::{Held, LinearSolver};
use crate::error::Result;
use crate::memory;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::Vector3;

/// Matrices before block Jacobi is tried again for the first time: the trial costs at most the price of one of them.
const FIRST_TRIAL: u64 = 16;

/// An analysis that costs a twentieth of what has been spent is looked into whatever it shows: fill may make it cost a few times more.
const LOOK: f64 = 20.0;

/// Iterations that a solve to ten digits takes with multigrid, before any is known: 12 to 35 on cloths, lattices and networks.
const MULTIGRID_ITERATIONS: f64 = 25.0;

/// Factorizations that cost so many times what multigrid does are not analysed further.
const HOPELESS: f64 = 10.0;

/// Degrees of freedom beyond which nothing is analysed: ordering alone would take seconds.
pub(super) const LARGEST_ANALYSED: usize = 1_500_000;

/// Whether a factor of so many bytes leaves as much room for everything else, in what the process may ever hold.
pub(super) fn fits(bytes: u64) -> bool {
    memory::limit().is_none_or(|limit| bytes <= limit / 2)
}

/// What solves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    BlockJacobi,
    Multigrid,
    Cholesky,
}

/// What is known of factorizations.
enum Direct {
    Unknown,
    /// Analysed, and without memory yet.
    Known(Box<CholeskyPlan>),
    Ready(Box<CholeskySolver>),
    /// Not wanted, too expensive, or too large.
    Never,
}

/// What a matrix costs, in force evaluations: once, and for every solve.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Price {
    once: f64,
    solve: f64,
}

impl Price {
    const UNAFFORDABLE: Self = Self { once: f64::INFINITY, solve: 0.0 };

    fn direct(costs: &CostModel, size: FactorSize) -> Self {
        Self { once: costs.factorization(size), solve: costs.direct_solve(size) }
    }

    fn of(self, solves: f64) -> f64 {
        self.once + solves * self.solve
    }
}

/// Three solvers for one system, one of which solves.
pub struct AutomaticSolver {
    method: Method,
    /// With the preconditioner of the method.
    iterative: CgSolver,
    /// The preconditioner that is not in use.
    other: Option<Preconditioner>,
    direct: Direct,
    par: Par,
    costs: CostModel,
    multigrid_price: Price,
    direct_price: Price,
    /// Where the particles are, for multigrid.
    positions: Vec<Vector3<f64>>,
    /// Solves with the matrix at hand, and what the method has spent on it.
    solves: f64,
    spent: f64,
    /// What block Jacobi has spent on all matrices.
    spent_in_all: f64,
    /// Matrices before block Jacobi is tried again, and after the next trial in vain.
    until_trial: u64,
    interval: u64,
}

impl AutomaticSolver {
    /// For a system, with products by `application`; `factors` says whether factorizations are considered.
    pub(super) fn new(
        system: &System,
        options: &SolverOptions,
        application: Application,
        factors: bool,
    ) -> Result<Self> {
        let costs = CostModel::of(system);
        let iterative =
            CgSolver::new(system, PreconditionerKind::BlockJacobi, options.tolerance.strictest(), application)?;
        let solve = MULTIGRID_ITERATIONS * costs.iteration(PreconditionerKind::Multigrid);
        let is_wanted = factors && system.dofs().len() <= LARGEST_ANALYSED;
        Ok(Self {
            method: Method::BlockJacobi,
            iterative: iterative.interrupted_by(options.interrupt),
            other: None,
            direct: if is_wanted { Direct::Unknown } else { Direct::Never },
            par: options.par,
            multigrid_price: Price { once: costs.multigrid_setup(), solve },
            direct_price: Price::UNAFFORDABLE,
            costs,
            positions: vec![Vector3::zeros(); system.particles()],
            solves: 0.0,
            spent: 0.0,
            spent_in_all: 0.0,
            until_trial: FIRST_TRIAL,
            interval: FIRST_TRIAL,
        })
    }

    fn current(&self) -> &dyn LinearSolver {
        match (&self.direct, self.method) {
            (Direct::Ready(direct), Method::Cholesky) => &**direct,
            _ => &self.iterative,
        }
    }

    /// What the method may spend on the matrix at hand: what the cheaper of those that follow would.
    fn allowance(&self) -> f64 {
        let [multigrid, direct] = [self.multigrid_price, self.direct_price].map(|price| price.of(self.solves));
        match self.method {
            Method::BlockJacobi => multigrid.min(direct),
            Method::Multigrid => direct,
            Method::Cholesky => f64::INFINITY,
        }
    }

    /// Analyses the pattern, as far as factorizations seem to pay.
    fn analyse(&mut self, system: &System, work: &mut Work) {
        if !matches!(self.direct, Direct::Unknown) {
            return;
        }
        self.direct = Direct::Never;
        let most = HOPELESS * self.multigrid_price.of(1.0);
        let is_worth = |size: FactorSize, bytes: u64| Price::direct(&self.costs, size).of(1.0) <= most && fits(bytes);
        let glance = CholeskyEstimate::new(system, work).ok();
        let glance = glance.filter(|glance| is_worth(glance.least(), 8 * glance.least().entries as u64));
        let plan = glance.and_then(|glance| glance.plan(self.par).ok());
        if let Some(plan) = plan.filter(|plan| is_worth(plan.size(), plan.bytes())) {
            self.direct_price = Price::direct(&self.costs, plan.size());
            self.direct = Direct::Known(Box::new(plan));
        }
    }

    /// Changes to the cheaper one of those that follow; what cannot be had is not considered again.
    fn change(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        if self.method == Method::BlockJacobi {
            self.interval = self.interval.saturating_mul(2);
            self.until_trial = self.interval;
        }
        self.analyse(a.system(), work);
        self.spent = 0.0;
        let [multigrid, direct] = [self.multigrid_price, self.direct_price].map(|price| price.of(self.solves));
        if self.method == Method::Multigrid || direct <= multigrid {
            self.direct = match std::mem::replace(&mut self.direct, Direct::Never) {
                Direct::Known(plan) => {
                    plan.solver(a.system()).map_or(Direct::Never, |direct| Direct::Ready(Box::new(direct)))
                }
                direct => direct,
            };
            if let Direct::Ready(direct) = &mut self.direct {
                let taken = direct.take(a, work).map(drop);
                self.use_blocks();
                self.method = Method::Cholesky;
                return taken;
            }
            self.direct_price = Price::UNAFFORDABLE;
            return Ok(());
        }
        let made = || Preconditioner::new(PreconditionerKind::Multigrid, a.system());
        match self.other.take().map_or_else(made, Ok) {
            Ok(mut multigrid) => {
                multigrid.place(&self.positions);
                self.exchange(multigrid);
                self.method = Method::Multigrid;
                let setups = work.multigrid_setups;
                let updated = self.iterative.update_preconditioner(a, work);
                self.spent += (work.multigrid_setups - setups) as f64 * self.costs.multigrid_setup();
                updated
            }
            Err(_) => {
                self.multigrid_price = Price::UNAFFORDABLE;
                Ok(())
            }
        }
    }

    fn exchange(&mut self, mut preconditioner: Preconditioner) {
        self.iterative.exchange_preconditioner(&mut preconditioner);
        self.other = Some(preconditioner);
    }

    /// Gives conjugate gradients their first preconditioner back.
    fn use_blocks(&mut self) {
        if self.method == Method::Multigrid
            && let Some(blocks) = self.other.take()
        {
            self.exchange(blocks);
        }
        self.method = Method::BlockJacobi;
    }

    /// Block Jacobi once more, where it is time to try it.
    fn try_again(&mut self) {
        if self.method == Method::BlockJacobi {
            return;
        }
        if self.until_trial > 0 {
            self.until_trial -= 1;
            return;
        }
        self.use_blocks();
    }

    fn kind(&self) -> PreconditionerKind {
        match self.method {
            Method::Multigrid => PreconditionerKind::Multigrid,
            Method::BlockJacobi | Method::Cholesky => PreconditionerKind::BlockJacobi,
        }
    }
}

impl LinearSolver for AutomaticSolver {
    fn name(&self) -> &'static str {
        self.current().name()
    }

    fn preconditioner(&self) -> Option<&'static str> {
        self.current().preconditioner()
    }

    fn factor(&self) -> Option<FactorReport> {
        match &self.direct {
            Direct::Known(plan) => Some(plan.report()),
            Direct::Ready(direct) => direct.factor(),
            Direct::Unknown | Direct::Never => None,
        }
    }

    fn choice(&self) -> Option<String> {
        let [multigrid, direct] = [self.multigrid_price, self.direct_price].map(|price| price.of(1.0));
        let direct = match self.direct {
            Direct::Unknown => "a factorization has not been considered".into(),
            Direct::Never => "a factorization costs far more, or is too large".into(),
            Direct::Known(_) | Direct::Ready(_) => format!("a factorization and a solve cost {direct:.0}"),
        };
        let what = self.preconditioner().map_or(String::new(), |preconditioner| format!(" with {preconditioner}"));
        Some(format!("{}{what}: in force evaluations, multigrid costs about {multigrid:.0}; {direct}", self.name()))
    }

    fn place(&mut self, positions: &[Vector3<f64>]) {
        self.positions.iter_mut().zip(positions).for_each(|(place, position)| *place = *position);
        self.iterative.place(positions);
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        (self.solves, self.spent) = (0.0, 0.0);
        if self.spent_in_all > LOOK * self.costs.least_analysis() {
            self.analyse(a.system(), work);
        }
        self.try_again();
        match (&mut self.direct, self.method) {
            (Direct::Ready(direct), Method::Cholesky) => direct.take(a, work),
            _ => {
                let setups = work.multigrid_setups;
                let taken = self.iterative.take(a, work);
                self.spent += (work.multigrid_setups - setups) as f64 * self.costs.multigrid_setup();
                taken
            }
        }
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.iterative.set_tolerance(tolerance);
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        self.solves += 1.0;
        loop {
            if let (Direct::Ready(direct), Method::Cholesky) = (&mut self.direct, self.method) {
                let solved = direct.solve(a, b, x, work)?;
                // A trial begins where conjugate gradients would be.
                self.iterative.remember(x);
                return Ok(solved);
            }
            let iteration = self.costs.iteration(self.kind());
            let own_limit = self.iterative.method().iteration_limit;
            let most = ((self.allowance() - self.spent) / iteration).max(1.0) as u64;
            self.iterative.method().iteration_limit = own_limit.min(most);
            let before = work.cg_iterations;
            let solved = self.iterative.solve(a, b, x, work);
            self.iterative.method().iteration_limit = own_limit;
            let cost = (work.cg_iterations - before) as f64 * iteration;
            self.spent += cost;
            match self.method {
                Method::BlockJacobi => self.spent_in_all += cost,
                Method::Multigrid if solved.is_ok() => {
                    self.multigrid_price.solve = 0.5 * (self.multigrid_price.solve + cost);
                }
                Method::Multigrid => self.multigrid_price.solve = self.multigrid_price.solve.max(cost),
                Method::Cholesky => {}
            }
            match solved {
                Err(SolveFailure::NotConverged { reason: NotConverged::IterationLimit, .. }) if most < own_limit => {
                    self.change(&a, work)?;
                }
                _ => return solved,
            }
        }
    }

    fn solve_aside(
        &mut self,
        a: Held<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        match (&mut self.direct, self.method) {
            (Direct::Ready(direct), Method::Cholesky) => direct.solve(a, b, x, work),
            _ => self.iterative.solve_aside(a, b, x, tolerance, work),
        }
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests;
