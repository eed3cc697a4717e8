//! This crate's methods beside general-purpose integrators of other libraries, on the same scenes, machine and error norm.
//!
//! Draws time over error, one picture a scene, into `verification/charts`, and replaces the results in `README.md` beside this package.
//! With the words `scenes FOLDER` it writes the scenes, and where they end in truth, for `mujoco_curves.py`.

mod contender;
mod curve;
mod limits;
mod motion;
mod mujoco;
mod page;
mod peers;
mod scenes;
mod verdict;

use contender::{Contender, Task};
use curve::{ACCURACIES, Curve, shortest_of_all};
use scenes::TestCase;
use sprung::accuracy::extent;
use sprung::chart::Reference;
use sprung::report::plot;
use sprung::scene::Scene;
use sprung::{State, System};
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;
use verdict::Measured;

type Failure = Box<dyn std::error::Error>;

/// Where the results begin in the README.
const RESULTS: &str = "## Results\n";

/// In which the reference must be there.
const PATIENCE: Duration = Duration::from_secs(240);

/// A first step for it, in s, where the library's method does not get there.
const FIRST_STEP: f64 = 1e-3;

fn main() -> Result<(), Failure> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let verification = here.join("../../verification");
    let subjects = scenes::all(&verification)?;
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [] => measure(here, &verification, &subjects),
        ["scenes", folder] => export(Path::new(folder), &subjects),
        _ => Err("what is understood is nothing, or: scenes FOLDER".into()),
    }
}

fn reference(system: &System, start: &State, duration: f64) -> Result<Reference, Failure> {
    let reference = Reference::compute(system, start, [FIRST_STEP, duration], PATIENCE)?;
    reference.ok_or_else(|| "a scene without a reference".into())
}

/// Writes scenes as JSON, with all that it takes to tell an error.
fn export(folder: &Path, subjects: &[TestCase]) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)?;
    for subject in subjects {
        let name = &subject.scene.name;
        let (system, start) = subject.scene.build()?;
        let end = reference(&system, &start, subject.duration())?.state.positions;
        // A mesh becomes particles and springs.
        let scene: serde_json::Value = serde_json::from_str(&Scene::snapshot(name, &system, &start).to_json())?;
        let content = serde_json::json!({
            "scene": scene,
            "frames": subject.frames,
            "reference": end.iter().map(|x| [x.x, x.y, x.z]).collect::<Vec<_>>(),
            "extent": extent(&end, &start.positions),
        });
        std::fs::write(folder.join(format!("{}.json", name.replace(' ', "-"))), content.to_string())?;
    }
    Ok(())
}

/// Measures everybody on every scene, and writes the pictures and the results.
fn measure(here: &Path, verification: &Path, subjects: &[TestCase]) -> Result<(), Failure> {
    let mujoco = mujoco::Measured::load(&here.join(mujoco::FILE))?;
    let mut all = Vec::new();
    let mut scenes = String::new();
    for subject in subjects {
        let name = &subject.scene.name;
        eprintln!("{name}");
        let (system, start) = subject.scene.build()?;
        let duration = subject.duration();
        let reference = reference(&system, &start, duration)?;
        let task = Task { system: &system, start: &start, duration, reference: &reference };
        let mut curves = compete(&task);
        curves.extend(mujoco.iter().flat_map(|measured| measured.curves(name)));
        let file = format!("peers-{}.svg", name.replace(' ', "-"));
        let picture = page::picture(name, &curves, reference.error_estimate);
        std::fs::write(verification.join("charts").join(&file), plot::svg(&picture))?;
        let unknowns = 2 * system.dofs().len();
        write!(scenes, "\n### {name}\n\nFor {duration:.3} s: {}, {unknowns} unknowns.", subject.words)?;
        writeln!(scenes, " The reference errs by about {:.0e}.\n", reference.error_estimate)?;
        page::table(&mut scenes, &curves)?;
        writeln!(scenes, "\n![Time against accuracy: {name}](../../verification/charts/{file})")?;
        all.push(Measured { scene: name.clone(), curves });
    }
    let mut results = String::from(RESULTS);
    verdict::write(&mut results, &all)?;
    match &mujoco {
        Some(measured) => {
            let left_out = measured.left_out.iter().map(|(scene, why)| format!(", but for {scene} ({why})"));
            writeln!(results, "\nMuJoCo {} takes part{}.", measured.version, left_out.collect::<String>())?;
        }
        None => writeln!(results, "\nMuJoCo does not take part: there is no {}.", mujoco::FILE)?,
    }
    let page = std::fs::read_to_string(here.join("README.md"))?;
    let (text, _) = page.split_once(RESULTS).ok_or("the README has no results to replace")?;
    std::fs::write(here.join("README.md"), format!("{text}{results}{scenes}"))?;
    Ok(())
}

/// The curves of all contenders, each measured by itself and those that matter once more when all had their turn.
fn compete(task: &Task<'_>) -> Vec<Curve> {
    let least = ACCURACIES.into_iter().fold(f64::INFINITY, f64::min);
    let contenders = Contender::all();
    let mut curves: Vec<Curve> = Vec::new();
    for contender in &contenders {
        curves.push(contender.climb(task, shortest_of_all(&curves, least)));
    }
    let fastest = ACCURACIES.map(|accuracy| shortest_of_all(&curves, accuracy));
    for (contender, curve) in contenders.iter().zip(&mut curves) {
        contender.repeat(task, curve, &fastest);
    }
    curves
}
