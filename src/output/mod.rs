//! Results on disk: JSON, CSV, Matrix Market and VTK, each file written whole or not at all.
//!
//! Every number is written in the shortest decimal form that reads back to the same bits.

mod arrays;
mod atomic;
mod checkpoint;
mod checksum;
mod energy;
mod failure_bundle;
mod final_state;
mod folder;
mod frames;
mod matrix_market;
mod playback;
mod run_summary;
mod search_summary;
mod summary;
mod trajectory;
mod vtk;

pub use atomic::AtomicFile;
pub use checkpoint::{CHECKPOINT, Checkpoint, FINISHED, fingerprint, rows};
pub use energy::{EnergyLog, LogPosition};
pub use failure_bundle::{BUNDLE, FailedStep};
pub use final_state::{read_final_state, write_final_state};
pub use folder::OutputFolder;
pub use frames::{Frames, clear_frames, clear_frames_after};
pub use matrix_market::{write_dofs, write_symmetric, write_vector};
pub use playback::{describe, energy_tracks, playback};
pub use run_summary::Ran;
pub use summary::{ChoiceReport, Effort, EnergyChange, ErrorKind, ErrorReport, FailureReport, Summary};
pub use trajectory::{TRAJECTORY, Trajectory, WAITING};
pub use vtk::write_frame;
