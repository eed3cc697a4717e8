//! `sprung chart`: speed against accuracy, and the limits of stability.

use super::Stop;
use super::common::{LoadedScene, Process, SceneFile, claim, positive};
use super::console::{Console, error};
use super::definiteness;
use super::threads::{end_in_order, interrupt, is_interrupted};
use serde::Serialize;
use sprung::Result;
use sprung::chart::{Deadline, Reference, Run, StabilityMap, SweepOptions, WorkPrecision};
use sprung::integrate::{Method, Monitor, Schedule, Status, StiffnessPolicy, percent};
use sprung::linear::SolverChoice;
use sprung::output::AtomicFile;
use sprung::plan::{MethodChoice, RunOptions, parallelism};
use sprung::report::{chart_html, plot, tiles};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

/// Chart speed against accuracy
///
/// Runs the scene with every method, stiffness option and solver at many step sizes, as long as the budget lasts, and measures
/// the error at the end against an independent reference. Writes chart.html, one page with every picture and a decision in words,
/// the pictures as SVG files in a folder chart, and chart.json with every run, failed ones too.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Chart {
    #[command(flatten)]
    scene: SceneFile,

    /// Time for all runs, in seconds; with --stability half of it is for the map, which is as fine as that allows
    #[arg(long, value_name = "S", default_value = "60", value_parser = positive)]
    budget: f64,

    /// Length of the motion, in seconds [default: the scene's time.duration]
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,

    /// Time step around which to sweep, in seconds [default: the scene's time.dt, or 0.01]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Map the limits of stability too: every method on a model of one particle between two springs
    #[arg(long)]
    stability: bool,

    /// Compare every answer to a matrix that is not definite instead: one backward Euler step of 1, 4, 16, 64 and 256 dt and the equilibrium, from
    /// the scene's start, under every stiffness option and policy. Writes definiteness.html, definiteness.json and chart/definiteness.svg
    #[arg(long, conflicts_with_all = ["stability", "duration"])]
    definiteness: bool,

    #[command(flatten)]
    process: Process,
}

const FILES: [&str; 2] = ["chart.json", "chart.html"];

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    chart: &'a WorkPrecision,
    stability: &'a StabilityMap,
}

impl Chart {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let scene = self.scene.load(console)?;
        let budget = Duration::try_from_secs_f64(self.budget).unwrap_or(Duration::MAX / 16).min(Duration::MAX / 16);
        let dt = scene.step_or_default(console, self.dt);
        let folder = self.process.folder(&scene);
        if self.definiteness {
            return definiteness::execute(&scene, dt, budget, &self.process.threads, &folder, console);
        }
        let duration = scene.motion_length(self.duration, "a chart")?;
        scene.schedule(dt, duration)?;
        end_in_order();
        let claimed = claim(&folder, &FILES, false)?;
        claimed.check_inside("chart")?;
        let until = Deadline::after(budget, interrupt());
        let sweep = if self.stability { budget / 2 } else { budget };
        let whole = scene.time.duration.filter(|whole| *whole > duration);
        // Recommendations must hold to the end of the whole scene, which takes time too.
        let sweep = if whole.is_some() { sweep * 7 / 10 } else { sweep };
        let par = parallelism(&scene.system);
        let options = SweepOptions { duration, dt, budget: sweep, par, interrupt: interrupt() };
        let bar = console.bar(budget.as_secs().max(1), "{wide_bar} {pos} of at most {len} s, {msg}");
        bar.set_message("starting");
        let (measured, map) = self.process.threads.install(|| {
            let mut progress = |elapsed: Duration, what: &str| {
                bar.set_position(elapsed.as_secs());
                bar.set_message(what.to_owned());
            };
            let mut chart = WorkPrecision::measure(&scene.name, &scene.system, &scene.state, &options, &mut progress)
                .map_err(|error| error.in_file(&scene.file))?;
            if let (Some(chart), Some(whole)) = (&mut chart, whole) {
                chart.verify_recommendations(|run| holds(&scene, run, whole, until));
            }
            let mut progress = |_: Duration, what: &str| bar.set_message(format!("stability of {what}"));
            let map = match self.stability {
                true => StabilityMap::within(36, &mut progress, until)?,
                false => StabilityMap { tiles: Vec::new(), missing: 0 },
            };
            Ok((chart, map))
        })?;
        bar.finish_and_clear();
        let Some(chart) = measured else {
            return Err(Stop::Computation(if is_interrupted() {
                "interrupted before there was a reference solution".into()
            } else {
                "no reference solution was found within a third of the budget: give it more, or a shorter --duration"
                    .into()
            }));
        };
        let report = Report { chart: &chart, stability: &map };
        write(&folder, &report).map_err(Stop::Broken)?;
        let failed = chart.runs.iter().filter(|run| run.cause().is_some()).count();
        let mut lines = vec![format!("{}: {} runs, {failed} of them failed", chart.scene, chart.runs.len())];
        let Reference { method, error_estimate, .. } = &chart.reference;
        lines.push(format!("  reference  {method}, error about {}", percent(*error_estimate)));
        if let Some(whole) = whole {
            lines.push(format!(
                "  recommended are runs that also hold to the scene's own end, at {whole} s; {} of those tried do not",
                chart.excluded.len()
            ));
        }
        lines.extend(chart.conclusion_lines().iter().map(|sentence| format!("  {sentence}")));
        lines.push(format!("  files      {} and chart/*.svg in {}", FILES.join(", "), folder.display()));
        console.result(&report, lines.join("\n"))?;
        if map.missing > 0 && !is_interrupted() {
            let all = map.tiles.len() + map.missing;
            console.note(format_args!("the budget was enough for {} of {all} maps of stability", map.tiles.len()));
        }
        let mut outcome = Ok(());
        if is_interrupted() {
            error("interrupted: the chart shows the runs made so far");
            outcome = Err(Stop::Reported);
        }
        for check in map.checks().iter().filter(|check| !check.passed()) {
            error(format_args!("{}, {}: {}", check.name, check.scene, check.why));
            outcome = Err(Stop::Reported);
        }
        outcome
    }
}

/// Whether a recommended run, made as by `sprung run` for the whole duration, completes without a warning. After the deadline nothing is recommended.
fn holds(scene: &LoadedScene, run: &Run, duration: f64, until: Deadline) -> bool {
    let LoadedScene { system, state: start, .. } = scene;
    let method = Method::ALL.into_iter().find(|method| method.name() == run.method).map(MethodChoice::Named);
    let stiffness = StiffnessPolicy::ALL.into_iter().find(|policy| policy.name() == run.stiffness);
    let solver = SolverChoice::ALL.into_iter().find(|solver| solver.name() == run.solver);
    let run_options = RunOptions { method, stiffness, solver, rtol: run.rtol, ..RunOptions::default() };
    let made = || -> Result<bool> {
        let plan = run_options.plan(system, start, [run.dt, duration], run.rtol)?;
        let mut monitor = Monitor::new(system, start, plan.monitor(true, true))?;
        let mut stepper = plan.stepper(system, start)?;
        let mut state = start.clone();
        let outcome =
            stepper.run(system, &mut state, &Schedule::duration(run.dt, duration), &mut monitor, |_, _, _| {
                if until.left().is_zero() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
        let completed = outcome.status() == Status::Completed;
        Ok(completed && monitor.indicators(&state).warnings(run.rtol).is_empty())
    };
    made().unwrap_or(false)
}

fn write(folder: &Path, report: &Report<'_>) -> Result<()> {
    let Report { chart, stability: map } = report;
    let picture =
        |name: &str, svg: String| AtomicFile::write_text(folder.join("chart").join(format!("{name}.svg")), &svg);
    for figure in chart.figures() {
        picture(figure.name, plot::svg(&figure.plot))?;
        if let Some(full) = &figure.full {
            picture(&format!("{}-all", figure.name), plot::svg(full))?;
        }
    }
    for tile in &map.tiles {
        picture(&tile.file_name(), tiles::svg(&tile.figure()))?;
    }
    AtomicFile::write_text(folder.join("chart.html"), &chart_html(chart, map))?;
    AtomicFile::write_json(folder.join("chart.json"), report)
}
