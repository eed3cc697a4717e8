//! `energy.csv`: the energies over time.

use super::AtomicFile;
use crate::error::{Error, Result};
use crate::force::Energy;
use serde::Serialize;
use std::io;
use std::path::PathBuf;

/// `energy.csv` while a run is under way: header `time,kinetic,elastic,gravitational,total`, one row per recorded step,
/// time in s and energies in J. The file appears at [`finish`](Self::finish); memory does not grow with the number of
/// rows.
#[derive(Debug)]
pub struct EnergyLog {
    target: PathBuf,
    rows: csv::Writer<AtomicFile>,
}

#[derive(Serialize)]
struct Row {
    time: f64,
    kinetic: f64,
    elastic: f64,
    gravitational: f64,
    total: f64,
}

impl EnergyLog {
    /// Starts the file.
    ///
    /// # Errors
    /// [`Error::Io`] when its folder cannot be written.
    pub fn create(target: impl Into<PathBuf>) -> Result<Self> {
        let target = target.into();
        let rows = csv::Writer::from_writer(AtomicFile::create(&target)?);
        Ok(Self { target, rows })
    }

    /// Adds the row of a time, in s.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn push(&mut self, time: f64, energy: &Energy) -> Result<()> {
        let Energy { kinetic, elastic, gravitational } = *energy;
        let row = Row { time, kinetic, elastic, gravitational, total: energy.total() };
        self.rows.serialize(row).map_err(|error| Error::io(&self.target, io::Error::from(error)))
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written or renamed.
    pub fn finish(self) -> Result<()> {
        let Self { target, rows } = self;
        rows.into_inner().map_err(|failed| Error::io(target, failed.into_error()))?.commit()
    }
}
