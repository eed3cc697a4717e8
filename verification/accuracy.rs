//! Makes `verification/accuracy.md`: what `--accuracy` answers on random and on ready scenes, how wrong the answers are, and what they cost
//! against the cheapest single run that a sweep over all methods, options, solvers and steps finds.
//!
//! ```sh
//! cargo xtask accuracy --ready --write         # the page; sweeps of ready scenes take an hour
//! cargo xtask accuracy --count 20 --first 500  # other random scenes
//! cargo xtask accuracy --named cloth-of-6      # one scene with a name, answer by answer
//! ```
//!
//! References are those of the study, kept in `target/study`.

#[allow(dead_code, reason = "only scenes and references of the study are used")]
#[path = "study/mod.rs"]
mod study;

use clap::Parser;
use cpu_time::ThreadTime;
use sprung::accuracy::{
    Audience, Configuration, Pace, Requirement, SearchProgress, Verdict, answer, reduce, relative_position_error, trial,
};
use sprung::integrate::{Equations, ImplicitOptions, Method, Monitor, Status, StiffnessPolicy};
use sprung::linear::{CostModel, SolverChoice, SolverOptions};
use sprung::scene::Scene;
use sprung::{State, Stiffness, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use study::reference::Reference;
use study::store::Store;
use study::{named, random};

/// Compares the cost of answers with that of the cheapest single run.
#[derive(Parser)]
struct Arguments {
    /// How many random scenes
    #[arg(long, default_value_t = 150)]
    count: u64,

    /// The first seed
    #[arg(long, default_value_t = 0)]
    first: u64,

    /// Only this one of the scenes with names
    #[arg(long, value_name = "NAME")]
    named: Option<String>,

    /// Ready scenes too
    #[arg(long)]
    ready: bool,

    /// Says what was done for every answer, and what it has cost
    #[arg(long)]
    runs: bool,

    /// Writes the page
    #[arg(long)]
    write: bool,
}

const ACCURACIES: [f64; 6] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// A reference must be better than the accuracy by so much to say what has it.
const TELLING: f64 = 0.1;

/// Steps of the sweep to a power of two, and tolerances to a decade.
const PER_OCTAVE: f64 = 3.0;
const PER_DECADE: f64 = 3.0;

/// Steps of the coarsest run.
const FEWEST_STEPS: f64 = 4.0;

/// The finest tolerance.
const FINEST: f64 = 1e-11;

/// Times are the shortest of so many.
const REPEATS: usize = 3;

/// A single run that is good enough: what it costs.
#[derive(Debug, Clone)]
struct Single {
    configuration: Configuration,
    pace: Pace,
    cost: f64,
}

/// Says what a search does.
#[derive(Default)]
struct Runs {
    doing: String,
    before: f64,
    spent: f64,
}

impl Runs {
    /// Says what the run that is over has cost.
    fn say(&self) {
        if !self.doing.is_empty() {
            eprintln!("    {:>9.0}  {}", self.spent - self.before, self.doing);
        }
    }
}

impl Audience for Runs {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> sprung::Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> sprung::Result<()> {
        Ok(())
    }

    fn progress(&mut self, now: &SearchProgress<'_>) {
        if now.doing != self.doing {
            self.say();
            (self.doing, self.before) = (now.doing.into(), self.spent);
        }
        self.spent = now.spent;
    }
}

struct Motion<'a> {
    system: &'a System,
    start: &'a State,
    duration: f64,
    costs: CostModel,
    reference: &'a Reference,
    says_runs: bool,
}

/// An answer beside the cheapest single run.
struct Row {
    accuracy: f64,
    method: &'static str,
    estimate: Option<f64>,
    confirmed: bool,
    error: f64,
    cost: f64,
    total: f64,
    /// What the cheapest is, and its cost.
    cheapest: String,
    least: f64,
    /// The time of the answer over that of the cheapest run.
    slower: f64,
}

/// Every way to run: methods, each with its stiffness policies and solvers, with steps of one length and adaptive ones.
fn ways() -> Vec<(Configuration, bool)> {
    let mut ways = Vec::new();
    let explicit_first = |method: &Method| method.is_implicit();
    let mut methods = Method::ALL.to_vec();
    methods.sort_by_key(explicit_first);
    for method in methods {
        let mut options = vec![ImplicitOptions::default()];
        if method.is_implicit() {
            for solver in [SolverChoice::Llt, SolverChoice::Cg] {
                let linear = SolverOptions { solver, ..SolverOptions::default() };
                options.push(ImplicitOptions { linear, ..ImplicitOptions::default() });
            }
        }
        if matches!(method.equations(), Equations::Linear | Equations::Nonlinear) {
            for stiffness in [Stiffness::Tension, Stiffness::Axial] {
                let stiffness = StiffnessPolicy::Always(stiffness);
                options.push(ImplicitOptions { stiffness, ..ImplicitOptions::default() });
            }
        }
        for options in options {
            ways.push((Configuration { method, options }, false));
            if method.estimates_errors() {
                ways.push((Configuration { method, options }, true));
            }
        }
    }
    ways
}

impl Motion<'_> {
    fn error(&self, state: &State) -> f64 {
        relative_position_error(&state.positions, &self.reference.points(), &self.start.positions)
    }

    fn asks(&self) -> Vec<f64> {
        ACCURACIES.into_iter().filter(|accuracy| self.reference.error <= TELLING * accuracy).collect()
    }

    fn requirement(&self, accuracy: f64) -> Requirement {
        let (method, stiffness, solver) = (None, None, None);
        // As the command does where no step is given.
        let interval = (1.0 / 60.0f64).min(self.duration / 100.0);
        let duration = self.duration;
        Requirement { accuracy, duration, interval, par: faer::Par::Seq, method, stiffness, solver }
    }

    /// Improves on the cheapest run of every accuracy, `best`, which begins with the runs that are answers: nothing that costs more
    /// than all of them is of use.
    fn sweep(&self, best: &mut BTreeMap<usize, Single>) -> Result<(), Box<dyn Error>> {
        let asks = self.asks();
        for (configuration, adaptive) in ways() {
            for j in 0.. {
                let most = best.values().map(|single| single.cost).fold(0.0, f64::max);
                let pace = if adaptive {
                    Pace::Adaptive { rtol: 10f64.powf(-f64::from(j) / PER_DECADE), first_step: None }
                } else {
                    let steps = FEWEST_STEPS * (f64::from(j) / PER_OCTAVE).exp2();
                    Pace::Step(self.duration / steps.ceil())
                };
                let over = match pace {
                    Pace::Adaptive { rtol, .. } => rtol < FINEST,
                    Pace::Step(dt) => self.duration / dt > most,
                };
                if over {
                    break;
                }
                // Every step costs an evaluation at least.
                let left = Cell::new(most);
                let go_on = || {
                    left.set(left.get() - 1.0);
                    left.get() > 0.0
                };
                let run = trial(self.system, self.start, &configuration, pace, self.duration, &go_on)?;
                let cost = self.costs.cost(&run.statistics.work, run.factor);
                if run.status == Status::Completed {
                    let error = self.error(&run.state);
                    for (ask, _) in asks.iter().enumerate().filter(|(_, accuracy)| error <= **accuracy) {
                        if best.get(&ask).is_none_or(|single| cost < single.cost) {
                            best.insert(ask, Single { configuration, pace, cost });
                        }
                    }
                }
                if cost > most {
                    break;
                }
            }
        }
        Ok(())
    }

    fn rows(&self) -> Result<Vec<Row>, Box<dyn Error>> {
        let (mut best, mut answers) = (BTreeMap::new(), Vec::new());
        for (ask, accuracy) in self.asks().into_iter().enumerate() {
            let requirement = self.requirement(accuracy);
            let mut runs = Runs::default();
            let Some(found) = answer(self.system, self.start, &requirement, &mut runs, &|| true)? else { continue };
            let error = self.error(&found.state);
            if self.says_runs {
                runs.say();
                eprintln!("    {:>9.0}  in all for {accuracy:e}", found.total_cost);
            }
            // The answer itself is a single run.
            let cost = if error <= accuracy { found.cost } else { found.total_cost };
            best.insert(ask, Single { configuration: found.configuration, pace: found.pace, cost });
            answers.push((ask, accuracy, found, error));
        }
        self.sweep(&mut best)?;
        let mut rows = Vec::new();
        for (ask, accuracy, found, error) in answers {
            let Some(Single { configuration, pace, cost }) = best.get(&ask).cloned() else { continue };
            let requirement = self.requirement(accuracy);
            let slower = shortest(|| answer(self.system, self.start, &requirement, &mut (), &|| true).map(|_| ()))?
                / shortest(|| {
                    trial(self.system, self.start, &configuration, pace, self.duration, &|| true).map(|_| ())
                })?;
            let pace = match pace {
                Pace::Step(_) => "",
                Pace::Adaptive { .. } => " --rtol",
            };
            rows.push(Row {
                accuracy,
                method: found.configuration.method.name(),
                estimate: found.estimated_error,
                confirmed: found.verdict == Verdict::Confirmed,
                error,
                cost: found.cost,
                total: found.total_cost,
                cheapest: format!("{}{pace}", configuration.method.name()),
                least: cost,
                slower,
            });
        }
        Ok(rows)
    }
}

/// In s.
fn shortest(mut work: impl FnMut() -> sprung::Result<()>) -> sprung::Result<f64> {
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let clock = ThreadTime::now();
        work()?;
        least = least.min(clock.elapsed().as_secs_f64());
    }
    Ok(least)
}

fn rows(scene: &Scene, store: &Store, says_runs: bool) -> Result<Vec<Row>, Box<dyn Error>> {
    let (system, start) = scene.build()?;
    let duration = scene.time.duration.unwrap_or(1.0);
    let Some(reference) = store.reference(scene, duration)? else { return Ok(Vec::new()) };
    let system = reduce(&system, &start).system;
    let costs = CostModel::of(&system);
    Motion { system: &system, start: &start, duration, costs, reference: &reference, says_runs }.rows()
}

/// The scenes of the repository and those with names of the study.
fn ready() -> Result<Vec<Scene>, Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/scenes");
    let mut paths: Vec<_> = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.retain(|path| path.extension().is_some_and(|end| end == "toml" || end == "json"));
    let mut scenes = paths.iter().map(Scene::load).collect::<Result<Vec<_>, _>>()?;
    scenes.extend(named::scenes()?);
    Ok(scenes)
}

/// The value below which the given part of a list lies.
fn quantile(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
}

/// What an accuracy costs on some scenes, one accuracy a line and all together.
fn table(rows: &[Row]) -> Result<String, std::fmt::Error> {
    let mut text = String::from(
        "| accuracy | answers | confirmed | of these wrong | cost over the cheapest run: median, 90 %, most | above 3.5 | above 8 | time over its time: median, 90 % |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for accuracy in ACCURACIES.into_iter().map(Some).chain([None]) {
        let these: Vec<&Row> = rows.iter().filter(|row| accuracy.is_none_or(|a| row.accuracy == a)).collect();
        let ratios: Vec<f64> = these.iter().map(|row| row.total / row.least).collect();
        let times: Vec<f64> = these.iter().map(|row| row.slower).collect();
        let confirmed = these.iter().filter(|row| row.confirmed);
        let part = |above: f64| {
            let count = ratios.iter().filter(|ratio| **ratio > above).count();
            format!("{:.0} %", 100.0 * count as f64 / ratios.len().max(1) as f64)
        };
        writeln!(
            text,
            "| {} | {} | {} | {} | {:.2}, {:.2}, {:.1} | {} | {} | {:.2}, {:.2} |",
            accuracy.map_or("all".into(), |accuracy| format!("{accuracy:.0e}")),
            these.len(),
            confirmed.clone().count(),
            confirmed.filter(|row| row.error > row.accuracy).count(),
            quantile(&ratios, 0.5),
            quantile(&ratios, 0.9),
            quantile(&ratios, 1.0),
            part(3.5),
            part(8.0),
            quantile(&times, 0.5),
            quantile(&times, 0.9),
        )?;
    }
    Ok(text)
}

fn line(scene: &str, row: &Row) -> String {
    format!(
        "| {scene} | {:.0e} | {} | {}{} | {:.1e} | {:.0} | {:.0} | {} {:.0} | {:.1} | {:.1} |",
        row.accuracy,
        row.method,
        row.estimate.map_or("–".into(), |error| format!("{error:.1e}")),
        if row.confirmed { "" } else { ", unconfirmed" },
        row.error,
        row.cost,
        row.total,
        row.cheapest,
        row.least,
        row.total / row.least,
        row.slower,
    )
}

const HEADER: &str = "| scene | accuracy | answer by | estimated error | achieved | work of the run | of everything | cheapest run, its work | ratio | of times |\n\
                      |---|---|---|---|---|---|---|---|---|---|\n";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let store = Store::open(&root.join("target/study/references"))?;
    let (mut lines, mut of_ready) = (String::new(), Vec::new());
    let wanted = |scene: &Scene| arguments.named.as_ref().is_none_or(|name| *name == scene.name);
    let ready = if arguments.ready || arguments.named.is_some() { ready()? } else { Vec::new() };
    for scene in ready.iter().filter(|scene| wanted(scene)) {
        for row in rows(scene, &store, arguments.runs)? {
            eprintln!("{}", line(&scene.name, &row));
            writeln!(lines, "{}", line(&scene.name, &row))?;
            of_ready.push(row);
        }
    }
    let mut drawn: Vec<(String, Row)> = Vec::new();
    let seeds = if arguments.named.is_some() { 0..0 } else { arguments.first..arguments.first + arguments.count };
    for seed in seeds {
        let scene = random::scene(seed).scene;
        for row in rows(&scene, &store, arguments.runs)? {
            eprintln!("{}", line(&scene.name, &row));
            drawn.push((scene.name.clone(), row));
        }
    }
    drawn.sort_by(|(_, a), (_, b)| (b.total / b.least).total_cmp(&(a.total / a.least)));
    let dearest: String = drawn.iter().take(20).map(|(scene, row)| line(scene, row) + "\n").collect();
    let of_random: Vec<Row> = drawn.into_iter().map(|(_, row)| row).collect();
    let ready = if of_ready.is_empty() {
        String::new()
    } else {
        format!("## Ready scenes\n\n{}\n{HEADER}{lines}", table(&of_ready)?)
    };
    let page = format!(
        "# What `--accuracy` answers\n\n\
         Made by `cargo xtask accuracy --first {} --count {}{} --write`. Errors are relative position errors at the end of the\n\
         motion, against the references of [the study](study.md), of scenes whose reference is ten times better than the accuracy. Work is\n\
         counted in force evaluations of the scene: that of the run handed out, and of everything done to find and confirm it\n\
         (`effort.run` and `effort.total` of `summary.json`). The cheapest run is that of a sweep over all methods with their stiffness options\n\
         and solvers, three steps to a power of two and three tolerances to a decade, and is cheapest with hindsight: also one that\n\
         is good enough by chance counts. Times are those of the search, with what recording asks of it, and of that run alone: of one thread, the shortest of {REPEATS}.\n\n\
         ## {} random scenes\n\n{}\nDearest first:\n\n{HEADER}{dearest}\n{ready}",
        arguments.first,
        arguments.count,
        if arguments.ready { " --ready" } else { "" },
        arguments.count,
        table(&of_random)?,
    );
    println!("{page}");
    if arguments.write {
        std::fs::write(root.join("verification/accuracy.md"), page)?;
    }
    Ok(())
}
