//! The study of a thousand random scenes, and its page `verification/study.md`.
//!
//! ```sh
//! cargo xtask study                    # everything, and the page
//! cargo xtask study --count 100        # the first hundred seeds
//! cargo xtask study --only 17          # one scene, run by run
//! cargo xtask study --export 17 a.json # that scene as a file for the command
//! ```
//!
//! References are kept in `target/study`; every run is written there too, one scene a line, in `records.jsonl`.

#[path = "mod.rs"]
mod study;

use clap::Parser;
use rayon::prelude::*;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use study::record::{Record, Wanted, of_scene, of_seed};
use study::store::Store;
use study::{named, random, rows, tables};

/// Runs random scenes with every method and compares with the truth.
#[derive(Parser)]
struct Arguments {
    /// Number of seeds
    #[arg(long, default_value_t = 1000)]
    count: u64,

    /// The first seed
    #[arg(long, default_value_t = 0)]
    first: u64,

    /// One seed alone, run by run
    #[arg(long, value_name = "SEED")]
    only: Option<u64>,

    /// Writes the scene of a seed as JSON
    #[arg(long, num_args = 2, value_names = ["SEED", "FILE"])]
    export: Option<Vec<String>>,

    /// Only these: fixed, rtol, accuracy, named, none (references alone)
    #[arg(long, value_delimiter = ',', default_value = "fixed,rtol,accuracy,named")]
    what: Vec<String>,

    /// Scenes at a time
    #[arg(long)]
    threads: Option<usize>,

    /// Goes on with the last study instead of beginning anew
    #[arg(long)]
    resume: bool,

    /// Writes the page even when it is about a part of the study
    #[arg(long)]
    write: bool,

    /// Makes the page anew from the records of the last study
    #[arg(long)]
    page: bool,

    /// Where references and records are kept
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/study"))]
    folder: PathBuf,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    let store = Store::open(&arguments.folder.join("references"))?;
    if let Some([seed, file]) = arguments.export.as_deref() {
        return Ok(std::fs::write(file, random::scene(seed.parse()?).scene.to_json())?);
    }
    let has = |what: &str| arguments.what.iter().any(|asked| asked == what);
    let wanted = Wanted { fixed: has("fixed"), adaptive: has("rtol"), accuracy: has("accuracy") };
    if let Some(seed) = arguments.only {
        print!("{}", rows::scene(&of_seed(seed, &store, wanted)?));
        return Ok(());
    }
    let file = arguments.folder.join("records.jsonl");
    let records = if arguments.page {
        read_records(&file)?
    } else {
        if let Some(threads) = arguments.threads {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        }
        measure(&arguments, &store, wanted, has("named"), &file)?
    };
    let page = tables::page(&records);
    print!("{page}");
    // A part of the study is not what the page is about, unless it is asked for.
    if arguments.write || records.iter().filter(|record| record.seed.is_some()).count() >= 1000 {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("study.md"), page)?;
    }
    Ok(())
}

/// Studies what is asked for. Every scene is written to `file` when it is done; with `--resume` those that are there are kept.
fn measure(
    arguments: &Arguments,
    store: &Store,
    wanted: Wanted,
    named: bool,
    file: &Path,
) -> Result<Vec<Record>, Box<dyn std::error::Error>> {
    let mut records = if arguments.resume { read_records(file)? } else { Vec::new() };
    let is_new = |name: &str| !records.iter().any(|record| record.scene == name);
    let seeds = arguments.first..arguments.first + arguments.count;
    let seeds: Vec<u64> = seeds.filter(|&seed| is_new(&random::name(seed))).collect();
    let mut scenes = if named { named::scenes()? } else { Vec::new() };
    scenes.retain(|scene| is_new(&scene.name));
    let (done, all) = (AtomicUsize::new(0), seeds.len() + scenes.len());
    let log = Mutex::new(OpenOptions::new().create(true).append(true).truncate(false).open(file)?);
    if !arguments.resume {
        OpenOptions::new().write(true).truncate(true).open(file)?;
    }
    let report = |record: &Record| {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if let (Ok(mut log), Ok(line)) = (log.lock(), serde_json::to_string(record)) {
            let _ = writeln!(log, "{line}");
            if done.is_multiple_of(20) || done == all {
                eprintln!("{done} of {all}: {}", record.scene);
            }
        }
    };
    // Scenes differ a thousandfold in cost: each is a task of its own.
    let random = seeds.par_iter().with_max_len(1).map(|&seed| of_seed(seed, store, wanted).inspect(report));
    records.extend(random.collect::<sprung::Result<Vec<_>>>()?);
    let with_names = scenes.par_iter().with_max_len(1).map(|scene| of_scene(scene, store, wanted).inspect(report));
    records.extend(with_names.collect::<sprung::Result<Vec<_>>>()?);
    records.sort_by_key(|record| record.seed.unwrap_or(u64::MAX));
    Ok(records)
}

/// Those of a file, or of several that were put together: what was run on a scene at different times is one record.
fn read_records(file: &Path) -> Result<Vec<Record>, Box<dyn std::error::Error>> {
    let mut records = Vec::<Record>::new();
    for line in std::fs::read_to_string(file)?.lines() {
        let record: Record = serde_json::from_str(line)?;
        match records.iter_mut().find(|known| known.scene == record.scene) {
            Some(known) => known.runs.extend(record.runs),
            None => records.push(record),
        }
    }
    Ok(records)
}
