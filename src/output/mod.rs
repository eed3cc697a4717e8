//! Results on disk: JSON, CSV, Matrix Market and VTK, each file written whole or not at all.
//!
//! Numbers are written in the shortest decimal form that reads back to the same bits. Errors are [`Error::Io`] with the path of a file that cannot be
//! written, renamed or removed, unless a function says otherwise.

mod checkpoint;
mod energy;
mod files;
mod final_state;
mod frames;
mod matrix_market;
mod modes;
mod playback;
mod summary;
mod trajectory;

pub use checkpoint::{Checkpoint, fingerprint};
pub use energy::{EnergyLog, LogPosition};
pub use files::{AtomicFile, OutputFolder};
pub use final_state::{read_final_state, write_final_state};
pub use frames::{Frames, clear_frames, clear_frames_after, write_frame};
pub use matrix_market::{BUNDLE, write_dofs, write_failed_step, write_symmetric, write_vector};
pub use modes::write_modes;
pub use playback::{describe, energy_tracks, playback};
pub use summary::{ChoiceReport, Effort, EnergyChange, ErrorKind, ErrorReport, FailureReport, RunRecord, Summary};
use trajectory::Trajectory;
pub use trajectory::{TRAJECTORY, WAITING};

use crate::error::{Error, Result};
use crate::report;
use crate::verify::Results;
use std::path::Path;

/// Writes `report.html`, `report.json` and `junit.xml` of a verification into a folder, which is created.
pub fn write_report(folder: impl AsRef<Path>, results: &Results) -> Result<()> {
    let file = |name: &str| folder.as_ref().join(name);
    let failed = |source| Error::io(folder.as_ref(), source);
    AtomicFile::write_text(file("report.html"), &report::html(results))?;
    AtomicFile::write_text(file("report.json"), &report::json(results).map_err(failed)?)?;
    AtomicFile::write_text(file("junit.xml"), &report::junit(results).map_err(failed)?)
}
