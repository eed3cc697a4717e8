//! `final.json`: positions and velocities at the end of a run.

use super::AtomicFile;
use crate::error::{Error, Invalid, Result};
use crate::force::{Energy, Reactions};
use crate::memory;
use crate::scene::{Row, json_table};
use crate::system::{State, System, check_length};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Writes `{"scene", "time", "steps", "positions", "velocities", "reactions"}` in s, m and m/s, one row per particle with as many entries as the scene
/// has axes. `"reactions"` is `{"particles": […], "forces": [[…]…]}`: for every particle with a prescribed coordinate the [force](Reactions::at) of its
/// constraint in N, zero along free axes; null where the ends of a spring coincide.
pub fn write_final_state(
    target: impl Into<PathBuf>,
    scene: &str,
    system: &System,
    steps: u64,
    state: &State,
) -> Result<()> {
    let rows = |vectors: &[Vector3<f64>]| vectors.iter().map(|x| Row::of(x, system.dimension())).collect();
    let reactions = Reactions::at(system, state).ok();
    let content = FinalState {
        scene,
        time: state.time,
        steps,
        positions: rows(&state.positions),
        velocities: rows(&state.velocities),
        reactions: reactions.as_ref().map(|of| ReactionRows { particles: &of.particles, forces: rows(&of.forces) }),
    };
    AtomicFile::write_json(target, &content)
}

/// Reads `"time"`, `"positions"` and `"velocities"` that [`write_final_state`] wrote, to the bit; other keys are ignored.
///
/// # Errors
/// With the file's name: [`Error::Io`] when it cannot be read, [`Error::Format`] for text that is no such JSON, and [`Error::Invalid`] for a state that
/// does not fit the system or from which no run can start.
pub fn read_final_state(file: &Path, system: &System) -> Result<State> {
    let bytes = std::fs::metadata(file).map_err(|source| Error::io(file, source))?.len();
    // Parsing holds the text, and rows twice.
    memory::ensure(bytes.saturating_mul(8), "the state")?;
    let text = std::fs::read_to_string(file).map_err(|source| Error::reading_text(file, source))?;
    let stored: Stored = json_table(&text).map_err(|message| {
        let is_table = text.trim_start_matches('\u{feff}').trim_start().starts_with('{');
        let wanted = if is_table { "" } else { "must be a state as final.json has it: " };
        Error::Format { file: file.into(), message: format!("{wanted}{message}") }
    })?;
    stored.state(system).map_err(|invalid| Error::from(invalid).in_file(file))
}

#[derive(Deserialize)]
struct Stored {
    time: f64,
    positions: Vec<Row>,
    velocities: Vec<Row>,
}

impl Stored {
    fn state(&self, system: &System) -> Result<State, Invalid> {
        let vectors = |key: &str, rows: &[Row]| -> Result<Vec<_>, Invalid> {
            check_length(key, rows.len(), system.particles(), "particles of the scene")?;
            rows.iter().enumerate().map(|(at, row)| vector(key, at, row, system.dimension())).collect()
        };
        let positions = vectors("positions", &self.positions)?;
        let state = State { time: self.time, positions, velocities: vectors("velocities", &self.velocities)? };
        for (spring, &[i, j]) in system.pairs().iter().enumerate() {
            let ends = [i, j].map(|p| &state.positions[p as usize]);
            if system.extension(spring, ends[0], ends[1]).is_none() {
                let rule = format!("is where particle {i} is: spring {spring} has zero length and no direction");
                return Err(Invalid::new("positions", format!("{:?}", self.positions[j as usize]), rule).at(j as usize));
            }
        }
        if !Energy::of(system, &state).total().is_finite() {
            let rule = "have an energy beyond the largest number, with the scene's masses and springs";
            return Err(Invalid::new("velocities", "those of the state", rule));
        }
        Ok(state)
    }
}

fn vector(key: &str, at: usize, row: &Row, dimension: usize) -> Result<Vector3<f64>, Invalid> {
    let wrong = |rule: String| Err(Invalid::new(key, format!("{row:?}"), rule).at(at));
    if row.dimension() != dimension {
        let entries = if dimension == 1 { "entry" } else { "entries" };
        return wrong(format!("must have {dimension} {entries}, as the scene's rows have"));
    }
    if !row.as_slice().iter().all(|x| x.abs() <= State::LARGEST) {
        return wrong("must be at most 1e150 in size: larger numbers overflow when squared".into());
    }
    Ok(row.vector())
}

#[derive(Serialize)]
struct FinalState<'a> {
    scene: &'a str,
    time: f64,
    steps: u64,
    positions: Vec<Row>,
    velocities: Vec<Row>,
    reactions: Option<ReactionRows<'a>>,
}

#[derive(Serialize)]
struct ReactionRows<'a> {
    particles: &'a [usize],
    forces: Vec<Row>,
}
