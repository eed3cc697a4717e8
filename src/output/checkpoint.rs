//! `checkpoint`, from which a run continues: a line with the format, one line of JSON, and a line with a checksum.
//!
//! Solver state (factors, initial guesses, coarse levels, the choices of `auto`) is not stored: a run resets it at every checkpoint, interrupted or not,
//! so both have the same bits.

use super::energy::{Checksum, Tally};
use super::{AtomicFile, LogPosition, OutputFolder};
use crate::error::{Error, Result};
use crate::integrate::{MonitorCheckpoint, Statistics, rows};
use crate::memory;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

const CHECKPOINT: &str = "checkpoint";

/// The name of a finished run's last checkpoint: a longer run may continue from it.
const FINISHED: &str = "checkpoint.finished";

/// The first line. The number changes with the format.
const FORMAT: &str = "sprung checkpoint 3";

/// A run at one of its steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Everything that determines the bits of the run, a name and a value on each line, the [`fingerprint`] of the scene among them.
    pub run: String,
    /// Options that depend on the length of the run: with the same ones a run of another length has the same bits up to here.
    pub length: String,
    /// Steps from one checkpoint to the next.
    pub every: u64,
    /// Steps of the schedule, or records where steps are adaptive: a multiple of `every`.
    pub reached: u64,
    /// Steps done.
    pub steps: u64,
    /// Time, in s.
    pub time: f64,
    /// Positions, in m.
    #[serde(with = "rows")]
    pub positions: Vec<Vector3<f64>>,
    /// Velocities, in m/s.
    #[serde(with = "rows")]
    pub velocities: Vec<Vector3<f64>>,
    /// Work done.
    pub statistics: Statistics,
    /// Seconds that the run has taken.
    pub wall_seconds: f64,
    /// The monitor: energies, error indicators.
    pub account: MonitorCheckpoint,
    /// The position in `energy.csv`.
    pub energies: LogPosition,
    /// Time and step of every frame.
    pub frames: Vec<(f64, u64)>,
}

impl Checkpoint {
    /// Writes the file, replacing an older one atomically.
    pub fn write(&self, folder: &Path) -> Result<()> {
        AtomicFile::write(folder.join(CHECKPOINT), |file| self.write_to(file))
    }

    /// Writes the file's bytes.
    pub fn write_to(&self, mut file: impl Write) -> io::Result<()> {
        let mut lines = Tally::new(&mut file);
        writeln!(lines, "{FORMAT}")?;
        serde_json::to_writer(&mut lines, self).map_err(io::Error::from)?;
        lines.write_all(b"\n")?;
        let LogPosition { checksum, .. } = lines.position();
        writeln!(file, "{checksum}")
    }

    /// Reads the checkpoint of a folder; `None` where there is none.
    ///
    /// # Errors
    /// [`Error::Io`] for one that cannot be read, [`Error::Format`] for one that is damaged, or of another version.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        Self::read_file(folder.join(CHECKPOINT))
    }

    /// Reads the last checkpoint of a finished run; `None` where there is none.
    pub fn read_finished(folder: &Path) -> Result<Option<Self>> {
        Self::read_file(folder.join(FINISHED))
    }

    /// Marks the checkpoint of a folder, if there is one, as that of a finished run.
    pub fn finish(folder: &OutputFolder) -> Result<()> {
        folder.rename(CHECKPOINT, FINISHED)
    }

    /// Marks the checkpoint of a finished run, if there is one, as that of a run under way.
    pub fn reopen(folder: &OutputFolder) -> Result<()> {
        folder.rename(FINISHED, CHECKPOINT)
    }

    /// Removes the checkpoints of an earlier run.
    pub fn forget(folder: &OutputFolder) -> Result<()> {
        folder.remove(CHECKPOINT)?;
        folder.remove(FINISHED)
    }

    fn read_file(file: PathBuf) -> Result<Option<Self>> {
        let bytes = match std::fs::metadata(&file) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            metadata => metadata.map_err(|source| Error::io(&file, source))?.len(),
        };
        // Parsing holds at most six bytes for a byte of the file.
        memory::ensure(bytes.saturating_mul(6), "the checkpoint")?;
        let bytes = std::fs::read(&file).map_err(|source| Error::io(&file, source))?;
        Self::parse(&bytes).map(Some).map_err(|message| Error::Format { file, message })
    }

    /// Parses the bytes of a file.
    ///
    /// # Errors
    /// A message for bytes that are no intact checkpoint of this version.
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
        State { time: self.time, positions: self.positions.clone(), velocities: self.velocities.clone() }
    }
}

/// A hash of everything in a scene that determines the bits of a run: the system and its initial state.
pub fn fingerprint(system: &System, start: &State) -> String {
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
    sum.text()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{Monitor, MonitorOptions};
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};

    fn builder() -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        builder.gravity(0.0, -9.81, 0.0);
        builder.particle([0.0, 0.1, 0.2], 1.0);
        builder.particle([1.0 / 3.0, 2.0, 3.0], 2.0);
        builder.spring(0, 1, Spring { stiffness: 5.0, rest_length: 1.0, damping: 0.5 });
        builder.hold(0);
        builder
    }

    fn checkpoint(system: &System, state: &State) -> Checkpoint {
        Checkpoint {
            run: "0123".into(),
            length: "None".into(),
            every: 5,
            reached: 10,
            steps: 10,
            time: 0.1 + 0.2,
            positions: state.positions.clone(),
            velocities: state.velocities.clone(),
            statistics: Statistics::default(),
            wall_seconds: 1.5,
            account: Monitor::new(system, state, MonitorOptions::default()).unwrap().account(),
            energies: LogPosition { bytes: 7, checksum: "89ab".into() },
            frames: vec![(0.0, 0), (0.3, 10)],
        }
    }

    #[test]
    fn damage_is_detected() {
        let (system, state) = builder().build().unwrap();
        let right = checkpoint(&system, &state);
        let mut bytes = Vec::new();
        right.write_to(&mut bytes).unwrap();
        for at in 0..bytes.len() - 1 {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(Checkpoint::parse(&changed).is_err(), "{at}");
        }
        let later = [b"sprung checkpoint 99", &bytes[19..]].concat();
        let message = Checkpoint::parse(&later).unwrap_err();
        assert!(message.contains("begins with \"sprung checkpoint 99"), "{message}");
        // Whole files with a state that is none.
        let parse = |change: &dyn Fn(&mut Checkpoint)| {
            let (mut checkpoint, mut bytes) = (right.clone(), Vec::new());
            change(&mut checkpoint);
            checkpoint.write_to(&mut bytes).unwrap();
            Checkpoint::parse(&bytes).map(drop)
        };
        assert_eq!(parse(&|checkpoint| checkpoint.every = 1), Ok(()));
        let damaged = Err("the checkpoint is damaged".to_owned());
        assert_eq!(parse(&|checkpoint| checkpoint.every = 0), damaged);
        assert_eq!(parse(&|checkpoint| _ = checkpoint.velocities.pop()), damaged);
        assert_eq!(parse(&|checkpoint| checkpoint.positions[1][2] = 1e151), damaged);
    }

    /// Everything in a scene that changes a run's result changes its fingerprint.
    #[test]
    fn fingerprints_distinguish_runs() {
        let of = |change: &dyn Fn(&mut SystemBuilder)| {
            let mut builder = builder();
            change(&mut builder);
            let (system, state) = builder.build().unwrap();
            fingerprint(&system, &state)
        };
        let moved = |by: f64| {
            let motion = Motion::Velocity(Vector3::new(0.0, by, 0.0));
            Constraint { particles: vec![1], axes: Axes::of(&[1]), motion }
        };
        let same = of(&|_| {});
        assert_eq!(same, of(&|_| {}));
        let others = [
            of(&|builder| builder.gravity.y = -9.82),
            of(&|builder| builder.positions[1].x += 1e-15),
            of(&|builder| builder.velocities[1].z = 1.0),
            of(&|builder| builder.masses[1] = 2.5),
            of(&|builder| builder.springs[0].stiffness = 6.0),
            of(&|builder| builder.springs[0].rest_length = 1.5),
            of(&|builder| builder.springs[0].damping = 0.25),
            of(&|builder| builder.pairs[0] = [1, 0]),
            of(&|builder| _ = builder.hold(1)),
            of(&|builder| _ = builder.constrain(moved(1.0))),
            of(&|builder| _ = builder.constrain(moved(2.0))),
        ];
        let all: std::collections::BTreeSet<&String> = others.iter().chain([&same]).collect();
        assert_eq!(all.len(), 12, "{others:?}");
    }
}
