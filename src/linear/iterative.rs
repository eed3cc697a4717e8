//! Conjugate gradients as a time step's solver, matrix-free or on the assembled A.

use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::cost::CostModel;
use super::outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure};
use super::preconditioner::{Precondition, Preconditioner};
use super::preconditioner_kind::PreconditionerKind;
use super::warm_start::WarmStart;
use super::{Held, LinearSolver, Prepared};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::interrupt::Interrupt;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
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

/// Iterations with block Jacobi after which an automatic choice takes multigrid: about what the first solve with multigrid
/// costs, its analysis included. Whatever a scene needs, trying costs at most twice the better choice.
const TRIAL: u64 = 150;

/// Conjugate gradients with a preconditioner.
#[derive(Debug)]
pub struct CgSolver {
    method: ConjugateGradient,
    preconditioner: Preconditioner,
    application: Application,
    /// While block Jacobi is on trial: where the particles are, for multigrid.
    trial: Option<Vec<Vector3<f64>>>,
    warm_start: WarmStart,
    costs: CostModel,
    /// [Cost](CostModel) of set-ups, iterations and first guesses so far, and the most that it may grow to.
    effort: f64,
    allowed: f64,
}

impl CgSolver {
    /// Matrix-free. Without a preconditioner given it starts with block Jacobi, and changes to multigrid for good in the first
    /// solve that takes long.
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
        let preconditioner = Preconditioner::new(kind.unwrap_or(PreconditionerKind::BlockJacobi), system)?;
        let trial = kind.is_none().then(|| vec![Vector3::zeros(); system.particles()]);
        Ok(Self { trial, ..Self::of(system, preconditioner, tolerance, application) })
    }

    fn of(system: &System, preconditioner: Preconditioner, tolerance: f64, application: Application) -> Self {
        Self {
            method: ConjugateGradient::new(system.dofs().len(), tolerance),
            preconditioner,
            application,
            warm_start: WarmStart::new(system.dofs().len()),
            trial: None,
            costs: CostModel::of(system),
            effort: 0.0,
            allowed: f64::INFINITY,
        }
    }

    fn run(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], work: &mut Work) -> CgReport {
        let Self { method, preconditioner, application, .. } = self;
        let report = match application {
            Application::MatrixFree => method.solve(a, preconditioner, b, x),
            Application::Assembled(matrix) => method.solve(matrix.matrix(), preconditioner, b, x),
        };
        work.cg_iterations += report.iterations;
        if self.preconditioner.kind() == Some(PreconditionerKind::Multigrid) {
            work.multigrid_iterations += report.iterations;
        }
        self.effort += report.iterations as f64 * self.iteration();
        report
    }

    fn iteration(&self) -> f64 {
        self.costs.iteration(self.preconditioner.kind().unwrap_or(PreconditionerKind::BlockJacobi))
    }

    /// Makes iterations end when asked to.
    pub fn interrupted_by(mut self, interrupt: Interrupt) -> Self {
        self.method.interrupt = interrupt;
        self
    }

    /// What it has cost so far, counted, not timed, in [force evaluations](CostModel).
    pub fn effort(&self) -> f64 {
        self.effort
    }

    /// Lets the effort grow by so much; a solve that needs more ends as [`NotConverged::IterationLimit`].
    pub fn allow(&mut self, more: f64) {
        self.allowed = self.effort + more;
    }

    /// Iterations that can be afforded.
    fn affordable(&self) -> u64 {
        ((self.allowed - self.effort) / self.iteration()) as u64
    }

    /// Whether coarse levels can be afforded, and iterations that make them worth it.
    fn affords_multigrid(&self) -> bool {
        self.allowed - self.effort > 1.5 * self.costs.multigrid_setup()
    }

    /// Makes a preconditioner that has lost patience a better one.
    fn improve(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.effort += self.costs.multigrid_setup();
        if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
            return multigrid.rebuild(a, work);
        }
        // A system too large for multigrid's indices stays with what it has.
        if let Some(positions) = self.trial.take()
            && let Ok(mut multigrid) = Preconditioner::new(PreconditionerKind::Multigrid, a.system())
        {
            multigrid.place(&positions);
            multigrid.update(a, work)?;
            self.preconditioner = multigrid;
        }
        Ok(())
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
        if let Some(places) = &mut self.trial {
            places.copy_from_slice(positions);
        }
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if let Application::Assembled(matrix) = &mut self.application {
            matrix.refill(a);
        }
        let setups = work.multigrid_setups;
        let updated = self.preconditioner.update(a, work);
        self.effort += (work.multigrid_setups - setups) as f64 * self.costs.multigrid_setup();
        updated.map(|()| Definiteness::Unknown)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.method.tolerance = tolerance;
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        work.solves += 1;
        work.iterative_solves += 1;
        self.effort += self.costs.iterative_solve();
        if x.iter().all(|&x| x == 0.0) {
            let warm_start = &mut self.warm_start;
            let guessed = match &self.application {
                Application::MatrixFree => warm_start.guess(&*a, b, x),
                Application::Assembled(matrix) => warm_start.guess(matrix.matrix(), b, x),
            };
            work.warm_starts += u64::from(guessed);
            self.effort += self.costs.warm_start() * f64::from(u8::from(guessed));
        }
        let digits = -self.method.tolerance.log10();
        let patience = match &self.preconditioner {
            Preconditioner::Multigrid(multigrid) => multigrid.patience(digits),
            _ => self.trial.as_ref().map(|_| TRIAL),
        };
        let limit = self.method.iteration_limit;
        self.method.iteration_limit = limit.min(patience.unwrap_or(limit)).min(self.affordable());
        let mut report = self.run(&a, b, x, work);
        let digits = digits.min((report.first_residual / self.method.tolerance).log10());
        if patience.is_some() && report.outcome == CgOutcome::IterationLimit && self.affords_multigrid() {
            let improved = self.improve(&a, work);
            self.method.iteration_limit = limit.min(self.affordable());
            report = if improved.is_ok() { self.run(&a, b, x, work) } else { report };
            self.method.iteration_limit = limit;
            improved?;
        }
        self.method.iteration_limit = limit;
        if report.outcome == CgOutcome::Converged {
            self.warm_start.record(x);
            if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
                multigrid.record(report.iterations, digits);
            }
        }
        accept(&report)
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
