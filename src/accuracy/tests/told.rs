//! A motion that a way to an answer is tried on, what that is told, and the list that holds it.

use crate::accuracy::Requirement;
use crate::accuracy::attempt::Task;
use crate::accuracy::audience::{Audience, SearchProgress};
use crate::accuracy::price::Price;
use crate::accuracy::rates::Rates;
use crate::accuracy::samples::Grid;
use crate::accuracy::search::{Answer, Search, Verdict};
use crate::error::Result;
use crate::integrate::{Monitor, StiffnessPolicy};
use crate::linear::{CostModel, SolverChoice};
use crate::system::{State, System};
use faer::Par;
use std::cell::Cell;
use std::fmt::Write as _;
use std::path::Path;

/// Keeps what every run was told about as it began, and as it was last seen.
pub(super) struct Told {
    runs: Vec<[String; 2]>,
    /// What was spent before.
    before: f64,
}

impl Audience for Told {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        self.runs.push(Default::default());
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn progress(&mut self, &SearchProgress { doing, part, spent, left }: &SearchProgress<'_>) {
        let Some([first, last]) = self.runs.last_mut() else { return };
        let seen = format!("at {part:.2} {:.4e} spent {left:.4e} left", spent - self.before);
        if first.is_empty() {
            *first = format!("{doing} {seen}");
        } else {
            *last = seen;
        }
    }
}

/// What leads to an answer, or away from one.
pub(super) type Way<'w> = &'w dyn Fn(&mut Search<'_, Told>, Price) -> Result<String>;

/// A motion, how long it is looked at, the accuracy, what has been spent, and how often the search may look whether it goes on.
#[derive(Clone)]
pub(super) struct Case {
    pub system: System,
    pub start: State,
    pub duration: f64,
    pub accuracy: f64,
    pub spent: f64,
    pub looks: u64,
    pub price: Option<Price>,
    pub stiffness: Option<StiffnessPolicy>,
    pub solver: Option<SolverChoice>,
    pub par: Par,
    pub verdict: Verdict,
}

impl Case {
    pub fn new((system, start): (System, State), duration: f64, accuracy: f64) -> Self {
        Self {
            system,
            start,
            duration,
            accuracy,
            spent: 0.0,
            looks: u64::MAX,
            price: None,
            stiffness: None,
            solver: None,
            par: Par::Seq,
            verdict: Verdict::Confirmed,
        }
    }

    pub fn with(&self, change: impl Fn(&mut Self)) -> Self {
        let mut other = self.clone();
        change(&mut other);
        other
    }

    /// The runs that a way makes, a line each, and where it leads.
    pub fn tried(&self, way: Way<'_>) -> String {
        self.followed(way).0
    }

    /// As [`tried`](Self::tried), with the answer found.
    pub fn followed(&self, way: Way<'_>) -> (String, Option<Answer<()>>) {
        let (system, start, duration) = (&self.system, &self.start, self.duration);
        let requirement = Requirement {
            accuracy: self.accuracy,
            duration,
            interval: duration / 8.0,
            par: self.par,
            method: None,
            stiffness: self.stiffness,
            solver: self.solver,
        };
        let costs = CostModel::of(system);
        let looked = Cell::new(0);
        let go_on = || looked.replace(looked.get() + 1) < self.looks;
        let grid = Grid::new(duration, requirement.interval, system.particles());
        let task = Task { system, start, duration, costs, grid, go_on: &go_on };
        let mut told = Told { runs: Vec::new(), before: self.spent };
        let mut search = Search::new(&task, &requirement, &mut told);
        search.spend(self.spent);
        let price = self.price.unwrap_or_else(|| Price::of(&Rates::of(system, start).unwrap(), duration));
        let mut led = way(&mut search, price).unwrap();
        let horizon = search.horizon.map(|horizon| [horizon.known, horizon.most, horizon.spread]);
        let found = search.answer(self.verdict.clone());
        if let Some(found) = &found {
            let error = found.estimated_error.map_or("anything".into(), |error| format!("{error:.4e}"));
            let _ = write!(led, "; of {} runs one errs by {error} cost {:.4e}", found.runs, found.cost);
            let _ =
                write!(led, " of {:.4e} in {} steps; {:?}", found.total_cost - self.spent, found.steps, found.verdict);
        }
        if let Some(known) = horizon {
            let _ = write!(led, "; known to {:.4e} and {:.4e} apart {:.4e}", known[0], known[1], known[2]);
        }
        let mut text = String::new();
        for [first, last] in told.runs {
            let _ = writeln!(text, "    {first} {last}");
        }
        (text + "    " + &led + "\n", found)
    }
}

pub(super) fn priced(verlet: f64, steps: f64, radius: f64) -> impl Fn(&mut Case) {
    move |case| case.price = Some(Price { verlet, steps, radius })
}

/// Holds what was tried to the list: words as they are, numbers to two percent.
pub(super) fn hold(name: &str, cases: Vec<(String, String)>) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/accuracy/tests").join(format!("{name}.txt"));
    let text: String = cases.iter().map(|(case, tried)| format!("{case}:\n{tried}")).collect();
    if std::env::var("SPRUNG_RENEW").is_ok_and(|of| name.contains(&of)) {
        std::fs::write(&file, &text).unwrap();
    }
    let known = std::fs::read_to_string(file).unwrap();
    let is_same = |a: &str, b: &str, by: f64| match (a.parse::<f64>(), b.parse::<f64>()) {
        // Rounding decides about what is less.
        (Ok(a), Ok(b)) => (a - b).abs() <= by * a.abs().max(b.abs()) || a.abs().max(b.abs()) < 1e-12,
        _ => a == b,
    };
    let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let mut is_folding = false;
    for (line, expected) in text.lines().zip(known.lines()) {
        let (found, expected) = (words(line), words(expected));
        if line.ends_with(':') {
            is_folding = line.starts_with("folding");
        }
        // What forgets how it began remembers how it was rounded.
        let by = if is_folding { 0.5 } else { 0.02 };
        let is_right = found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| is_same(a, b, by));
        assert!(is_right, "{name}: {}\nis not {}\nin\n{text}", found.join(" "), expected.join(" "));
    }
    assert_eq!(text.lines().count(), known.lines().count(), "{name}:\n{text}");
}

/// What a few more words than the way itself make of it.
pub(super) fn each(way: Way<'_>, cases: &[(&str, Case)]) -> Vec<(String, String)> {
    cases.iter().map(|(name, case)| ((*name).to_owned(), case.tried(way))).collect()
}
