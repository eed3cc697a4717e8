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
mod playback;
mod summary;
mod trajectory;

pub use checkpoint::{Checkpoint, fingerprint};
pub use energy::{EnergyLog, LogPosition};
pub use files::{AtomicFile, OutputFolder};
pub use final_state::{read_final_state, write_final_state};
pub use frames::{Frames, clear_frames, clear_frames_after, write_frame};
pub use matrix_market::{BUNDLE, write_dofs, write_failed_step, write_symmetric, write_vector};
pub use playback::{describe, energy_tracks, playback};
pub use summary::{ChoiceReport, Effort, EnergyChange, ErrorKind, ErrorReport, FailureReport, RunRecord, Summary};
use trajectory::Trajectory;
pub use trajectory::{TRAJECTORY, WAITING};

use crate::error::{Error, Result};
use crate::modes::{Mode, Modes};
use crate::report;
use crate::scene::NpzWriter;
use crate::system::System;
use crate::verify::Results;
use std::path::{Path, PathBuf};

/// Writes `report.html`, `report.json` and `junit.xml` of a verification into a folder, which is created.
pub fn write_report(folder: impl AsRef<Path>, results: &Results) -> Result<()> {
    let file = |name: &str| folder.as_ref().join(name);
    let failed = |source| Error::io(folder.as_ref(), source);
    AtomicFile::write_text(file("report.html"), &report::html(results))?;
    AtomicFile::write_text(file("report.json"), &report::json(results).map_err(failed)?)?;
    AtomicFile::write_text(file("junit.xml"), &report::junit(results).map_err(failed)?)
}

/// Writes `modes.npz`, normal modes as NumPy arrays: `eigenvalues` (1/s²), `frequencies` (Hz, NaN where ω² is negative), `shapes` (modes × particles × axes, in
/// kg^{-1/2}), `damping_ratios` (NaN where there is none), `residuals` and `error_bounds` (1/s²), `effective_masses` (modes × 3, in kg), and `zero_shapes`, those of
/// the zero modes.
pub fn write_modes(target: impl Into<PathBuf>, system: &System, found: &Modes) -> Result<()> {
    let modes = || found.modes.iter();
    let count = found.modes.len();
    let shapes = |modes: &[Mode]| {
        let shapes = modes.iter().flat_map(|mode| found.shape(mode));
        let axes = system.dimension();
        shapes.flat_map(|u| u.data.0[0].into_iter().take(axes).collect::<Vec<_>>()).collect::<Vec<f64>>()
    };
    AtomicFile::write(target, |file| {
        let mut npz = NpzWriter::new(file);
        npz.put("eigenvalues", &[count], modes().map(|mode| mode.eigenvalue))?;
        npz.put("frequencies", &[count], modes().map(|mode| mode.frequency().unwrap_or(f64::NAN)))?;
        npz.put("damping_ratios", &[count], modes().map(|mode| mode.damping_ratio.unwrap_or(f64::NAN)))?;
        npz.put("residuals", &[count], modes().map(|mode| mode.residual))?;
        npz.put("error_bounds", &[count], modes().map(|mode| mode.error_bound))?;
        npz.put("effective_masses", &[count, 3], modes().flat_map(|mode| mode.effective_mass))?;
        for (name, modes) in [("shapes", &found.modes), ("zero_shapes", &found.zero_modes)] {
            let shape = [modes.len(), system.particles(), system.dimension()];
            npz.put(name, &shape, shapes(modes).into_iter())?;
        }
        npz.finish()
    })
}
