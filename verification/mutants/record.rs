//! What became of the mutants: kept below the target folder, and told in `verification/mutants.md`.

use super::Result;
use super::listed::Mutant;
use super::trial::{Fate, Part};
use crate::copy;
use serde::Deserialize;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// A mutant by what stays when lines move: file, change, text of the line, and which of several like it there.
type Key = (String, String, String, usize);

/// Mutants that behave as the program does, so that no test can catch them.
#[derive(Deserialize)]
struct Equivalents {
    #[serde(default)]
    equivalent: Vec<Equivalent>,
}

#[derive(Deserialize)]
struct Equivalent {
    file: String,
    reason: String,
    /// Changes, each with the source line, or a part of it, that it is made in.
    mutants: Vec<(String, String)>,
}

pub struct Record<'m> {
    mutants: &'m [Mutant],
    keys: Vec<Key>,
    fates: HashMap<Key, Fate>,
    equivalents: Vec<Equivalent>,
    outcomes: PathBuf,
    table: PathBuf,
}

impl<'m> Record<'m> {
    /// What is known of the mutants from earlier runs.
    pub fn new(root: &Path, mutants: &'m [Mutant]) -> Result<Self> {
        let (mut sources, mut seen) = (BTreeMap::<&str, String>::new(), HashMap::<Key, usize>::new());
        let mut keys = Vec::new();
        for mutant in mutants {
            if !sources.contains_key(mutant.file.as_str()) {
                sources.insert(&mutant.file, fs::read_to_string(root.join(&mutant.file))?);
            }
            let line = sources[mutant.file.as_str()].lines().nth(mutant.span.start.line - 1).unwrap_or("").trim();
            let key = (mutant.file.clone(), mutant.change().to_owned(), line.to_owned(), 0);
            let like = seen.entry(key.clone()).or_default();
            keys.push((key.0, key.1, key.2, *like));
            *like += 1;
        }
        let folder = root.join("verification");
        let outcomes = copy::target(root).join("mutants-outcomes.json");
        let known: Vec<(Key, Fate)> = match fs::read_to_string(&outcomes) {
            Ok(text) => serde_json::from_str(&text)?,
            Err(_) => Vec::new(),
        };
        // Of code that is gone nothing need be known.
        let present: HashSet<&Key> = keys.iter().collect();
        let fates = known.into_iter().filter(|(key, _)| present.contains(key)).collect();
        let equivalents: Equivalents = toml::from_str(&fs::read_to_string(folder.join("equivalent.toml"))?)?;
        let (equivalents, table) = (equivalents.equivalent, folder.join("mutants.md"));
        Ok(Self { mutants, keys, fates, equivalents, outcomes, table })
    }

    /// Whether a mutant need not be tried again: a test caught it, it does not compile, or it is known to be equivalent.
    pub fn settled(&self, number: usize) -> bool {
        let key = &self.keys[number - 1];
        match self.fates.get(key) {
            None => false,
            Some(Fate::Survived) => self.equivalents.iter().any(|equivalent| equivalent.holds(key)),
            Some(_) => true,
        }
    }

    /// Sorts parts of the tests for a mutant: first those that have caught most mutants of the same file for their time.
    pub fn promising_first(&self, mutant: &Mutant, parts: &mut [&Part]) {
        let mut caught = HashMap::<&str, f64>::new();
        for (key, fate) in &self.fates {
            if let Fate::Caught { by, .. } = fate {
                // What was caught in other files counts a little.
                *caught.entry(by).or_default() += if key.0 == mutant.file { 1.0 } else { 0.03 };
            }
        }
        let rate = |part: &Part| (caught.get(part.name.as_str()).unwrap_or(&0.0) + 1.0) / part.duration.as_secs_f64();
        parts.sort_by(|a, b| rate(b).total_cmp(&rate(a)));
    }

    pub fn set(&mut self, number: usize, fate: Fate) {
        self.fates.insert(self.keys[number - 1].clone(), fate);
    }

    /// Keeps what is known so far for a later run.
    pub fn keep(&self) -> Result<()> {
        let outcomes: Vec<(&Key, &Fate)> = self.fates.iter().collect();
        Ok(fs::write(&self.outcomes, serde_json::to_string(&outcomes)? + "\n")?)
    }

    /// Writes the table; whether all mutants were tried, and every survivor is listed as equivalent.
    pub fn write(&self) -> Result<bool> {
        self.keep()?;
        let outcomes: Vec<(&Key, &Fate)> =
            self.keys.iter().filter_map(|key| self.fates.get(key).map(|fate| (key, fate))).collect();
        let untried = self.mutants.len() - outcomes.len();
        let survivors: Vec<&Key> =
            outcomes.iter().filter(|(_, fate)| **fate == Fate::Survived).map(|(key, _)| *key).collect();
        let (listed, unlisted): (Vec<&Key>, Vec<&Key>) =
            survivors.iter().partition(|key| self.equivalents.iter().any(|equivalent| equivalent.holds(key)));
        unlisted.iter().for_each(|(file, change, line, _)| println!("not caught: {file}: {change}: {line}"));
        let stale = |(file, (change, line)): &(&String, &(String, String))| {
            !survivors.iter().any(|key| key.0 == **file && key.1 == *change && key.2.contains(line.as_str()))
        };
        let entries = self.equivalents.iter().flat_map(|of| of.mutants.iter().map(|mutant| (&of.file, mutant)));
        let stale: Vec<_> = entries.filter(stale).collect();
        stale.iter().for_each(|(file, (change, line))| println!("listed, but no survivor: {file}: {change}: {line}"));
        println!(
            "{} mutants, {untried} not tried, {} survived: {} equivalent, {} not caught",
            self.mutants.len(),
            survivors.len(),
            listed.len(),
            unlisted.len()
        );
        fs::write(&self.table, self.table(&unlisted))?;
        Ok(untried == 0 && unlisted.is_empty() && stale.is_empty())
    }

    fn table(&self, unlisted: &[&Key]) -> String {
        let mut text = String::from(
            "# Mutants, and what became of them\n\n\
             Written by `cargo xtask mutants`. The mutants are those that cargo-mutants makes of the \
             numerical modules: an operator, a condition, a returned value or a term of a sum is another. The tests that \
             enter its function are run with every one until one fails, those first that caught most like it for their \
             time. So the columns say which tests were the quickest to see it, not which others would have.\n\n\
             | file | mutants | do not compile | caught by the suite | by other tests | do not end | equivalent | not caught | not tried |\n\
             |---|---|---|---|---|---|---|---|---|\n",
        );
        let mut rows = BTreeMap::<&str, [usize; 8]>::new();
        for key in &self.keys {
            let column = match self.fates.get(key) {
                None => 7,
                Some(Fate::Unviable) => 1,
                Some(Fate::Caught { by, .. }) if by.starts_with("verification") => 2,
                Some(Fate::Caught { .. }) => 3,
                Some(Fate::Endless { .. }) => 4,
                Some(Fate::Survived) if unlisted.contains(&key) => 6,
                Some(Fate::Survived) => 5,
            };
            for file in [key.0.as_str(), "~ all"] {
                let row = rows.entry(file).or_default();
                row[0] += 1;
                row[column] += 1;
            }
        }
        for (file, numbers) in rows {
            let numbers = numbers.map(|number| number.to_string()).join(" | ");
            let file = if file == "~ all" { "**all**".to_owned() } else { format!("`{file}`") };
            let _ = writeln!(text, "| {file} | {numbers} |");
        }
        if !unlisted.is_empty() {
            text += "\n## Not caught\n\n";
        }
        for (file, change, line, _) in unlisted {
            let _ = writeln!(text, "- `{file}`: {change}: `{line}`");
        }
        text += "\n## Equivalent mutants\n\nNo test can tell them from the program, or only from its speed; from `equivalent.toml`.\n";
        for Equivalent { file, reason, mutants } in &self.equivalents {
            let _ = writeln!(text, "\n**`{file}`**: {reason}\n");
            for (change, line) in mutants {
                let _ = writeln!(text, "- {change}: `{line}`");
            }
        }
        text
    }
}

impl Equivalent {
    fn holds(&self, key: &Key) -> bool {
        self.file == key.0 && self.mutants.iter().any(|(change, line)| *change == key.1 && key.2.contains(line))
    }
}
