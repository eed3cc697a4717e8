//! Runs of the test programs with a mutant.

use super::{Result, switch};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Starts a program with 8 GB of addresses at most, as some mutants fill vectors without end, and with a limit on the time of the
/// processor that it takes: a busy machine makes nothing endless.
const LIMITED: &str = r#"ulimit -v 8000000; ulimit -t "$1"; shift; exec "$@""#;

/// The signal that a program gets at its limit.
const OVER_LIMIT: i32 = 24;

/// Tests that take longer are left out: a mutant that only they would catch counts as a survivor.
const LONGEST: Duration = Duration::from_secs(60);

/// Programs whose tests draw pages, look at a browser, or take long by themselves.
const LEFT_OUT: [&str; 5] = ["bunny", "pages", "view_browser", "study", "costs"];

/// A part of the tests: a program and the arguments that choose tests of it.
pub struct Part {
    pub name: String,
    program: PathBuf,
    arguments: Vec<String>,
    /// The time that it takes unchanged, and the functions that it enters.
    pub duration: Duration,
    pub entered: BTreeSet<usize>,
}

/// All tests of the copy.
pub struct Tests {
    pub parts: Vec<Part>,
    /// The function of every mutant behind a switch.
    pub functions: BTreeMap<usize, usize>,
    pub folder: PathBuf,
}

impl Tests {
    /// The parts that enter the function of a mutant: no other can see it.
    pub fn entering(&self, number: usize) -> Vec<&Part> {
        let function = self.functions.get(&number);
        self.parts.iter().filter(|part| function.is_none_or(|function| part.entered.contains(function))).collect()
    }
}

/// What became of a mutant.
#[derive(Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Fate {
    /// It does not compile.
    Unviable,
    /// A test of this program fails.
    Caught { by: String, test: String },
    /// The tests of this program do not end.
    Endless { in_program: String },
    /// All tests that enter its function pass.
    Survived,
    /// The most promising of them pass, the others were not tried.
    Alive,
}

/// The parts of a program, with the arguments that choose their tests: every test by itself; of the suite the scenes.
fn division(name: &str, program: &Path, folder: &Path) -> Result<Vec<(String, Vec<String>)>> {
    let words = |words: &[&str]| words.iter().map(ToString::to_string).collect();
    if name == "verification" {
        return Ok([
            ("verification", &["--skip", "bunny", "--skip", "large_cloth", "--skip", "convergence"][..]),
            ("verification of convergence", &["convergence", "--skip", "bunny", "--skip", "large_cloth"]),
        ]
        .map(|(name, arguments)| (name.to_owned(), words(arguments)))
        .to_vec());
    }
    let list = Command::new(program).args(["--list", "--format", "terse"]).current_dir(folder).output()?;
    let tests = String::from_utf8(list.stdout)?;
    let tests = tests.lines().filter_map(|line| line.strip_suffix(": test"));
    Ok(tests.map(|test| (format!("{name} {test}"), words(&["--exact", test]))).collect())
}

/// The tests in parts. Those that alone take longer than the time that a mutant is given are left out.
pub fn parts(programs: Vec<(String, PathBuf)>, folder: &Path, time: Option<Duration>) -> Result<Vec<Part>> {
    let longest = time.map_or(LONGEST, |time| time.min(LONGEST));
    let mut parts = Vec::new();
    for (program_name, program) in programs.into_iter().filter(|(name, _)| !LEFT_OUT.contains(&name.as_str())) {
        let all = Instant::now();
        for (name, arguments) in division(&program_name, &program, folder)? {
            let mut part =
                Part { name, program: program.clone(), arguments, duration: Duration::ZERO, entered: BTreeSet::new() };
            let entered = folder.with_file_name("entered");
            fs::write(&entered, "")?;
            let started = Instant::now();
            match part.run(0, folder, longest, Some(&entered))? {
                Fate::Survived => {}
                Fate::Endless { .. } => {
                    println!("left out, as it takes long: {}", part.name);
                    continue;
                }
                _ => {
                    println!("left out, as it fails without a mutant: {}", part.name);
                    continue;
                }
            }
            part.duration = started.elapsed();
            part.entered = fs::read_to_string(&entered)?.lines().filter_map(|line| line.parse().ok()).collect();
            if part.duration < longest {
                parts.push(part);
            } else {
                println!("left out, as it takes long: {}", part.name);
            }
        }
        println!("{:6.2} s  {program_name}", all.elapsed().as_secs_f64());
    }
    Ok(parts)
}

/// How many of the parts, from the first on, take no longer than this together.
pub fn within(parts: &[&Part], duration: Duration) -> usize {
    let mut sum = Duration::ZERO;
    let sums = parts.iter().map(|part| {
        sum += part.duration;
        sum
    });
    sums.take_while(|&sum| sum <= duration).count()
}

/// Runs parts until one fails.
pub fn fate<'p>(parts: impl IntoIterator<Item = &'p Part>, number: usize, folder: &Path) -> Result<Fate> {
    for part in parts {
        let fate = part.run(number, folder, part.duration * 6 + Duration::from_secs(3), None)?;
        if fate != Fate::Survived {
            return Ok(fate);
        }
    }
    Ok(Fate::Survived)
}

impl Part {
    /// Runs the tests of this part until one fails or has taken so much time of the processor, or waited twenty times as long.
    /// A file, if given, gets the functions entered.
    fn run(&self, number: usize, folder: &Path, patience: Duration, entered: Option<&Path>) -> Result<Fate> {
        let mut command = Command::new("sh");
        command
            .args(["-c", LIMITED, "sh", &patience.as_secs().to_string()])
            .arg(&self.program)
            .args(&self.arguments)
            .args(["--color", "never", "--test-threads", "1"])
            .env(switch::VARIABLE, number.to_string())
            // The same cases as without a mutant, and none that another mutant has left behind.
            .env("PROPTEST_RNG_SEED", "1")
            .env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true")
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .process_group(0);
        if let Some(entered) = entered {
            command.env(switch::ENTERED, entered);
        }
        let mut child = command.spawn()?;
        let output = child.stdout.take().ok_or("no output")?;
        let (ended, late) = (AtomicBool::new(false), AtomicBool::new(false));
        let (failed, last) = std::thread::scope(|scope| {
            // Ends the program when its time is over, which closes the output that is read below.
            let child = &mut child;
            let watch = scope.spawn(|| watch(child, patience * 20, &ended, &late));
            let (mut failed, mut last) = (None, String::new());
            for line in BufReader::new(output).lines().map_while(std::result::Result::ok) {
                let words: Vec<&str> = line.split_whitespace().collect();
                if let ["test", name, ..] = words[..] {
                    last = name.to_owned();
                    if line.ends_with("FAILED") {
                        failed = Some(name.to_owned());
                        break;
                    }
                }
            }
            ended.store(failed.is_some(), Ordering::Relaxed);
            let _ = watch.join();
            (failed, last)
        });
        let status = child.wait()?;
        Ok(match failed {
            Some(test) => Fate::Caught { by: self.name.clone(), test },
            None if late.into_inner() || status.signal() == Some(OVER_LIMIT) => {
                Fate::Endless { in_program: self.name.clone() }
            }
            None if status.success() => Fate::Survived,
            // Not every way to fail leaves a line: an overflow of the stack or the memory ends the program.
            None => Fate::Caught { by: self.name.clone(), test: format!("the program ended after {last}") },
        })
    }
}

/// Waits for a program to end; kills it when it may, or when its time is over.
fn watch(child: &mut Child, patience: Duration, ended: &AtomicBool, late: &AtomicBool) {
    let started = Instant::now();
    while !matches!(child.try_wait(), Ok(Some(_))) {
        let over = started.elapsed() > patience;
        late.store(over, Ordering::Relaxed);
        if over || ended.load(Ordering::Relaxed) {
            // The whole group: programs that a test has started would go on for ever without it.
            let _ = Command::new("kill").args(["-9", "--", &format!("-{}", child.id())]).status();
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
