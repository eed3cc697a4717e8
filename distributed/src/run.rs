//! `sprung-mpi run`: simulate a scene.

use crate::agreed::agreed;
use crate::checkpoint::{self, Checkpoint};
use crate::load::Source;
use crate::method::{MethodArguments, positive};
use crate::part::{self, Part};
use crate::petsc::Petsc;
use crate::results::{Frames, clear_frames, write_final_state};
use crate::slab::Header;
use crate::solver::PetscSolver;
use crate::{Stop, or_end, ranks, say};
use sprung::State;
use sprung::integrate::{
    Bdf2, LinearBackwardEuler, Method, Monitor, MonitorOptions, Outcome, Schedule, Statistics, Status, TimeStepper,
    Verlet, run_monitored,
};
use sprung::linear::{CostModel, LinearSolver};
use sprung::output::{Effort, EnergyChange, EnergyLog, ErrorKind, ErrorReport, FailureReport, OutputFolder, Summary};
use std::num::NonZeroU64;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Simulate a scene
///
/// Writes summary.json, final.json and energy.csv as `sprung run` does; with --frames also frames for ParaView, in pieces.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Run {
    #[command(flatten)]
    source: Source,

    /// Time step, in seconds [default: the scene's time.dt]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Length of the run, in seconds [default: the scene's time.duration]
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,

    /// Length of the run, in steps; wins over a duration
    #[arg(long, value_name = "N")]
    steps: Option<u64>,

    #[command(flatten)]
    method: MethodArguments,

    /// Write every Nth step as frames/frame_N.pvtp with a piece of every rank, and frames.pvd, which opens them as a time series
    #[arg(long, value_name = "N")]
    frames: Option<NonZeroU64>,

    /// Continue when energy appears without cause
    #[arg(long)]
    allow_unstable: bool,

    /// Write a checkpoint every N steps, from which --resume goes on, on any number of ranks
    #[arg(long, value_name = "N")]
    checkpoint: Option<NonZeroU64>,

    /// Go on in the output folder from its last checkpoint
    #[arg(long)]
    resume: bool,

    /// Folder for the files, made where it does not exist [default: out/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

/// How often progress is told.
const PROGRESS: Duration = Duration::from_secs(5);

/// A run under way.
struct Running<'r> {
    run: &'r Run,
    header: &'r Header,
    part: &'r Part,
    petsc: &'r Petsc,
    schedule: Schedule,
    folder: &'r Path,
    fingerprint: String,
}

/// What has been done, and what became of it.
struct Ended<'r> {
    monitor: Monitor<'r>,
    outcome: Outcome,
    statistics: Statistics,
    solver: [&'static str; 2],
    wall_seconds: f64,
}

impl Run {
    /// Runs the command.
    ///
    /// # Errors
    /// Why not, on all ranks.
    pub fn execute(&self) -> Result<(), Stop> {
        let (header, slab) = self.source.load(crate::petsc::MOST_ROWS)?;
        let schedule = self.schedule(&header)?;
        let petsc = self.method.start();
        let part = or_end(part::cut(&petsc, &header, slab));
        let folder = self.out.clone().unwrap_or_else(|| self.source.folder(&header));
        let found = if self.resume { Checkpoint::read(&folder)? } else { None };
        let method = &self.method;
        let fingerprint = format!(
            "{} {} {} {} {:?} {schedule:?} {:?}",
            header.fingerprint, method.method, method.stiffness, method.solver, method.tolerance, self.frames
        );
        let mut claimed = None;
        agreed(|| {
            claimed = Some(OutputFolder::claim(&folder, self.resume).map_err(|error| error.to_string())?);
            Ok(true)
        })?;
        if let Some(found) = &found
            && (found.run != fingerprint || self.checkpoint.is_some_and(|every| every.get() != found.every))
        {
            let folder = folder.display();
            return Err(Stop::Unusable(format!("{folder}: its checkpoint is of another run: leave out --resume")));
        }
        if self.resume && found.is_none() && self.checkpoint.is_none() {
            let folder = folder.display();
            return Err(Stop::Unusable(format!("{folder}: no checkpoint to resume from; --checkpoint N writes them")));
        }
        let interrupted = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            or_end(signal_hook::flag::register(signal, interrupted.clone()));
        }
        let running =
            Running { run: self, header: &header, part: &part, petsc: &petsc, schedule, folder: &folder, fingerprint };
        let status = running.go(found, &interrupted)?;
        if !self.method.petsc.is_empty() {
            or_end(petsc.report_unused_options());
        }
        if status == Status::Completed { Ok(()) } else { Err(Stop::Failed) }
    }

    fn schedule(&self, header: &Header) -> Result<Schedule, Stop> {
        let missing = |name: &str| Stop::Unusable(format!("{}: no {name}: give the option --{name}", header.name));
        let dt = self.dt.or(header.dt).ok_or_else(|| missing("dt"))?;
        let steps = self.steps.map(|steps| Schedule::steps(dt, steps));
        let duration = self.duration.or(header.duration);
        let schedule = match (steps, duration) {
            (Some(steps), _) => steps,
            (None, Some(duration)) => Schedule::duration(dt, duration),
            (None, None) => return Err(missing("duration")),
        };
        Schedule::check(dt, schedule.duration_of_whole()).map_err(|invalid| Stop::Unusable(invalid.to_string()))?;
        Ok(schedule)
    }
}

impl<'r> Running<'r> {
    fn go(&self, found: Option<Checkpoint>, interrupted: &AtomicBool) -> Result<Status, Stop> {
        let Self { header, part, folder, .. } = *self;
        let total = header.particles;
        let mut state = part.state.clone();
        if let Some(found) = &found {
            state = found.state(folder, total, part)?;
        } else {
            checkpoint::forget(folder);
            clear_frames(folder);
        }
        let energies = folder.join("energy.csv");
        let mut log = (ranks::rank() == 0).then(|| {
            or_end(match (&found, self.run.checkpoint) {
                (Some(found), _) => EnergyLog::resume(energies, &found.energies),
                (None, Some(_)) => EnergyLog::create_resumable(energies),
                (None, None) => EnergyLog::create(energies),
            })
        });
        let series = found.as_ref().map_or_else(Vec::new, |found| found.frames.clone());
        let mut frames = self.run.frames.map(|every| Frames::new(folder, every, part, series));
        let ended = self.run_parts(found, &mut state, &mut log, &mut frames, interrupted);
        let steps = ended.outcome.steps;
        let status = ended.outcome.status();
        let summary = self.summary(&ended, &state);
        write_final_state(&folder.join("final.json"), &header.name, total, steps, part, &state);
        if let Some(log) = log {
            or_end(log.finish());
            or_end(summary.write(folder.join("summary.json")));
            println!("{}", in_words(&summary, folder));
            summary.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
            if let Some(failure) = &summary.failure {
                eprintln!("error: step {} at t = {} s: {}", failure.step, failure.time, failure.message);
            }
        }
        if status == Status::Completed {
            checkpoint::forget(folder);
        }
        Ok(status)
    }

    fn stepper(&self, state: &State) -> Box<dyn TimeStepper + 'r> {
        let Self { run, part, petsc, .. } = *self;
        let (system, options) = (&part.system, run.method.options());
        let solver = || -> Box<dyn LinearSolver + 'r> {
            let choice = run.method.choice();
            Box::new(or_end(PetscSolver::new(petsc, system, part.halo.clone(), choice, run.method.tolerance)))
        };
        match run.method.method() {
            Method::Verlet => Box::new(or_end(Verlet::new(system, state))),
            Method::Bdf2 => Box::new(or_end(Bdf2::with_solver(system, state, &options, solver()))),
            _ => Box::new(or_end(LinearBackwardEuler::with_solver(system, state, &options, solver()))),
        }
    }

    /// From one checkpoint to the next, each part with a stepper of its own.
    fn run_parts(
        &self,
        found: Option<Checkpoint>,
        state: &mut State,
        log: &mut Option<EnergyLog>,
        frames: &mut Option<Frames>,
        interrupted: &AtomicBool,
    ) -> Ended<'r> {
        let Self { run, header, part, schedule, folder, .. } = self;
        let system = &part.system;
        let options = MonitorOptions { stops_unstable: !run.allow_unstable, ..MonitorOptions::default() };
        let every = run.checkpoint.map(NonZeroU64::get).or(found.as_ref().map(|found| found.every));
        let clock = Instant::now();
        let (mut reached, mut earlier, mut spent) = (0, Statistics::default(), 0.0);
        let mut monitor = or_end(match &found {
            None => Monitor::new(system, state, options),
            Some(found) => {
                (reached, earlier, spent) = (found.reached, found.statistics, found.wall_seconds);
                Monitor::continued(system, [&part.state, state], found.reached, &found.account, options)
            }
        });
        if found.is_none() {
            record(log, frames, state, 0, &monitor);
        }
        let mut told = Instant::now();
        loop {
            let leg = every.map_or(*schedule, |every| schedule.part(reached, every));
            let mut stepper = self.stepper(state);
            let outcome = run_monitored(&mut *stepper, state, &leg, &mut monitor, |step, state, monitor| {
                record(log, frames, state, step, monitor);
                if !run.quiet && told.elapsed() > PROGRESS {
                    told = Instant::now();
                    say(format_args!("step {step} of {}, t = {:.4} s", schedule.len(), state.time));
                }
                let stops = ranks::any(interrupted.load(Ordering::Relaxed));
                if stops { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            let mut statistics = *stepper.statistics();
            statistics.add(&earlier);
            let wall_seconds = spent + clock.elapsed().as_secs_f64();
            let solver = stepper.linear_solver();
            let solver = [
                solver.map_or("none", LinearSolver::name),
                solver.and_then(LinearSolver::preconditioner).unwrap_or("none"),
            ];
            drop(stepper);
            let is_over = outcome.status() != Status::Completed || leg.len() >= schedule.len();
            let Some(every) = every.filter(|_| !is_over) else {
                return Ended { monitor, outcome, statistics, solver, wall_seconds };
            };
            (reached, earlier) = (leg.len(), statistics);
            let position = log.as_mut().map(|log| or_end(log.position()));
            let checkpoint = Checkpoint {
                format: checkpoint::format(),
                run: self.fingerprint.clone(),
                every,
                reached,
                time: state.time,
                statistics,
                wall_seconds,
                account: monitor.account(),
                energies: position.unwrap_or(sprung::output::LogPosition { bytes: 0, checksum: String::new() }),
                frames: frames.as_ref().map_or_else(Vec::new, |frames| frames.series.clone()),
                checksum: 0,
            };
            let account = checkpoint.account.clone();
            checkpoint.write(folder, header.particles, part, state);
            monitor = or_end(Monitor::continued(system, [&part.state, state], reached, &account, options));
        }
    }

    fn summary(&self, ended: &Ended, state: &State) -> Summary {
        let Self { run, header, part, schedule, .. } = self;
        let Ended { monitor, outcome, statistics, solver, wall_seconds } = ended;
        let method = run.method.method();
        let system = &part.system;
        let dofs = ranks::total(system.dofs().first_row(part.halo.own) as u64);
        let indicators = monitor.indicators(state);
        let status = outcome.status();
        let tells = matches!(status, Status::Completed | Status::Interrupted);
        let error = indicators.estimate.filter(|_| tells);
        let warnings = if tells { indicators.warnings(None) } else { Vec::new() };
        let effort = CostModel::of(system).cost(&statistics.work, None);
        Summary {
            scene: header.name.clone(),
            status,
            method: method.name(),
            stiffness: if method.is_implicit() { run.method.policy().name() } else { "none" },
            solver: solver[0],
            preconditioner: solver[1],
            solver_choice: None,
            dt: schedule.dt(),
            steps: outcome.steps,
            time: state.time,
            particles: header.particles as usize,
            springs: header.springs as usize,
            dofs: dofs as usize,
            wall_seconds: *wall_seconds,
            statistics: *statistics,
            factor: None,
            energy: EnergyChange::of(monitor),
            error: error.map(|estimate| ErrorReport { estimate, kind: ErrorKind::Indicator }),
            warnings: warnings.iter().map(ToString::to_string).collect(),
            effort: Effort { run: effort, total: effort },
            choice: None,
            failure: FailureReport::of(outcome, state.time),
        }
    }
}

/// An error ends all ranks.
fn record(log: &mut Option<EnergyLog>, frames: &mut Option<Frames>, state: &State, step: u64, monitor: &Monitor) {
    if let Some(log) = log {
        or_end(log.push(state.time, &monitor.energy(), &monitor.balance()));
    }
    if let Some(frames) = frames {
        frames.record(state, step);
    }
}

/// The summary for people.
fn in_words(summary: &Summary, folder: &Path) -> String {
    let Summary { scene, method, solver, preconditioner, steps, time, particles, springs, statistics, energy, .. } =
        summary;
    let work = &statistics.work;
    format!(
        "{scene}: {} after {steps} steps, at t = {time} s, in {:.1} s on {} ranks\n  system    {particles} particles, {springs} springs\n  \
         method    {method}, solver {solver} with {preconditioner}\n  work      {} solves, {} factorizations, {} CG iterations\n  \
         residual  at most {:.1e} of the right-hand side\n  energy    {:.6e} J at the start, {:.6e} J at the end\n  files     {}",
        summary.status.name(),
        summary.wall_seconds,
        ranks::ranks(),
        work.solves,
        work.factorizations,
        work.cg_iterations,
        statistics.max_relative_residual,
        energy.initial,
        energy.last,
        folder.display(),
    )
}
