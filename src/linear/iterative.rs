//! Conjugate gradients as a time step's solver, matrix-free or on the assembled A.

use super::LinearSolver;
use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure};
use super::preconditioner::{Preconditioner, PreconditionerKind};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
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

/// Conjugate gradients with a preconditioner.
#[derive(Debug)]
pub struct CgSolver {
    method: ConjugateGradient,
    preconditioner: Preconditioner,
    application: Application,
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
    /// More entries than 32-bit indices can count.
    pub fn assembled(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Result<Self> {
        let matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?));
        Self::new(system, preconditioner, tolerance, Application::Assembled(Box::new(matrix)))
    }

    fn new(system: &System, kind: PreconditionerKind, tolerance: f64, application: Application) -> Result<Self> {
        let method = ConjugateGradient::new(system.dofs().len(), tolerance);
        Ok(Self { method, preconditioner: Preconditioner::new(kind, system)?, application })
    }

    fn run(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], work: &mut Work) -> CgReport {
        let Self { method, preconditioner, application } = self;
        let report = match application {
            Application::MatrixFree => method.solve(a, preconditioner, b, x),
            Application::Assembled(matrix) => method.solve(matrix.matrix(), preconditioner, b, x),
        };
        work.cg_iterations += report.iterations;
        report
    }

    /// The method: its parameters, and the direction of negative curvature after a failure.
    pub fn method(&mut self) -> &mut ConjugateGradient {
        &mut self.method
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
        Some(self.preconditioner.kind().name())
    }

    fn place(&mut self, positions: &[Vector3<f64>]) {
        self.preconditioner.place(positions);
    }

    fn prepare(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if let Application::Assembled(matrix) = &mut self.application {
            matrix.refill(a);
        }
        self.preconditioner.update(a, work)?;
        Ok(Definiteness::Unknown)
    }

    fn solve(
        &mut self,
        a: &SystemOperator,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        work.solves += 1;
        let digits = -self.method.tolerance.log10();
        let patience = if let Preconditioner::Multigrid(multigrid) = &self.preconditioner { multigrid.patience(digits) } else { None };
        let limit = self.method.iteration_limit;
        if let Some(patience) = patience {
            self.method.iteration_limit = limit.min(patience);
        }
        let mut report = self.run(a, b, x, work);
        self.method.iteration_limit = limit;
        if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
            if patience.is_some() && report.outcome == CgOutcome::IterationLimit {
                multigrid.rebuild(a, work)?;
                report = self.run(a, b, x, work);
            } else if report.outcome == CgOutcome::Converged {
                multigrid.record(report.iterations, digits);
            }
        }
        accept(&report)
    }
}

fn accept(report: &CgReport) -> Result<Solution, SolveFailure> {
    let CgReport { outcome, iterations, relative_residual } = *report;
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
    }
}
