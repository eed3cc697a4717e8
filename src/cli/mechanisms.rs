//! `sprung mechanisms`: which motions stretch no spring, and why a matrix is singular.

use super::Stop;
use super::common::{At, Process, SceneFile, claim};
use super::console::{Console, warning};
use super::view::write_motions;
use sprung::mechanisms::mechanisms;
use sprung::output::AtomicFile;
use sprung::report::statics::{MechanismsRecord, mechanism_motions, mechanisms_text};

/// Say why a matrix is singular: motions that stretch no spring
///
/// Takes the rank of the springs' directions at the start, or at the state of a file. Motions beyond the rank stretch no spring: rigid ones, and
/// mechanisms, which are listed with the particles that move, the springs that would remove them, and whether prestress stiffens them. Springs
/// beyond the rank can be in tension without any load: states of self-stress. Writes mechanisms.json, and mechanisms.html, which plays every
/// mechanism, where there are any.
#[derive(Debug, clap::Args)]
pub struct MechanismsCommand {
    #[command(flatten)]
    scene: SceneFile,

    #[command(flatten)]
    at: At,

    #[command(flatten)]
    process: Process,
}

const PAGE: &str = "mechanisms.html";
const FILES: [&str; 2] = ["mechanisms.json", PAGE];

impl MechanismsCommand {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let scene = self.at.place(self.scene.load(console)?)?;
        let folder = self.process.folder(&scene);
        let (scene, found) = self.process.compute(scene, |scene| Ok(mechanisms(&scene.system, &scene.state)?))?;
        let claimed = claim(&folder, &FILES, false)?;
        let record = MechanismsRecord { scene: &scene.name, found: &found };
        let motions = mechanism_motions(&scene.name, &found);
        let written = AtomicFile::write_indented_json(folder.join(FILES[0]), &record)
            .and_then(|()| write_motions(&claimed, PAGE, &scene, &scene.state.positions, &motions));
        let has_page = written.map_err(Stop::Broken)?;
        let mut text = mechanisms_text(&scene.name, &found).trim_end().to_owned();
        if has_page {
            text += &format!("\nopen {}", folder.join(PAGE).display());
        }
        if !found.decided {
            warning("a singular value is too close to the limit of rounding: the rank is not certain");
        }
        console.result(&record, text)
    }
}
