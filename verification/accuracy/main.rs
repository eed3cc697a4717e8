//! Makes `verification/accuracy.md`: what `--accuracy` answers on random and on ready scenes, how wrong the answers are, and what they cost
//! against the cheapest single run that a sweep over all methods, options, solvers and steps finds.
//!
//! ```sh
//! cargo xtask accuracy --write                 # the page, a quarter of an hour; --ready for ready scenes too
//! cargo xtask accuracy --count 20 --first 500  # other random scenes
//! cargo xtask accuracy --named cloth-of-6      # one scene with a name, answer by answer
//! ```
//!
//! References are those of the study, kept in `target/study`.

mod commands;
mod motion;
mod runs;
#[allow(dead_code, reason = "only scenes and references of the study are used")]
#[path = "../study/mod.rs"]
mod study;
mod table;
mod timing;

use clap::Parser;
use commands::Commands;
use motion::{Motion, Row};
use rayon::prelude::*;
use sprung::linear::CostModel;
use sprung::scene::Scene;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use study::store::Store;
use study::{named, random};
use table::{HEADER, line, table};
use timing::REPEATS;

/// Compares the cost of answers with that of the cheapest single run.
#[derive(Parser)]
struct Arguments {
    /// Number of random scenes
    #[arg(long, default_value_t = 1000)]
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

    /// Times whole commands of so many of the random scenes, and of all ready ones
    #[arg(long, value_name = "COUNT")]
    commands: Option<u64>,

    /// Says what was done for every answer, and what it has cost
    #[arg(long)]
    runs: bool,

    /// Writes the page
    #[arg(long)]
    write: bool,
}

fn rows(
    scene: &Scene,
    store: &Store,
    commands: Option<&Commands>,
    says_runs: bool,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let (system, start) = scene.build()?;
    let duration = scene.time.duration.unwrap_or(1.0);
    let Some(reference) = store.reference(scene, duration)? else { return Ok(Vec::new()) };
    let costs = CostModel::of(&system);
    let file = commands.map(|commands| commands.scene(scene)).transpose()?;
    let commands = commands.zip(file.as_ref()).map(|(commands, file)| commands.on(file));
    Motion { system: &system, start: &start, duration, costs, reference: &reference, commands, says_runs }.rows()
}

/// The scenes of the repository and those with names of the study.
fn ready() -> Result<Vec<Scene>, Box<dyn Error>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = here.join("scenes");
    let carried = std::fs::read_dir(here.join("../src/verify/scenes"))?;
    let mut paths: Vec<_> =
        std::fs::read_dir(&folder)?.chain(carried).filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.retain(|path| path.extension().is_some_and(|end| end == "toml" || end == "json"));
    let mut scenes = paths.iter().map(Scene::load).collect::<Result<Vec<_>, _>>()?;
    for mesh in scenes.iter_mut().filter_map(|scene| scene.mesh.as_mut()) {
        // Commands are given copies of the scenes, which stand elsewhere.
        mesh.file = folder.join(&mesh.file).to_string_lossy().into_owned();
    }
    scenes.extend(named::scenes()?);
    Ok(scenes)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("in no folder")?;
    let store = Store::open(&root.join("target/study/references"))?;
    let commands = arguments.commands.map(|_| Commands::build(root)).transpose()?;
    let (mut lines, mut of_ready) = (String::new(), Vec::new());
    let wanted = |scene: &Scene| arguments.named.as_ref().is_none_or(|name| *name == scene.name);
    let ready = if arguments.ready || arguments.named.is_some() { ready()? } else { Vec::new() };
    for scene in ready.iter().filter(|scene| wanted(scene)) {
        for row in rows(scene, &store, commands.as_ref(), arguments.runs)? {
            eprintln!("{}", line(&scene.name, &row));
            writeln!(lines, "{}", line(&scene.name, &row))?;
            of_ready.push(row);
        }
    }
    let count = if arguments.named.is_some() { 0 } else { arguments.count };
    let seeds: Vec<u64> = (arguments.first..arguments.first + count).collect();
    let of_seed = |seed: u64| -> Result<Vec<(String, Row)>, String> {
        let scene = random::scene(seed).scene;
        let are_timed = arguments.commands.is_some_and(|count| seed < arguments.first + count);
        let commands = commands.as_ref().filter(|_| are_timed);
        let rows =
            rows(&scene, &store, commands, arguments.runs).map_err(|error| format!("{}: {error}", scene.name))?;
        rows.iter().for_each(|row| eprintln!("{}", line(&scene.name, row)));
        Ok(rows.into_iter().map(|row| (scene.name.clone(), row)).collect())
    };
    // Scenes one beside the other, each on one thread, whose time is what is counted; but whole commands, and what is told run by run, one after the other.
    let threads = if commands.is_some() || arguments.runs { 1 } else { 0 };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let drawn = threads
        .install(|| seeds.par_iter().with_max_len(1).map(|&seed| of_seed(seed)).collect::<Result<Vec<_>, _>>())?;
    let mut drawn: Vec<(String, Row)> = drawn.into_iter().flatten().collect();
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
         Made by `cargo xtask accuracy --first {} --count {}{}{} --write`. Errors are relative position errors at the end of the\n\
         motion, against the references of [the study](study.md), of scenes whose reference is ten times better than the accuracy. Work is\n\
         counted in force evaluations of the scene: that of the run handed out, and of everything done to find and confirm it\n\
         (`effort.run` and `effort.total` of `summary.json`). The cheapest run is that of a sweep over all methods with their stiffness options\n\
         and solvers, three steps to a power of two and three tolerances to a decade, and is cheapest with hindsight: also one that\n\
         is good enough by chance counts. *Right for sure* is a run from which on all finer ones of the same way to run are good enough too, as far as\n\
         they cost no more than the answer; also that is hindsight. Times of the search, with what recording asks of it, are set against those of\n\
         that run alone, without any account of it; times of `sprung run --accuracy` against those of the `sprung run` that makes it{}. All are those of one thread,\n\
         the shortest of {REPEATS}.\n\n\
         ## {} random scenes\n\n{}\nDearest first:\n\n{HEADER}{dearest}\n{ready}",
        arguments.first,
        arguments.count,
        if arguments.ready { " --ready" } else { "" },
        arguments.commands.map_or(String::new(), |count| format!(" --commands {count}")),
        arguments
            .commands
            .map_or(String::new(), |count| format!(", on {} of the random scenes", count.min(arguments.count))),
        arguments.count,
        table(&of_random)?,
    );
    println!("{page}");
    if arguments.write {
        std::fs::write(root.join("verification/accuracy.md"), page)?;
    }
    Ok(())
}
