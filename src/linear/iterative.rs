//! Conjugate gradients as a time step's solver, matrix-free or on the assembled A.

use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure};
use super::preconditioner::{CustomPreconditioner, Preconditioner};
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

impl Application {
    /// Room for the assembled matrix of a system.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count, or than there is memory for.
    pub fn assembled(system: &System) -> Result<Self> {
        let matrix = SystemMatrix::try_zeros(Arc::new(SpringPattern::of_stiffness(system)?))?;
        Ok(Self::Assembled(Box::new(matrix)))
    }
}

/// Conjugate gradients with a preconditioner.
#[derive(Debug)]
pub struct CgSolver {
    method: ConjugateGradient,
    preconditioner: Preconditioner,
    application: Application,
    warm_start: WarmStart,
}

impl CgSolver {
    /// Matrix-free.
    ///
    /// # Errors
    /// For multigrid, more matrix blocks than 32-bit indices can count.
    pub fn matrix_free(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Result<Self> {
        Self::new(system, preconditioner, tolerance, Application::MatrixFree)
    }

    /// On the assembled matrix.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count, or than there is memory for.
    pub fn assembled(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Result<Self> {
        Self::new(system, preconditioner, tolerance, Application::assembled(system)?)
    }

    /// Matrix-free, with a preconditioner of your own.
    pub fn with_preconditioner(system: &System, own: Box<dyn CustomPreconditioner>, tolerance: f64) -> Self {
        Self::of(system, Preconditioner::Own(own), tolerance, Application::MatrixFree)
    }

    pub(super) fn new(
        system: &System,
        preconditioner: PreconditionerKind,
        tolerance: f64,
        application: Application,
    ) -> Result<Self> {
        Ok(Self::of(system, Preconditioner::new(preconditioner, system)?, tolerance, application))
    }

    fn of(system: &System, preconditioner: Preconditioner, tolerance: f64, application: Application) -> Self {
        let order = system.dofs().len();
        Self {
            method: ConjugateGradient::new(order, tolerance),
            preconditioner,
            application,
            warm_start: WarmStart::new(order),
        }
    }

    /// Makes iterations end when asked to.
    pub fn interrupted_by(mut self, interrupt: Interrupt) -> Self {
        self.method.interrupt = interrupt;
        self
    }

    /// Records a solution that another solver found, for first guesses.
    pub(super) fn remember(&mut self, x: &[f64]) {
        self.warm_start.record(x);
    }

    /// Exchanges the preconditioner for another one, which has to be [updated](Self::update_preconditioner) before the next solve.
    pub(super) fn exchange_preconditioner(&mut self, other: &mut Preconditioner) {
        std::mem::swap(&mut self.preconditioner, other);
    }

    /// Makes the preconditioner fit a matrix.
    pub(super) fn update_preconditioner(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.preconditioner.update(a, work)
    }

    /// The method: its parameters, and the direction of negative curvature after a failure.
    pub fn method(&mut self) -> &mut ConjugateGradient {
        &mut self.method
    }

    /// Solves from the given x.
    fn iterate(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], work: &mut Work) -> CgReport {
        let Self { method, preconditioner, application, .. } = self;
        work.solves += 1;
        work.iterative_solves += 1;
        let report = match &*application {
            Application::MatrixFree => method.solve(a, preconditioner, b, x),
            Application::Assembled(matrix) => method.solve(matrix.matrix(), preconditioner, b, x),
        };
        work.cg_iterations += report.iterations;
        match preconditioner.kind() {
            Some(PreconditionerKind::None) => work.plain_iterations += report.iterations,
            Some(PreconditionerKind::Multigrid) => work.multigrid_iterations += report.iterations,
            _ => {}
        }
        report
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
    }

    fn take(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if let Application::Assembled(matrix) = &mut self.application {
            matrix.refill(a);
        }
        self.update_preconditioner(a, work).map(|()| Definiteness::Unknown)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.method.tolerance = tolerance;
    }

    fn solve(&mut self, a: Held<'_>, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        if x.iter().all(|&x| x == 0.0) {
            let Self { application, warm_start, .. } = self;
            work.warm_starts += u64::from(match &*application {
                Application::MatrixFree => warm_start.guess(&*a, b, x),
                Application::Assembled(matrix) => warm_start.guess(matrix.matrix(), b, x),
            });
        }
        let report = self.iterate(&a, b, x, work);
        if report.outcome == CgOutcome::Converged {
            self.warm_start.record(x);
            if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
                multigrid.record(report.iterations, (report.first_residual / self.method.tolerance).log10());
            }
        }
        accept(&report)
    }

    fn solve_aside(
        &mut self,
        a: Held<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        x.fill(0.0);
        let own = std::mem::replace(&mut self.method.tolerance, tolerance);
        let report = self.iterate(&a, b, x, work);
        self.method.tolerance = own;
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
