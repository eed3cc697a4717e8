//! Conjugate gradients as a time step's solver, matrix-free or on the assembled A.

use super::LinearSolver;
use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure};
use super::preconditioner::{NotPositiveBlock, Preconditioner, PreconditionerKind};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
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
#[derive(Debug, Clone)]
pub struct CgSolver {
    method: ConjugateGradient,
    preconditioner: Preconditioner,
    application: Application,
}

impl CgSolver {
    /// Matrix-free.
    pub fn matrix_free(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Self {
        Self::new(system, preconditioner, tolerance, Application::MatrixFree)
    }

    /// On the assembled matrix.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn assembled(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Result<Self> {
        let matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?));
        Ok(Self::new(system, preconditioner, tolerance, Application::Assembled(Box::new(matrix))))
    }

    fn new(system: &System, kind: PreconditionerKind, tolerance: f64, application: Application) -> Self {
        let dofs = system.dofs();
        let method = ConjugateGradient::new(dofs.len(), tolerance);
        Self { method, preconditioner: Preconditioner::new(kind, dofs), application }
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

    fn prepare(&mut self, a: &SystemOperator, _work: &mut Work) -> Result<Definiteness, SolveFailure> {
        let update = match &mut self.application {
            Application::MatrixFree => self.preconditioner.update(a),
            Application::Assembled(matrix) => {
                matrix.refill(a);
                self.preconditioner.update(matrix.matrix())
            }
        };
        update.map_err(|NotPositiveBlock(dof)| SolveFailure::Indefinite(Evidence::DiagonalBlock(dof)))?;
        Ok(Definiteness::Unknown)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.method.tolerance = tolerance;
    }

    fn solve(
        &mut self,
        a: &SystemOperator,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        let report = match &self.application {
            Application::MatrixFree => self.method.solve(a, &self.preconditioner, b, x),
            Application::Assembled(matrix) => self.method.solve(matrix.matrix(), &self.preconditioner, b, x),
        };
        work.solves += 1;
        work.cg_iterations += report.iterations;
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
