//! Makes `verification/accuracy.md`: what `--accuracy` answers on telling scenes, how wrong the answers are, and what they cost against the
//! cheapest single run that a sweep finds.
//!
//! `cargo run --release --example accuracy`; names of scenes after `--` do only these, and write no page.

use sprung::accuracy::{Configuration, Pace, Requirement, Verdict, answer, reduce, relative_position_error, trial};
use sprung::chart::Reference;
use sprung::integrate::{ImplicitOptions, Method, Status};
use sprung::linear::CostModel;
use sprung::scene::{Kind, Scene, builtin};
use sprung::{State, System};
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

const ACCURACIES: [f64; 6] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// Steps and tolerances of the sweep: so many to a power of two, and to a decade.
const PER_OCTAVE: i32 = 3;
const PER_DECADE: i32 = 3;

/// A run of the sweep may cost this many times the answer at the finest accuracy.
const FAR: f64 = 2.0;

/// A single run: what it costs and how wrong it is.
struct Single {
    name: String,
    cost: f64,
    error: f64,
}

struct Motion<'a> {
    system: &'a System,
    start: &'a State,
    duration: f64,
    costs: CostModel,
    end: &'a State,
}

impl Motion<'_> {
    fn error(&self, state: &State) -> f64 {
        relative_position_error(&state.positions, &self.end.positions, &self.start.positions)
    }

    /// Runs a method at one pace; `None` where it does not come to its end.
    fn single(&self, method: Method, pace: Pace) -> Result<Option<Single>, sprung::Error> {
        let configuration = Configuration { method, options: ImplicitOptions::default() };
        let run = trial(self.system, self.start, &configuration, pace, self.duration, &|| true)?;
        let cost = self.costs.cost(&run.statistics.work, run.factor);
        let single = Single { name: method.name().into(), cost, error: self.error(&run.state) };
        Ok((run.status == Status::Completed).then_some(single))
    }

    /// Every method, coarse to fine, until it costs too much or is as exact as anybody asks.
    fn sweep(&self, most: f64) -> Result<Vec<Single>, sprung::Error> {
        let mut singles = Vec::new();
        for method in Method::ALL {
            for j in 0.. {
                let pace = if method.estimates_errors() {
                    Pace::Adaptive { rtol: 10f64.powf(-f64::from(j) / f64::from(PER_DECADE)), first_step: None }
                } else {
                    Pace::Step(self.duration / (4.0 * (f64::from(j) / f64::from(PER_OCTAVE)).exp2()).ceil())
                };
                let too_far = matches!(pace, Pace::Adaptive { rtol, .. } if rtol < 1e-11)
                    || matches!(pace, Pace::Step(dt) if self.duration / dt > most);
                let Some(single) = self.single(method, pace)?.filter(|_| !too_far) else {
                    if too_far {
                        break;
                    }
                    continue;
                };
                let done = single.cost > most || single.error < 0.5 * ACCURACIES[ACCURACIES.len() - 1];
                singles.push(single);
                if done {
                    break;
                }
            }
        }
        Ok(singles)
    }
}

fn scenes() -> Result<Vec<Scene>, Box<dyn std::error::Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/scenes");
    let mut scenes = Vec::new();
    for folder in [root.clone(), root.join("hard")] {
        let mut paths: Vec<_> =
            std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()).collect();
        paths.sort();
        let is_scene = |path: &&std::path::PathBuf| path.extension().is_some_and(|end| end == "toml" || end == "json");
        scenes.extend(paths.iter().filter(is_scene).map(Scene::load).collect::<Result<Vec<_>, _>>()?);
    }
    for (kind, size, duration) in [
        (Kind::Chain, 10, 0.5),
        (Kind::Cloth, 8, 0.2),
        (Kind::Lattice, 4, 0.5),
        (Kind::Network, 40, 0.5),
        (Kind::Pendulum, 1, 2.0),
    ] {
        let mut scene = builtin(kind, size)?;
        scene.time.duration = Some(duration);
        scenes.push(scene);
    }
    Ok(scenes)
}

/// The value below which the given part of a sorted list lies.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let (mut rows, mut ratios) = (String::new(), Vec::new());
    let (mut asked, mut confirmed, mut broken) = (0, 0, 0);
    for scene in scenes()?.iter().filter(|scene| wanted.is_empty() || wanted.contains(&scene.name)) {
        let (system, start) = scene.build()?;
        let system = reduce(&system, &start).system;
        let duration = scene.time.duration.unwrap_or(1.0);
        let Some(reference) = Reference::compute(&system, &start, [0.01, duration], Duration::from_secs(20))? else {
            eprintln!("{}: no reference", scene.name);
            continue;
        };
        let costs = CostModel::of(&system);
        let motion = Motion { system: &system, start: &start, duration, costs, end: &reference.state };
        let mut answers = Vec::new();
        for accuracy in ACCURACIES.into_iter().filter(|accuracy| *accuracy > 10.0 * reference.error_estimate) {
            let requirement = Requirement {
                accuracy,
                duration,
                interval: duration / 50.0,
                par: faer::Par::Seq,
                method: None,
                stiffness: None,
                solver: None,
            };
            if let Some(found) = answer(&system, &start, &requirement, &mut (), &|| true)? {
                answers.push((accuracy, found));
            }
        }
        let most = answers.iter().map(|(_, found)| FAR * found.cost).fold(2000.0, f64::max);
        let singles = motion.sweep(most)?;
        for (accuracy, found) in answers {
            let error = motion.error(&found.state);
            let enough = singles.iter().filter(|single| single.error <= accuracy);
            let cheapest = enough.min_by(|a, b| a.cost.total_cmp(&b.cost));
            let ratio = cheapest.map(|single| found.total_cost / single.cost);
            let is_confirmed = found.verdict == Verdict::Confirmed;
            asked += 1;
            confirmed += u32::from(is_confirmed);
            broken += u32::from(is_confirmed && error > accuracy);
            ratios.extend(ratio);
            let row = format!(
                "| {} | {accuracy:.0e} | {} | {}{} | {error:.1e} | {:.0} | {:.0} | {} | {} |",
                scene.name,
                found.configuration.method.name(),
                found.estimated_error.map_or("–".into(), |error| format!("{error:.1e}")),
                if is_confirmed { "" } else { ", unconfirmed" },
                found.cost,
                found.total_cost,
                cheapest.map_or("none".into(), |single| format!("{} {:.0}", single.name, single.cost)),
                ratio.map_or("–".into(), |ratio| format!("{ratio:.1}")),
            );
            eprintln!("{row}");
            writeln!(rows, "{row}")?;
        }
    }
    ratios.sort_by(f64::total_cmp);
    let summary = format!(
        "{confirmed} of {asked} answers are confirmed, {broken} of these miss the accuracy asked for. Everything included they cost {:.1} times \
         the cheapest single run in the median, {:.1} times in nine of ten, {:.1} times at most.",
        quantile(&ratios, 0.5),
        quantile(&ratios, 0.9),
        quantile(&ratios, 1.0),
    );
    eprintln!("{summary}");
    if wanted.is_empty() {
        let page = format!(
            "# What `--accuracy` answers\n\n\
             Made by `cargo run --release --example accuracy`, which writes this page. Errors are relative position errors at the end of the\n\
             motion, against a reference (DOP853 to 10⁻¹²) that the answers know nothing of. Work is counted in force evaluations of the\n\
             scene: that of the run handed out, and of everything done to find and confirm it. The cheapest single run is that of a sweep\n\
             over all methods with three steps to a power of two, and three tolerances to a decade; to find it costs many times more.\n\n\
             {summary}\n\n\
             | scene | accuracy | answer by | estimated error | achieved | work of the run | of everything | cheapest single run | ratio |\n\
             |---|---|---|---|---|---|---|---|---|\n{rows}"
        );
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/accuracy.md"), page)?;
    }
    Ok(())
}
