//! Conjugate gradients as a time step's solver, matrix-free or on the assembled A.

mod choice;

use super::budget::Budget;
use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::contest::Contest;
use super::cost::CostModel;
use super::outcome::{Definiteness, Evidence, NotConverged, Progress, Solution, SolveFailure};
use super::preconditioner::{Precondition, Preconditioner};
use super::preconditioner_kind::PreconditionerKind;
use super::reuse::Patience;
use super::warm_start::WarmStart;
use super::{Held, LinearSolver, Prepared};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::interrupt::Interrupt;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use choice::Choice;
use nalgebra::Vector3;
use std::sync::Arc;

/// How the products with A are made.
#[derive(Debug, Clone)]
pub enum Application {
    /// Spring by spring, without a matrix.
    MatrixFree,
    /// With the assembled sparse matrix.
    Assembled(Box<SystemMatrix>),
}

/// Conjugate gradients with a preconditioner.
#[derive(Debug)]
pub struct CgSolver {
    method: ConjugateGradient,
    preconditioner: Preconditioner,
    application: Application,
    /// Where none was asked for.
    choice: Option<Choice>,
    warm_start: WarmStart,
    /// For set-ups, iterations and first guesses.
    budget: Budget,
}

/// Iterations of a solve.
#[derive(Debug, Clone, Copy)]
struct Limit {
    /// After which it is time to look for something better.
    patience: Option<u64>,
    /// And how long to go on with old coarse levels then.
    coarse: Option<Patience>,
    most: u64,
}

impl CgSolver {
    /// Matrix-free. Without a preconditioner given it begins without one, and finds out whether block Jacobi or multigrid costs less.
    ///
    /// # Errors
    /// For multigrid, more matrix blocks than 32-bit indices can count.
    pub fn matrix_free(system: &System, preconditioner: Option<PreconditionerKind>, tolerance: f64) -> Result<Self> {
        Self::new(system, preconditioner, tolerance, Application::MatrixFree)
    }

    /// On the assembled matrix, preconditioned as [`matrix_free`](Self::matrix_free).
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn assembled(system: &System, preconditioner: Option<PreconditionerKind>, tolerance: f64) -> Result<Self> {
        let matrix = SystemMatrix::try_zeros(Arc::new(SpringPattern::of_stiffness(system)?))?;
        Self::new(system, preconditioner, tolerance, Application::Assembled(Box::new(matrix)))
    }

    /// Matrix-free, with a preconditioner of your own; it remains the only one. In [`effort`](Self::effort) an iteration counts as
    /// one with block Jacobi.
    pub fn with_preconditioner(system: &System, own: Box<dyn Precondition>, tolerance: f64) -> Self {
        Self::of(system, Preconditioner::Own(own), tolerance, Application::MatrixFree)
    }

    fn new(
        system: &System,
        kind: Option<PreconditionerKind>,
        tolerance: f64,
        application: Application,
    ) -> Result<Self> {
        let preconditioner = Preconditioner::new(kind.unwrap_or(Contest::FIRST), system)?;
        let solver = Self::of(system, preconditioner, tolerance, application);
        let choice = kind.is_none().then(|| Choice::new(system, &solver.budget.costs));
        Ok(Self { choice, ..solver })
    }

    fn of(system: &System, preconditioner: Preconditioner, tolerance: f64, application: Application) -> Self {
        Self {
            budget: Budget::new(costs(CostModel::of(system), &preconditioner)),
            method: ConjugateGradient::new(system.dofs().len(), tolerance),
            preconditioner,
            application,
            warm_start: WarmStart::new(system.dofs().len()),
            choice: None,
        }
    }

    /// Iterates as long as patience goes, and longer where a change would cost more, but no more than can be afforded.
    fn run(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], limit: Limit, work: &mut Work) -> CgReport {
        let kind = self.kind();
        let Self { method, preconditioner, application, choice, budget, .. } = self;
        let more = &mut |progress: Progress| {
            let left = limit.most.saturating_sub(progress.iterations);
            let more = match (&limit.coarse, &choice) {
                (Some(coarse), _) => coarse.more(progress),
                (None, Some(choice)) => choice.contest.more(kind, progress, budget),
                (None, None) => 0,
            };
            more.min(left)
        };
        let general = std::mem::replace(
            &mut method.iteration_limit,
            limit.patience.map_or(limit.most, |patience| patience.min(limit.most)),
        );
        let report = match application {
            Application::MatrixFree => method.solve_or_ask(a, preconditioner, b, x, more),
            Application::Assembled(matrix) => method.solve_or_ask(matrix.matrix(), preconditioner, b, x, more),
        };
        method.iteration_limit = general;
        work.cg_iterations += report.iterations;
        match self.preconditioner.kind() {
            Some(PreconditionerKind::None) => work.plain_iterations += report.iterations,
            Some(PreconditionerKind::Multigrid) => work.multigrid_iterations += report.iterations,
            _ => {}
        }
        self.budget.spend(report.iterations as f64 * self.budget.costs.iteration(self.kind()));
        report
    }

    /// The preconditioner, as far as costs are concerned.
    fn kind(&self) -> PreconditionerKind {
        self.preconditioner.kind().unwrap_or(PreconditionerKind::BlockJacobi)
    }

    /// Makes iterations end when asked to.
    pub fn interrupted_by(mut self, interrupt: Interrupt) -> Self {
        self.method.interrupt = interrupt;
        self
    }

    /// What it has cost so far, counted, not timed, in [force evaluations](CostModel).
    pub fn effort(&self) -> f64 {
        self.budget.spent()
    }

    /// Takes note of a solution that another solver found, for first guesses.
    pub(super) fn remember(&mut self, x: &[f64]) {
        self.warm_start.record(x);
    }

    /// Lets the effort grow by so much; a solve that needs more ends as [`NotConverged::IterationLimit`].
    pub fn allow(&mut self, more: f64) {
        self.budget.allow(more);
    }

    /// Iterations after which a solve is to go on with something better, if there is anything.
    fn patience(&self) -> Option<u64> {
        match &self.preconditioner {
            Preconditioner::Multigrid(_) => self.coarse().map(|patience| patience.first),
            _ if self.choice.is_some() => Contest::patience(self.kind()),
            _ => None,
        }
    }

    /// How long to go on with old coarse levels, where new ones can be afforded.
    fn coarse(&self) -> Option<Patience> {
        match &self.preconditioner {
            Preconditioner::Multigrid(multigrid) if self.budget.affords(PreconditionerKind::Multigrid) => {
                multigrid.patience()
            }
            _ => None,
        }
    }

    /// Gives a solve that has lost patience better coarse levels, or the preconditioner that seems to cost least, or all the patience there is where that
    /// cannot be had; `false` where it costs too much.
    fn improve(&mut self, report: &CgReport, a: &SystemOperator, work: &mut Work) -> Result<bool, SolveFailure> {
        let CgReport { iterations, first_residual, relative_residual, .. } = *report;
        let progress = Progress::new(iterations, first_residual, relative_residual, self.method.tolerance);
        let kind = self.kind();
        let better = self.choice.as_ref().and_then(|choice| choice.contest.better(kind, progress, &self.budget));
        let next = if kind == PreconditionerKind::Multigrid { Some(kind) } else { better.map(|(next, _)| next) };
        let Some(next) = next.filter(|&next| self.budget.affords(next)) else { return Ok(false) };
        if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
            self.budget.spend(self.budget.costs.multigrid_setup());
            if let Some(choice) = &mut self.choice {
                choice.contest.set_up(1.0);
            }
            return multigrid.rebuild(a, work).map(|()| true);
        }
        if self.change(next, a.system()) {
            self.prepare_for(a, work)?;
        }
        Ok(true)
    }

    /// Takes note of iterations.
    fn record(&mut self, report: &CgReport, x: &[f64]) {
        let is_done = report.outcome == CgOutcome::Converged;
        let reached = if is_done { self.method.tolerance } else { report.relative_residual };
        let digits = (report.first_residual / reached).log10();
        if is_done {
            self.warm_start.record(x);
        }
        let is_refused = matches!(report.outcome, CgOutcome::NegativeCurvature { .. });
        match &mut self.preconditioner {
            Preconditioner::Multigrid(multigrid) if is_done => multigrid.record(report.iterations, digits),
            Preconditioner::Multigrid(multigrid) if is_refused => multigrid.refused(),
            _ => {}
        }
        let kind = self.kind();
        if let Some(choice) = &mut self.choice {
            choice.contest.record(kind, report.iterations, digits);
            if is_refused {
                choice.contest.refused();
            }
        }
    }

    /// Changes to another preconditioner. Where there is no room for it, or it cannot count so many entries, the one at hand stays for good.
    fn change(&mut self, kind: PreconditionerKind, system: &System) -> bool {
        let before = self.kind();
        let Some(choice) = &mut self.choice else { return false };
        let Ok(mut preconditioner) = Preconditioner::new(kind, system) else {
            self.choice = None;
            return false;
        };
        preconditioner.place(&choice.places);
        self.budget.costs = costs(self.budget.costs, &preconditioner);
        self.preconditioner = preconditioner;
        choice.watch = None;
        choice.contest.changed(before, kind);
        true
    }

    fn prepare_for(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        let setups = work.multigrid_setups;
        let mut updated = self.preconditioner.update(a, work);
        let setups = (work.multigrid_setups - setups) as f64;
        let costs = self.budget.costs;
        self.budget.spend(costs.preparation(self.kind()) + setups * costs.multigrid_setup());
        let is_plain = self.kind() == PreconditionerKind::None;
        let Some(choice) = &mut self.choice else { return updated };
        choice.contest.set_up(setups);
        if is_plain && choice.is_watchful() {
            self.budget.spend(costs.preparation(PreconditionerKind::BlockJacobi));
            updated = choice.watch(a);
        }
        if matches!(updated, Err(SolveFailure::Indefinite(_))) {
            choice.contest.refused();
        }
        updated
    }

    /// The method: its parameters, and the direction of negative curvature after a failure.
    pub fn method(&mut self) -> &mut ConjugateGradient {
        &mut self.method
    }
}

impl Prepared<'_, CgSolver> {
    /// The method: its parameters, and the direction of negative curvature after a failure.
    pub fn method(&mut self) -> &mut ConjugateGradient {
        self.solver().method()
    }
}

impl LinearSolver for CgSolver {
    fn name(&self) -> &'static str {
        match self.application {
            Application::MatrixFree => "cg",
            Application::Assembled(_) => "cg-assembled",
        }
    }

    fn preconditioner(&self) -> Option<&'static str> {
        Some(self.preconditioner.name())
    }

    fn place(&mut self, positions: &[Vector3<f64>]) {
        self.preconditioner.place(positions);
        if let Some(choice) = &mut self.choice {
            choice.places.copy_from_slice(positions);
        }
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if let Application::Assembled(matrix) = &mut self.application {
            matrix.refill(a);
        }
        let kind = self.kind();
        let better = self.choice.as_mut().and_then(|choice| choice.next(kind, a, &self.budget.costs));
        if let Some(better) = better {
            self.change(better, a.system());
        }
        self.prepare_for(a, work).map(|()| Definiteness::Unknown)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.method.tolerance = tolerance;
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        work.solves += 1;
        work.iterative_solves += 1;
        self.budget.spend(self.budget.costs.iterative_solve());
        if x.iter().all(|&x| x == 0.0) {
            let warm_start = &mut self.warm_start;
            let guessed = match &self.application {
                Application::MatrixFree => warm_start.guess(&*a, b, x),
                Application::Assembled(matrix) => warm_start.guess(matrix.matrix(), b, x),
            };
            work.warm_starts += u64::from(guessed);
            self.budget.spend(self.budget.costs.warm_start() * f64::from(u8::from(guessed)));
        }
        loop {
            let patience = self.patience();
            let most = self.method.iteration_limit.min(self.budget.iterations(self.kind()));
            let report = self.run(&a, b, x, Limit { patience, coarse: self.coarse(), most }, work);
            self.record(&report, x);
            let is_late = report.outcome == CgOutcome::IterationLimit
                && patience.is_some_and(|patience| report.iterations >= patience);
            if !(is_late && self.improve(&report, &a, work)?) {
                return accept(&report);
            }
        }
    }
}

/// Costs where a preconditioner is at hand, of which more is known than of one that is not.
fn costs(costs: CostModel, preconditioner: &Preconditioner) -> CostModel {
    match preconditioner {
        Preconditioner::Multigrid(multigrid) => costs.with_coarse_levels(multigrid.multiplications()),
        _ => costs,
    }
}

fn accept(report: &CgReport) -> Result<Solution, SolveFailure> {
    let CgReport { outcome, iterations, relative_residual, .. } = *report;
    let not_converged = |reason| Err(SolveFailure::NotConverged { iterations, relative_residual, reason });
    match outcome {
        CgOutcome::Converged => Ok(Solution { relative_residual }),
        CgOutcome::NegativeCurvature { rayleigh_quotient, .. } => {
            let iteration = iterations;
            Err(SolveFailure::Indefinite(Evidence::NegativeCurvature { iteration, rayleigh_quotient }))
        }
        CgOutcome::Stagnated => not_converged(NotConverged::Stagnated),
        CgOutcome::IterationLimit => not_converged(NotConverged::IterationLimit),
        CgOutcome::NonFinite => Err(SolveFailure::NonFinite),
        CgOutcome::Interrupted => Err(SolveFailure::Interrupted),
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests;
