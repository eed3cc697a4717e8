//! The mutants that cargo-mutants finds in the rooms that compute.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// A place in a file; lines and columns count from 1, columns in characters.
#[derive(Deserialize, Clone, Copy)]
pub struct Place {
    pub line: usize,
    pub column: usize,
}

/// From a place to just before another.
#[derive(Deserialize, Clone, Copy)]
pub struct Span {
    pub start: Place,
    pub end: Place,
}

#[derive(Deserialize, Clone)]
pub struct Function {
    pub return_type: String,
    pub span: Span,
}

/// A mutant: what is put in place of a piece of the source.
#[derive(Deserialize, Clone)]
pub struct Mutant {
    /// Place and change in words, for example `src/spring.rs:92:19: replace < with <= in Spring::is_compressed`.
    pub name: String,
    pub file: String,
    pub span: Span,
    pub replacement: String,
    /// The function around it; none for constants, for functions that constants call, and for those that return a type without a
    /// name.
    pub function: Option<Function>,
}

impl Mutant {
    /// The room of the library: `linear` of `src/linear/cg.rs`, `spring` of `src/spring.rs`.
    pub fn room(&self) -> &str {
        let within = self.file.strip_prefix("src/").unwrap_or(&self.file);
        within.split(['/', '.']).next().unwrap_or(within)
    }

    /// Name without line and column, which move when the file is edited.
    pub fn change(&self) -> &str {
        self.name.splitn(4, ':').last().unwrap_or(&self.name).trim()
    }
}

/// Lines of a source before its tests, which stand at the end: cargo-mutants leaves out those under `cfg(test)` alone.
fn lines(source: &str) -> usize {
    let tests = source.find("\nmod tests").unwrap_or(source.len());
    source[..tests].lines().count()
}

/// All mutants, in the order of the files. `.cargo/mutants.toml` says which files.
pub fn all(root: &Path) -> super::Result<Vec<Mutant>> {
    let list = Command::new(env!("CARGO")).args(["mutants", "--list", "--json"]).current_dir(root).output()?;
    if !list.status.success() {
        let why = String::from_utf8_lossy(&list.stderr).into_owned();
        return Err(format!("cargo-mutants is needed, `cargo install cargo-mutants --locked`: {why}").into());
    }
    let mut mutants: Vec<Mutant> = serde_json::from_slice(&list.stdout)?;
    let mut sources = BTreeMap::new();
    for mutant in &mutants {
        if !sources.contains_key(&mutant.file) {
            sources.insert(mutant.file.clone(), fs::read_to_string(root.join(&mutant.file))?);
        }
    }
    let is_program = |mutant: &Mutant| mutant.span.start.line <= lines(&sources[&mutant.file]);
    mutants.retain(|mutant| !mutant.file.ends_with("tests.rs") && is_program(mutant));
    for mutant in &mut mutants {
        if let Some(function) = &mutant.function {
            let source = &sources[&mutant.file];
            let first = source.lines().skip(function.span.start.line - 1).find(|line| line.contains("fn "));
            let opaque = function.return_type.strip_prefix("-> impl ");
            // An arm can be an iterator, and nothing else that has no name.
            let has_arms =
                opaque.is_none_or(|of| of.starts_with("Iterator") && !of.contains("Clone") && !of.contains("Send"));
            if first.is_some_and(|line| line.contains("const fn ")) || !has_arms {
                mutant.function = None;
            }
        }
    }
    Ok(mutants)
}
