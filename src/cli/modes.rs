//! `sprung modes`: how the scene vibrates about a state.

use super::Stop;
use super::common::{At, Process, SceneFile, claim, positive_count};
use super::console::{Console, warning};
use super::view::write_motions;
use sprung::equilibrium::{EquilibriumOptions, Stability, equilibrium};
use sprung::modes::modes;
use sprung::output::{AtomicFile, write_modes};
use sprung::report::statics::{ModesRecord, mode_motions, modes_text, verdict};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Find the lowest normal modes: frequencies, damping, shapes
///
/// Solves −K φ = ω² M φ at a state. Zero modes, rigid motions and mechanisms, are counted apart. Negative ω² are motions that grow. A
/// factorization counts the eigenvalues below the last mode: "complete" means that none is missing. Writes modes.json, modes.npz, the
/// shapes for NumPy, and modes.html, which plays every mode.
#[derive(Debug, clap::Args)]
pub struct ModesCommand {
    #[command(flatten)]
    scene: SceneFile,

    /// Number of modes, zero modes not counted
    #[arg(short, long = "number", value_name = "N", default_value = "10", value_parser = positive_count::<NonZeroUsize>)]
    number: NonZeroUsize,

    /// The state: start, the equilibrium that is found from there, or a file, a final.json or equilibrium.json
    #[arg(long, value_name = "start|equilibrium|FILE", default_value = "start")]
    at: PathBuf,

    #[command(flatten)]
    process: Process,
}

const PAGE: &str = "modes.html";
const FILES: [&str; 3] = ["modes.json", "modes.npz", PAGE];

impl ModesCommand {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let at = self.at.display().to_string();
        let is_file = !matches!(at.as_str(), "start" | "equilibrium");
        let scene = At { at: is_file.then(|| self.at.clone()) }.place(self.scene.load(console)?)?;
        let folder = self.process.folder(&scene);
        let (number, from_equilibrium) = (self.number.get(), at == "equilibrium");
        let (scene, found) = self.process.compute(scene, move |scene| {
            if from_equilibrium {
                let found = equilibrium(&scene.system, &scene.state, EquilibriumOptions::default())?;
                if matches!(found.stability, Stability::None | Stability::NotConverged) {
                    return Err(Stop::Computation(format!("no equilibrium was found: {}", verdict(&found))));
                }
                scene.state = found.state;
            }
            Ok(modes(&scene.system, &scene.state, number)?)
        })?;
        let claimed = claim(&folder, &FILES, false)?;
        let record = ModesRecord { scene: &scene.name, at: &at, found: &found };
        let motions = mode_motions(&scene.name, &at, &scene.system, &found);
        let written = AtomicFile::write_indented_json(folder.join(FILES[0]), &record)
            .and_then(|()| write_modes(folder.join(FILES[1]), &scene.system, &found))
            .and_then(|()| write_motions(&claimed, PAGE, &scene, &scene.state.positions, &motions));
        let has_page = written.map_err(Stop::Broken)?;
        let text = modes_text(&scene.name, &at, &scene.system, &found);
        let names = if has_page { &FILES[..] } else { &FILES[..2] };
        let mut text = format!("{text}  files: {} in {}", names.join(", "), folder.display());
        if has_page {
            text += &format!("\nopen {}", folder.join(PAGE).display());
        }
        if !found.complete && !scene.system.dofs().is_empty() {
            warning("the eigenvalues were not counted: modes may be missing");
        }
        console.result(&record, text)
    }
}
