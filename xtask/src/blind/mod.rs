//! Random faults in every module, chosen without a look at its tests.
//!
//! Every test runs once without a fault and notes the switches that it passes; a fault then needs only the tests that reach it.

mod sites;
mod tests;

use crate::cycles::{collect, module};
use crate::faults::copy;
use crate::switches;
use anyhow::{Context, Result};
use clap::Args;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;
use sites::{Change, Site};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

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
    copy::dependencies(root, &target.join("build"))?;
    let files = chosen(root, choice)?;
    let mut faults = faults(&files);
    let wrong = switches::plant(root, &program, &target.join("build"), switched(files))?;
    println!("{} of {} faults are no valid code and left out", wrong.len(), faults.len());
    faults.retain(|fault| !wrong.contains(&fault.number));
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

/// The files with their faults behind switches.
fn switched(files: Vec<File>) -> Vec<switches::File> {
    let mut number = 0;
    let mut sites = |file: &File| {
        let sites = file.sites.iter().map(|site| {
            number += 1;
            let (is_on, right) = (switches::is_on(number), &file.text[site.bytes.clone()]);
            let code = match &site.change {
                Change::Expression(wrong) => format!("(if {is_on} {{ {wrong} }} else {{ {right} }})"),
                Change::Removed => format!("if !{is_on} {{ {right} }}"),
            };
            switches::Site { bytes: site.bytes.clone(), code, faults: vec![number] }
        });
        sites.collect()
    };
    files.into_iter().map(|file| switches::File { sites: sites(&file), path: file.path, text: file.text }).collect()
}

/// The faults, numbered as behind their switches.
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
