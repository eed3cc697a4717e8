//! `sprung view`: the motion of a run as a page that plays it.

use super::common::{SceneFile, folder_of};
use super::console::Console;
use super::number::number;
use super::start::At;
use super::{Exit, Stop};
use serde::Serialize;
use sprung::figure::{Animation, SceneTopology};
use sprung::integrate::Schedule;
use sprung::output::{AtomicFile, Checkpoint, Frames, TRAJECTORY, playback};
use sprung::plan::RECORDS;
use sprung::report::view::html;
use sprung::{Error, Result, System};
use std::io::Write;
use std::num::NonZeroU64;
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

/// The name of the page in an output folder.
pub const PAGE: &str = "view.html";

/// The result as JSON.
#[derive(Serialize)]
struct Written<'a> {
    page: &'a Path,
    frames: usize,
    bytes: usize,
}

impl View {
    pub fn execute(&self, console: &Console) -> Result<Exit, Stop> {
        if self.subject.as_os_str() != "-" && !self.subject.exists() {
            return Err(missing(&self.subject).into());
        }
        let (animation, folder) = if self.subject.is_dir() {
            if self.at.is_given() {
                let run = self.subject.display();
                return Err(
                    Error::Usage(format!("{run}: --at shows a scene at another state, and this is a run")).into()
                );
            }
            (motion(&self.subject)?, self.subject.clone())
        } else {
            let scene = self.at.place(SceneFile::at(&self.subject).load(console)?)?;
            let cast = SceneTopology::of(&scene.system, &scene.triangles);
            (Animation::still(&scene.name, cast, &scene.state), scene.folder(&None))
        };
        let page = self.output.clone().unwrap_or_else(|| folder.join(PAGE));
        let bytes = write(&page, &animation).map_err(Stop::Broken)?;
        let frames = animation.times.len();
        let of_what = match animation.times[..] {
            [time] if self.at.is_given() => format!("the scene at t = {} s", number(time)),
            [_] => "the scene at rest".to_owned(),
            _ => format!("{frames} frames"),
        };
        let megabytes = bytes as f64 / 1e6;
        let text = format!("{}: {of_what}, {megabytes:.1} MB\nopen {}", animation.title, page.display());
        console.result(&Written { page: &page, frames, bytes }, text)?;
        Ok(Exit::Done)
    }
}

/// Neither a run nor a scene; perhaps the name of one.
fn missing(subject: &Path) -> Error {
    let of_scene = subject.file_stem().map(|name| folder_of(&name.to_string_lossy())).filter(|folder| folder.is_dir());
    let instead = match of_scene {
        Some(folder) => format!("did you mean {}?", folder.display()),
        None => "give the output folder of a run, out/<scene name> as a rule, or a scene file".into(),
    };
    Error::Usage(format!("{}: there is nothing of this name; {instead}", subject.display()))
}

/// The motion in a folder, or which option keeps one.
fn motion(folder: &Path) -> Result<Animation> {
    if folder.join(TRAJECTORY).is_file() {
        return playback(folder);
    }
    Err(Error::Usage(format!(
        "{}: no {TRAJECTORY} there: a run keeps its motion with --view or --frames N",
        folder.display()
    )))
}

/// Frames of a page where nothing else is asked for, bytes that they may take while they wait, and the fewest there are then.
const SMOOTH: usize = RECORDS as usize;
const SPACE: usize = 1_000_000_000;
const FEWEST: usize = 30;

/// Where the frames of a run go, if any are wanted: every Nth, or as many as make a smooth motion within a gigabyte.
///
/// # Errors
/// A folder that cannot be written.
pub fn frames(
    folder: &Path,
    every: Option<NonZeroU64>,
    view: bool,
    schedule: &Schedule,
    system: &System,
    from: Option<&Checkpoint>,
) -> Result<Option<Frames>> {
    let frames = |every| match from {
        Some(checkpoint) => Frames::resume(folder, every, checkpoint.frames.clone(), system),
        None => Frames::create(folder, every),
    };
    match interval(every, view, schedule, system) {
        None => Ok(None),
        Some(steps) if every.is_some() => frames(steps).map(Some),
        Some(steps) => Ok(Some(frames(steps)?.without_vtk())),
    }
}

/// Steps from one frame of a run to the next, if frames are kept.
pub fn interval(every: Option<NonZeroU64>, view: bool, schedule: &Schedule, system: &System) -> Option<NonZeroU64> {
    let smooth = || {
        let frame = 6 * size_of::<f64>() * system.particles().max(1);
        let wanted = (SPACE / frame).clamp(FEWEST, SMOOTH) as u64;
        NonZeroU64::new(schedule.len().div_ceil(wanted)).unwrap_or(NonZeroU64::MIN)
    };
    every.or_else(|| view.then(smooth))
}

/// Writes the page; returns its size.
///
/// # Errors
/// When it cannot be written.
pub fn write(page: &Path, animation: &Animation) -> Result<usize> {
    let text = html(animation).map_err(|source| Error::io(page, source))?;
    AtomicFile::write(page, |file| file.write_all(text.as_bytes()))?;
    Ok(text.len())
}
