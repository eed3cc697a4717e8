//! `energy.csv`: the energies over time.

use super::AtomicFile;
use super::checksum::{Checksum, Tally};
use crate::error::{Error, Result};
use crate::force::Energy;
use crate::integrate::Balance;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::PathBuf;

/// `energy.csv` while a run is under way: header `time,kinetic,elastic,gravitational,total,work,dissipated,imbalance`, one row
/// per recorded step, time in s and energies in J, the last three since the start of the run. An energy that is not finite is
/// left empty. The file appears at [`finish`](Self::finish); memory does not grow with the number of rows.
#[derive(Debug)]
pub struct EnergyLog {
    target: PathBuf,
    rows: csv::Writer<Tally<AtomicFile>>,
}

/// How far an `energy.csv` is that a checkpoint goes on with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogPosition {
    /// Its length.
    pub bytes: u64,
    /// The checksum of these bytes.
    pub checksum: String,
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
        let rows = csv::Writer::from_writer(Tally::new(AtomicFile::create(&target)?));
        Ok(Self { target, rows })
    }

    /// Starts a file that a later process can go on with.
    ///
    /// # Errors
    /// [`Error::Io`] when its folder cannot be written.
    pub fn create_resumable(target: impl Into<PathBuf>) -> Result<Self> {
        let target = target.into();
        let rows = csv::Writer::from_writer(Tally::new(AtomicFile::create_resumable(&target)?));
        Ok(Self { target, rows })
    }

    /// Goes on with a file behind a position.
    ///
    /// # Errors
    /// [`Error::Io`] when it is not there, or has other bytes.
    pub fn resume(target: impl Into<PathBuf>, position: &LogPosition) -> Result<Self> {
        let target = target.into();
        let mut sum = Checksum::default();
        let file =
            AtomicFile::resume(&target, position.bytes, |bytes| Checksum::of(bytes).text() == position.checksum)?;
        let before = std::fs::read(file.unfinished()).map_err(|source| Error::io(&target, source))?;
        sum.add(&before);
        let rows = Tally::after(file, position.bytes, sum);
        let rows = csv::WriterBuilder::new().has_headers(position.bytes == 0).from_writer(rows);
        Ok(Self { target, rows })
    }

    /// Where it is: everything before that is in the file, whatever happens to the process.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn position(&mut self) -> Result<LogPosition> {
        self.rows.flush().map_err(|source| Error::io(&self.target, source))?;
        let (bytes, checksum) = self.rows.get_ref().so_far();
        Ok(LogPosition { bytes, checksum: checksum.text() })
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
        rows.into_inner().map_err(|failed| Error::io(target, failed.into_error()))?.into_inner().commit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a position says is in the file, should the process end there.
    #[test]
    fn positions_are_on_disk() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = EnergyLog::create_resumable(folder.path().join("energy.csv")).unwrap();
        let energy = Energy { kinetic: 1.0, elastic: 0.25, gravitational: -2.0 };
        let balance = Balance { work: 0.5, dissipated: 0.125, imbalance: 0.0 };
        for time in [0.0, 0.5] {
            log.push(time, &energy, &balance).unwrap();
            let position = log.position().unwrap();
            let written = std::fs::read(folder.path().join(".sprung-energy.csv.part")).unwrap();
            assert_eq!((position.bytes, position.checksum), (written.len() as u64, Checksum::of(&written).text()));
        }
    }

    /// From the first row, from the head alone, and from nothing: the bytes are those of a log that was never interrupted.
    #[test]
    fn a_log_goes_on_where_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let energy = Energy { kinetic: 1.0, elastic: 0.25, gravitational: -2.0 };
        let balance = Balance { work: 0.5, dissipated: 0.125, imbalance: f64::NAN };
        let path = |name: &str| folder.path().join(name);
        let mut log = EnergyLog::create(path("whole.csv")).unwrap();
        log.push(0.0, &energy, &balance).unwrap();
        let after_one = log.position().unwrap();
        log.push(0.5, &energy, &balance).unwrap();
        log.finish().unwrap();
        let whole = std::fs::read_to_string(path("whole.csv")).unwrap();
        let rows = ["0.0,1.0,0.25,-2.0,-0.75,0.5,0.125,", "0.5,1.0,0.25,-2.0,-0.75,0.5,0.125,"];
        assert_eq!(whole.lines().skip(1).collect::<Vec<_>>(), rows);
        assert_eq!(after_one.bytes as usize, whole.find("0.5,1.0").unwrap());

        let mut log = EnergyLog::resume(path("whole.csv"), &after_one).unwrap();
        assert_eq!(log.position().unwrap(), after_one);
        log.push(0.5, &energy, &balance).unwrap();
        log.finish().unwrap();
        assert_eq!(std::fs::read_to_string(path("whole.csv")).unwrap(), whole);

        let nothing = LogPosition { bytes: 0, checksum: Checksum::default().text() };
        let mut log = EnergyLog::resume(path("whole.csv"), &nothing).unwrap();
        log.push(0.0, &energy, &balance).unwrap();
        assert_eq!(log.position().unwrap(), after_one);
        drop(log);
        let other = LogPosition { checksum: "0".repeat(16), ..after_one };
        assert!(EnergyLog::resume(path("whole.csv"), &other).is_err());
    }
}
