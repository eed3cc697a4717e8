//! Runs of the test programs with a mutant.

use super::{Result, switch};
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Parts that take longer come last, when all mutants have been tried with the others.
const LONG: Duration = Duration::from_millis(700);

/// Starts a program with 8 GB of addresses at most: some mutants fill vectors without end.
const LIMITED: &str = r#"ulimit -v 8000000; exec "$0" "$@""#;

/// Tests of whole scenes and other rooms that take long: a mutant that only they would catch counts as a survivor.
const LEFT_OUT: [&str; 4] = ["bunny", "chart", "culprits", "verify_jacobian"];

/// A part of the tests: a program and the arguments that choose tests of it, and the time that it takes unchanged.
pub struct Part {
    pub name: String,
    program: PathBuf,
    arguments: &'static [&'static str],
    duration: Duration,
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
    /// All tests pass.
    Survived,
}

/// The tests in parts, quick ones first, so that most mutants are caught in no time.
pub fn parts(programs: Vec<(String, PathBuf)>, folder: &Path) -> Result<Vec<Part>> {
    let mut parts = Vec::new();
    for (name, program) in programs.into_iter().filter(|(name, _)| !LEFT_OUT.contains(&name.as_str())) {
        let suite: [&'static [&'static str]; 4] = [
            &["--skip", "bunny", "--skip", "large_cloth", "--skip", "convergence"],
            &["convergence", "--skip", "bunny", "--skip", "large_cloth"],
            &["bunny"],
            &["large_cloth"],
        ];
        let whole: [&'static [&'static str]; 1] = [&[]];
        for arguments in if name == "verification" { suite.iter() } else { whole.iter() } {
            let mut part = Part { name: name.clone(), program: program.clone(), arguments, duration: Duration::ZERO };
            let started = Instant::now();
            let fate = part.run(0, folder, Duration::from_secs(600))?;
            if fate != Fate::Survived {
                return Err(format!("{name} fails without a mutant").into());
            }
            part.duration = started.elapsed();
            println!("{:6.2} s  {name} {}", part.duration.as_secs_f64(), arguments.join(" "));
            parts.push(part);
        }
    }
    // The first part, small scenes of the suite, catches most.
    if let Some((_, others)) = parts.split_first_mut() {
        others.sort_by_key(|part| part.duration);
    }
    Ok(parts)
}

/// Runs parts until one fails.
pub fn fate<'p>(parts: impl IntoIterator<Item = &'p Part>, number: usize, folder: &Path) -> Result<Fate> {
    for part in parts {
        let fate = part.run(number, folder, part.duration * 3 + Duration::from_secs(5))?;
        if fate != Fate::Survived {
            return Ok(fate);
        }
    }
    Ok(Fate::Survived)
}

impl Part {
    /// Whether it takes longer than `LONG`.
    pub fn is_long(&self) -> bool {
        self.duration > LONG
    }

    /// Runs the tests of this part until one fails or the patience ends.
    fn run(&self, number: usize, folder: &Path, patience: Duration) -> Result<Fate> {
        let mut child = Command::new("sh")
            .args(["-c", LIMITED])
            .arg(&self.program)
            .args(self.arguments)
            .args(["--color", "never", "--test-threads", "1"])
            .env(switch::VARIABLE, number.to_string())
            // The same cases as without a mutant, and none that another mutant has left behind.
            .env("PROPTEST_RNG_SEED", "1")
            .env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true")
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn()?;
        let output = child.stdout.take().ok_or("no output")?;
        let (ended, late) = (AtomicBool::new(false), AtomicBool::new(false));
        let (failed, last) = std::thread::scope(|scope| {
            // Ends the program when its time is over, which closes the output that is read below.
            let child = &mut child;
            let watch = scope.spawn(|| watch(child, patience, &ended, &late));
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
            None if late.into_inner() => Fate::Endless { in_program: self.name.clone() },
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
