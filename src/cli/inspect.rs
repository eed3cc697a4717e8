//! `sprung inspect`: is A positive definite, which springs spoil it, and which step is safe?

use super::Stop;
use super::common::{At, LoadedScene, Process, SceneFile, advance, choice, claim, positive, whole};
use super::console::{Console, PARTS, number};
use super::threads::{end_in_order, is_interrupted};
use sprung::inspect::{AFFORDABLE, FirstLosses, Follower, Inspection, Part, Pictures};
use sprung::integrate::RunFailure;
use sprung::output::{AtomicFile, OutputFolder};
use sprung::plan::parallelism;
use sprung::report::inspection::{InspectionReport, first_answer};
use sprung::{Error, Result, Stiffness};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// Say whether A is positive definite, which springs spoil it, and which step is safe
///
/// Counts the signs of the eigenvalues of A = M/dt² − G/dt − K, finds λ_min, λ_max and the condition number, the largest time step for which A is
/// positive definite, the largest for which linearised backward Euler is stable and the largest that turns no spring too far, under each stiffness
/// option, and the springs behind every direction of negative curvature. All of this is about one state. Whether A is positive definite, and the
/// spring that spoils it most, is said first, on stderr. With --steps it follows so many steps of linearised backward Euler, says after which step
/// definiteness, stability, turning and energy were lost first, and looks at the state at the end. Writes inspect.html and its pictures.
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
    #[arg(long, value_name = "OPTION", default_value = "full", value_parser = choice(&STIFFNESSES, Stiffness::name))]
    stiffness: Stiffness,

    /// Inspect everything, however long it takes, instead of skipping what takes too much work
    #[arg(long)]
    all: bool,

    #[command(flatten)]
    process: Process,
}

const STIFFNESSES: [(Stiffness, &str); 4] = [
    (Stiffness::Full, "the exact stiffness"),
    (Stiffness::Tension, "without the transverse terms of compressed springs"),
    (Stiffness::Axial, "without any transverse term"),
    (Stiffness::Absolute, "the transverse terms of compressed springs with the other sign"),
];

const FILES: [&str; 6] =
    ["inspect.html", "scene.svg", "lambda-min.svg", "spectrum.svg", "pattern-A.svg", "pattern-L.svg"];

#[derive(Default)]
struct Followed {
    steps: u64,
    losses: Option<FirstLosses>,
    failure: Option<RunFailure>,
}

impl Inspect {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let mut scene = self.at.place(self.scene.load(console)?)?;
        let dt = scene.step_or_default(console, self.dt);
        let folder = self.process.folder(&scene);
        if self.steps > 0 {
            end_in_order();
        }
        let followed = self.process.threads.install(|| Ok(self.follow(console, &mut scene, dt)))?;
        let scene = Arc::new(scene);
        let LoadedScene { file, name, system, state, .. } = &*scene;
        let in_file = |error: Error| error.in_file(file);
        let Followed { steps, losses, failure } = followed.map_err(in_file)?;
        let (inspection, pictures) = self.inspect(console, &scene, dt)?.map_err(in_file)?;
        let Some(inspection) = inspection else {
            return Err(Stop::Computation("interrupted before anything was known of A".into()));
        };
        let is_known = !inspection.lacks(Part::Spectrum(self.stiffness)) && !system.dofs().is_empty();
        if is_known && !inspection.examined().largest.is_finite() {
            let message = format!("A has entries that are not finite numbers (dt = {} s)", number(dt));
            return Err(Stop::Computation(message));
        }
        let claimed = claim(&folder, &FILES, false)?;
        // Those of an interrupted inspection are few and quickly made.
        let pictures = pictures.map_or_else(|| Pictures::of(system, state, &inspection), Ok).map_err(in_file)?;
        let pictures = pictures.named(name);
        let report = InspectionReport {
            scene: name,
            step: steps,
            time: state.time,
            inspection: &inspection,
            losses: losses.as_ref(),
        };
        write(&folder, &claimed, &report.html(&pictures), &pictures).map_err(Stop::Broken)?;
        let text = report.text();
        console.result(&report, format!("{text}\n  pictures     {}", folder.join("inspect.html").display()))?;
        if let Some(failure) = failure {
            return Err(failure.into());
        }
        if is_interrupted() {
            return Err(Stop::Computation("interrupted: what was not looked at is left out".into()));
        }
        Ok(())
    }

    /// Inspects the state and draws it; after an interruption, returns what is known by then.
    fn inspect(&self, console: &Console, scene: &Arc<LoadedScene>, dt: f64) -> Result<Result<Inspected>, Stop> {
        let bar = console.bar(PARTS, "{wide_bar} {msg}, {eta}").with_message("inspecting");
        let (option, all, inspected) = (self.stiffness, self.all, scene.clone());
        let (mut known, mut is_answered) = (None, false);
        let inspected = self.process.threads.attend(
            move |tell| {
                let LoadedScene { system, state, .. } = &*inspected;
                let par = parallelism(system);
                let most = if all { f64::INFINITY } else { AFFORDABLE };
                let mut observer = |progress: f64, found: &Inspection| tell((progress, found.clone()));
                let inspection = Inspection::within(system, state, dt, option, par, most, &mut observer)?;
                tell((1.0, inspection.clone()));
                let pictures = Pictures::of(system, state, &inspection)?;
                Ok((Some(inspection), Some(pictures)))
            },
            |(progress, found)| {
                if !is_answered && let Some(first) = first_answer(&found) {
                    bar.suspend(|| console.note(first));
                    is_answered = true;
                }
                bar.set_position((progress * PARTS as f64) as u64);
                bar.set_message(if progress < 1.0 { "inspecting" } else { "drawing" });
                known = Some(found);
            },
        )?;
        bar.finish_and_clear();
        // Without the picture that takes longest.
        Ok(inspected.unwrap_or_else(|| Ok((known.map(Inspection::without_curve), None))))
    }

    fn follow(&self, console: &Console, scene: &mut LoadedScene, dt: f64) -> Result<Followed> {
        if self.steps == 0 {
            return Ok(Followed::default());
        }
        let LoadedScene { system, state, .. } = scene;
        let mut follower = Follower::new(system, state, self.stiffness, dt, parallelism(system))?;
        let mut collapsed = None;
        let outcome = advance(console, (system, state), (dt, self.steps), "looking at each", |step, state| {
            collapsed = follower.look(step, state).err();
            if collapsed.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        match collapsed {
            Some(spring) => Err(spring.into()),
            None => Ok(Followed {
                steps: outcome.steps,
                losses: Some(follower.first_losses().clone()),
                failure: outcome.end.err(),
            }),
        }
    }
}

type Inspected = (Option<Inspection>, Option<Pictures>);

fn write(folder: &Path, claimed: &OutputFolder, page: &str, pictures: &Pictures) -> Result<()> {
    AtomicFile::write_text(folder.join("inspect.html"), page)?;
    let drawn = sprung::report::inspection::pictures(pictures);
    for (name, svg) in &drawn {
        AtomicFile::write_text(folder.join(name), svg)?;
    }
    // Pictures of an earlier inspection that this one does not replace.
    let is_older = |name: &&&str| drawn.iter().all(|(drawn, _)| drawn != *name);
    FILES[1..].iter().filter(is_older).try_for_each(|name| claimed.remove(name))
}
