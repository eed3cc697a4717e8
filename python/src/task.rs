//! What is run, for how long, and what comes of it.

use crate::error::invalid;
use crate::recorded::Recorded;
use pyo3::prelude::*;
use sprung::System;
use sprung::error::Invalid;
use sprung::integrate::Schedule;
use sprung::output::Summary;
use sprung::plan::{DEFAULT_STEP, RunOptions, records_every};
use std::num::NonZeroU64;

/// What is run.
pub struct Subject<'s> {
    pub name: &'s str,
    pub system: &'s System,
}

/// How long a run is, and how its steps and records are made.
#[derive(Debug, Clone, Copy)]
pub struct Pacing {
    pub duration: f64,
    /// Length of steps, or interval of records.
    pub interval: f64,
    /// The tolerance of adaptive steps.
    pub rtol: Option<f64>,
    /// Whether steps are adaptive because nothing was given.
    pub is_chosen: bool,
    pub stops_unstable: bool,
    pub every: NonZeroU64,
}

impl Pacing {
    /// What the arguments mean, as for the command.
    pub fn new(
        run_options: &RunOptions,
        duration: f64,
        dt: Option<f64>,
        stops_unstable: bool,
        every: u64,
    ) -> PyResult<Self> {
        let Some(every) = NonZeroU64::new(every) else {
            return Err(invalid(Invalid::new("every", every, "must be positive")));
        };
        if !(duration.is_finite() && duration > 0.0) {
            return Err(invalid(Invalid::new("duration", duration, "must be finite and positive")));
        }
        let rtol = if dt.is_none() { run_options.rtol_without_step() } else { run_options.rtol };
        let is_chosen = dt.is_none() && rtol.is_some() && run_options.rtol.is_none();
        let chosen =
            if rtol.is_some() || run_options.accuracy.is_some() { records_every(duration) } else { DEFAULT_STEP };
        let interval = dt.unwrap_or(chosen);
        Schedule::check(interval, duration).map_err(invalid)?;
        Ok(Self { duration, interval, rtol, is_chosen, stops_unstable, every })
    }
}

/// A number between zero and one.
pub fn fraction(key: &str, value: Option<f64>) -> PyResult<Option<f64>> {
    match value {
        Some(value) if !(value > 0.0 && value < 1.0) => {
            Err(invalid(Invalid::new(key, value, "must be between 0 and 1")))
        }
        value => Ok(value),
    }
}

/// A run that has ended.
pub struct Done {
    pub summary: Summary,
    pub recorded: Recorded,
}
