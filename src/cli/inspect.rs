//! `sprung inspect`: is A positive definite, which springs spoil it, and which step is safe?

use super::common::{LoadedScene, SceneFile, Threads, check_writable};
use super::console::{Console, error};
use super::number::number;
use super::recorder::bar;
use super::start::{At, advance};
use super::values::{choice, positive, whole};
use super::{Exit, Stop, interrupt};
use faer::Par;
use sprung::inspect::{AFFORDABLE, FirstLosses, Follower, Inspection, Part, Pictures};
use sprung::integrate::RunFailure;
use sprung::output::{AtomicFile, OutputFolder};
use sprung::plan::parallelism;
use sprung::report::inspection::{InspectionRecord, first_answer, html, pictures, text};
use sprung::{Result, Stiffness};
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Say whether A is positive definite, which springs spoil it, and which step is safe
///
/// Counts the signs of the eigenvalues of A = M/dt² − G/dt − K, finds λ_min, λ_max and the condition number, the largest time
/// step for which A is positive definite, the largest for which linearised backward Euler is stable and the largest that turns
/// no spring too far, under each stiffness option, and the springs behind every direction of negative curvature. All of this is
/// about one state. Whether A is positive definite, and the spring that spoils it most, is said first, on stderr. With --steps it
/// follows so many steps of linearised backward Euler, says after which step definiteness, stability, turning and energy were
/// lost first, and looks at the state at the end. Writes inspect.html and its pictures.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Inspect {
    #[command(flatten)]
    scene: SceneFile,

    /// Time step, in seconds [default: the scene's time.dt, or 0.01]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Follow a run for so many steps first (with on-demand stiffness)
    #[arg(long, value_name = "N", value_parser = whole, default_value = "0")]
    steps: u64,

    #[command(flatten)]
    at: At,

    /// Which part of every spring's stiffness enters the matrix that is examined
    #[arg(long, value_name = "OPTION", default_value = "full", value_parser = choice(&Stiffness::ALL, Stiffness::name, describe_stiffness))]
    stiffness: Stiffness,

    /// Look at everything, however long it takes, instead of leaving out what takes too much work
    #[arg(long)]
    all: bool,

    #[command(flatten)]
    threads: Threads,

    /// Folder for the files, made where it does not exist [default: out/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn describe_stiffness(option: Stiffness) -> &'static str {
    match option {
        Stiffness::Full => "the exact stiffness",
        Stiffness::Tension => "without the transverse terms of compressed springs",
        Stiffness::Axial => "without any transverse term",
    }
}

const FILES: [&str; 6] =
    ["inspect.html", "scene.svg", "lambda-min.svg", "spectrum.svg", "pattern-A.svg", "pattern-L.svg"];

/// Where a run came to, what was lost on the way, and what ended it early.
struct Arrival {
    steps: u64,
    losses: Option<FirstLosses>,
    failure: Option<RunFailure>,
}

impl Inspect {
    pub fn execute(&self, console: &Console) -> Result<Exit, Stop> {
        let mut scene = self.at.place(self.scene.load(console)?)?;
        let dt = scene.step_or_default(console, self.dt);
        let folder = scene.folder(&self.out);
        let file = scene.file.clone();
        let in_file = |error: sprung::Error| error.in_file(&file);
        let par = parallelism(&scene.system);
        if self.steps > 0 {
            interrupt::keep();
        }
        let arrival = self.threads.install(|| Ok(self.arrive(console, &mut scene, dt)))?.map_err(in_file)?;
        let scene = Arc::new(scene);
        let Looked { inspection, images } = self.look(console, &scene, dt, par)?.map_err(in_file)?;
        let LoadedScene { name, system, state, .. } = &*scene;
        let Some(inspection) = inspection else {
            return Err(Stop::Computation("interrupted before anything was known of A".into()));
        };
        let is_known = !inspection.lacks(Part::Spectrum(self.stiffness)) && !system.dofs().is_empty();
        if is_known && !inspection.examined().largest.is_finite() {
            error(format_args!("A has entries that are not finite numbers (dt = {dt:?} s)"));
            return Ok(Exit::Failed);
        }
        let claimed = check_writable(&folder, &FILES)?;
        // Those of an interrupted inspection are few and quickly made.
        let images = match images {
            Some(images) => images,
            None => Pictures::of(system, state, &inspection).map_err(in_file)?,
        };
        let images = images.named(name);
        let losses = arrival.losses.as_ref();
        let page = html(name, arrival.steps, state.time, &inspection, losses, &images);
        write(&folder, &claimed, &page, &images).map_err(Stop::Broken)?;
        let record = InspectionRecord::new(name, arrival.steps, state.time, &inspection).with_losses(losses);
        let text = text(name, arrival.steps, state.time, &inspection, losses);
        let page = folder.join("inspect.html");
        console.result(&record, format!("{text}\n  pictures     {}", page.display()))?;
        if let Some(RunFailure { step, time, failure }) = arrival.failure {
            let time = number(time);
            error(format_args!("{} in step {step}, at t = {time} s: {failure}", failure.status().name()));
            return Ok(Exit::Failed);
        }
        if interrupt::is_requested() {
            error("interrupted: what was not looked at is left out");
            return Ok(Exit::Failed);
        }
        Ok(Exit::Done)
    }

    /// Inspects the state; where the user interrupts, with what is known by then.
    fn look(&self, console: &Console, scene: &Arc<LoadedScene>, dt: f64, par: Par) -> Result<Result<Looked>, Stop> {
        let bar = bar(console, PARTS, "{wide_bar} {msg}, {eta}").with_message("inspecting");
        let (option, all, inspected) = (self.stiffness, self.all, scene.clone());
        let (mut known, mut told) = (None, false);
        let looked = self.threads.attend(
            move |tell| {
                let LoadedScene { system, state, .. } = &*inspected;
                let most = if all { f64::INFINITY } else { AFFORDABLE };
                let mut onlooker = |progress: f64, found: &Inspection| tell((progress, found.clone()));
                let inspection = Inspection::within(system, state, dt, option, par, most, &mut onlooker)?;
                tell((1.0, inspection.clone()));
                let images = Pictures::of(system, state, &inspection)?;
                Ok(Looked { inspection: Some(inspection), images: Some(images) })
            },
            |(progress, found)| {
                if !told && let Some(first) = first_answer(&found) {
                    bar.suspend(|| console.note(first));
                    told = true;
                }
                bar.set_position((progress * PARTS as f64) as u64);
                bar.set_message(if progress < 1.0 { "inspecting" } else { "drawing" });
                known = Some(found);
            },
        )?;
        bar.finish_and_clear();
        // What was known when the wait ended is known without the picture that takes longest.
        Ok(looked.unwrap_or_else(|| Ok(Looked { inspection: known.map(Inspection::without_curve), images: None })))
    }

    /// Follows as many steps as asked for, looking at the state before each and after the last.
    fn arrive(&self, console: &Console, scene: &mut LoadedScene, dt: f64) -> Result<Arrival> {
        let mut arrival = Arrival { steps: 0, losses: None, failure: None };
        if self.steps == 0 {
            return Ok(arrival);
        }
        let LoadedScene { system, state, .. } = scene;
        let mut follower = Follower::new(system, state, self.stiffness, dt, parallelism(system))?;
        let mut collapsed = None;
        let outcome = advance(console, (system, state), (dt, self.steps), "looking at each", |step, state| {
            collapsed = follower.look(step, state).err();
            if collapsed.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        if let Some(spring) = collapsed {
            return Err(spring.into());
        }
        arrival.steps = outcome.steps;
        arrival.losses = Some(follower.first_losses().clone());
        arrival.failure = outcome.end.err();
        Ok(arrival)
    }
}

/// What was found, and its pictures.
struct Looked {
    inspection: Option<Inspection>,
    images: Option<Pictures>,
}

/// Parts of the bar.
const PARTS: u64 = 1000;

fn write(folder: &Path, claimed: &OutputFolder, page: &str, images: &Pictures) -> Result<()> {
    AtomicFile::write(folder.join("inspect.html"), |file| file.write_all(page.as_bytes()))?;
    let pictures = pictures(images);
    for (name, svg) in &pictures {
        AtomicFile::write(folder.join(name), |file| file.write_all(svg.as_bytes()))?;
    }
    // Pictures of an earlier inspection that this one has none of.
    let drawn: Vec<&str> = pictures.iter().map(|(name, _)| *name).collect();
    FILES[1..].iter().filter(|name| !drawn.contains(name)).try_for_each(|name| claimed.remove(name))
}
