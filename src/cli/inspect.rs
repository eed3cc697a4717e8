//! `sprung inspect`: is A positive definite, which springs spoil it, and which step is safe?

use super::common::{LoadedScene, SceneFile, Threads, check_writable};
use super::console::{Console, error};
use super::recorder::progress_bar;
use super::values::{choice, count, positive};
use super::{Exit, Stop};
use sprung::inspect::{FirstLosses, Follower, Inspection, Pictures};
use sprung::integrate::{ImplicitOptions, Method, RunFailure, Schedule, run};
use sprung::linear::SolverOptions;
use sprung::output::AtomicFile;
use sprung::plan::parallelism;
use sprung::report::inspection::{InspectionRecord, html, pictures, text};
use sprung::{Result, State, Stiffness};
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Say whether A is positive definite, which springs spoil it, and which step is safe
///
/// Counts the signs of the eigenvalues of A = M/dt² − G/dt − K, finds λ_min, λ_max and the condition number, the largest time
/// step for which A is positive definite, the largest for which linearised backward Euler is stable and the largest that turns
/// no spring too far, under each stiffness option, and the springs behind every direction of negative curvature. All of this is
/// about one state. With --steps it follows so many steps of linearised backward Euler, says after which step definiteness,
/// stability, turning and energy were lost first, and looks at the state at the end. Writes inspect.html and its pictures.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Inspect {
    #[command(flatten)]
    scene: SceneFile,

    /// Time step, in seconds [default: the scene's time.dt, or 0.01]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Follow a run for so many steps first (with on-demand stiffness)
    #[arg(long, value_name = "N", value_parser = count, default_value = "0")]
    steps: u64,

    /// Which part of every spring's stiffness enters the matrix that is examined
    #[arg(long, value_name = "OPTION", default_value = "full", value_parser = choice(&Stiffness::ALL, Stiffness::name, describe_stiffness))]
    stiffness: Stiffness,

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
        let scene = self.scene.load()?;
        let dt = scene.step_or_default(console, self.dt);
        self.threads.install(|| self.inspect(console, scene, dt))
    }

    fn inspect(&self, console: &Console, mut scene: LoadedScene, dt: f64) -> Result<Exit, Stop> {
        let folder = scene.folder(&self.out);
        let file = scene.file.clone();
        let in_file = |error: sprung::Error| error.in_file(&file);
        let arrival = self.arrive(console, &mut scene, dt).map_err(in_file)?;
        let LoadedScene { name, system, state, .. } = &scene;
        let par = parallelism(system);
        let inspection = Inspection::at(system, state, dt, self.stiffness, par).map_err(in_file)?;
        if !inspection.examined().largest.is_finite() && !system.dofs().is_empty() {
            error(format_args!("A has entries that are not finite numbers (dt = {dt:?} s)"));
            return Ok(Exit::Failed);
        }
        let _claimed = check_writable(&folder, &FILES)?;
        let images = Pictures::of(system, state, &inspection, par).map_err(in_file)?;
        let losses = arrival.losses.as_ref();
        let page = html(name, arrival.steps, state.time, &inspection, losses, &images);
        write(&folder, &page, &images).map_err(Stop::Broken)?;
        let record = InspectionRecord::new(name, arrival.steps, state.time, &inspection).with_losses(losses);
        let text = text(name, arrival.steps, state.time, &inspection, losses);
        let page = folder.join("inspect.html");
        console.result(&record, format!("{text}\n  pictures     {}", page.display()))?;
        match arrival.failure {
            None => Ok(Exit::Done),
            Some(RunFailure { step, time, failure }) => {
                error(format_args!("{} in step {step}, at t = {time} s: {failure}", failure.status().name()));
                Ok(Exit::Failed)
            }
        }
    }

    /// Follows as many steps as asked for, looking at the state before each and after the last.
    fn arrive(&self, console: &Console, scene: &mut LoadedScene, dt: f64) -> Result<Arrival> {
        let mut arrival = Arrival { steps: 0, losses: None, failure: None };
        if self.steps == 0 {
            return Ok(arrival);
        }
        let LoadedScene { system, state, .. } = scene;
        let par = parallelism(system);
        let mut follower = Follower::new(system, state, self.stiffness, dt, par)?;
        let linear = SolverOptions { par, ..SolverOptions::default() };
        let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
        let mut stepper = Method::LinearBackwardEuler.stepper(system, state, &options)?;
        let mut collapsed = None;
        let bar = progress_bar(console, self.steps).with_message("looking at each");
        let outcome = run(stepper.as_mut(), state, &Schedule::steps(dt, self.steps), |step, state: &State| {
            bar.set_position(step);
            collapsed = follower.look(step, state).err();
            if collapsed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        if let Some(spring) = collapsed {
            return Err(spring.into());
        }
        arrival.steps = outcome.steps;
        arrival.losses = Some(follower.first_losses().clone());
        arrival.failure = outcome.end.err();
        Ok(arrival)
    }
}

fn write(folder: &Path, page: &str, images: &Pictures) -> Result<()> {
    AtomicFile::write(folder.join("inspect.html"), |file| file.write_all(page.as_bytes()))?;
    for (name, svg) in pictures(images) {
        AtomicFile::write(folder.join(name), |file| file.write_all(svg.as_bytes()))?;
    }
    Ok(())
}
