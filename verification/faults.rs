//! Plants faults in a copy of the program, one after the other, and records which checks of the suite catch each.
//!
//! `cargo xtask faults` applies every fault of `faults.toml` to a copy below the target folder, runs the
//! verification suite on it, or the tests of a room that the suite does not see, and writes `faults.json` (for programs) and `faults.md` (for readers) beside the list.
//! Arguments choose faults by part of their name; then only their rows are renewed. Every fault costs a build: a quarter of an
//! hour for all. A fault that survives, does not compile or no longer finds its place makes the exit status 1.

mod copy;

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Longest time that the suite may take on a faulty program; it takes some seconds on the right one.
const PATIENCE: Duration = Duration::from_secs(300);

#[derive(Deserialize)]
struct List {
    fault: Vec<Fault>,
}

/// A fault: a place in the source, by its text, and what is put there.
#[derive(Deserialize)]
struct Fault {
    name: String,
    file: String,
    find: String,
    replace: String,
    /// A room whose own tests are to catch it, as the suite does not see it: unit tests, and the program of this name in `tests` where there is one.
    room: Option<String>,
}

/// A fault and the tests that failed because of it, by family.
#[derive(Serialize, Deserialize)]
struct Caught {
    fault: String,
    file: String,
    /// Number of tests that failed.
    tests: usize,
    /// Families of these tests, each with their number, the largest first.
    by: Vec<(String, usize)>,
}

/// How the suite ended on a program.
enum Verdict {
    Failed(Vec<String>),
    Passed,
    /// It did not start, or did not end in time.
    Broke(String),
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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = folder.parent().ok_or("in no folder")?;
    let list: List = toml::from_str(&fs::read_to_string(folder.join("faults.toml"))?)?;
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let target = copy::target(root).join("faults-planted");
    let copy = target.join("program");
    copy::program(root, &copy)?;
    copy::dependencies(root, &target.join("build"))?;
    let mut rooms: Vec<Option<&str>> =
        list.fault.iter().filter(|fault| chosen(&wanted, fault)).map(|fault| fault.room.as_deref()).collect();
    rooms.sort_unstable();
    rooms.dedup();
    for room in rooms {
        if let Verdict::Failed(tests) = verdict(&copy, &target, room)? {
            return Err(format!("the program fails without a fault: {}", tests.join(", ")).into());
        }
    }
    let record = root.join("src/report/faults.json");
    let mut caught: Vec<Caught> =
        if wanted.is_empty() { Vec::new() } else { serde_json::from_str(&fs::read_to_string(&record)?)? };
    caught.retain(|row| list.fault.iter().any(|fault| fault.name == row.fault && !chosen(&wanted, fault)));
    for fault in list.fault.iter().filter(|fault| chosen(&wanted, fault)) {
        let started = Instant::now();
        let row = plant(fault, &copy, &target)?;
        let by: Vec<String> = row.by.iter().map(|(family, count)| format!("{family} ({count})")).collect();
        println!("{:>4.0?} s  {}: {}", started.elapsed().as_secs(), row.fault, by.join(", "));
        caught.push(row);
    }
    caught.sort_by_key(|row| list.fault.iter().position(|fault| fault.name == row.fault));
    fs::write(record, serde_json::to_string_pretty(&caught)? + "\n")?;
    fs::write(folder.join("faults.md"), table(&caught))?;
    let survived = caught.iter().filter(|row| row.tests == 0).count();
    println!("{} faults, {survived} survived", caught.len());
    Ok(survived == 0)
}

/// Whether a fault is among those asked for: all, where nothing is.
fn chosen(wanted: &[String], fault: &Fault) -> bool {
    wanted.is_empty() || wanted.iter().any(|part| fault.name.contains(part.as_str()))
}

/// Applies a fault to the copy, runs the suite, and takes the fault out again.
fn plant(fault: &Fault, copy: &Path, target: &Path) -> Result<Caught> {
    let place = copy.join(&fault.file);
    let source = fs::read_to_string(&place)?;
    if source.matches(&fault.find).count() != 1 {
        return Err(format!("{}: its place is not found exactly once in {}", fault.name, fault.file).into());
    }
    fs::write(&place, source.replacen(&fault.find, &fault.replace, 1))?;
    let verdict = verdict(copy, target, fault.room.as_deref());
    fs::write(&place, source)?;
    let tests = match verdict? {
        Verdict::Failed(tests) => tests,
        Verdict::Passed => Vec::new(),
        Verdict::Broke(how) => vec![format!("the suite {how}")],
    };
    let mut families = BTreeMap::<String, usize>::new();
    for test in &tests {
        let family = match test.rsplit_once("::") {
            // A room's tests have names of their own.
            Some((family, _)) if fault.room.is_none() => family,
            _ => test.as_str(),
        };
        *families.entry(family.to_owned()).or_default() += 1;
    }
    let mut by: Vec<(String, usize)> = families.into_iter().collect();
    by.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    Ok(Caught { fault: fault.name.clone(), file: fault.file.clone(), tests: tests.len(), by })
}

/// Builds the suite in the copy, or the tests of a room, and runs them.
fn verdict(copy: &Path, target: &Path, room: Option<&str>) -> Result<Verdict> {
    let has_program =
        |room: &str| [format!("{room}.rs"), room.into()].iter().any(|at| copy.join("tests").join(at).exists());
    let chosen = match room {
        None => vec!["--test", "verification"],
        Some(room) if has_program(room) => vec!["--lib", "--test", room],
        Some(_) => vec!["--lib"],
    };
    let build = Command::new(env!("CARGO"))
        .args(["test", "--profile", "faults", "--no-run", "--message-format", "json"])
        .args(chosen)
        .arg("--target-dir")
        .arg(target.join("build"))
        .current_dir(copy)
        .stderr(Stdio::null())
        .output()?;
    if !build.status.success() {
        return Err(format!("the program in {} does not compile", copy.display()).into());
    }
    let messages = String::from_utf8(build.stdout)?;
    let messages = messages.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let tests = messages.filter(|message| message["profile"]["test"] == true);
    let mut failed = Vec::new();
    for message in tests {
        let (Some(name), Some(program)) = (message["target"]["name"].as_str(), message["executable"].as_str()) else {
            continue;
        };
        let mut command = Command::new(program);
        command.args(["--color", "never"]).current_dir(copy);
        if let Some(room) = room.filter(|_| name == "sprung") {
            command.arg(format!("{room}::"));
        }
        match outcome(&mut command, &target.join("output.txt"))? {
            Verdict::Passed => {}
            // What a program of tests is called stands before its tests, as the suite's families do.
            Verdict::Failed(tests) if room.is_some_and(|room| room == name) => {
                failed.extend(tests.into_iter().map(|test| format!("tests::{name}::{test}")));
            }
            Verdict::Failed(tests) => failed.extend(tests),
            broke @ Verdict::Broke(_) => return Ok(broke),
        }
    }
    Ok(if failed.is_empty() { Verdict::Passed } else { Verdict::Failed(failed) })
}

/// Runs a program of tests.
fn outcome(command: &mut Command, output: &Path) -> Result<Verdict> {
    let mut child = command.stdout(fs::File::create(output)?).stderr(Stdio::null()).spawn()?;
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if started.elapsed() > PATIENCE {
            child.kill()?;
            child.wait()?;
            return Ok(Verdict::Broke("does not end".into()));
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let output = String::from_utf8_lossy(&fs::read(output)?).into_owned();
    let failed = output.lines().filter(|line| line.starts_with("test ") && line.ends_with("FAILED"));
    let tests: Vec<String> = failed.filter_map(|line| line.split_whitespace().nth(1).map(str::to_owned)).collect();
    Ok(match (status.success(), tests.is_empty()) {
        (true, _) => Verdict::Passed,
        (false, false) => Verdict::Failed(tests),
        (false, true) => Verdict::Broke("does not start".into()),
    })
}

/// How many families, or faults, a row of a table names.
const NAMED: usize = 4;

fn table(caught: &[Caught]) -> String {
    let mut text = String::from(
        "# Planted faults, and what catches them\n\n\
         Written by `cargo xtask faults` from `faults.toml`. Every fault is put into a copy of the program, and the whole \
         suite runs on it. Numbers are tests that fail, by family; a family is a check, its tests are the scenes or cases.\n\n\
         | fault | in | tests | caught by |\n|---|---|---|---|\n",
    );
    for Caught { fault, file, tests, by } in caught {
        let by: Vec<String> = by.iter().map(|(family, count)| format!("`{family}` ({count})")).collect();
        let _ = writeln!(text, "| {fault} | `{file}` | {tests} | {} |", shortened(&by, "**nothing**"));
    }
    text +=
        "\n## By family\n\n| family | faults caught | among them, those first that few others catch |\n|---|---|---|\n";
    // First those that few other families see: they say what a family is there for.
    let mut telling: Vec<&Caught> = caught.iter().collect();
    telling.sort_by_key(|row| row.by.len());
    let mut families = BTreeMap::<&str, Vec<String>>::new();
    for Caught { fault, by, .. } in telling {
        by.iter().for_each(|(family, _)| families.entry(family).or_default().push(fault.clone()));
    }
    for (family, faults) in families {
        let _ = writeln!(text, "| `{family}` | {} | {} |", faults.len(), shortened(&faults, ""));
    }
    text
}

fn shortened(names: &[String], nothing: &str) -> String {
    let more = if names.len() > NAMED { format!(" and {} more", names.len() - NAMED) } else { String::new() };
    if names.is_empty() { nothing.into() } else { names[..names.len().min(NAMED)].join(", ") + &more }
}
