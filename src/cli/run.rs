//! `sprung run`: simulate a scene.

use super::answer::AccuracyCommand;
use super::common::{LoadedScene, SceneFile, Threads, claim};
use super::console::{Console, error, help, warning};
use super::diagnostics::doubts;
use super::failure::Failed;
use super::files::{FILES, Files, text};
use super::method::{MethodArguments, repeat};
use super::number::{count, number};
use super::parts::{Checkpoints, Ended, Parts};
use super::recorder::Recorder;
use super::resume::Earlier;
use super::start::At;
use super::values::{positive, positive_count, whole};
use super::view;
use super::{Exit, Stop, interrupt};
use sprung::accuracy::AccuracyOptions;
use sprung::integrate::{Schedule, Status, StiffnessPolicy};
use sprung::output::{
    Checkpoint, ChoiceReport, EnergyLog, FailureReport, OutputFolder, Ran, Summary, WAITING, clear_frames,
    clear_frames_after, fingerprint, write_final_state,
};
use sprung::plan::{DEFAULT_STEP, Plan, records_every};
use sprung::{Error, Result, System};
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

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

    /// Time step, in seconds [default: the scene's time.dt; without one steps are adaptive, see --rtol, or 0.01 for methods that
    /// have none]
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

    /// Go on when energy appears from nowhere: to see it blow up
    #[arg(long)]
    allow_unstable: bool,

    /// Do not propagate the errors of steps: faster, and nothing is known of the error at the end
    #[arg(long)]
    no_error_estimate: bool,

    /// Write a checkpoint every N steps, from which --resume goes on. Solvers forget what they have learnt at each of them
    #[arg(long, value_name = "N", value_parser = positive_count)]
    checkpoint: Option<NonZeroU64>,

    /// Go on in the output folder from its last checkpoint: every file in the end is that of a run that nothing interrupted, with
    /// the same arguments. So a run that has come to its end goes on when a longer --duration or --steps is given. Where there is no checkpoint
    /// yet and --checkpoint is given the run begins anew; so it does, and says why, where a finished run cannot be gone on with: with other
    /// arguments, and with adaptive steps, which depend on the length of the run
    #[arg(long)]
    resume: bool,

    #[command(flatten)]
    threads: Threads,

    /// Folder for the files, made where it does not exist [default: out/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What is to be run and how.
struct Prepared {
    schedule: Schedule,
    plan: Plan,
    choice: Option<ChoiceReport>,
}

/// Steps of fixed length, or the interval of records and the tolerance of adaptive ones.
struct Pacing {
    schedule: Schedule,
    rtol: Option<f64>,
    /// Whether steps are adaptive because no dt was given.
    is_chosen: bool,
}

impl Run {
    pub fn execute(&self, console: &Console) -> Result<Exit, Stop> {
        let scene = self.at.place(self.scene.load(console)?)?;
        let accuracy = self.accuracy_options(&scene)?;
        if accuracy.is_some() && self.checkpoint.is_some() {
            console.note("--checkpoint has no effect with --accuracy");
        }
        let pace = if accuracy.is_none() { Some(self.pace(console, &scene)?) } else { None };
        self.method.note_unused(console, pace.as_ref().and_then(|pace| pace.rtol));
        let interrupted = interrupt::flag();
        let summary = self.threads.install(|| match (accuracy, pace) {
            (Some(options), _) => {
                let folder = scene.folder(&self.out);
                AccuracyCommand { files: &self.files, options, folder, interrupted }.answer(console, &scene)
            }
            (None, Some(pace)) => {
                let prepared = self.prepare(&scene, pace)?;
                self.simulate(console, scene, prepared, interrupted)
            }
            (None, None) => Err(Error::Usage("neither steps nor an accuracy are given".into()).into()),
        })?;
        if summary.statistics.indefinite_solves > 0 {
            let solves = count(summary.statistics.indefinite_solves, "solve");
            console.note(format_args!("A was indefinite in {solves}: the motion may look right and be wrong"));
        }
        Ok(if summary.status == Status::Completed { Exit::Done } else { Exit::Failed })
    }

    /// How long the steps are, and for how long. A number of steps asks for steps of one length.
    fn pace(&self, console: &Console, scene: &LoadedScene) -> Result<Pacing> {
        let adaptive = if self.steps.is_some() {
            self.method.run_options().rtol
        } else {
            self.method.run_options().rtol_without_step()
        };
        let asked = self.method.run_options().rtol.is_some();
        let given = self.dt.or(scene.time.dt.filter(|_| !asked));
        if let (Some(dt), true, None) = (scene.time.dt, asked, self.dt) {
            let dt = number(dt);
            console.note(format_args!("--rtol: steps are adaptive; the scene's dt of {dt} s is not used"));
        }
        if let (None, Some(rtol)) = (given, adaptive) {
            let duration = match self.steps {
                Some(steps) => steps as f64 * DEFAULT_STEP,
                None => scene.or_given(self.duration, scene.time.duration, "duration")?,
            };
            // A motion without a length is its start alone.
            let interval = if duration > 0.0 { records_every(duration) } else { DEFAULT_STEP };
            return Ok(Pacing { schedule: scene.schedule(interval, duration)?, rtol: Some(rtol), is_chosen: !asked });
        }
        let duration = |dt| -> Result<Schedule> {
            scene.schedule(dt, scene.or_given(self.duration, scene.time.duration, "duration")?)
        };
        let dt = self.dt.or(scene.time.dt);
        // What is missing altogether is said before what is put in its place.
        let schedule = self.steps.map_or_else(
            || duration(dt.unwrap_or(DEFAULT_STEP)),
            |steps| {
                let dt = dt.unwrap_or(DEFAULT_STEP);
                scene.schedule(dt, steps as f64 * dt).map(|_| Schedule::steps(dt, steps))
            },
        )?;
        scene.step_or_default(console, self.dt);
        Ok(Pacing { schedule, rtol: self.method.run_options().rtol, is_chosen: false })
    }

    /// Decides how the scene is run.
    fn prepare(&self, scene: &LoadedScene, pace: Pacing) -> Result<Prepared, Stop> {
        let LoadedScene { file, system, state, .. } = scene;
        let Pacing { schedule, rtol, is_chosen } = pace;
        let lengths = [schedule.dt(), schedule.elapsed(schedule.len())];
        let plan = self.method.run_options().plan(system, state, lengths, rtol).map_err(|error| error.in_file(file))?;
        let why = if is_chosen { "no dt is given: " } else { "" };
        let steps = rtol.map(|rtol| format!("{why}adaptive steps, rtol {rtol:e}"));
        let reasons: Vec<String> = steps.into_iter().chain(plan.reason.clone()).collect();
        let choice =
            (!reasons.is_empty()).then(|| ChoiceReport { rtol, ..ChoiceReport::of_preset(reasons.join("; ")) });
        Ok(Prepared { schedule, plan, choice })
    }

    /// The accuracy that is required, if one is. The answer is recorded at multiples of dt, where there is one.
    fn accuracy_options(&self, scene: &LoadedScene) -> Result<Option<AccuracyOptions>> {
        if self.method.run_options().accuracy.is_none() {
            return Ok(None);
        }
        if self.resume {
            return Err(Error::Usage("--resume: a search for an --accuracy cannot be gone on with".into()));
        }
        let duration = scene.motion_length(self.duration, "--accuracy")?;
        let interval = self.dt.or(scene.time.dt).unwrap_or(records_every(duration));
        scene.schedule(interval, duration)?;
        Ok(self.method.run_options().accuracy_options(&scene.system, duration, interval))
    }

    /// Runs, writes and reports the results.
    fn simulate(
        &self,
        console: &Console,
        scene: LoadedScene,
        prepared: Prepared,
        interrupted: &AtomicBool,
    ) -> Result<Summary, Stop> {
        let folder = scene.folder(&self.out);
        let Prepared { schedule, plan, choice } = prepared;
        let schedule = &schedule;
        let LoadedScene { file, name, system, state: start, triangles, .. } = scene;
        let earlier = Earlier::of(&folder, self.resume)?;
        let every = self.checkpoint.or_else(|| earlier.every());
        let parts = Parts {
            system: &system,
            start: &start,
            plan: &plan,
            schedule,
            monitor: plan.monitor(!self.allow_unstable, !self.no_error_estimate),
            interrupted,
            checkpoints: every.map(|every| Checkpoints {
                every,
                folder: &folder,
                run: fingerprint(&system, &start, &self.how(&plan, schedule)),
                length: self.length(&plan, schedule, &system),
            }),
        };
        let from = earlier.checkpoint(console, self.resume, &parts)?;
        let mut state = from.as_ref().map_or_else(|| start.clone(), Checkpoint::state);
        let begun = parts.begin(from.as_ref(), &state).map_err(|error| error.in_file(&file))?;
        interrupt::keep();
        let claimed = claim(&folder, &FILES, self.resume)?;
        match &from {
            None => {
                Checkpoint::forget(&claimed)?;
                if self.files.frames.is_some() {
                    clear_frames(&claimed)?;
                }
            }
            Some(checkpoint) => {
                Checkpoint::reopen(&claimed)?;
                clear_frames_after(&claimed, checkpoint.reached)?;
            }
        }
        let resumable = every.is_some();
        let kept = view::frames(&folder, self.files.frames, self.files.view, schedule, &system, from.as_ref())?;
        let kept = kept.map(|frames| frames.with_triangles(triangles));
        let kept = kept.map(|frames| if resumable { frames.resumable() } else { frames });
        let mut recorder = match &from {
            Some(checkpoint) => Recorder::resume(console, &folder, kept, schedule, checkpoint)?,
            None => {
                let energies = folder.join("energy.csv");
                let energies =
                    if resumable { EnergyLog::create_resumable(energies)? } else { EnergyLog::create(energies)? };
                Recorder::start(console, energies, kept, schedule, &system, &state, &begun.0)?
            }
        };
        let ended = parts.run(from, begun, &mut state, &mut recorder).map_err(Stop::Broken)?;
        let Ended { stepper, monitor, outcome, statistics, wall_seconds } = ended;
        let status = outcome.status();
        let (doubt, warnings) = doubts(&plan, status, &monitor.indicators(&state));
        let ran = Ran {
            scene: name,
            system: &system,
            plan: &plan,
            schedule,
            stepper: stepper.get(),
            monitor: &monitor,
            outcome: &outcome,
            statistics,
            state: &state,
            wall_seconds,
            error: doubt,
            warnings,
            choice,
        };
        let summary = ran.summary();
        let written = recorder
            .finish(&system)
            .and_then(|()| write_final_state(folder.join("final.json"), &summary.scene, &system, summary.steps, &state))
            .and_then(|()| self.files.clear_older(&claimed))
            .and_then(|()| summary.write(folder.join("summary.json")))
            .and_then(|()| if summary.status == Status::Completed { put_away(&claimed) } else { Ok(()) });
        written.map_err(Stop::Broken)?;
        if summary.status == Status::Completed {
            claimed.tidy();
        }
        let names = self.files.show(&folder).map_err(Stop::Broken)?;
        console.result(&summary, text(&summary, &folder, &names))?;
        summary.warnings.iter().for_each(warning);
        if let Some(FailureReport { step, time, message }) = &summary.failure {
            let time = number(*time);
            error(format_args!("{} in step {step}, at t = {time} s: {message}", summary.status.name()));
        }
        if summary.status == Status::Unstable {
            let kept = format!("step {}, t = {} s", summary.steps, number(summary.time));
            help(format_args!("the state kept is from before that ({kept}); --allow-unstable goes on"));
        }
        if summary.status == Status::Indefinite {
            let step = schedule.step(summary.steps).unwrap_or(schedule.dt());
            let (option, matrix_dt) = plan.failed_matrix(step);
            let (scene, steps, repeat) = (&summary.scene, summary.steps, repeat(&plan));
            let is_on_demand = plan.configuration.options.stiffness == StiffnessPolicy::OnDemand;
            let failed = Failed { scene, system: &system, state: &state, steps, step, is_on_demand, repeat };
            failed.explain(console, option, matrix_dt, &folder.join("failure")).map_err(Stop::Broken)?;
        }
        Ok(summary)
    }
}

impl Run {
    /// Everything but the scene that decides about the bits of the files, however long the run is.
    fn how(&self, plan: &Plan, schedule: &Schedule) -> String {
        let Plan { configuration, rtol, .. } = plan;
        format!(
            "{configuration:?} {rtol:?} {:?} {:?} {} {} {}",
            schedule.dt(),
            self.files.frames,
            self.files.view,
            self.allow_unstable,
            self.no_error_estimate
        )
    }

    /// What of a run depends on its length: all of one that adapts its steps, whose tolerance is for the whole; else the interval of frames that was not asked for.
    fn length(&self, plan: &Plan, schedule: &Schedule, system: &System) -> String {
        if plan.rtol.is_some() {
            return format!("{schedule:?}");
        }
        format!("{:?}", view::interval(self.files.frames, self.files.view, schedule, system))
    }
}

/// A run that came to its end keeps its last checkpoint, for a longer one; its frames are in the trajectory.
fn put_away(folder: &OutputFolder) -> Result<()> {
    Checkpoint::finish(folder)?;
    folder.remove(WAITING)
}
