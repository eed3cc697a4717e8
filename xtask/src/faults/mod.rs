//! Plants faults in a copy of the program and records the tests that detect each.
//!
//! The faults of `verification/faults.toml` are planted in a copy in the target folder, in functions all together behind switches, in constants one at a
//! time. With each the verification suite runs, or the tests of a module if the suite cannot detect the fault. `src/report/faults.json` (for reports) and `verification/faults.md` record the results.

pub mod copy;
mod page;
mod place;

use crate::switches::{self, SWITCH};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use place::{Place, Source};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit of the suite on a faulty program; on the correct one it takes seconds.
const PATIENCE: Duration = Duration::from_secs(300);

/// The rows, for reports.
const RECORD: &str = "src/report/faults.json";

/// The number of test families in a record.
const NAMED: usize = 4;

/// The selected faults.
#[derive(Debug, Clone, Args)]
pub struct Chosen {
    /// Parts of names of faults to plant and renew; default: all
    parts: Vec<String>,
}

impl Chosen {
    fn has(&self, name: &str) -> bool {
        self.parts.is_empty() || self.parts.iter().any(|part| name.contains(part.as_str()))
    }
}

#[derive(Deserialize)]
struct List {
    fault: Vec<Fault>,
}

/// A fault: an expression in a function, and its replacement.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fault {
    name: String,
    /// A unique suffix of the path of a function or constant.
    function: String,
    find: String,
    replace: String,
    /// The filter of the unit and library tests that detect it, if the suite does not.
    tests: Option<String>,
}

/// A fault and the tests that failed because of it, by family.
#[derive(Serialize, Deserialize)]
struct Caught {
    fault: String,
    function: String,
    /// The number of failed tests.
    tests: usize,
    /// The number of their families.
    families: usize,
    /// The largest families with their numbers of tests.
    by: Vec<(String, usize)>,
}

/// The outcome of tests on a program.
enum Verdict {
    Failed(Vec<String>),
    Passed,
    /// They did not start, or exceeded the time limit.
    Broke(&'static str),
}

/// The copy that faults are planted in.
struct Copy {
    program: PathBuf,
    target: PathBuf,
}

/// Plants the chosen faults and renews their rows.
///
/// # Errors
/// A fault that survives, does not compile or has lost its place.
pub fn run(root: &Path, chosen: &Chosen) -> Result<()> {
    let faults = list(root)?;
    let target = copy::target(root).join("faults-planted");
    let copy = Copy { program: target.join("program"), target };
    copy::dependencies(root, &copy.target.join("build"))?;
    let source = Source::read(&root.join("src"))?;
    let place = |fault: &Fault| source.find(&fault.function, &fault.find).with_context(|| fault.name.clone());
    let places = faults.iter().map(place).collect::<Result<Vec<_>>>()?;
    let planted: Vec<usize> = (0..faults.len()).filter(|&at| chosen.has(&faults[at].name)).collect();
    let files = switched(root, &faults, &places, &planted)?;
    let mut apart: BTreeSet<usize> = planted.iter().copied().filter(|&at| places[at].body.is_none()).collect();
    let wrong = switches::plant(root, &copy.program, &copy.target.join("build"), files)?;
    apart.extend(wrong.iter().map(|number| number - 1));
    let filters: BTreeSet<_> = planted.iter().map(|&at| faults[at].tests.as_deref()).collect();
    for filter in filters {
        match copy.verdict(filter, 0)? {
            Verdict::Passed => {}
            Verdict::Failed(tests) => bail!("the program fails without a fault: {}", tests.join(", ")),
            Verdict::Broke(how) => bail!("without a fault the suite {how}"),
        }
    }
    let mut caught: Vec<Caught> = serde_json::from_str(&fs::read_to_string(root.join(RECORD))?)?;
    caught.retain(|row| faults.iter().any(|fault| fault.name == row.fault));
    let together = planted.iter().filter(|at| !apart.contains(at));
    for &at in together.chain(&apart) {
        let (fault, place) = (&faults[at], &places[at]);
        let started = Instant::now();
        let verdict = if apart.contains(&at) {
            copy.apart(root, fault, place)
        } else {
            copy.verdict(fault.tests.as_deref(), at + 1)
        };
        let row = caught_by(fault, verdict.with_context(|| fault.name.clone())?);
        println!("{:>4} s  {}: {}", started.elapsed().as_secs(), row.fault, page::families(&row, "nothing"));
        caught.retain(|before| before.fault != row.fault);
        caught.push(row);
        caught.sort_by_key(|row| faults.iter().position(|fault| fault.name == row.fault));
        record(root, &caught)?;
    }
    let survived: Vec<&str> = caught.iter().filter(|row| row.tests == 0).map(|row| row.fault.as_str()).collect();
    ensure!(survived.is_empty(), "{} of {} faults survived: {}", survived.len(), caught.len(), survived.join(", "));
    println!("{} faults, all caught", caught.len());
    Ok(())
}

/// Files with the chosen faults behind switches: a function has its right body and one for each of its faults. The number of a fault is its place in the
/// list, from 1.
fn switched(root: &Path, faults: &[Fault], places: &[Place], planted: &[usize]) -> Result<Vec<switches::File>> {
    let mut files = BTreeMap::<&Path, BTreeMap<(usize, usize), Vec<usize>>>::new();
    for &at in planted {
        if let Some(body) = &places[at].body {
            let bodies = files.entry(&places[at].file).or_default();
            bodies.entry((body.start, body.end)).or_default().push(at);
        }
    }
    let mut switched = Vec::new();
    for (path, bodies) in files {
        let text = fs::read_to_string(path)?;
        let sites = bodies.into_iter().map(|((start, end), planted)| {
            let mut code = String::from("{ ");
            for &at in &planted {
                let place = &places[at].bytes;
                let faulty = [&text[start..place.start], &faults[at].replace, &text[place.end..end]].concat();
                code += &format!("if {} {faulty} else ", switches::is_on(at + 1));
            }
            code += &format!("{} }}", &text[start..end]);
            switches::Site { bytes: start..end, code, faults: planted.iter().map(|at| at + 1).collect() }
        });
        let sites = sites.collect();
        switched.push(switches::File { path: path.strip_prefix(root)?.to_owned(), text, sites });
    }
    Ok(switched)
}

/// The row of a fault.
fn caught_by(fault: &Fault, verdict: Verdict) -> Caught {
    let tests = match verdict {
        Verdict::Failed(tests) => tests,
        Verdict::Passed => Vec::new(),
        Verdict::Broke(how) => vec![format!("the suite {how}")],
    };
    let mut families = BTreeMap::<&str, usize>::new();
    for test in &tests {
        let family = match test.rsplit_once("::") {
            Some((family, _)) if fault.tests.is_none() => family,
            // Unit tests have names of their own.
            _ => test.as_str(),
        };
        *families.entry(family).or_default() += 1;
    }
    let mut by: Vec<(String, usize)> = families.iter().map(|(&family, &count)| (family.to_owned(), count)).collect();
    by.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    by.truncate(NAMED);
    let (fault, function) = (fault.name.clone(), fault.function.clone());
    Caught { fault, function, tests: tests.len(), families: families.len(), by }
}

/// Writes the rows of all faults, after every one: a run that is interrupted loses nothing.
fn record(root: &Path, caught: &[Caught]) -> Result<()> {
    let rows = caught.iter().map(serde_json::to_string).collect::<Result<Vec<_>, _>>()?;
    fs::write(root.join(RECORD), format!("[\n{}\n]\n", rows.join(",\n")))?;
    fs::write(root.join("verification/faults.md"), page::page(caught))?;
    Ok(())
}

fn list(root: &Path) -> Result<Vec<Fault>> {
    let text = fs::read_to_string(root.join("verification/faults.toml"))?;
    Ok(toml::from_str::<List>(&text)?.fault)
}

impl Copy {
    /// Builds the copy with this fault alone, which no switch can hold, and runs the tests.
    fn apart(&self, root: &Path, fault: &Fault, place: &Place) -> Result<Verdict> {
        copy::program(root, &self.program)?;
        let mut text = fs::read_to_string(&place.file)?;
        text.replace_range(place.bytes.clone(), &fault.replace);
        copy::write(&self.program.join(place.file.strip_prefix(root)?), text.as_bytes())?;
        self.verdict(fault.tests.as_deref(), 0)
    }

    /// Builds the suite, or unit tests and tests of the library, and runs them with a fault switched on.
    fn verdict(&self, filter: Option<&str>, switch: usize) -> Result<Verdict> {
        let chosen: &[&str] = match filter {
            None => &["--package", "sprung-verification", "--test", "verification"],
            Some(_) => &["--package", "sprung", "--lib", "--test", "library"],
        };
        let build = Command::new("cargo")
            .args(["test", "--profile", "faults", "--no-run", "--message-format", "json"])
            .args(chosen)
            .arg("--target-dir")
            .arg(self.target.join("build"))
            .current_dir(&self.program)
            .stderr(Stdio::null())
            .output()?;
        ensure!(build.status.success(), "the program in {} does not compile", self.program.display());
        let messages = String::from_utf8(build.stdout)?;
        let messages = messages.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
        let mut failed = Vec::new();
        for message in messages.filter(|message| message["profile"]["test"] == true) {
            let Some(program) = message["executable"].as_str() else { continue };
            let mut command = Command::new(program);
            command
                .args(["--color", "never"])
                .args(filter.map(|filter| format!("{filter}::")))
                .env(SWITCH, switch.to_string())
                .current_dir(&self.program);
            match outcome(&mut command, &self.target.join("output.txt"))? {
                Verdict::Passed => {}
                Verdict::Failed(tests) => failed.extend(tests),
                broke @ Verdict::Broke(_) => return Ok(broke),
            }
        }
        Ok(if failed.is_empty() { Verdict::Passed } else { Verdict::Failed(failed) })
    }
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
            return Ok(Verdict::Broke("does not end"));
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let output = String::from_utf8_lossy(&fs::read(output)?).into_owned();
    let failed = output.lines().filter(|line| line.starts_with("test ") && line.ends_with("FAILED"));
    let tests: Vec<String> = failed.filter_map(|line| line.split_whitespace().nth(1).map(str::to_owned)).collect();
    Ok(match (status.success(), tests.is_empty()) {
        (true, _) => Verdict::Passed,
        (false, false) => Verdict::Failed(tests),
        (false, true) => Verdict::Broke("does not start"),
    })
}

#[cfg(test)]
mod tests {
    use super::{list, place::Source};

    /// The place of every fault exists.
    #[test]
    fn every_fault_has_its_place() {
        let root = crate::root().unwrap();
        let source = Source::read(&root.join("src")).unwrap();
        let faults = list(&root).unwrap();
        assert!(faults.len() > 100);
        let lost: Vec<String> = faults
            .iter()
            .filter_map(|fault| Some(format!("{}: {:#}", fault.name, source.find(&fault.function, &fault.find).err()?)))
            .collect();
        assert!(lost.is_empty(), "{} have lost their place:\n{}", lost.len(), lost.join("\n"));
        assert!(faults.iter().all(|fault| fault.find != fault.replace));
    }
}
