//! Checkpoints, independent of the number of ranks: `checkpoint-mpi.json` and a file with the state.
//!
//! All ranks write their ranges of the state into one file: position and velocity of each particle, little endian, in the order of the scene.
//! The JSON file that names it is replaced last and atomically, so there is always a complete checkpoint.

use crate::part::Part;
use crate::results::{by_number, by_part};
use crate::{Stop, or_end, ranks};
use serde::{Deserialize, Serialize};
use sprung::State;
use sprung::integrate::{MonitorCheckpoint, Statistics};
use sprung::output::LogPosition;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

const FILE: &str = "checkpoint-mpi.json";
const FORMAT: &str = "sprung-mpi checkpoint 1";
/// Bytes of a particle: x and v.
const RECORD: u64 = 48;

/// A run at one of its steps, but for the state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    pub format: String,
    /// Of the scene and of how it is run: another run cannot go on from here.
    pub run: String,
    pub every: u64,
    pub reached: u64,
    pub time: f64,
    pub statistics: Statistics,
    pub wall_seconds: f64,
    pub account: MonitorCheckpoint,
    pub energies: LogPosition,
    pub frames: Vec<(f64, u64)>,
    /// Of the state's bytes: the sum of the bits of its numbers, each times its place.
    pub checksum: u64,
}

fn state_file(folder: &Path, reached: u64) -> PathBuf {
    folder.join(format!("checkpoint-mpi-{reached}.state"))
}

/// The format's name, for those who make one.
pub fn format() -> String {
    FORMAT.into()
}

impl Checkpoint {
    /// Writes the state and then the file that names it. An error ends all ranks.
    pub fn write(mut self, folder: &Path, total: u64, part: &Part, state: &State) {
        let file = state_file(folder, self.reached);
        if ranks::rank() == 0 {
            let length = File::create(&file).and_then(|made| made.set_len(RECORD * total));
            or_end(length.map_err(|error| format!("{}: {error}", file.display())));
        }
        ranks::total(0);
        let rows = [&state.positions, &state.velocities].map(|vectors| by_number(&part.halo, total, vectors));
        let first = ranks::ranges(total)[ranks::rank()];
        let numbers: Vec<f64> = rows[0].iter().zip(&rows[1]).flat_map(|(x, v)| [*x, *v].concat()).collect();
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let written = OpenOptions::new().write(true).open(&file).and_then(|file| {
            file.write_all_at(&bytes, RECORD * first)?;
            file.sync_all()
        });
        or_end(written.map_err(|error| format!("{}: {error}", file.display())));
        self.checksum = checksum(first, &numbers);
        if ranks::rank() == 0 {
            let text = or_end(serde_json::to_string(&self));
            or_end(crate::results::write_text(&folder.join(FILE), &text));
            remove_states(folder, Some(self.reached));
        }
    }

    /// The checkpoint of a folder, known to all ranks; `None` where there is none.
    ///
    /// # Errors
    /// One that cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Self>, Stop> {
        let mut text = String::new();
        let file = folder.join(FILE);
        crate::agreed::agreed(|| {
            if file.exists() {
                text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
            }
            Ok(true)
        })?;
        let text = ranks::share_text(&text);
        if text.is_empty() {
            return Ok(None);
        }
        let damaged = |what: String| Stop::Unusable(format!("{}: {what}", file.display()));
        let checkpoint: Self = serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))?;
        if checkpoint.format != FORMAT {
            return Err(damaged("is no checkpoint that this version can read".into()));
        }
        Ok(Some(checkpoint))
    }

    /// The state.
    ///
    /// # Errors
    /// One that is missing or damaged, on all ranks.
    pub fn state(&self, folder: &Path, total: u64, part: &Part) -> Result<State, Stop> {
        let file = state_file(folder, self.reached);
        let ranges = ranks::ranges(total);
        let (first, end) = (ranges[ranks::rank()], ranges[ranks::rank() + 1]);
        let mut bytes = vec![0; (RECORD * (end - first)) as usize];
        let read = File::open(&file).and_then(|file| file.read_exact_at(&mut bytes, RECORD * first));
        if ranks::any(read.is_err()) {
            return Err(Stop::Unusable(format!("{}: cannot be read whole", file.display())));
        }
        let number = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().unwrap_or_default());
        let numbers: Vec<f64> = bytes.chunks_exact(8).map(number).collect();
        if checksum(first, &numbers) != self.checksum {
            return Err(Stop::Unusable(format!("{}: is damaged", file.display())));
        }
        let rows = |from: usize| -> Vec<[f64; 3]> {
            numbers.chunks_exact(6).map(|row| [row[from], row[from + 1], row[from + 2]]).collect()
        };
        let [positions, velocities] = [0, 3].map(|from| by_part(&part.halo, total, &rows(from)));
        Ok(State { time: self.time, positions, velocities })
    }
}

/// Over all ranks.
fn checksum(first: u64, numbers: &[f64]) -> u64 {
    let weigh = |(at, number): (u64, &f64)| number.to_bits().wrapping_mul(2 * at + 1);
    let here = (6 * first..).zip(numbers).map(weigh).fold(0, u64::wrapping_add);
    ranks::all(here).into_iter().fold(0, u64::wrapping_add)
}

/// Removes what a run that came to its end has no more use for.
pub fn forget(folder: &Path) {
    if ranks::rank() == 0 {
        let _ = std::fs::remove_file(folder.join(FILE));
        remove_states(folder, None);
    }
}

fn remove_states(folder: &Path, but: Option<u64>) {
    let kept = but.map(|reached| state_file(folder, reached));
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_state =
            name.to_str().is_some_and(|name| name.starts_with("checkpoint-mpi-") && name.ends_with(".state"));
        if is_state && Some(entry.path()) != kept {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}
