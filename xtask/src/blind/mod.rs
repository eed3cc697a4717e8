//! Random faults in every module, chosen without a look at its tests.
//!
//! All are compiled into one copy of the program, each behind a switch, and an environment variable turns one on (mutant schemata: R. H. Untch,
//! A. J. Offutt, M. J. Harrold, Mutation analysis using mutant schemata, ISSTA 1993). So all faults together cost one build. Every test runs once without
//! a fault and notes the switches that it passes; a fault then needs only the tests that reach it.

mod sites;
mod tests;

use crate::cycles::{collect, module};
use crate::faults::copy;
use anyhow::{Context, Result, ensure};
use clap::Args;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use sites::{Change, Site};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// The environment variable that switches a fault on.
const SWITCH: &str = "SPRUNG_FAULT";
/// The environment variable with the file that passed switches are noted in.
const REACHED: &str = "SPRUNG_FAULTS_REACHED";

/// At most so many faults of one function.
const PER_FUNCTION: usize = 2;

/// The random faults.
#[derive(Debug, Clone, Args)]
pub struct Choice {
    /// Seed of the random choice
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of faults in each module
    #[arg(long, default_value_t = 20)]
    per_module: usize,
    /// Only these modules
    #[arg(long, value_delimiter = ',')]
    modules: Vec<String>,
    /// Faults tested at a time
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Seconds of tests for each fault
    #[arg(long, default_value_t = 120)]
    seconds: u64,
    /// Only prints the faults
    #[arg(long)]
    list: bool,
}

/// A file of the program with its faults.
struct File {
    /// Relative to the root.
    path: PathBuf,
    text: String,
    sites: Vec<Site>,
}

/// A fault in the copy.
struct Fault {
    number: usize,
    module: String,
    function: String,
    /// The code and its replacement, on one line.
    change: String,
}

/// Plants random faults and prints which tests detect each. Tests that fail without a fault are left out.
///
/// # Errors
/// A program that does not compile.
pub fn run(root: &Path, choice: &Choice) -> Result<()> {
    let target = copy::target(root).join("faults-planted");
    let program = target.join("blind");
    copy::program(root, &program)?;
    copy::dependencies(root, &target.join("build"))?;
    let mut files = chosen(root, choice)?;
    loop {
        let places = plant(root, &program, &files)?;
        let wrong = errors(&program, &target.join("build"), &places)?;
        if wrong.is_empty() {
            break;
        }
        println!("{} faults are no valid code and left out", wrong.len());
        let mut number = 0;
        for file in &mut files {
            file.sites.retain(|_| {
                number += 1;
                !wrong.contains(&number)
            });
        }
    }
    let faults = faults(&files);
    if choice.list {
        for fault in &faults {
            println!("{:>4} {}: {}", fault.number, fault.function, fault.change);
        }
        return Ok(());
    }
    let tests = tests::Tests::new(&program, &target.join("build"), choice.threads, faults.len())?;
    let verdicts = tests.all(&faults, choice.threads, Duration::from_secs(choice.seconds))?;
    print(&faults, &verdicts);
    Ok(())
}

/// Faults of every module in random order, so many of each, none within another.
fn chosen(root: &Path, choice: &Choice) -> Result<Vec<File>> {
    let mut paths = Vec::new();
    collect(&root.join("src"), &mut paths)?;
    paths.sort();
    let mut files = Vec::new();
    let mut modules = BTreeMap::<String, Vec<(usize, Site)>>::new();
    for path in paths {
        let text = fs::read_to_string(&path)?;
        let parts = module(path.strip_prefix(root.join("src"))?);
        let Some(top) = parts.first() else { continue };
        if choice.modules.is_empty() || choice.modules.contains(top) {
            let found = sites::find(&text, &parts).with_context(|| path.display().to_string())?;
            modules.entry(top.clone()).or_default().extend(found.into_iter().map(|site| (files.len(), site)));
            files.push(File { path: path.strip_prefix(root)?.to_owned(), text, sites: Vec::new() });
        }
    }
    for (name, mut candidates) in modules {
        // A module's faults do not depend on those of the others.
        let salt = name.bytes().fold(choice.seed, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte)));
        candidates.shuffle(&mut ChaCha8Rng::seed_from_u64(salt));
        let mut functions = BTreeMap::<String, usize>::new();
        let mut taken = 0;
        for (file, site) in candidates {
            let sites = &mut files[file].sites;
            let is_free =
                sites.iter().all(|other| other.bytes.end <= site.bytes.start || site.bytes.end <= other.bytes.start);
            let count = functions.entry(site.function.clone()).or_default();
            if taken < choice.per_module && is_free && *count < PER_FUNCTION {
                *count += 1;
                taken += 1;
                sites.push(site);
            }
        }
    }
    for file in &mut files {
        file.sites.sort_by_key(|site| site.bytes.start);
    }
    Ok(files)
}

/// Writes the files with all faults behind their switches, and returns the place of each fault: number, file, bytes.
fn plant(root: &Path, program: &Path, files: &[File]) -> Result<Vec<(usize, PathBuf, std::ops::Range<usize>)>> {
    let mut places = Vec::new();
    let mut number = 0;
    for file in files {
        let mut faulty = String::new();
        let mut end = 0;
        for site in &file.sites {
            number += 1;
            faulty += &file.text[end..site.bytes.start];
            let right = &file.text[site.bytes.clone()];
            let start = faulty.len();
            faulty += &match &site.change {
                Change::Expression(wrong) => format!("(if crate::planted({number}) {{ {wrong} }} else {{ {right} }})"),
                Change::Removed => format!("if !crate::planted({number}) {{ {right} }}"),
            };
            places.push((number, file.path.clone(), start..faulty.len()));
            end = site.bytes.end;
        }
        faulty += &file.text[end..];
        copy::write(&program.join(&file.path), faulty.as_bytes())?;
    }
    let crate_root = fs::read_to_string(root.join("src/lib.rs"))?;
    let switch = include_str!("switch.rs").replace("COUNT", &(number + 1).to_string());
    let switch = switch.replace("SWITCH", SWITCH).replace("REACHED", REACHED);
    let switch = format!("#![allow(warnings)]\n{crate_root}\n{switch}");
    copy::write(&program.join("src/lib.rs"), switch.as_bytes())?;
    Ok(places)
}

/// Faults that do not compile.
fn errors(
    program: &Path,
    target: &Path,
    places: &[(usize, PathBuf, std::ops::Range<usize>)],
) -> Result<BTreeSet<usize>> {
    let check = Command::new("cargo")
        .args(["check", "--profile", "faults", "--package", "sprung", "--all-features", "--message-format", "json"])
        .arg("--target-dir")
        .arg(target)
        .current_dir(program)
        .stderr(Stdio::null())
        .output()?;
    let mut wrong = BTreeSet::new();
    let mut others = Vec::new();
    let text = String::from_utf8(check.stdout)?;
    for message in text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
        let message = &message["message"];
        if message["level"] != "error" {
            continue;
        }
        let spans = message["spans"].as_array().map_or(&[][..], Vec::as_slice);
        let overlaps = |place: &&(usize, PathBuf, std::ops::Range<usize>)| {
            spans.iter().any(|span| {
                let (start, end) = (span["byte_start"].as_u64().unwrap_or(0), span["byte_end"].as_u64().unwrap_or(0));
                span["file_name"].as_str().is_some_and(|name| Path::new(name) == place.1)
                    && (start as usize) < place.2.end
                    && place.2.start < end as usize
            })
        };
        let found: Vec<usize> = places.iter().filter(overlaps).map(|place| place.0).collect();
        if found.is_empty() && !spans.is_empty() {
            others.push(message["rendered"].to_string());
        }
        wrong.extend(found);
    }
    ensure!(
        check.status.success() || !wrong.is_empty(),
        "the program in {} does not compile: {}",
        program.display(),
        others.join("\n")
    );
    Ok(wrong)
}

/// The faults, numbered as in the copy.
fn faults(files: &[File]) -> Vec<Fault> {
    let one_line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let sites = files.iter().flat_map(|file| file.sites.iter().map(move |site| (file, site)));
    sites
        .enumerate()
        .map(|(index, (file, site))| Fault {
            number: index + 1,
            module: site.function.split("::").next().unwrap_or_default().to_owned(),
            function: site.function.clone(),
            change: match &site.change {
                Change::Expression(wrong) => {
                    format!("`{}` → `{}`", one_line(&file.text[site.bytes.clone()]), one_line(wrong))
                }
                Change::Removed => format!("without `{}`", one_line(&file.text[site.bytes.clone()])),
            },
        })
        .collect()
}

/// Prints the counts of every module and the faults that survived.
fn print(faults: &[Fault], verdicts: &[tests::Verdict]) {
    let mut modules = BTreeMap::<&str, [usize; 3]>::new();
    for (fault, verdict) in faults.iter().zip(verdicts) {
        let counts = modules.entry(&fault.module).or_default();
        counts[0] += 1;
        match verdict {
            tests::Verdict::Own(_) => counts[1] += 1,
            tests::Verdict::Other(_) => counts[2] += 1,
            tests::Verdict::Survived(_) => {}
        }
    }
    println!(
        "| module | faults | detected by its own unit tests | by other tests | not detected |\n|---|---|---|---|---|"
    );
    for (module, [all, own, other]) in &modules {
        println!("| {module} | {all} | {own} | {other} | {} |", all - own - other);
    }
    let sum = |at: usize| modules.values().map(|counts| counts[at]).sum::<usize>();
    println!("| all | {} | {} | {} | {} |\n", sum(0), sum(1), sum(2), sum(0) - sum(1) - sum(2));
    for (fault, verdict) in faults.iter().zip(verdicts) {
        if let tests::Verdict::Survived(tests) = verdict {
            println!("- {} ({tests} tests): {}", fault.function, fault.change);
        }
    }
}
