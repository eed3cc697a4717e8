//! What became of the mutants: kept in `results/`, one file a room, and told in `verification/mutants.md`.

use super::Result;
use super::listed::Mutant;
use super::trial::{Fate, Part, START};
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
    /// Changes, each with the source line, or a part of it, that it is made in. `replace + with _ in f` is any that replaces this.
    mutants: Vec<(String, String)>,
}

pub struct Record<'m> {
    mutants: &'m [Mutant],
    keys: Vec<Key>,
    fates: HashMap<Key, Fate>,
    /// Rooms that something new is known of. The files of the others are left alone: another run may be writing them.
    renewed: HashSet<&'m str>,
    equivalents: Vec<Equivalent>,
    results: PathBuf,
    table: PathBuf,
}

/// So many of a file that are not caught are listed on the page; of more only their number is.
const MANY: usize = 20;

/// What is counted of a file or a room.
const COLUMNS: &str = "mutants | do not compile | caught by the suite | by other tests | do not end | equivalent | not caught | alive after some tests | not tried |\n|---|---|---|---|---|---|---|---|---|---|\n";

/// A row of the page.
type Row = [usize; 9];

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
        let results = folder.join("mutants/results");
        fs::create_dir_all(&results)?;
        let mut known: Vec<(Key, Fate)> = Vec::new();
        for entry in fs::read_dir(&results)? {
            known.extend(serde_json::from_str::<Vec<(Key, Fate)>>(&fs::read_to_string(entry?.path())?)?);
        }
        // Of code that is gone nothing need be known.
        let present: HashSet<&Key> = keys.iter().collect();
        let fates = known.into_iter().filter(|(key, _)| present.contains(key)).collect();
        let equivalents: Equivalents = toml::from_str(&fs::read_to_string(folder.join("equivalent.toml"))?)?;
        let (equivalents, table) = (equivalents.equivalent, folder.join("mutants.md"));
        Ok(Self { mutants, keys, fates, renewed: HashSet::new(), equivalents, results, table })
    }

    /// Whether a mutant need not be tried again: a test caught it, it does not compile, or it is known to be equivalent.
    pub fn settled(&self, number: usize) -> bool {
        let key = &self.keys[number - 1];
        match self.fates.get(key) {
            None => false,
            Some(Fate::Survived | Fate::Alive) => self.equivalents.iter().any(|equivalent| equivalent.holds(key)),
            Some(_) => true,
        }
    }

    /// Whether anything is known of a mutant.
    pub fn tried(&self, number: usize) -> bool {
        self.fates.contains_key(&self.keys[number - 1])
    }

    /// Sorts parts of the tests for a mutant: first those that have caught most mutants of the same file for their time. What was
    /// caught in other files counts a little, and so does a name like the file's, as long as nothing is known.
    pub fn promising_first(&self, mutant: &Mutant, parts: &mut [&Part]) {
        let mut caught = HashMap::<&str, f64>::new();
        for (key, fate) in &self.fates {
            if let Fate::Caught { by, .. } = fate {
                *caught.entry(by).or_default() += if key.0 == mutant.file { 1.0 } else { 0.03 };
            }
        }
        let stem = Path::new(&mutant.file).file_stem().and_then(|stem| stem.to_str()).unwrap_or("");
        let expected = |part: &Part| match () {
            () if part.name.contains(stem) => 4.0,
            () if part.name.contains(mutant.room()) => 1.0,
            () => 0.1,
        };
        let rate = |part: &Part| {
            let caught = caught.get(part.name.as_str()).unwrap_or(&0.0);
            (caught + expected(part)) / (part.duration + START).as_secs_f64()
        };
        parts.sort_by(|a, b| rate(b).total_cmp(&rate(a)));
    }

    pub fn set(&mut self, number: usize, fate: Fate) {
        self.renewed.insert(self.mutants[number - 1].room());
        self.fates.insert(self.keys[number - 1].clone(), fate);
    }

    /// Keeps what is known so far for a later run, in the order of the source.
    pub fn keep(&self) -> Result<()> {
        let mut rooms = BTreeMap::<&str, String>::new();
        for (mutant, key) in self.mutants.iter().zip(&self.keys) {
            let text = rooms.entry(mutant.room()).or_default();
            if let Some(fate) = self.fates.get(key) {
                let comma = if text.is_empty() { "" } else { ",\n" };
                *text += &format!("{comma}{}", serde_json::to_string(&(key, fate))?);
            }
        }
        for (room, text) in rooms.iter().filter(|(room, _)| self.renewed.contains(*room)) {
            copy::write(&self.results.join(format!("{room}.json")), format!("[\n{text}\n]\n").as_bytes())?;
        }
        Ok(())
    }

    /// Whether a mutant is alive, and listed as equivalent if it is.
    fn alive(&self, key: &Key) -> Option<bool> {
        matches!(self.fates.get(key), Some(Fate::Survived | Fate::Alive))
            .then(|| self.equivalents.iter().any(|equivalent| equivalent.holds(key)))
    }

    /// Writes the table; whether all mutants were tried, and every survivor is listed as equivalent.
    pub fn write(&self) -> Result<bool> {
        self.keep()?;
        let untried = self.keys.iter().filter(|key| !self.fates.contains_key(*key)).count();
        let (listed, unlisted): (Vec<&Key>, Vec<&Key>) =
            self.keys.iter().filter(|key| self.alive(key).is_some()).partition(|key| self.alive(key) == Some(true));
        unlisted.iter().for_each(|(file, change, line, _)| println!("not caught: {file}: {change}: {line}"));
        // What a test catches, what does not compile, and what is not in the source is not equivalent.
        let stale = |(file, (change, line)): &(&String, &(String, String))| {
            let mut of =
                self.keys.iter().filter(|key| key.0 == **file && is(change, &key.1) && key.2.contains(line.as_str()));
            of.all(|key| self.fates.contains_key(key) && self.alive(key).is_none())
        };
        let entries = self.equivalents.iter().flat_map(|of| of.mutants.iter().map(|mutant| (&of.file, mutant)));
        let stale: Vec<_> = entries.filter(stale).collect();
        stale.iter().for_each(|(file, (change, line))| println!("listed, but no survivor: {file}: {change}: {line}"));
        println!(
            "{} mutants, {untried} not tried, {} survived: {} equivalent, {} not caught",
            self.mutants.len(),
            listed.len() + unlisted.len(),
            listed.len(),
            unlisted.len()
        );
        fs::write(&self.table, self.table(&unlisted))?;
        Ok(untried == 0 && unlisted.is_empty() && stale.is_empty())
    }

    /// In which column of the page a mutant is counted.
    fn column(&self, key: &Key) -> usize {
        match (self.fates.get(key), self.alive(key)) {
            (None, _) => 8,
            (Some(Fate::Unviable), _) => 1,
            (Some(Fate::Caught { by, .. }), _) if by.starts_with("verification") => 2,
            (Some(Fate::Caught { .. }), _) => 3,
            (Some(Fate::Endless { .. }), _) => 4,
            (Some(_), Some(true)) => 5,
            (Some(Fate::Alive), _) => 7,
            (Some(Fate::Survived), _) => 6,
        }
    }

    /// Rows of the page: of what each mutant is counted under, or of nothing.
    fn rows<'k>(&'k self, name: impl Fn(&'k Mutant) -> Option<&'k str>) -> String {
        let mut rows = BTreeMap::<&str, Row>::new();
        let mut all: Row = [0; 9];
        for (mutant, key) in self.mutants.iter().zip(&self.keys) {
            let Some(name) = name(mutant) else { continue };
            for row in [rows.entry(name).or_default(), &mut all] {
                row[0] += 1;
                row[self.column(key)] += 1;
            }
        }
        let mut text = String::new();
        let mut write = |name: &str, row: Row| {
            let _ = writeln!(text, "| {name} | {} |", row.map(|number| number.to_string()).join(" | "));
        };
        rows.into_iter().for_each(|(name, row)| write(&format!("`{name}`"), row));
        write("**all**", all);
        text
    }

    /// The rooms and what is known of them.
    pub fn rooms(&self) -> String {
        format!("| room | {COLUMNS}{}", self.rows(|mutant| Some(mutant.room())))
    }

    fn table(&self, unlisted: &[&Key]) -> String {
        let tried: HashSet<&str> = self
            .mutants
            .iter()
            .zip(&self.keys)
            .filter(|(_, key)| self.fates.contains_key(*key))
            .map(|(m, _)| m.room())
            .collect();
        let mut text = String::from(
            "# Mutants, and what became of them\n\n\
             Written by `cargo xtask mutants`. The mutants are those that cargo-mutants makes of the rooms that compute: an \
             operator, a condition, a returned value or a term of a sum is another. The tests that \
             enter its function are run with every one until one fails, those first that caught most like it for their \
             time. So the columns say which tests were the quickest to see it, not which others would have. One that is alive \
             after some tests was not caught by the most promising ones, and has not been tried with the others. A room of which nothing \
             is known here, or not all, is counted as that, whatever was known of it before results were kept.\n\n",
        );
        text += &self.rooms();
        let _ = write!(text, "\n## Files of the rooms that were tried\n\n| file | {COLUMNS}");
        text += &self.rows(|mutant| tried.contains(mutant.room()).then_some(mutant.file.as_str()));
        if !unlisted.is_empty() {
            text += "\n## Not caught, or not yet\n\n";
        }
        for of_file in unlisted.chunk_by(|a, b| a.0 == b.0) {
            for (file, change, line, _) in of_file.iter().filter(|_| of_file.len() <= MANY) {
                let _ = writeln!(text, "- `{file}`: {change}: `{line}`");
            }
            if let ([(file, ..), ..], true) = (of_file, of_file.len() > MANY) {
                let _ = writeln!(text, "- `{file}`: {} of them, in `mutants/results`", of_file.len());
            }
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
        self.file == key.0 && self.mutants.iter().any(|(change, line)| is(change, &key.1) && key.2.contains(line))
    }
}

/// Whether a change is the one that is listed, or one of those that are.
fn is(listed: &str, change: &str) -> bool {
    listed == change
        || listed.split_once(" with _").is_some_and(|(what, place)| {
            change.strip_prefix(what).is_some_and(|rest| rest.starts_with(" with ") && rest.ends_with(place))
        })
}
