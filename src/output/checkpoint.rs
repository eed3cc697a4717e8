//! What a run needs to go on where it was: `checkpoint`, one line of JSON between one that names the format and a checksum.
//!
//! The solvers' memory (factors, first guesses, coarse levels, what `auto` has learnt) is not kept. A run with checkpoints
//! forgets it at each of them, whether it was interrupted there or not, and starts again from the state alone; that is what makes the
//! bits of both the same. Numbers are written in the shortest form that reads back to the same bits.

use super::checksum::{Checksum, Tally};
use super::{AtomicFile, LogPosition, OutputFolder};
use crate::error::{Error, Result};
use crate::integrate::{MonitorCheckpoint, Statistics};
use crate::memory;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The file's name.
pub const CHECKPOINT: &str = "checkpoint";

/// The name that the last checkpoint of a run has once that has come to its end: a longer run may go on from it.
pub const FINISHED: &str = "checkpoint.finished";

/// The first line. The number changes with the meaning of what follows.
const FORMAT: &str = "sprung checkpoint 3";

/// Bytes that reading holds at most for a byte of a checkpoint.
const BYTES: u64 = 6;

/// A run at one of its steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Of the scene and of how it is run, see [`fingerprint`]: another run cannot go on from here.
    pub run: String,
    /// What depends on the length of the run: where it is the same, a run of another length has the same bits up to here.
    pub length: String,
    /// Steps from one checkpoint to the next.
    pub every: u64,
    /// Steps that the run counts, or records where its steps are adaptive: a multiple of `every`.
    pub reached: u64,
    /// Steps done.
    pub steps: u64,
    /// Time, in s.
    pub time: f64,
    /// Positions, in m.
    pub positions: Vec<[f64; 3]>,
    /// Velocities, in m/s.
    pub velocities: Vec<[f64; 3]>,
    /// Work done.
    pub statistics: Statistics,
    /// Seconds that the run has taken.
    pub wall_seconds: f64,
    /// What accompanies the run: energies, indicators.
    pub account: MonitorCheckpoint,
    /// How far `energy.csv` is.
    pub energies: LogPosition,
    /// Time and step of every frame.
    pub frames: Vec<(f64, u64)>,
}

impl Checkpoint {
    /// Writes the file, replacing an older one in one move.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        AtomicFile::write(folder.join(CHECKPOINT), |file| self.write_to(file))
    }

    /// Writes the file's bytes.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_to(&self, mut file: impl Write) -> io::Result<()> {
        let mut lines = Tally::new(&mut file);
        writeln!(lines, "{FORMAT}")?;
        serde_json::to_writer(&mut lines, self).map_err(io::Error::from)?;
        lines.write_all(b"\n")?;
        let (_, checksum) = lines.so_far();
        writeln!(file, "{}", checksum.text())
    }

    /// Reads the checkpoint of a folder; `None` where there is none.
    ///
    /// # Errors
    /// [`Error::Io`] for one that cannot be read, [`Error::Format`] for one that is damaged, or of another version.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        Self::read_file(folder.join(CHECKPOINT))
    }

    /// Reads the last checkpoint of a run that has come to its end; `None` where there is none.
    ///
    /// # Errors
    /// As for [`read`](Self::read).
    pub fn read_finished(folder: &Path) -> Result<Option<Self>> {
        Self::read_file(folder.join(FINISHED))
    }

    /// Puts the checkpoint of a folder, if there is one, aside as that of a run that has come to its end.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be renamed.
    pub fn finish(folder: &OutputFolder) -> Result<()> {
        folder.rename(CHECKPOINT, FINISHED)
    }

    /// Takes the checkpoint of a run that has come to its end, if there is one, as that of a run which goes on.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be renamed.
    pub fn reopen(folder: &OutputFolder) -> Result<()> {
        folder.rename(FINISHED, CHECKPOINT)
    }

    /// Removes the checkpoints of an earlier run.
    ///
    /// # Errors
    /// [`Error::Io`] when one cannot be removed.
    pub fn forget(folder: &OutputFolder) -> Result<()> {
        folder.remove(CHECKPOINT)?;
        folder.remove(FINISHED)
    }

    fn read_file(file: PathBuf) -> Result<Option<Self>> {
        let bytes = match std::fs::metadata(&file) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            metadata => metadata.map_err(|source| Error::io(&file, source))?.len(),
        };
        memory::ensure(bytes.saturating_mul(BYTES), "the checkpoint")?;
        let bytes = std::fs::read(&file).map_err(|source| Error::io(&file, source))?;
        Self::parse(&bytes).map(Some).map_err(|message| Error::Format { file, message })
    }

    /// From the bytes of a file.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let damaged = || "the checkpoint is damaged".to_owned();
        let text = str::from_utf8(bytes).map_err(|_| damaged())?;
        let mut lines = text.split_inclusive('\n');
        let (Some(format), Some(json), Some(checksum), None) = (lines.next(), lines.next(), lines.next(), lines.next())
        else {
            return Err(damaged());
        };
        if format.trim_end() != FORMAT {
            return Err(format!("is no checkpoint that this version can read: it begins with {:?}", format.trim_end()));
        }
        let summed = &bytes[..format.len() + json.len()];
        if checksum.trim_end() != Checksum::of(summed).text() {
            return Err(damaged());
        }
        let checkpoint: Self = serde_json::from_str(json).map_err(|error| format!("{}: {error}", damaged()))?;
        let state = checkpoint.state();
        let fits = checkpoint.every > 0 && state.positions.len() == state.velocities.len();
        if fits && state.is_finite() { Ok(checkpoint) } else { Err(damaged()) }
    }

    /// The state.
    pub fn state(&self) -> State {
        let vectors = |rows: &[[f64; 3]]| rows.iter().map(|&row| Vector3::from(row)).collect();
        State { time: self.time, positions: vectors(&self.positions), velocities: vectors(&self.velocities) }
    }
}

/// Rows of numbers as a checkpoint has them.
pub fn rows(vectors: &[Vector3<f64>]) -> Vec<[f64; 3]> {
    vectors.iter().map(|&v| v.into()).collect()
}

/// A few digits for everything that decides about the bits of a run: the system, the state that it starts from, and `how` it is run.
pub fn fingerprint(system: &System, start: &State, how: &str) -> String {
    let mut sum = Checksum::default();
    let mut number = |x: f64| sum.add(&x.to_bits().to_le_bytes());
    number(system.dimension() as f64);
    system.gravity().iter().chain(start.positions.iter().chain(&start.velocities).flatten()).for_each(|&x| number(x));
    system.masses().iter().for_each(|&m| number(m));
    for (pair, spring) in system.pairs().iter().zip(system.springs()) {
        pair.iter().for_each(|&p| number(f64::from(p)));
        [spring.stiffness, spring.rest_length, spring.damping].into_iter().for_each(&mut number);
    }
    for (dof, place, motion) in system.prescribed().iter() {
        [dof.particle as f64, dof.axis as f64, place, motion as f64].into_iter().for_each(&mut number);
    }
    number(start.time);
    sum.add(format!("{:?}", system.prescribed().motions()).as_bytes());
    sum.add(format!("{:?}{:?}", system.loads(), system.behaviour()).as_bytes());
    sum.add(how.as_bytes());
    sum.add(env!("CARGO_PKG_VERSION").as_bytes());
    sum.text()
}

#[cfg(test)]
mod tests;
