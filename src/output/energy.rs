//! `energy.csv`, the energies over time, and checksums, which a continued file must match.

use super::AtomicFile;
use crate::error::{Error, Result};
use crate::force::Energy;
use crate::integrate::Balance;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::PathBuf;

/// `energy.csv` during a run: `time,kinetic,elastic,gravitational,total,work,dissipated,imbalance` of every recorded step, in s and J, the last three
/// since the start of the run. An energy that is not finite is left empty. The file appears at [`finish`](Self::finish).
#[derive(Debug)]
pub struct EnergyLog {
    rows: csv::Writer<Tally<AtomicFile>>,
}

/// The position in an `energy.csv` that a checkpoint continues.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogPosition {
    /// Its length.
    pub bytes: u64,
    /// The checksum of these bytes.
    pub checksum: String,
}

const COLUMNS: [&str; 8] = ["time", "kinetic", "elastic", "gravitational", "total", "work", "dissipated", "imbalance"];

impl EnergyLog {
    fn new(file: Tally<AtomicFile>) -> Result<Self> {
        let is_empty = file.bytes == 0;
        let mut log = Self { rows: csv::Writer::from_writer(file) };
        if is_empty {
            log.add(COLUMNS)?;
        }
        Ok(log)
    }

    fn add(&mut self, row: impl Serialize) -> Result<()> {
        self.rows.serialize(row).map_err(|error| self.error(error.into()))
    }

    fn error(&self, source: io::Error) -> Error {
        Error::io(&self.rows.get_ref().inner.target, source)
    }

    /// Starts the file.
    pub fn create(target: impl Into<PathBuf>) -> Result<Self> {
        Self::new(Tally::new(AtomicFile::create(target)?))
    }

    /// Starts a file that a later process can continue.
    pub fn create_resumable(target: impl Into<PathBuf>) -> Result<Self> {
        Self::new(Tally::new(AtomicFile::create_resumable(target)?))
    }

    /// Continues a file after a position.
    ///
    /// # Errors
    /// [`Error::Io`] when it does not exist, or has other bytes.
    pub fn resume(target: impl Into<PathBuf>, position: &LogPosition) -> Result<Self> {
        let is_right = |bytes: &[u8]| Checksum::of(bytes).text() == position.checksum;
        let file = AtomicFile::resume(target, position.bytes, is_right)?;
        let before = std::fs::read(file.unfinished()).map_err(|source| Error::io(&file.target, source))?;
        Self::new(Tally { inner: file, bytes: position.bytes, checksum: Checksum::of(&before) })
    }

    /// The position up to which everything is in the file, whatever happens to the process.
    pub fn position(&mut self) -> Result<LogPosition> {
        self.rows.flush().map_err(|source| self.error(source))?;
        Ok(self.rows.get_ref().position())
    }

    /// Adds the row of a time, in s: the energy of the state, and the balance since the start.
    pub fn push(&mut self, time: f64, energy: &Energy, balance: &Balance) -> Result<()> {
        let Energy { kinetic, elastic, gravitational } = *energy;
        let Balance { work, dissipated, imbalance } = *balance;
        let energies = [kinetic, elastic, gravitational, energy.total(), work, dissipated, imbalance];
        self.add((time, energies.map(|value| value.is_finite().then_some(value))))
    }

    /// Completes the file.
    pub fn finish(self) -> Result<()> {
        let target = self.rows.get_ref().inner.target.clone();
        self.rows.into_inner().map_err(|failed| Error::io(target, failed.into_error()))?.inner.commit()
    }
}

/// FNV-1a of 64 bits, which detects damaged files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Checksum(u64);

impl Default for Checksum {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Checksum {
    pub fn of(bytes: &[u8]) -> Self {
        let mut checksum = Self::default();
        checksum.add(bytes);
        checksum
    }

    pub fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// Sixteen hexadecimal digits.
    pub fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// A writer that counts its bytes and sums them up.
#[derive(Debug)]
pub struct Tally<W> {
    inner: W,
    bytes: u64,
    checksum: Checksum,
}

impl<W> Tally<W> {
    pub fn new(inner: W) -> Self {
        Self { inner, bytes: 0, checksum: Checksum::default() }
    }

    pub fn position(&self) -> LogPosition {
        LogPosition { bytes: self.bytes, checksum: self.checksum.text() }
    }
}

impl<W: Write> Write for Tally<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.bytes += written as u64;
        self.checksum.add(bytes.get(..written).unwrap_or(bytes));
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A position is on disk. Continued after the first row or from nothing, the bytes are those of a log that was never interrupted.
    #[test]
    fn logs_continue() {
        let folder = tempfile::tempdir().unwrap();
        let energy = Energy { kinetic: 1.0, elastic: 0.25, gravitational: -2.0 };
        let balance = Balance { work: 0.5, dissipated: 0.125, imbalance: f64::NAN };
        let path = |name: &str| folder.path().join(name);
        let mut log = EnergyLog::create_resumable(path("whole.csv")).unwrap();
        log.push(0.0, &energy, &balance).unwrap();
        let after_one = log.position().unwrap();
        let written = std::fs::read(path(".sprung-whole.csv.part")).unwrap();
        assert_eq!((after_one.bytes, &after_one.checksum), (written.len() as u64, &Checksum::of(&written).text()));
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

    /// The published values of FNV-1a.
    #[test]
    fn checksums_are_the_published_ones() {
        for (text, sum) in [("", "cbf29ce484222325"), ("a", "af63dc4c8601ec8c"), ("foobar", "85944171f73967e8")] {
            assert_eq!(Checksum::of(text.as_bytes()).text(), sum);
        }
    }
}
