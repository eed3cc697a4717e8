//! `sprung run`: simulate a scene.

use super::Stop;
use super::accuracy;
use super::common::{At, LoadedScene, Process, SceneFile, positive, positive_count, whole};
use super::console::{Console, error, help, number};
use super::files::{Files, Recorder};
use super::method::{MethodArguments, arguments_of, preconditioner_name};
use super::resume::{Checkpoints, Earlier, Ended, NOT_GIVEN, OTHER_OPTIONS, Parts};
use super::summary::SummaryText;
use super::threads::end_in_order;
use sprung::accuracy::AccuracyOptions;
use sprung::inspect::Inspection;
use sprung::integrate::{ImplicitOptions, Schedule, Status, StiffnessPolicy};
use sprung::linear::Tolerance;
use sprung::output::{
    Checkpoint, ChoiceReport, EnergyLog, FailureReport, Frames, OutputFolder, RunRecord, Summary, clear_frames,
    clear_frames_after, fingerprint, write_failed_step,
};
use sprung::plan::{DEFAULT_STEP, Plan, parallelism};
use sprung::report::inspection::explain;
use sprung::{Error, Result, State, System};
use std::num::NonZeroU64;
use std::path::Path;

/// Simulate a scene
///
/// Writes summary.json (what was done, how it ended, and how wrong it is about), final.json (positions in m and velocities in
/// m/s at the end) and energy.csv (energies in J after every step); with --frames also frames for ParaView. Without a time
/// step, here or in the scene, the run chooses its steps. Without --steps the run ends exactly at the duration: the last step is
/// shorter where the time step does not divide it. A run that breaks down, or in which energy appears from nowhere, writes
/// its last good state and ends with status 1; so does one that is ended by Ctrl-C, after the current step.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Run {
    #[command(flatten)]
    scene: SceneFile,

    /// Time step, in seconds [default: the scene's time.dt; without one steps are adaptive, see --rtol, or 0.01 for methods that have none]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Length of the run, in seconds; with --at it counts from there [default: the scene's time.duration]
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,

    /// Length of the run, in steps; wins over a duration
    #[arg(long, value_name = "N", value_parser = whole)]
    steps: Option<u64>,

    #[command(flatten)]
    at: At,

    #[command(flatten)]
    method: MethodArguments,

    #[command(flatten)]
    files: Files,

    /// Continue when energy appears without cause, to see the run blow up
    #[arg(long)]
    allow_unstable: bool,

    /// Do not propagate the errors of steps: faster, and nothing is known of the error at the end
    #[arg(long, conflicts_with = "accuracy")]
    no_error_estimate: bool,

    /// Write a checkpoint every N steps, from which --resume goes on. Solvers forget what they have learnt at each of them
    #[arg(long, value_name = "N", value_parser = positive_count::<NonZeroU64>)]
    checkpoint: Option<NonZeroU64>,

    /// Go on in the output folder from its last checkpoint: every file in the end is that of a run that nothing interrupted, with
    /// the same arguments. So a run that has come to its end goes on when a longer --duration or --steps is given. Where there is no checkpoint
    /// yet and --checkpoint is given the run begins anew; so it does, and says why, where a finished run cannot be gone on with: with other
    /// arguments, and with adaptive steps, which depend on the length of the run
    #[arg(long)]
    resume: bool,

    #[command(flatten)]
    process: Process,
}

/// Fixed steps, or the interval of records and the tolerance of adaptive ones.
struct Pacing {
    schedule: Schedule,
    rtol: Option<f64>,
    /// Steps are adaptive because no dt was given.
    has_no_dt: bool,
}

impl Run {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let scene = self.at.place(self.scene.load(console)?)?;
        let summary = if let Some(options) = self.accuracy_options(&scene)? {
            if self.checkpoint.is_some() {
                console.note("--checkpoint has no effect with --accuracy");
            }
            self.method.note_unused(console, None);
            let folder = self.process.folder(&scene);
            self.process.threads.install(|| accuracy::search(console, &scene, &self.files, &options, &folder))?
        } else {
            let pacing = self.pacing(console, &scene)?;
            self.method.note_unused(console, pacing.rtol);
            self.process.threads.install(|| self.simulate(console, &scene, pacing))?
        };
        if summary.status == Status::Completed { Ok(()) } else { Err(Stop::Reported) }
    }

    /// The required accuracy, if any. The answer is recorded at multiples of dt, where there is one.
    fn accuracy_options(&self, scene: &LoadedScene) -> Result<Option<AccuracyOptions>> {
        let options = self.method.run_options();
        if options.accuracy.is_none() {
            return Ok(None);
        }
        if self.resume {
            return Err(Error::Usage("--resume: a search for an --accuracy cannot be gone on with".into()));
        }
        let duration = scene.motion_length(self.duration, "--accuracy")?;
        let interval = self.dt.or(scene.time.dt).map_or_else(|| scene.record_interval(duration), Ok)?;
        scene.schedule(interval, duration)?;
        Ok(options.accuracy_options(&scene.system, duration, interval))
    }

    fn pacing(&self, console: &Console, scene: &LoadedScene) -> Result<Pacing> {
        let options = self.method.run_options();
        let is_adaptive = options.rtol.is_some();
        let duration = || scene.duration(self.duration);
        if let (Some(dt), true, None) = (scene.time.dt, is_adaptive, self.dt) {
            let dt = number(dt);
            console.note(format_args!("--rtol: steps are adaptive; the scene's dt of {dt} s is not used"));
        }
        // A number of steps asks for fixed ones.
        let rtol = if self.steps.is_some() { options.rtol } else { options.rtol_without_step() };
        if let (None, Some(rtol)) = (self.dt.or(scene.time.dt.filter(|_| !is_adaptive)), rtol) {
            let duration = self.steps.map_or_else(duration, |steps| Ok(steps as f64 * DEFAULT_STEP))?;
            let interval = if duration > 0.0 { scene.record_interval(duration)? } else { DEFAULT_STEP };
            let schedule = scene.schedule(interval, duration)?;
            return Ok(Pacing { schedule, rtol: Some(rtol), has_no_dt: !is_adaptive });
        }
        let dt = self.dt.or(scene.time.dt).unwrap_or(DEFAULT_STEP);
        let schedule = match self.steps {
            None => scene.schedule(dt, duration()?)?,
            Some(steps) => scene.schedule(dt, steps as f64 * dt).map(|_| Schedule::steps(dt, steps))?,
        };
        // Notes a default, once nothing else is missing.
        scene.step_or_default(console, self.dt);
        Ok(Pacing { schedule, rtol: options.rtol, has_no_dt: false })
    }

    fn simulate(&self, console: &Console, scene: &LoadedScene, pacing: Pacing) -> Result<Summary, Stop> {
        let Pacing { schedule, rtol, has_no_dt } = &pacing;
        let LoadedScene { file, name, system, state: start, .. } = scene;
        let lengths = [schedule.dt(), schedule.elapsed(schedule.len())];
        let plan = self.method.run_options().plan(system, start, lengths, *rtol);
        let plan = &plan.map_err(|error| error.in_file(file))?;
        let folder = self.process.folder(scene);
        let earlier = Earlier::of(&folder, self.resume, &self.files)?;
        let every = self.checkpoint.or_else(|| earlier.every());
        let parts = Parts {
            system,
            start,
            plan,
            schedule,
            monitor: plan.monitor(!self.allow_unstable, !self.no_error_estimate),
            checkpoints: every.map(|every| Checkpoints {
                every,
                folder: &folder,
                run: self.description(scene, plan, schedule),
                length: self.length_text(plan, schedule, system),
            }),
        };
        let from = earlier.checkpoint(console, &parts)?;
        let mut state = from.as_ref().map_or_else(|| start.clone(), Checkpoint::state);
        let begun = parts.begin(from.as_ref(), &state).map_err(|error| error.in_file(file))?;
        end_in_order();
        let claimed = self.files.claim(&folder, self.resume)?;
        self.remove_replaced(&claimed, from.as_ref())?;
        let frames = self.files.start_frames(&folder, schedule, scene, from.as_ref())?;
        let is_resumable = every.is_some();
        let energies = folder.join("energy.csv");
        let mut recorder = Recorder {
            energies: match &from {
                Some(checkpoint) => EnergyLog::resume(energies, &checkpoint.energies)?,
                None if is_resumable => EnergyLog::create_resumable(energies)?,
                None => EnergyLog::create(energies)?,
            },
            frames: if is_resumable { frames.map(Frames::resumable) } else { frames },
            progress: console.step_bar(schedule.len()),
        };
        if from.is_none() {
            recorder.record(system, &state, 0, &begun.0)?;
        }
        let ended = parts.run(from, begun, &mut state, &mut recorder).map_err(Stop::Broken)?;
        let Ended { stepper, monitor, outcome, statistics, wall_seconds } = ended;
        let record = RunRecord {
            scene: name.clone(),
            system,
            plan,
            schedule,
            stepper: stepper.get(),
            monitor: &monitor,
            outcome: &outcome,
            statistics,
            state: &state,
            wall_seconds,
            choice: ChoiceReport::of_plan(plan, *has_no_dt),
        };
        let summary = record.summary();
        let written = recorder.finish(system).and_then(|()| self.files.finish(&claimed, system, &state, &summary));
        let names = written.map_err(Stop::Broken)?;
        SummaryText { summary: &summary, system, folder: &folder, files: &names }.print(console)?;
        if let Some(FailureReport { step, time, message }) = &summary.failure {
            let time = number(*time);
            error(format_args!("{} in step {step}, at t = {time} s: {message}", summary.status.name()));
        }
        if summary.status == Status::Unstable {
            let last = format!("step {}, t = {} s", summary.steps, number(summary.time));
            help(format_args!("the state kept is from before that ({last}); --allow-unstable goes on"));
        }
        if summary.status == Status::Indefinite {
            let dt = schedule.step(summary.steps).unwrap_or(schedule.dt());
            let failure = folder.join("failure");
            explain_failure(console, (system, &state), plan, &summary, dt, &failure).map_err(Stop::Broken)?;
        }
        Ok(summary)
    }

    fn remove_replaced(&self, folder: &OutputFolder, from: Option<&Checkpoint>) -> Result<()> {
        if let Some(checkpoint) = from {
            Checkpoint::reopen(folder)?;
            return clear_frames_after(folder, checkpoint.reached);
        }
        Checkpoint::forget(folder)?;
        if self.files.frames.is_some() { clear_frames(folder) } else { Ok(()) }
    }

    /// Everything besides the length of the run that determines the bits of the files: a name and a value on each line.
    fn description(&self, scene: &LoadedScene, plan: &Plan, schedule: &Schedule) -> String {
        let Plan { configuration, rtol, .. } = plan;
        let ImplicitOptions { stiffness, linear } = &configuration.options;
        let given = |is_given: bool| if is_given { "given" } else { NOT_GIVEN }.to_owned();
        let some = |value: Option<String>| value.unwrap_or_else(|| NOT_GIVEN.to_owned());
        let tolerance = match linear.tolerance {
            Tolerance::Fixed(tolerance) => format!("{tolerance:?}"),
            Tolerance::Adaptive => "adaptive".to_owned(),
        };
        let lines = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("scene", fingerprint(&scene.system, &scene.state)),
            ("--method", configuration.method.name().to_owned()),
            // The interval of records of adaptive steps depends on the length of the run.
            ("--dt", some(rtol.is_none().then(|| format!("{:?}", schedule.dt())))),
            ("--rtol", some(rtol.map(|rtol| format!("{rtol:?}")))),
            ("--stiffness", stiffness.name().to_owned()),
            ("--solver", linear.solver.name().to_owned()),
            ("--preconditioner", preconditioner_name(linear.preconditioner).to_owned()),
            ("--tolerance", tolerance),
            ("--frames", some(self.files.frames.map(|frames| frames.to_string()))),
            ("--view", given(self.files.view)),
            ("--allow-unstable", given(self.allow_unstable)),
            ("--no-error-estimate", given(self.no_error_estimate)),
            (OTHER_OPTIONS, format!("{configuration:?}")),
        ];
        lines.map(|(name, value)| format!("{name} {value}\n")).concat()
    }

    /// Options that depend on the length of the run: everything with adaptive steps, whose tolerance is for the whole run; else the
    /// interval of frames.
    fn length_text(&self, plan: &Plan, schedule: &Schedule, system: &System) -> String {
        match plan.rtol {
            Some(_) => format!("{schedule:?}"),
            None => format!("{:?}", self.files.interval(schedule, system)),
        }
    }
}

/// Explains a step that failed for an indefinite matrix, suggests a remedy, and writes the files to examine it.
fn explain_failure(
    console: &Console,
    (system, state): (&System, &State),
    plan: &Plan,
    summary: &Summary,
    dt: f64,
    folder: &Path,
) -> Result<()> {
    // The inspection of a larger system takes longer than a user waits.
    if system.dofs().len() > 200_000 {
        console.note("the system is too large to be inspected here: see sprung inspect");
        return Ok(());
    }
    let (option, matrix_dt) = plan.failed_matrix(dt);
    let inspection = Inspection::at(system, state, matrix_dt, option, parallelism(system))?;
    let (causes, remedy) = explain(&inspection, dt);
    causes.into_iter().for_each(error);
    // Other policies would have been no help to one that finds definite matrices.
    let is_policy = !matches!(plan.configuration.options.stiffness, StiffnessPolicy::Always(_));
    remedy.filter(|_| !is_policy).into_iter().for_each(help);
    write_failed_step(folder, &summary.scene, (system, state), summary.steps, dt, &inspection)?;
    console.note(format_args!("{} has A, b and the culprits", folder.display()));
    let command = format!("sprung run '{}' {}", folder.join("scene.toml").display(), arguments_of(plan));
    help(format_args!("this repeats the step: {command}"));
    Ok(())
}
