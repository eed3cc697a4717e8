//! Faults behind switches: all are compiled into one copy of the program, and an environment variable turns one on (mutant schemata: R. H. Untch,
//! A. J. Offutt, M. J. Harrold, Mutation analysis using mutant schemata, ISSTA 1993). So all faults together cost one build.

use crate::faults::copy;
use anyhow::{Result, ensure};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The environment variable with the number of the fault that is switched on.
pub const SWITCH: &str = "SPRUNG_FAULT";
/// The environment variable with the file that passed switches are noted in.
pub const REACHED: &str = "SPRUNG_FAULTS_REACHED";

/// A part of a file, and code with faults that takes its place.
pub struct Site {
    pub bytes: Range<usize>,
    /// The same code as before unless one of the faults is switched on.
    pub code: String,
    /// The numbers of the faults.
    pub faults: Vec<usize>,
}

/// A file with its sites, in order and disjoint.
pub struct File {
    /// Relative to the root.
    pub path: PathBuf,
    pub text: String,
    pub sites: Vec<Site>,
}

/// The condition that a fault is switched on.
pub fn is_on(number: usize) -> String {
    format!("crate::planted({number})")
}

/// Puts all faults into a copy of the program, except those that do not compile. Returns the numbers of the latter.
///
/// # Errors
/// A program that does not compile without them either.
pub fn plant(root: &Path, program: &Path, target: &Path, mut files: Vec<File>) -> Result<BTreeSet<usize>> {
    copy::program(root, program)?;
    let mut wrong = BTreeSet::new();
    loop {
        let places = write(root, program, &files)?;
        let errors = errors(program, target, &places)?;
        if errors.is_empty() {
            return Ok(wrong);
        }
        for file in &mut files {
            file.sites.retain(|site| site.faults.iter().all(|number| !errors.contains(number)));
        }
        wrong.extend(errors);
    }
}

/// A site in the copy.
struct Place {
    faults: Vec<usize>,
    file: PathBuf,
    bytes: Range<usize>,
}

/// Writes the files with all faults behind their switches.
fn write(root: &Path, program: &Path, files: &[File]) -> Result<Vec<Place>> {
    let mut places = Vec::new();
    for file in files {
        let mut faulty = String::new();
        let mut end = 0;
        for site in &file.sites {
            faulty += &file.text[end..site.bytes.start];
            let start = faulty.len();
            faulty += &site.code;
            places.push(Place { faults: site.faults.clone(), file: file.path.clone(), bytes: start..faulty.len() });
            end = site.bytes.end;
        }
        faulty += &file.text[end..];
        copy::write(&program.join(&file.path), faulty.as_bytes())?;
    }
    let count = places.iter().flat_map(|place| &place.faults).max().map_or(1, |last| last + 1);
    let switch = include_str!("switch.rs").replace("COUNT", &count.to_string());
    let switch = switch.replace("SWITCH", SWITCH).replace("REACHED", REACHED);
    let crate_root = fs::read_to_string(root.join("src/lib.rs"))?;
    let switch = format!("#![allow(warnings)]\n{crate_root}\n{switch}");
    copy::write(&program.join("src/lib.rs"), switch.as_bytes())?;
    Ok(places)
}

/// Faults that do not compile.
fn errors(program: &Path, target: &Path, places: &[Place]) -> Result<BTreeSet<usize>> {
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
        let overlaps = |place: &&Place| {
            spans.iter().any(|span| {
                let (start, end) = (span["byte_start"].as_u64().unwrap_or(0), span["byte_end"].as_u64().unwrap_or(0));
                span["file_name"].as_str().is_some_and(|name| Path::new(name) == place.file)
                    && (start as usize) < place.bytes.end
                    && place.bytes.start < end as usize
            })
        };
        let found: Vec<usize> = places.iter().filter(overlaps).flat_map(|place| &place.faults).copied().collect();
        if found.is_empty() && !spans.is_empty() {
            others.push(message["rendered"].to_string());
        }
        wrong.extend(found);
    }
    let name = program.display();
    ensure!(
        check.status.success() || !wrong.is_empty(),
        "the program in {name} does not compile: {}",
        others.join("\n")
    );
    Ok(wrong)
}
