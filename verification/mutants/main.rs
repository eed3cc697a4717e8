//! Tries every mutant that cargo-mutants finds in the numerical modules, and records what became of each.
//!
//! `cargo xtask mutants` builds them all behind a switch in a copy below the target folder, runs the
//! tests with each until one fails, and writes `mutants.md` beside this folder. Only tests that enter the changed function
//! are run, those first that have caught most mutants of its file for the time they take. Arguments choose mutants by part
//! of their name; `--survivors` tries only those that no test has caught yet, those of a run that was ended among them, and
//! `--table` tries none. Those that no test can catch are listed in `equivalent.toml` with the reason; any other survivor,
//! and one not tried yet, makes the exit status 1.
//! cargo-mutants must be installed (`cargo install cargo-mutants --locked`), and the system a Unix.

mod build;
#[path = "../copy.rs"]
mod copy;
mod listed;
mod record;
mod switch;
mod trial;

use build::Copy;
use listed::Mutant;
use record::Record;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use trial::{Fate, Tests};

/// How much time of tests decides which mutants are tried with all.
const PROMISING: Duration = Duration::from_secs(6);

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// After how many mutants what is known of them is kept, so that little is lost if the run is ended.
const KEPT: usize = 20;

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<bool> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (options, wanted): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|word| word.starts_with("--"));
    if let Some(unknown) = options.iter().find(|option| !["--survivors", "--table"].contains(&option.as_str())) {
        return Err(format!("{unknown}: the options are --survivors and --table").into());
    }
    let mutants = listed::all(root)?;
    let mut record = Record::new(root, &mutants)?;
    if options.iter().any(|option| option == "--table") {
        return record.write();
    }
    let chosen: BTreeSet<usize> = build::numbered(&mutants)
        .filter(|(_, mutant)| wanted.is_empty() || wanted.iter().any(|part| mutant.name.contains(part.as_str())))
        .filter(|(number, _)| options.is_empty() || !record.settled(*number))
        .map(|(number, _)| number)
        .collect();
    println!("{} of {} mutants to try", chosen.len(), mutants.len());
    let copy = Copy::new(root)?;
    let (unviable, functions) = copy.with_switches(&mutants)?;
    unviable.iter().for_each(|&number| record.set(number, Fate::Unviable));
    println!("building the tests with {} mutants", mutants.len() - unviable.len());
    let parts = trial::parts(copy.tests()?, &copy.folder)?;
    let in_constants = |number: &usize| mutants[number - 1].function.is_none();
    let (apart, switched): (Vec<usize>, Vec<usize>) =
        chosen.difference(&unviable).partition(|number| in_constants(number));
    let record = Mutex::new(record);
    let tests = Tests { parts, functions, folder: copy.folder.clone() };
    let left = try_all(&switched, &mutants, &tests, Share::Promising, &record)?;
    println!("{} mutants survived the most promising tests", left.len());
    let left = try_all(&left, &mutants, &tests, Share::All, &record)?;
    println!("{} mutants survived", left.len());
    let mut record = record.into_inner().map_err(|error| error.to_string())?;
    for number in apart {
        let mutant = &mutants[number - 1];
        let compiles = copy.with_one(mutant)? && copy.tests().is_ok();
        let mut parts = tests.entering(number);
        record.promising_first(mutant, &mut parts);
        let fate = if compiles { trial::fate(parts, 0, &copy.folder)? } else { Fate::Unviable };
        tell(mutant, &fate);
        record.set(number, fate);
        record.keep()?;
    }
    record.write()
}

/// How many of the tests a mutant is tried with.
#[derive(Clone, Copy, PartialEq)]
enum Share {
    /// Those that are likely to catch it, of a few seconds: enough for most, and soon done.
    Promising,
    All,
}

/// Tries mutants, as many at a time as there are processors; returns those that survive.
fn try_all(
    numbers: &[usize],
    mutants: &[Mutant],
    tests: &Tests,
    share: Share,
    record: &Mutex<Record>,
) -> Result<Vec<usize>> {
    let (next, survivors) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while let Some(&number) = numbers.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mutant = &mutants[number - 1];
            let mut parts = tests.entering(number);
            record.lock().map_err(|error| error.to_string())?.promising_first(mutant, &mut parts);
            if share == Share::Promising {
                parts.truncate(trial::within(&parts, PROMISING));
            }
            let fate = trial::fate(parts, number, &tests.folder).map_err(|error| error.to_string())?;
            tell(mutant, &fate);
            let mut record = record.lock().map_err(|error| error.to_string())?;
            if fate == Fate::Survived {
                survivors.lock().map_err(|error| error.to_string())?.push(number);
                if share == Share::Promising {
                    continue;
                }
            }
            record.set(number, fate);
            if number.is_multiple_of(KEPT) {
                record.keep().map_err(|error| error.to_string())?;
            }
        }
        Ok::<(), String>(())
    };
    let workers = std::thread::available_parallelism().map_or(1, Into::into);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().map_err(|_| "a worker panicked")?)
    })?;
    Ok(survivors.into_inner().map_err(|error| error.to_string())?)
}

fn tell(mutant: &Mutant, fate: &Fate) {
    match fate {
        Fate::Survived => println!("SURVIVED {}", mutant.name),
        Fate::Endless { in_program } => println!("endless  {} in {in_program}", mutant.name),
        Fate::Caught { by, test } => println!("caught   {} by {by} {test}", mutant.name),
        Fate::Unviable => println!("unviable {}", mutant.name),
    }
}
