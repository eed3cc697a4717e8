//! `summary.json`: what a run did and how it ended.

use super::AtomicFile;
use crate::error::Result;
use crate::force::Energy;
use crate::integrate::{RunFailure, Statistics, Status};
use crate::linear::FactorReport;
use serde::Serialize;
use std::io::{self, Write};
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
    /// Total energy at both ends of the run.
    pub energy: EnergyChange,
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

/// Total energy at both ends of a run, in J.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EnergyChange {
    /// At the start.
    pub initial: f64,
    /// At the last good state.
    #[serde(rename = "final")]
    pub last: f64,
}

impl EnergyChange {
    /// From one energy to another.
    pub fn between(initial: &Energy, last: &Energy) -> Self {
        Self { initial: initial.total(), last: last.total() }
    }
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

impl From<&RunFailure> for FailureReport {
    fn from(failed: &RunFailure) -> Self {
        Self { step: failed.step, time: failed.time, message: failed.failure.to_string() }
    }
}
