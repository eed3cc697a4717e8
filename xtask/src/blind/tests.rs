//! The tests of the copy, and those that a fault needs.

use super::Fault;
use crate::switches::{REACHED, SWITCH};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A test may take so many times as long as without a fault, and [`LEAST`] more.
const SLOWER: u32 = 10;
const LEAST: Duration = Duration::from_secs(10);

/// The outcome of a fault, with the test that failed or the number of tests that passed.
pub enum Verdict {
    Own(String),
    Other(String),
    Survived(usize),
}

/// A test, and what it does without a fault.
struct Test {
    executable: PathBuf,
    name: String,
    /// A unit test of the library.
    is_unit: bool,
    time: Duration,
    /// The faults that it reaches.
    reached: BTreeSet<usize>,
}

/// Compiled tests, the quick ones first.
pub struct Tests {
    program: PathBuf,
    tests: Vec<Test>,
}

impl Tests {
    /// Compiles all tests of the copy and runs each without a fault.
    pub fn new(program: &Path, target: &Path, threads: usize, faults: usize) -> Result<Self> {
        let build = Command::new("cargo")
            .args(["test", "--profile", "faults", "--no-run", "--message-format", "json"])
            .args(["--package", "sprung", "--package", "sprung-verification"])
            .arg("--target-dir")
            .arg(target)
            .current_dir(program)
            .stderr(Stdio::null())
            .output()?;
        ensure!(build.status.success(), "the tests in {} do not compile", program.display());
        let messages = String::from_utf8(build.stdout)?;
        let messages = messages.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let mut names = Vec::new();
        for message in messages.filter(|message| message["profile"]["test"] == true) {
            let (Some(executable), Some(target)) = (message["executable"].as_str(), message["target"]["name"].as_str())
            else {
                continue;
            };
            // The pages need a browser; noting a switch allocates.
            if ["pages", "allocations"].contains(&target) {
                continue;
            }
            let is_unit = message["target"]["kind"][0] == "lib";
            let list = Command::new(executable).args(["--list", "--format", "terse"]).current_dir(program).output()?;
            let list = String::from_utf8(list.stdout)?;
            names.extend(
                list.lines()
                    .filter_map(|line| line.strip_suffix(": test"))
                    .map(|name| (PathBuf::from(executable), name.to_owned(), is_unit)),
            );
        }
        let folder = target.join("reached");
        fs::create_dir_all(&folder)?;
        let measured = each(&names, threads, |index, (executable, name, is_unit)| {
            let file = folder.join(index.to_string());
            fs::write(&file, "")?;
            let started = Instant::now();
            let mut command = command(executable, name, program);
            if !passes(command.env(REACHED, &file), Duration::MAX)? {
                println!("{name} fails without a fault and is left out");
                return Ok(None);
            }
            let reached = fs::read_to_string(file)?.lines().filter_map(|line| line.parse().ok()).collect();
            let (executable, name) = (executable.clone(), name.clone());
            Ok(Some(Test { executable, name, is_unit: *is_unit, time: started.elapsed(), reached }))
        })?;
        let mut tests: Vec<Test> = measured.into_iter().flatten().collect();
        tests.sort_by_key(|test| test.time);
        let reached: BTreeSet<usize> = tests.iter().flat_map(|test| &test.reached).copied().collect();
        let time: Duration = tests.iter().map(|test| test.time).sum();
        println!("{} tests of {} s reach {} of {faults} faults", tests.len(), time.as_secs(), reached.len());
        Ok(Self { program: program.to_owned(), tests })
    }

    /// Switches each fault on and runs the tests that reach it.
    pub fn all(&self, faults: &[Fault], threads: usize, limit: Duration) -> Result<Vec<Verdict>> {
        each(faults, threads, |_, fault| {
            let verdict = self.verdict(fault, limit)?;
            let said = match &verdict {
                Verdict::Own(test) | Verdict::Other(test) => test.clone(),
                Verdict::Survived(tests) => format!("SURVIVED {tests} tests"),
            };
            println!("{:>4} of {} {}: {}: {said}", fault.number, faults.len(), fault.function, fault.change);
            Ok(verdict)
        })
    }

    /// The first test that fails with a fault: unit tests of its module before all others, quick ones first.
    fn verdict(&self, fault: &Fault, limit: Duration) -> Result<Verdict> {
        let is_own = |test: &&Test| test.is_unit && test.name.starts_with(&format!("{}::", fault.module));
        let reaching = || self.tests.iter().filter(|test| test.reached.contains(&fault.number));
        let started = Instant::now();
        let mut passed = 0;
        for test in reaching().filter(is_own).chain(reaching().filter(|test| !is_own(test))) {
            let mut command = command(&test.executable, &test.name, &self.program);
            if !passes(command.env(SWITCH, fault.number.to_string()), LEAST + SLOWER * test.time)? {
                let name = test.name.clone();
                return Ok(if is_own(&test) { Verdict::Own(name) } else { Verdict::Other(name) });
            }
            passed += 1;
            if started.elapsed() > limit {
                break;
            }
        }
        Ok(Verdict::Survived(passed))
    }
}

fn command(executable: &Path, name: &str, folder: &Path) -> Command {
    let mut command = Command::new(executable);
    command.args(["--exact", name, "--test-threads", "1"]).env("INSTA_UPDATE", "no").current_dir(folder);
    // Commands that a test starts end with it.
    command.stdout(Stdio::null()).stderr(Stdio::null());
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command
}

/// Does a program end well within a time?
fn passes(command: &mut Command, limit: Duration) -> Result<bool> {
    let mut child = command.spawn()?;
    let started = Instant::now();
    let mut pause = Duration::from_millis(1);
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.success());
        }
        if started.elapsed() > limit {
            if cfg!(unix) {
                Command::new("kill").args(["-KILL", "--", &format!("-{}", child.id())]).status()?;
            }
            // It may have ended by now.
            child.kill().ok();
            child.wait()?;
            return Ok(false);
        }
        std::thread::sleep(pause);
        pause = (2 * pause).min(Duration::from_millis(50));
    }
}

/// Results for all items in their order, on several threads.
fn each<T: Sync, R: Send>(items: &[T], threads: usize, of: impl Fn(usize, &T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(index) else { break };
                    let result = of(index, item);
                    if let Ok(mut results) = results.lock() {
                        results.push((index, result));
                    }
                }
            });
        }
    });
    let mut results = results.into_inner().ok().context("a thread panicked")?;
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}
