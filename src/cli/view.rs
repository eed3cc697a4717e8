//! `sprung view`: the motion of a run as a page that plays it.

use super::Stop;
use super::common::{At, LoadedScene, SceneFile, folder_of};
use super::console::{Console, number};
use nalgebra::Vector3;
use serde_json::json;
use sprung::figure::{Animation, SceneTopology};
use sprung::output::{AtomicFile, OutputFolder, TRAJECTORY, playback};
use sprung::report::view::{Motions, html};
use sprung::{Error, Result};
use std::path::{Path, PathBuf};

/// Show a run's motion, or a scene at rest, in a browser
///
/// Writes one page that loads nothing and plays in any browser, on a phone too: springs coloured by strain, the mesh as a surface,
/// energies below in step with the picture. A run must have kept its motion: `sprung run SCENE --view` or `--frames N`. Scenes beyond
/// 20 000 particles are thinned, and the page says so.
#[derive(Debug, clap::Args)]
pub struct View {
    /// The output folder of a run, or a scene file
    #[arg(value_name = "RUN|SCENE")]
    subject: PathBuf,

    /// The page [default: view.html in the run's folder, or in out/<scene name>]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    #[command(flatten)]
    at: At,
}

pub const PAGE: &str = "view.html";

impl View {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let is_at = self.at.at.is_some();
        let (animation, folder) = if self.subject.is_dir() {
            if is_at {
                let run = self.subject.display();
                let message = format!("{run}: --at shows a scene at another state, and this is a run");
                return Err(Error::Usage(message).into());
            }
            (motion(&self.subject)?, self.subject.clone())
        } else if self.subject.as_os_str() == "-" || self.subject.exists() {
            let scene = self.at.place(SceneFile { path: self.subject.clone() }.load(console)?)?;
            let topology = SceneTopology::of(&scene.system, &scene.triangles);
            (Animation::still(&scene.name, topology, &scene.state), folder_of(&scene.name))
        } else {
            return Err(missing(&self.subject).into());
        };
        let page = self.output.clone().unwrap_or_else(|| folder.join(PAGE));
        // A place that cannot be written is an error of the call.
        AtomicFile::create(&page).map(drop)?;
        let bytes = write_page(&page, &animation).map_err(Stop::Broken)?;
        let frames = animation.times.len();
        let contents = match animation.times[..] {
            [time] if is_at => format!("the scene at t = {} s", number(time)),
            [_] => "the scene at rest".to_owned(),
            _ => format!("{frames} frames"),
        };
        let megabytes = bytes as f64 / 1e6;
        let text = format!("{}: {contents}, {megabytes:.1} MB\nopen {}", animation.title, page.display());
        let report = json!({"page": page.display().to_string(), "frames": frames, "bytes": bytes});
        console.result(&report, text)
    }
}

/// The error for neither a run nor a scene; perhaps the name of a run.
fn missing(subject: &Path) -> Error {
    let run = subject.file_stem().map(|name| folder_of(&name.to_string_lossy())).filter(|folder| folder.is_dir());
    let advice = match run {
        Some(folder) => format!("did you mean {}?", folder.display()),
        None => "give the output folder of a run, out/<scene name> as a rule, or a scene file".into(),
    };
    Error::Usage(format!("{}: there is nothing of this name; {advice}", subject.display()))
}

fn motion(folder: &Path) -> Result<Animation> {
    if folder.join(TRAJECTORY).is_file() {
        return playback(folder);
    }
    let folder = folder.display();
    Err(Error::Usage(format!("{folder}: no {TRAJECTORY} there: a run keeps its motion with --view or --frames N")))
}

/// Writes the page; returns its size in bytes.
pub fn write_page(page: &Path, animation: &Animation) -> Result<usize> {
    let text = html(animation).map_err(|source| Error::io(page, source))?;
    AtomicFile::write_text(page, &text)?;
    Ok(text.len())
}

/// Writes the page of motions about a state; removes an older one, and returns false, where there are none.
pub fn write_motions(
    claimed: &OutputFolder,
    name: &str,
    scene: &LoadedScene,
    positions: &[Vector3<f64>],
    motions: &Motions,
) -> Result<bool> {
    if motions.motions.is_empty() {
        return claimed.remove(name).map(|()| false);
    }
    let page = claimed.path().join(name);
    let text = motions.html(SceneTopology::of(&scene.system, &scene.triangles), positions);
    AtomicFile::write_text(&page, &text.map_err(|source| Error::io(&page, source))?).map(|()| true)
}
