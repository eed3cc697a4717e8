//! Tries the mutants that cargo-mutants finds in the rooms that compute, and records what became of each.
//!
//! `cargo xtask mutants` builds mutants behind a switch in a copy below the target folder, runs the tests with each until one
//! fails, keeps the results beside this file, one file a room, and writes `mutants.md` from all of them: so rooms can be tried on
//! different days, and what was not tried is counted as that. Only tests that enter the changed function are run, those first
//! that have caught most mutants of its file for the time they take, in processes of one test, then of ever more.
//!
//! | words | |
//! |---|---|
//! | `--room NAME` | only this room (`src/NAME/` or `src/NAME.rs`); may stand several times |
//! | a part of a name | only mutants whose names hold it |
//! | `--open` | only those of which nothing is settled: not tried, or alive and not listed as equivalent |
//! | `--alive` | of those only the ones that are alive: after new tests |
//! | `--seconds N` | tests of so many seconds of the processor for each mutant; what is alive then is kept as alive after some tests |
//! | `--tests NAME` | only the tests of this program in `tests/`, or `lib` for the unit tests; may stand several times; what is alive then is kept as alive after some tests |
//! | `--jobs N` | so many at a time, instead of one a processor |
//! | `--optimised` | the copy is optimised a little: builds take minutes longer, slow tests a fifth of their time |
//! | `--apart` | those in constants too, each of which takes a build of its own |
//! | `--count` | how many there are and what is known of them, nothing else |
//! | `--table` | the page from what is known, nothing else |
//!
//! Those that no test can catch are listed in `equivalent.toml` with the reason; any other survivor, and one not tried yet,
//! makes the exit status 1. cargo-mutants must be installed (`cargo install cargo-mutants --locked`), and the system a Unix.

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

/// What the words ask for.
#[derive(Default)]
struct Request {
    rooms: Vec<String>,
    parts: Vec<String>,
    tests: Vec<String>,
    open: bool,
    alive: bool,
    apart: bool,
    optimised: bool,
    count: bool,
    table: bool,
    seconds: Option<Duration>,
    jobs: Option<usize>,
}

impl Request {
    fn of(words: impl IntoIterator<Item = String>) -> Result<Self> {
        let mut request = Self::default();
        let mut words = words.into_iter();
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word}: a value is missing"));
            match word.as_str() {
                "--room" => request.rooms.push(value()?),
                "--tests" => request.tests.push(value()?),
                "--seconds" => request.seconds = Some(Duration::try_from_secs_f64(value()?.parse()?)?),
                "--jobs" => request.jobs = Some(value()?.parse()?),
                "--open" => request.open = true,
                "--alive" => (request.open, request.alive) = (true, true),
                "--apart" => request.apart = true,
                "--optimised" => request.optimised = true,
                "--count" => request.count = true,
                "--table" => request.table = true,
                _ if word.starts_with("--") => {
                    return Err(format!("{word}: the options are at the head of verification/mutants/main.rs").into());
                }
                _ => request.parts.push(word),
            }
        }
        Ok(request)
    }

    fn wants(&self, mutant: &Mutant) -> bool {
        let of_room = self.rooms.is_empty() || self.rooms.iter().any(|room| room == mutant.room());
        of_room && (self.parts.is_empty() || self.parts.iter().any(|part| mutant.name.contains(part.as_str())))
    }

    /// The name of the folder of the copy: rooms have their own, so that one can be built while another is tried.
    fn folder(&self) -> String {
        std::iter::once("mutants").chain(self.rooms.iter().map(String::as_str)).collect::<Vec<_>>().join("-")
    }
}

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
    let request = Request::of(std::env::args().skip(1))?;
    let mutants = listed::all(root)?;
    if let Some(room) = request.rooms.iter().find(|room| !mutants.iter().any(|mutant| mutant.room() == *room)) {
        return Err(format!("{room}: no such room").into());
    }
    let mut record = Record::new(root, &mutants)?;
    if request.count {
        print!("{}", record.rooms());
        return Ok(true);
    }
    if request.table {
        return record.write();
    }
    let chosen: BTreeSet<usize> = build::numbered(&mutants)
        .filter(|(_, mutant)| request.wants(mutant) && (request.apart || mutant.function.is_some()))
        .filter(|(number, _)| !request.open || !record.settled(*number))
        .filter(|(number, _)| !request.alive || record.tried(*number))
        .map(|(number, _)| number)
        .collect();
    println!("{} of {} mutants to try", chosen.len(), mutants.len());
    let copy = Copy::new(root, &request.folder(), request.optimised)?;
    let (unviable, functions) = copy.with_switches(&mutants, &chosen)?;
    unviable.iter().for_each(|&number| record.set(number, Fate::Unviable));
    record.keep()?;
    println!("building the tests with {} mutants", chosen.len() - unviable.len());
    let parts = trial::parts(copy.tests(&request.tests)?, &copy.folder, request.seconds)?;
    let in_constants = |number: &usize| mutants[number - 1].function.is_none();
    let (apart, switched): (Vec<usize>, Vec<usize>) =
        chosen.difference(&unviable).partition(|number| in_constants(number));
    let record = Mutex::new(record);
    let jobs = request.jobs.or_else(|| std::thread::available_parallelism().ok().map(Into::into)).unwrap_or(1);
    let tests = Tests { parts, functions, folder: copy.folder.clone() };
    let has_all = request.tests.is_empty();
    let trials = Trials { mutants: &mutants, tests: &tests, has_all, record: &record, jobs };
    let promising = request.seconds.map_or(PROMISING, |seconds| seconds.min(PROMISING));
    let left = trials.all(&switched, Some(promising))?;
    println!("{} mutants survived the most promising tests", left.len());
    let left = if promising == request.seconds.unwrap_or(Duration::MAX) {
        left
    } else {
        trials.all(&left, request.seconds)?
    };
    println!("{} mutants survived", left.len());
    let mut record = record.into_inner().map_err(|error| error.to_string())?;
    for number in apart {
        let mutant = &mutants[number - 1];
        let compiles = copy.with_one(mutant)? && copy.tests(&request.tests).is_ok();
        let mut parts = tests.entering(number);
        record.promising_first(mutant, &mut parts);
        let fate = if compiles { trial::fate(&parts, 0, &copy.folder)? } else { Fate::Unviable };
        tell(mutant, &fate);
        record.set(number, fate);
        record.keep()?;
    }
    record.write()
}

/// Mutants and what they are tried with.
struct Trials<'a, 'm> {
    mutants: &'a [Mutant],
    tests: &'a Tests,
    /// Whether there are all tests.
    has_all: bool,
    record: &'a Mutex<Record<'m>>,
    jobs: usize,
}

impl Trials<'_, '_> {
    /// Tries mutants, several at a time, each with the most promising tests of so much time, or with all that enter its function;
    /// returns those that survive.
    fn all(&self, numbers: &[usize], time: Option<Duration>) -> Result<Vec<usize>> {
        let (next, survivors) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        let work = || {
            while let Some(&number) = numbers.get(next.fetch_add(1, Ordering::Relaxed)) {
                let fate = self.one(number, time)?;
                tell(&self.mutants[number - 1], &fate);
                if matches!(fate, Fate::Survived | Fate::Alive) {
                    survivors.lock().map_err(|error| error.to_string())?.push(number);
                }
                let mut record = self.record.lock().map_err(|error| error.to_string())?;
                record.set(number, fate);
                if number.is_multiple_of(KEPT) {
                    record.keep().map_err(|error| error.to_string())?;
                }
            }
            Ok::<(), String>(())
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..self.jobs).map(|_| scope.spawn(work)).collect();
            workers.into_iter().try_for_each(|worker| worker.join().map_err(|_| "a worker panicked")?)
        })?;
        Ok(survivors.into_inner().map_err(|error| error.to_string())?)
    }

    fn one(&self, number: usize, time: Option<Duration>) -> std::result::Result<Fate, String> {
        let mut parts = self.tests.entering(number);
        let mutant = &self.mutants[number - 1];
        self.record.lock().map_err(|error| error.to_string())?.promising_first(mutant, &mut parts);
        let all = parts.len();
        parts.truncate(time.map_or(all, |time| trial::within(&parts, time)));
        let are_all = parts.len() == all && self.has_all;
        let fate = trial::fate(&parts, number, &self.tests.folder).map_err(|error| error.to_string())?;
        Ok(if fate == Fate::Survived && !are_all { Fate::Alive } else { fate })
    }
}

fn tell(mutant: &Mutant, fate: &Fate) {
    match fate {
        Fate::Survived => println!("SURVIVED {}", mutant.name),
        Fate::Alive => println!("alive    {}", mutant.name),
        Fate::Endless { in_program } => println!("endless  {} in {in_program}", mutant.name),
        Fate::Caught { by, test } => println!("caught   {} by {by} {test}", mutant.name),
        Fate::Unviable => println!("unviable {}", mutant.name),
    }
}
