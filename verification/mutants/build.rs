//! Builds of the changed copy: which mutants compile, and the test programs.

use super::Result;
use super::listed::Mutant;
use super::switch::{self, Switched};
use crate::copy;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{fs, mem};

/// Where lints stand in the manifest.
const LINTS: &str = "[lints.rust]\nunsafe_code = \"forbid\"\nmissing_docs = \"deny\"\n";

/// A folder with a copy of the program, to be changed.
pub struct Copy {
    /// Another copy, which stays as the program was when the run began: the program itself may be worked on meanwhile.
    original: PathBuf,
    pub folder: PathBuf,
    /// Of the compiler, for the library and the tests.
    level: &'static str,
}

impl Copy {
    pub fn new(root: &Path, name: &str, optimised: bool) -> Result<Self> {
        let beside = copy::target(root).join(name);
        // A function with a hundred bodies takes an optimiser for ever.
        let level = if optimised { "1" } else { "0" };
        let copy = Self { original: beside.join("original"), folder: beside.join("program"), level };
        copy::program(root, &copy.original)?;
        copy.restore()?;
        copy::dependencies(root, &copy.folder.with_file_name("build"))?;
        Ok(copy)
    }

    fn restore(&self) -> Result<()> {
        Ok(copy::program(&self.original, &self.folder)?)
    }

    /// Gives the copy the chosen mutants but those left out, behind switches, and the lines that they take in each file.
    fn switch(
        &self,
        mutants: &[Mutant],
        chosen: &BTreeSet<usize>,
        left_out: &BTreeSet<usize>,
    ) -> Result<BTreeMap<String, Switched>> {
        let mut files = BTreeMap::<&str, Vec<(usize, &Mutant)>>::new();
        for (number, mutant) in numbered(mutants).filter(|(number, _)| chosen.contains(number)) {
            let within = files.entry(&mutant.file).or_default();
            if mutant.function.is_some() && !left_out.contains(&number) {
                within.push((number, mutant));
            }
        }
        let mut written = BTreeMap::new();
        for (file, within) in files {
            let source = fs::read_to_string(self.original.join(file))?;
            let switched = switch::switched(&source, &within).ok_or_else(|| format!("{file}: cannot be switched"))?;
            copy::write(&self.folder.join(file), switched.source.as_bytes())?;
            written.insert(file.to_owned(), switched);
        }
        let library = fs::read_to_string(self.original.join("src/lib.rs"))? + switch::LIBRARY;
        copy::write(&self.folder.join("src/lib.rs"), library.as_bytes())?;
        let manifest = fs::read_to_string(self.original.join("Cargo.toml"))?;
        copy::write(&self.folder.join("Cargo.toml"), manifest.replace(LINTS, switch::LINTS).as_bytes())?;
        Ok(written)
    }

    /// Puts every chosen mutant that compiles behind a switch; returns the numbers of those that do not, and of the functions of the
    /// others.
    pub fn with_switches(
        &self,
        mutants: &[Mutant],
        chosen: &BTreeSet<usize>,
    ) -> Result<(BTreeSet<usize>, BTreeMap<usize, usize>)> {
        let mut unviable = BTreeSet::new();
        loop {
            let switched = self.switch(mutants, chosen, &unviable)?;
            let errors = self.errors()?;
            if errors.is_empty() {
                let arms = switched.values().flat_map(|file| &file.mutants);
                return Ok((unviable, arms.map(|arm| (arm.number, arm.function)).collect()));
            }
            let known = unviable.len();
            for error in &errors {
                let guilty = guilty(error, &switched);
                if guilty.is_empty() {
                    return Err(format!("outside the mutants: {}", error["rendered"]).into());
                }
                unviable.extend(guilty);
            }
            println!("{} mutants do not compile so far", unviable.len());
            if unviable.len() == known {
                return Err("the same errors again".into());
            }
        }
    }

    /// Gives the copy one mutant, without a switch; whether it compiles.
    pub fn with_one(&self, mutant: &Mutant) -> Result<bool> {
        self.restore()?;
        let source = fs::read_to_string(self.original.join(&mutant.file))?;
        let source = switch::replaced(&source, mutant).ok_or_else(|| format!("{}: no such place", mutant.name))?;
        fs::write(self.folder.join(&mutant.file), source)?;
        Ok(self.errors()?.is_empty())
    }

    /// Errors of the compiler in the library.
    fn errors(&self) -> Result<Vec<Value>> {
        let messages = self.cargo(&["check", "--lib"])?;
        let has_passed = messages.iter().any(|message| message["success"] == true);
        let of_compiler = messages.into_iter().filter(|message| message["reason"] == "compiler-message");
        let errors: Vec<Value> = of_compiler
            .map(|mut message| mem::take(&mut message["message"]))
            .filter(|message| message["level"] == "error" && !message["spans"].as_array().is_none_or(Vec::is_empty))
            .collect();
        // Ended for want of memory, for example.
        if errors.is_empty() && !has_passed {
            return Err("the compiler ended without an error in the source".into());
        }
        Ok(errors)
    }

    /// Builds the tests of these names, or all; returns the test programs, the verification suite first, each with its name.
    pub fn tests(&self, names: &[String]) -> Result<Vec<(String, PathBuf)>> {
        let mut arguments = vec!["test", "--no-run"];
        if names.is_empty() {
            arguments.extend(["--lib", "--tests"]);
        }
        for name in names {
            arguments.extend(if name == "lib" { vec!["--lib"] } else { vec!["--test", name] });
        }
        let messages = self.cargo(&arguments)?;
        let mut programs: Vec<(String, PathBuf)> = Vec::new();
        for message in messages.iter().filter(|message| message["profile"]["test"] == true) {
            let (name, program) = (message["target"]["name"].as_str(), message["executable"].as_str());
            if let (Some(name), Some(program)) = (name, program) {
                programs.push((name.into(), program.into()));
            }
        }
        if !messages.iter().any(|message| message["success"] == true) {
            return Err(format!("the tests in {} do not compile", self.folder.display()).into());
        }
        programs.sort_by_key(|(name, _)| (name != "verification", name.clone()));
        Ok(programs)
    }

    /// Runs cargo in the copy; the messages it gives.
    fn cargo(&self, arguments: &[&str]) -> Result<Vec<Value>> {
        let output = Command::new(env!("CARGO"))
            .args(arguments)
            .args(["--profile", "faults", "--message-format", "json", "--target-dir"])
            .arg(self.folder.with_file_name("build"))
            .env("CARGO_PROFILE_FAULTS_OPT_LEVEL", self.level)
            .env("CARGO_INCREMENTAL", "1")
            .current_dir(&self.folder)
            .stderr(Stdio::null())
            .output()?;
        Ok(String::from_utf8(output.stdout)?.lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
    }
}

/// Mutants with their numbers, from 1: 0 is the program itself.
pub fn numbered(mutants: &[Mutant]) -> impl Iterator<Item = (usize, &Mutant)> {
    mutants.iter().enumerate().map(|(index, mutant)| (index + 1, mutant))
}

/// The mutants in whose lines an error lies: where the compiler points first, or else anywhere it points. An error in the type that a
/// function returns comes of those that replace all of its body.
fn guilty(error: &Value, switched: &BTreeMap<String, Switched>) -> BTreeSet<usize> {
    let spans: Vec<&Value> = error["spans"].as_array().into_iter().flatten().collect();
    let place = |span: &Value| {
        let arms = span["file_name"].as_str().and_then(|file| switched.get(file)).map(|file| &file.mutants);
        (span["line_start"].as_u64().unwrap_or(0) as usize, arms.into_iter().flatten())
    };
    let at = |span: &&Value| {
        let (line, mut arms) = place(span);
        arms.find(|arm| arm.lines.contains(&line)).map(|arm| arm.number)
    };
    let primary: BTreeSet<usize> = spans.iter().filter(|span| span["is_primary"] == true).filter_map(at).collect();
    if !primary.is_empty() {
        return primary;
    }
    let any: BTreeSet<usize> = spans.iter().filter_map(at).collect();
    if !any.is_empty() {
        return any;
    }
    let whole = spans.iter().filter(|span| span["is_primary"] == true).flat_map(|span| {
        let (line, arms) = place(span);
        let arms: Vec<_> = arms.collect();
        let function = arms.iter().find(|arm| arm.lines.start > line).map(|arm| arm.function);
        arms.into_iter().filter(move |arm| arm.is_whole && Some(arm.function) == function).map(|arm| arm.number)
    });
    whole.collect()
}
