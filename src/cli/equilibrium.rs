//! `sprung equilibrium`: where the scene comes to rest.

use super::Stop;
use super::common::{At, LoadedScene, Process, SceneFile, choice, claim, positive_count};
use super::console::Console;
use super::method::STIFFNESSES;
use super::view::{write_motions, write_page};
use sprung::equilibrium::{EquilibriumOptions, Stability, equilibrium, load_path};
use sprung::figure::{Animation, SceneTopology};
use sprung::integrate::StiffnessPolicy;
use sprung::output::{AtomicFile, OutputFolder};
use sprung::report::statics::{
    EquilibriumRecord, buckling_motions, equilibrium_text, load_path_animation, load_path_plot, verdict,
};
use sprung::{Result, report};
use std::fmt::Write;
use std::num::NonZeroUsize;

/// Find where the scene comes to rest under its weight and loads
///
/// Goes downhill in energy from the start, or from the state of a file, by Newton's method, until the largest force left is 1e-10 of the largest
/// that acts. The signs of the eigenvalues of −K say what was found: stable; indifferent, where motions cost no energy; unstable, a saddle that
/// the search could not leave; none, where nothing holds some particles, which are named. The last two end with status 1, as does a search that does not
/// converge. Writes equilibrium.json, whose state other commands take with --at, and equilibrium.html.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct EquilibriumCommand {
    #[command(flatten)]
    scene: SceneFile,

    /// Follow gravity and loads from zero to their full values in N steps, locate the critical ones, at which the scene buckles or snaps
    /// through, and write load-path.svg and buckling.html; equilibrium.html then plays the path
    #[arg(long, value_name = "N", value_parser = positive_count::<NonZeroUsize>)]
    load_path: Option<NonZeroUsize>,

    /// Matrix of steps that start far from the equilibrium
    #[arg(long, value_name = "OPTION", default_value = "on-demand", value_parser = choice(&STIFFNESSES, StiffnessPolicy::name))]
    stiffness: StiffnessPolicy,

    #[command(flatten)]
    at: At,

    #[command(flatten)]
    process: Process,
}

const PLOT: &str = "load-path.svg";
/// Plays the equilibrium, or a load path.
const PAGE: &str = "equilibrium.html";
/// Plays the direction in which a load path loses its stiffness.
const BUCKLING: &str = "buckling.html";
const FILES: [&str; 4] = ["equilibrium.json", PAGE, PLOT, BUCKLING];

impl EquilibriumCommand {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let scene = self.at.place(self.scene.load(console)?)?;
        let folder = self.process.folder(&scene);
        let steps = self.load_path;
        let options = EquilibriumOptions { stiffness: self.stiffness, ..EquilibriumOptions::default() };
        let (scene, (found, path)) = self.process.compute(scene, move |scene| {
            let LoadedScene { system, state, .. } = scene;
            let found = equilibrium(system, state, options)?;
            let path = steps.map(|steps| load_path(system, state, steps.get())).transpose()?;
            Ok((found, path))
        })?;
        let claimed = claim(&folder, &FILES, false)?;
        let (path, dimension) = (path.as_ref(), scene.system.dimension());
        let record = EquilibriumRecord { scene: &scene.name, dimension, found: &found, path };
        write(&claimed, &scene, &record).map_err(Stop::Broken)?;
        let mut text = equilibrium_text(&scene.name, &found, path);
        let buckles = path.is_some_and(|path| !path.critical.is_empty());
        let written = 2 + usize::from(path.is_some()) + usize::from(buckles);
        let names = FILES[..written].join(", ");
        let _ = writeln!(text, "  files                 {names} in {}", folder.display());
        let _ = write!(text, "open {}", folder.join(PAGE).display());
        console.result(&record, text)?;
        match found.stability {
            Stability::Stable | Stability::Indifferent => Ok(()),
            _ => Err(Stop::Computation(verdict(&found))),
        }
    }
}

fn write(claimed: &OutputFolder, scene: &LoadedScene, record: &EquilibriumRecord<'_>) -> Result<()> {
    let (folder, found) = (claimed.path(), record.found);
    AtomicFile::write_json(folder.join(FILES[0]), record)?;
    let topology = SceneTopology::of(&scene.system, &scene.triangles);
    let animation = match record.path {
        Some(path) => {
            AtomicFile::write_text(folder.join(PLOT), &report::plot::svg(&load_path_plot(&scene.name, path)))?;
            let (motions, at) = (buckling_motions(&scene.name, &scene.system, path), path.critical.first());
            let positions = at.map_or(&scene.state.positions, |critical| &critical.state.positions);
            write_motions(claimed, BUCKLING, scene, positions, &motions)?;
            load_path_animation(&scene.name, topology, path)
        }
        None => {
            claimed.remove(PLOT)?;
            claimed.remove(BUCKLING)?;
            let mut animation = Animation::still(&scene.name, topology, &found.state);
            animation.remarks = vec![format!("equilibrium, {}", verdict(found))];
            animation
        }
    };
    write_page(&folder.join(PAGE), &animation).map(drop)
}
