//! The chart in words: what to use for how much accuracy.

use super::figures::best_of_each;
use super::{Run, WorkPrecision};

/// The cheapest run for an accuracy.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision<'a> {
    /// The largest error that is allowed.
    pub accuracy: f64,
    /// The run with the least work among those that are accurate enough; `None` where none is.
    pub cheapest: Option<&'a Run>,
    /// The one with the shortest time.
    pub fastest: Option<&'a Run>,
    /// The cheapest of the notes' method, linearised backward Euler.
    pub notes: Option<&'a Run>,
}

impl WorkPrecision {
    /// Decisions for errors of 10 %, 1 %, … as far as the sweep's best runs reach.
    pub fn decisions(&self) -> Vec<Decision<'_>> {
        let best = self.runs.iter().filter_map(Run::useful_error).fold(f64::INFINITY, f64::min);
        let accuracies = (1..=8).map(|exponent| 10f64.powi(-exponent));
        accuracies.take_while(|accuracy| *accuracy >= best).map(|accuracy| self.decision(accuracy)).collect()
    }

    /// The decision for one accuracy.
    pub fn decision(&self, accuracy: f64) -> Decision<'_> {
        let enough = || self.runs.iter().filter(|run| run.useful_error().is_some_and(|error| error <= accuracy));
        let cheapest = enough().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let fastest = enough().min_by(|a, b| a.wall_seconds.total_cmp(&b.wall_seconds));
        let notes = enough().filter(|run| run.method == "linear-backward-euler");
        Decision { accuracy, cheapest, fastest, notes: notes.min_by(|a, b| a.cost.total_cmp(&b.cost)) }
    }

    /// What the sweep says, in one sentence each.
    pub fn conclusions(&self) -> Vec<String> {
        let mut all: Vec<String> = self.decisions().iter().filter_map(Decision::sentence).collect();
        let usable = best_of_each(&self.runs).into_iter().map(|curve| {
            // The end of the curve's part without failures, from short steps up.
            let good = curve.runs.iter().rev().take_while(|run| run.cause().is_none());
            let name = name(&curve.method, curve.stiffness, curve.solver);
            match good.map(|run| run.dt).reduce(f64::max) {
                Some(dt) => format!("{name} up to {} s", short(dt)),
                None => format!("{name} not at all"),
            }
        });
        all.push(format!("Steps that end less than 100 % off: {}.", usable.collect::<Vec<_>>().join("; ")));
        all
    }
}

impl Decision<'_> {
    /// In words; `None` where no run is accurate enough.
    pub fn sentence(&self) -> Option<String> {
        let run = self.cheapest?;
        let against = match self.notes {
            Some(notes) if notes.method != run.method || notes.stiffness != run.stiffness => {
                format!("; linear-backward-euler needs {} times the work", short(notes.cost / run.cost))
            }
            Some(_) => String::new(),
            None => "; linear-backward-euler did not get there in the time".into(),
        };
        let percent = short(100.0 * self.accuracy);
        let pace = match run.rtol {
            Some(rtol) => format!("adaptive steps, rtol = {}", short(rtol)),
            None => format!("dt = {} s", short(run.dt)),
        };
        let (work, milliseconds) = (short(run.cost), short(1e3 * run.wall_seconds));
        Some(format!(
            "For an error below {percent} %: {} with {pace} ({work} force evaluations, {milliseconds} ms){against}.",
            name(run.method, run.stiffness, run.solver)
        ))
    }
}

fn name(method: &str, stiffness: &str, solver: &str) -> String {
    match (stiffness, solver) {
        ("none", _) => method.to_owned(),
        (stiffness, "llt") => format!("{method} ({stiffness})"),
        (stiffness, solver) => format!("{method} ({stiffness}, {solver})"),
    }
}

/// Three digits.
fn short(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e7).contains(&size) {
        return format!("{value:.1e}");
    }
    let digits = (2.0 - size.max(1e-300).log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
