//! `final.json`: where everything is and how fast it moves when a run ends.

use super::AtomicFile;
use crate::error::Result;
use crate::system::State;
use nalgebra::Vector3;
use serde::{Serialize, Serializer};
use std::io::{self, Write};
use std::path::PathBuf;

/// Writes `{"scene", "time", "steps", "positions", "velocities"}`, time in s, positions in m, velocities in m/s, one
/// row per particle with as many entries as the scene has axes (`dimension`).
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be written.
pub fn write_final_state(
    target: impl Into<PathBuf>,
    scene: &str,
    dimension: usize,
    steps: u64,
    state: &State,
) -> Result<()> {
    let rows = |rows| Rows { rows, dimension };
    let content = FinalState {
        scene,
        time: state.time,
        steps,
        positions: rows(&state.positions),
        velocities: rows(&state.velocities),
    };
    AtomicFile::write(target, |file| {
        serde_json::to_writer(&mut *file, &content).map_err(io::Error::from)?;
        file.write_all(b"\n")
    })
}

#[derive(Serialize)]
struct FinalState<'a> {
    scene: &'a str,
    time: f64,
    steps: u64,
    positions: Rows<'a>,
    velocities: Rows<'a>,
}

/// 3-vectors as rows of the first `dimension` components.
struct Rows<'a> {
    rows: &'a [Vector3<f64>],
    dimension: usize,
}

impl Serialize for Rows<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.rows.iter().map(|row| &row.as_slice()[..self.dimension.min(3)]))
    }
}
