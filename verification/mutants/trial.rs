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
/// processor that it takes: a busy machine makes nothing endless. A soft limit: at a hard one the signal is that of any kill.
const LIMITED: &str = r#"ulimit -v 8000000; ulimit -S -t "$1"; shift; exec "$@""#;

/// The signal that a program gets at its limit.
const OVER_LIMIT: i32 = 24;

/// Tests that take longer are left out: a mutant that only they would catch counts as a survivor.
const LONGEST: Duration = Duration::from_secs(60);

/// What it takes to start a program and to read what it says.
pub const START: Duration = Duration::from_millis(20);

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
            let (started, before) = (Instant::now(), taken());
            match run(&[&part], 0, folder, Some((longest, &entered)))? {
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
            // What else the machine does makes no test longer.
            part.duration = taken().zip(before).map_or_else(|| started.elapsed(), |(after, before)| after - before);
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

/// Runs parts until one fails, as many in one process as take no longer than all before, or than to start it: so starting is
/// not most of the time, and no more than half of it is spent on tests that follow one that fails.
pub fn fate(mut parts: &[&Part], number: usize, folder: &Path) -> Result<Fate> {
    let mut spent = START;
    while let Some((first, others)) = parts.split_first() {
        let mut duration = first.duration;
        let goes_with_first = |part: &&&Part| {
            duration += part.duration;
            duration <= spent && first.is_with(part)
        };
        let (now, later) = parts.split_at(1 + others.iter().take_while(goes_with_first).count());
        let fate = run(now, number, folder, None)?;
        if fate != Fate::Survived {
            return Ok(fate);
        }
        spent += now.iter().map(|part| part.duration).sum();
        parts = later;
    }
    Ok(Fate::Survived)
}

/// The time of the processor that the programs took that have ended, where the system tells it.
fn taken() -> Option<Duration> {
    // After the name, which may hold blanks: the state is the first, and the times of children the fourteenth and fifteenth, in
    // hundredths of a second.
    let statistics = fs::read_to_string("/proc/self/stat").ok()?;
    let fields = statistics.rsplit(')').next()?.split_whitespace();
    let ticks: Vec<u64> = fields.skip(13).take(2).map_while(|field| field.parse().ok()).collect();
    (ticks.len() == 2).then(|| Duration::from_millis(10 * ticks.iter().sum::<u64>()))
}

impl Part {
    /// Whether a process can run the tests of both: then both are chosen by their whole names.
    fn is_with(&self, other: &Self) -> bool {
        let by_name = |part: &Self| part.arguments.first().is_some_and(|word| word == "--exact");
        self.program == other.program && by_name(self) && by_name(other)
    }

    fn holds(&self, test: &str) -> bool {
        self.arguments.iter().any(|word| word == test)
    }
}

/// Runs the tests of parts that go into one process until one fails or all have taken so much time of the processor, or waited
/// twenty times as long and is stuck. While tests are measured it is given how long, and a file that gets the functions entered.
fn run(parts: &[&Part], number: usize, folder: &Path, measured: Option<(Duration, &Path)>) -> Result<Fate> {
    let first = parts.first().ok_or("no tests")?;
    let duration: Duration = parts.iter().map(|part| part.duration).sum();
    let patience = measured.map_or(duration * 6 + Duration::from_secs(1), |(longest, _)| longest);
    let mut command = Command::new("sh");
    command
        .args(["-c", LIMITED, "sh", &patience.as_secs_f64().ceil().to_string()])
        .arg(&first.program)
        .args(&first.arguments)
        // Without the first word, which the arguments of all begin with.
        .args(parts.iter().skip(1).flat_map(|part| part.arguments.iter().skip(1)))
        .args(["--color", "never", "--test-threads", "1"])
        .env(switch::VARIABLE, number.to_string())
        // The same cases as without a mutant, and none that another mutant has left behind.
        .env("PROPTEST_RNG_SEED", "1")
        .env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true")
        .current_dir(folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .process_group(0);
    if let Some((_, entered)) = measured {
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
    let name = |test: &str| parts.iter().find(|part| part.holds(test)).unwrap_or(first).name.clone();
    Ok(match failed {
        Some(test) => Fate::Caught { by: name(&test), test },
        None if late.into_inner() || status.signal() == Some(OVER_LIMIT) => Fate::Endless { in_program: name(&last) },
        None if status.success() => Fate::Survived,
        // Not every way to fail leaves a line: an overflow of the stack or the memory ends the program.
        None => Fate::Caught { by: name(&last), test: format!("the program ended after {last}") },
    })
}

/// After how long without any progress a program that is late waits for something that never comes.
const STUCK: Duration = Duration::from_secs(60);

/// Waits for a program to end; kills it when it may, or when its time is over and it is stuck: on a busy machine a test may be late by
/// any factor, and still gets on.
fn watch(child: &mut Child, patience: Duration, ended: &AtomicBool, late: &AtomicBool) {
    let started = Instant::now();
    let (mut ticks, mut moved) = (None, started);
    while !matches!(child.try_wait(), Ok(Some(_))) {
        if started.elapsed() > patience && moved.elapsed() > STUCK / 60 {
            let now = used(child.id());
            let is_stuck = now == ticks && moved.elapsed() > STUCK;
            late.store(is_stuck, Ordering::Relaxed);
            if now != ticks {
                (ticks, moved) = (now, Instant::now());
            }
        }
        if late.load(Ordering::Relaxed) || ended.load(Ordering::Relaxed) {
            // The whole group: programs that a test has started would go on for ever without it.
            let _ = Command::new("kill").args(["-9", "--", &format!("-{}", child.id())]).status();
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The time of the processor that a program has used, in a system's unit, where the system tells it.
fn used(process: u32) -> Option<u64> {
    // After the name, which may hold blanks: the state is the first, and its times the twelfth and thirteenth.
    let statistics = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let fields = statistics.rsplit(')').next()?.split_whitespace();
    fields.skip(11).take(2).map(|field| field.parse::<u64>().ok()).sum()
}
