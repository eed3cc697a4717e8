//! `energy.csv`: the energies over time.

use super::AtomicFile;
use crate::error::{Error, Result};
use std::io;
use std::path::PathBuf;

/// One row of `energy.csv`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EnergyRow {
    /// t, in s.
    pub time: f64,
    /// Kinetic energy, in J.
    pub kinetic: f64,
    /// Elastic energy, in J.
    pub elastic: f64,
    /// Potential energy in the gravitational field, in J; zero at the origin.
    pub gravitational: f64,
    /// Sum of the three, in J.
    pub total: f64,
}

/// `energy.csv` while a run is under way: header `time,kinetic,elastic,gravitational,total`, one row per recorded
/// step. The file appears at [`finish`](Self::finish); memory does not grow with the number of rows.
#[derive(Debug)]
pub struct EnergyLog {
    target: PathBuf,
    rows: csv::Writer<AtomicFile>,
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

    /// Adds a row.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn push(&mut self, row: &EnergyRow) -> Result<()> {
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
