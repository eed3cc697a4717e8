//! This crate's methods beside general-purpose integrators of other libraries, on the same scenes, machine and error norm.
//!
//! Peers are the BDF method and the ESDIRK method of `diffsol` with the exact Jacobian, and DOP853 of `ivp`. Draws time
//! over error, one picture a scene, into `verification/charts`, and replaces the results in `README.md` beside this package.

mod contender;
mod limits;
mod motion;
mod peers;

use contender::{Contender, Run, Task};
use peers::Integrator;
use sprung::accuracy::Configuration;
use sprung::chart::Reference;
use sprung::figure::{Guide, Look, Plot, Series};
use sprung::integrate::{ImplicitOptions, Method};
use sprung::report::plot;
use sprung::scene::{Kind, Scene, builtin};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

type Failure = Box<dyn std::error::Error>;

/// Accuracies of the table.
const ACCURACIES: [f64; 4] = [1e-1, 1e-2, 1e-4, 1e-6];

/// Where the results begin in the README.
const RESULTS: &str = "## Results\n";

fn main() -> Result<(), Failure> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let verification = here.join("../../verification");
    let mut cloth = builtin(Kind::Cloth, 6)?;
    cloth.time.duration = Some(0.2);
    cloth.time.dt = Some(0.01);
    let load = |name: &str| Scene::load(verification.join("scenes").join(name));
    let ours = |method| Configuration { method, options: ImplicitOptions::default() };
    let contenders = [
        Contender::Diffsol(Integrator::Bdf),
        Contender::Diffsol(Integrator::Esdirk34),
        Contender::Dop853,
        Contender::Adaptive(ours(Method::W2)),
        Contender::Steps(ours(Method::ImplicitMidpoint)),
        Contender::Steps(ours(Method::LinearBackwardEuler)),
        Contender::Steps(ours(Method::Verlet)),
        Contender::Adaptive(ours(Method::Dop853)),
        Contender::Adaptive(ours(Method::Rodas4)),
    ];
    let mut results = String::from(RESULTS);
    for scene in [load("stiff_pendulum.toml")?, load("tetrahedron.toml")?, cloth] {
        eprintln!("{}", scene.name);
        let (system, start) = scene.build()?;
        let (dt, duration) = scene.time.dt.zip(scene.time.duration).ok_or("a scene without time")?;
        let reference = Reference::compute(&system, &start, [dt, duration], Duration::from_secs(60))?.ok_or("none")?;
        let task = Task { system: &system, start: &start, duration, reference };
        let runs: Vec<(String, Vec<Run>)> =
            contenders.iter().map(|contender| (contender.name(), contender.runs(&task))).collect();
        let looks: Vec<Look> = contenders.iter().map(Contender::look).collect();
        let file = format!("peers-{}.svg", scene.name.replace(' ', "-"));
        std::fs::write(
            verification.join("charts").join(&file),
            plot::svg(&picture(&scene.name, &task, &runs, &looks)),
        )?;
        write!(results, "\n### {}, {} unknowns\n\n{}", scene.name, 2 * system.dofs().len(), table(&runs)?)?;
        write!(results, "\n![Time against accuracy: {}](../../verification/charts/{file})\n", scene.name)?;
    }
    let page = std::fs::read_to_string(here.join("README.md"))?;
    let (text, _) = page.split_once(RESULTS).ok_or("the README has no results to replace")?;
    std::fs::write(here.join("README.md"), format!("{text}{results}"))?;
    Ok(())
}

/// Time over error, failures on the rail of their cause.
fn picture(scene: &str, task: &Task<'_>, runs: &[(String, Vec<Run>)], looks: &[Look]) -> Plot {
    let mut plot = Plot::log_log(
        format!("This crate and its peers: {scene}"),
        "relative position error at the end",
        "time of the run, s",
    )
    .concluding(conclusion(runs));
    for ((name, runs), &look) in runs.iter().zip(looks) {
        let points = runs.iter().filter_map(|run| Some((*run.outcome.as_ref().ok()?, run.seconds))).collect();
        plot = plot.with_series(Series::line(name, points).looking(look));
    }
    for (name, runs) in runs {
        let mut failures: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
        for run in runs {
            if let Err(cause) = &run.outcome {
                failures.entry(cause).or_default().push((f64::INFINITY, run.seconds));
            }
        }
        for (cause, points) in failures {
            plot = plot.with_series(Series::failures(cause, points).like(name));
        }
    }
    plot.with_guide(Guide::Vertical { x: task.reference.error_estimate, label: "error of the reference".into() })
}

/// Who is fastest below two accuracies, and by how much.
fn conclusion(runs: &[(String, Vec<Run>)]) -> String {
    let below = |accuracy: f64| {
        let mut times: Vec<(f64, &str)> =
            runs.iter().filter_map(|(name, runs)| Some((shortest(runs, accuracy)?, name.as_str()))).collect();
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        match *times.as_slice() {
            [] => "none".into(),
            [(_, only)] => only.into(),
            [(first, fastest), (second, next), ..] => format!("{fastest}; next {next}, {:.1} times", second / first),
        }
    };
    format!("Fastest below 1 %: {}. Below 10⁻⁶: {}.", below(1e-2), below(1e-6))
}

/// The shortest time of the runs that err less, in s.
fn shortest(runs: &[Run], accuracy: f64) -> Option<f64> {
    let enough = runs.iter().filter(|run| run.outcome.as_ref().is_ok_and(|error| *error <= accuracy));
    enough.map(|run| run.seconds).reduce(f64::min)
}

/// The shortest time, in ms, of each contender for each accuracy.
fn table(runs: &[(String, Vec<Run>)]) -> Result<String, std::fmt::Error> {
    let mut text = String::from("| time in ms for an error below |");
    for accuracy in ACCURACIES {
        write!(text, " {accuracy:e} |")?;
    }
    writeln!(text, "\n|---|{}", "---|".repeat(ACCURACIES.len()))?;
    for (name, runs) in runs {
        write!(text, "| {name} |")?;
        for accuracy in ACCURACIES {
            match shortest(runs, accuracy) {
                Some(seconds) => write!(text, " {} |", milliseconds(seconds))?,
                None => write!(text, " – |")?,
            }
        }
        writeln!(text)?;
    }
    Ok(text)
}

/// Two digits.
fn milliseconds(seconds: f64) -> String {
    let value = 1e3 * seconds;
    let digits = (1.0 - value.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}
