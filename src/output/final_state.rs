//! `final.json`: where everything is and how fast it moves when a run ends.

use super::AtomicFile;
use crate::error::Result;
use crate::force::Reactions;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Serialize, Serializer};
use std::io::{self, Write};
use std::path::PathBuf;

/// Writes `{"scene", "time", "steps", "positions", "velocities", "reactions"}`, time in s, positions in m, velocities in m/s, one
/// row per particle with as many entries as the scene has axes.
///
/// `"reactions"` is `{"particles": […], "forces": [[…]…]}`: for every particle with a prescribed coordinate the
/// [force](Reactions::at) in N with which its constraint acts on it, zero along axes that are free; null where the ends of a spring
/// coincide.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be written.
pub fn write_final_state(
    target: impl Into<PathBuf>,
    scene: &str,
    system: &System,
    steps: u64,
    state: &State,
) -> Result<()> {
    let dimension = system.dimension();
    let reactions = Reactions::at(system, state).ok();
    let content = FinalState {
        scene,
        time: state.time,
        steps,
        positions: Rows::of(&state.positions, dimension),
        velocities: Rows::of(&state.velocities, dimension),
        reactions: reactions
            .as_ref()
            .map(|Reactions { particles, forces }| ReactionRows { particles, forces: Rows::of(forces, dimension) }),
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
    reactions: Option<ReactionRows<'a>>,
}

#[derive(Serialize)]
struct ReactionRows<'a> {
    particles: &'a [usize],
    forces: Rows<'a>,
}

/// 3-vectors as rows of the first `dimension` components.
struct Rows<'a> {
    rows: &'a [Vector3<f64>],
    dimension: usize,
}

impl<'a> Rows<'a> {
    fn of(rows: &'a [Vector3<f64>], dimension: usize) -> Self {
        Self { rows, dimension }
    }
}

impl Serialize for Rows<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.rows.iter().map(|row| &row.as_slice()[..self.dimension.min(3)]))
    }
}
