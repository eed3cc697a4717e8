//! `energy.csv`: the energies over time.

use super::AtomicFile;
use crate::error::{Error, Result};
use crate::force::Energy;
use crate::integrate::Balance;
use serde::Serialize;
use std::io;
use std::path::PathBuf;

/// `energy.csv` while a run is under way: header `time,kinetic,elastic,gravitational,total,work,dissipated,imbalance`, one row
/// per recorded step, time in s and energies in J, the last three since the start of the run. An energy that is not finite is
/// left empty. The file appears at [`finish`](Self::finish); memory does not grow with the number of rows.
#[derive(Debug)]
pub struct EnergyLog {
    target: PathBuf,
    rows: csv::Writer<AtomicFile>,
}

#[derive(Serialize)]
struct Row {
    time: f64,
    kinetic: Option<f64>,
    elastic: Option<f64>,
    gravitational: Option<f64>,
    total: Option<f64>,
    work: Option<f64>,
    dissipated: Option<f64>,
    imbalance: Option<f64>,
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

    /// Adds the row of a time, in s: the energy of the state, and where it went since the start.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn push(&mut self, time: f64, energy: &Energy, balance: &Balance) -> Result<()> {
        let finite = |value: f64| value.is_finite().then_some(value);
        let row = Row {
            time,
            kinetic: finite(energy.kinetic),
            elastic: finite(energy.elastic),
            gravitational: finite(energy.gravitational),
            total: finite(energy.total()),
            work: finite(balance.work),
            dissipated: finite(balance.dissipated),
            imbalance: finite(balance.imbalance),
        };
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
