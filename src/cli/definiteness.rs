//! `sprung chart --definiteness`: every answer to a matrix that is not definite.

use super::Stop;
use super::common::{LoadedScene, claim};
use super::console::{Console, error};
use super::threads::{Threads, end_in_order, interrupt, is_interrupted};
use serde::Serialize;
use sprung::Result;
use sprung::chart::Deadline;
use sprung::chart::definiteness::{Comparison, TOLERANCE};
use sprung::output::AtomicFile;
use sprung::report::{definiteness_html, definiteness_text, plot};
use std::path::Path;
use std::time::Duration;

const FILES: [&str; 2] = ["definiteness.json", "definiteness.html"];

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    comparison: &'a Comparison,
    tolerance: f64,
    conclusions: Vec<String>,
}

pub fn execute(
    scene: &LoadedScene,
    dt: f64,
    budget: Duration,
    threads: &Threads,
    folder: &Path,
    console: &Console,
) -> Result<(), Stop> {
    end_in_order();
    let claimed = claim(folder, &FILES, false)?;
    claimed.check_inside("chart")?;
    let until = Deadline::after(budget, interrupt());
    let LoadedScene { name, system, state, .. } = scene;
    let comparison = threads.install(|| {
        let measured = Comparison::measure(name, system, state, dt, until);
        Ok(measured.map_err(|error| error.in_file(&scene.file))?)
    })?;
    let report = Report { comparison: &comparison, tolerance: TOLERANCE, conclusions: comparison.conclusions() };
    write(folder, &report).map_err(Stop::Broken)?;
    let text = format!("{}  files: {} in {}", definiteness_text(&comparison), FILES.join(", "), folder.display());
    console.result(&report, text)?;
    if comparison.skipped > 0 {
        let why = if is_interrupted() { "interrupted" } else { "the budget is over" };
        error(format_args!("{why}: {} solves were not made", comparison.skipped));
        if is_interrupted() {
            return Err(Stop::Reported);
        }
    }
    Ok(())
}

fn write(folder: &Path, report: &Report<'_>) -> Result<()> {
    let comparison = report.comparison;
    AtomicFile::write_text(folder.join("chart/definiteness.svg"), &plot::svg(&comparison.profile()))?;
    AtomicFile::write_text(folder.join(FILES[1]), &definiteness_html(comparison))?;
    AtomicFile::write_json(folder.join(FILES[0]), report)
}
