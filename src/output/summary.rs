//! `summary.json`: what a run did and how it ended.

use super::AtomicFile;
use crate::accuracy::{Answer, StepControl};
use crate::error::Result;
use crate::force::Energy;
use crate::integrate::{Balance, Outcome, RunFailure, Statistics, Status};
use crate::linear::FactorReport;
use serde::Serialize;
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;

/// What a run did and how it ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The scene's name.
    pub scene: String,
    /// How the run ended.
    pub status: Status,
    /// The method's name.
    pub method: &'static str,
    /// The stiffness policy's name; `none` for a method without matrices.
    pub stiffness: &'static str,
    /// The linear solver really used; `none` for a method without matrices.
    pub solver: &'static str,
    /// The preconditioner really used; `none` where there is none.
    pub preconditioner: &'static str,
    /// Why this solver, in words, where the program chose it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver_choice: Option<String>,
    /// Time step, in s; the last step may have been shorter.
    pub dt: f64,
    /// Steps done.
    pub steps: u64,
    /// Time reached, in s.
    pub time: f64,
    /// Number of particles.
    pub particles: usize,
    /// Number of springs.
    pub springs: usize,
    /// Number of free degrees of freedom.
    pub dofs: usize,
    /// Elapsed time from the set-up of the method to the last step, in s.
    pub wall_seconds: f64,
    /// `work` and `max_relative_residual`, and how many solves met an indefinite A.
    #[serde(flatten)]
    pub statistics: Statistics,
    /// Size of the factor of A and the time it took, for a solver that factors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor: Option<FactorReport>,
    /// Total energy at both ends of the run, and where it went between them.
    pub energy: EnergyChange,
    /// How wrong the positions are at the end, as far as the run can know it.
    pub error: Option<ErrorReport>,
    /// What makes the result doubtful, in words; empty when there is nothing to say.
    pub warnings: Vec<String>,
    /// What was spent.
    pub effort: Effort,
    /// Why this method and step, where they were chosen by the program.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub choice: Option<ChoiceReport>,
    /// What broke the run, if anything did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<FailureReport>,
}

impl Summary {
    /// Writes the summary as JSON.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when the file cannot be written.
    pub fn write(&self, target: impl Into<PathBuf>) -> Result<()> {
        AtomicFile::write(target, |file| {
            serde_json::to_writer_pretty(&mut *file, self).map_err(io::Error::from)?;
            file.write_all(b"\n")
        })
    }
}

/// What the program chose and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChoiceReport {
    /// Why, in one line.
    pub reason: String,
    /// The relative position error that was allowed at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Estimated relative position error of the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_error: Option<f64>,
    /// Tolerance of adaptive steps, where they were chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rtol: Option<f64>,
    /// Runs done for it, the one handed out included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub runs: Option<u32>,
}

impl ChoiceReport {
    /// Of a method that was chosen without a run.
    pub fn of_preset(reason: String) -> Self {
        Self { reason, accuracy: None, estimated_error: None, rtol: None, runs: None }
    }

    /// Of an answer of a required accuracy.
    pub fn of_answer<R>(answer: &Answer<R>, accuracy: f64, reason: String) -> Self {
        let rtol = match answer.control {
            StepControl::Adaptive { rtol, .. } => Some(rtol),
            StepControl::Step(_) => None,
        };
        Self {
            reason,
            accuracy: Some(accuracy),
            estimated_error: answer.estimated_error,
            rtol,
            runs: Some(answer.runs),
        }
    }
}

/// Total energy at both ends of a run and where it went between them, in J. Numbers that are not finite are written as null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EnergyChange {
    /// At the start.
    pub initial: f64,
    /// At the last good state.
    #[serde(rename = "final")]
    pub last: f64,
    /// What moving constraints put in, damping took, and neither explains.
    #[serde(flatten)]
    pub balance: Balance,
}

impl EnergyChange {
    /// From one energy to another, of which the balance says why.
    pub fn between(initial: &Energy, last: &Energy, balance: Balance) -> Self {
        Self { initial: initial.total(), last: last.total(), balance }
    }
}

/// How wrong the positions are at the end of a run: the relative error
/// [`relative_position_error`](crate::accuracy::relative_position_error).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorReport {
    /// The estimate; finite.
    pub estimate: f64,
    /// Where it comes from.
    pub kind: ErrorKind,
}

/// Where an estimate of the error comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorKind {
    /// The propagated error of the run itself, see [`PropagatedError`](crate::integrate::PropagatedError): right to about a factor of ten.
    Indicator,
    /// Runs that do not share their errors agree, and so does the propagated error.
    Confirmed,
}

/// What a result took, in evaluations of the forces of the scene: the time that the work takes over that of one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Effort {
    /// The run handed out.
    pub run: f64,
    /// Everything, with what was spent on choosing.
    pub total: f64,
}

/// What broke a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FailureReport {
    /// The step that could not be done, from 1.
    pub step: u64,
    /// The time at its start, in s.
    pub time: f64,
    /// Why it could not be done.
    pub message: String,
}

impl FailureReport {
    /// Of a run that did not come to its end, by itself or because it was asked to stop; `time` is that of its last good state.
    pub fn of(outcome: &Outcome, time: f64) -> Option<Self> {
        match &outcome.end {
            Err(failed) => Some(failed.into()),
            Ok(ControlFlow::Continue(())) => None,
            Ok(ControlFlow::Break(())) => Some(Self { step: outcome.steps + 1, time, message: "asked to stop".into() }),
        }
    }
}

impl From<&RunFailure> for FailureReport {
    fn from(failed: &RunFailure) -> Self {
        Self { step: failed.step, time: failed.time, message: failed.failure.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::FailureReport;
    use crate::integrate::Outcome;
    use std::ops::ControlFlow;

    /// A run that was asked to stop after ten steps could not do the eleventh.
    #[test]
    fn a_run_that_was_stopped_says_where() {
        let outcome = |flow| Outcome { steps: 10, end: Ok(flow) };
        assert_eq!(FailureReport::of(&outcome(ControlFlow::Continue(())), 2.5), None);
        let report = FailureReport::of(&outcome(ControlFlow::Break(())), 2.5);
        assert_eq!(report, Some(FailureReport { step: 11, time: 2.5, message: "asked to stop".into() }));
    }
}
