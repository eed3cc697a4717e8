//! The chart in words: the configuration to use for an accuracy. Only runs of a [tail] are recommended, so that no finer run contradicts the advice.

use super::curve::{Curve, best_of_each, curves, tail};
use super::run::short;
use super::{Run, WorkPrecision};
use crate::integrate::percent;

/// The largest error for which a run is recommended.
const LEAST_ACCURACY: f64 = 0.1;

/// The best runs of an accuracy.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision<'a> {
    /// The largest error that is allowed.
    pub accuracy: f64,
    /// The run with the least work among those that can be relied on and are accurate enough; `None` where there is none.
    pub cheapest: Option<&'a Run>,
    /// The cheapest of linearised backward Euler, the method of the lecture notes.
    pub notes: Option<&'a Run>,
    /// The cheapest run of each method that is accurate enough, the least work first.
    pub methods: Vec<&'a Run>,
}

const LONGEST_STEPS: &str = "Steps from which on every shorter one did better";
const NOWHERE: &str = "nowhere";

impl WorkPrecision {
    /// Decisions for errors of 10 %, 1 %, … as far as runs that can be relied on reach.
    pub fn decisions(&self) -> Vec<Decision<'_>> {
        let best = self.sound_runs().into_iter().filter_map(Run::useful_error).fold(f64::INFINITY, f64::min);
        let accuracies = (1..=8).map(|exponent| 10f64.powi(-exponent));
        accuracies
            .take_while(|accuracy| *accuracy >= best.max(self.floor()))
            .map(|accuracy| self.decision(accuracy))
            .collect()
    }

    /// The decision for one accuracy.
    pub fn decision(&self, accuracy: f64) -> Decision<'_> {
        let enough = self.ranked(accuracy, |run| Some(run.cost));
        let mut methods: Vec<&Run> = Vec::new();
        for (_, run) in &enough {
            if methods.iter().all(|other| other.variant() != run.variant()) {
                methods.push(run);
            }
        }
        let notes = enough.iter().map(|(_, run)| *run).find(|run| run.method == "linear-backward-euler");
        Decision { accuracy, cheapest: methods.first().copied(), notes, methods }
    }

    /// The decision that is worth speaking of: for 1 %, or what is nearest to it among the accuracies that were reached.
    pub(super) fn telling_decision(&self) -> Option<Decision<'_>> {
        self.decisions().into_iter().take(2).next_back()
    }

    /// The conclusions of the sweep, in one sentence each.
    pub fn conclusions(&self) -> Vec<String> {
        let mut all = self.recommendations();
        all.extend(self.best_options().map(|(heading, options)| format!("{heading}: {}.", options.join("; "))));
        let limits: Vec<_> = self.longest_steps().into_iter().map(|(name, limit)| format!("{name} {limit}")).collect();
        if !limits.is_empty() {
            all.push(format!("{LONGEST_STEPS}: {}.", limits.join("; ")));
        }
        all
    }

    /// The conclusions for a terminal, in short lines: the recommendations, and a line for each method that some run speaks for.
    pub fn conclusion_lines(&self) -> Vec<String> {
        let mut lines = self.recommendations();
        let reached = self.longest_steps().into_iter().filter(|(_, limit)| !limit.starts_with(NOWHERE));
        let reached = reached.map(|(name, limit)| format!("{name} {limit}")).collect();
        for (heading, items) in self.best_options().into_iter().chain([(LONGEST_STEPS.to_owned(), reached)]) {
            if !items.is_empty() {
                lines.push(format!("{heading}:"));
                lines.extend(items.into_iter().map(|item| format!("  {item}")));
            }
        }
        lines
    }

    /// The configuration to use for each accuracy, in one sentence each.
    pub fn recommendations(&self) -> Vec<String> {
        let mut all: Vec<String> = self.decisions().iter().filter_map(Decision::sentence).collect();
        if all.is_empty() {
            all.push(format!("Nothing can be recommended: {}.", self.obstacle()));
        }
        all
    }

    fn obstacle(&self) -> String {
        let runs = self.runs.len();
        if self.floor() > LEAST_ACCURACY {
            return format!(
                "the reference is good to about {} only, so that errors below {} cannot be told from it; a larger budget or a \
                 shorter motion makes a better one",
                percent(self.reference.error_estimate),
                percent(self.floor())
            );
        }
        if runs == 0 {
            return "there was no time for a run; a larger budget has some".into();
        }
        let Some(best) = self.runs.iter().filter_map(Run::useful_error).reduce(f64::min) else {
            return format!("none of {runs} runs came to a useful end; shorter steps may");
        };
        if best > LEAST_ACCURACY {
            return format!(
                "the best of {runs} runs is wrong by {}; a larger budget or a shorter step to begin with makes finer ones",
                percent(best)
            );
        }
        let right = |at: &usize| self.runs[*at].useful_error().is_some_and(|error| error <= LEAST_ACCURACY);
        let excluded = self.excluded.iter().filter(|at| right(at)).count();
        if excluded > 0 {
            return format!(
                "{excluded} runs are right to 10 % over this motion, and none of those tried holds to the end of the whole scene, where its motion \
                 magnifies errors or shorter steps are needed"
            );
        }
        "in no method are errors below 10 % that shorter steps make smaller: what runs end with depends on chance"
            .into()
    }

    /// The best configuration of each method, and the longest steps up to which it can be relied on.
    pub fn longest_steps(&self) -> Vec<(String, String)> {
        let all = curves(&self.runs);
        let limit = |best: Curve<'_>| {
            let mut of_method = all.iter().filter(|curve| curve.method == best.method).flat_map(|curve| &curve.runs);
            let limit = match tail(&best, self.floor()).last() {
                Some(run) => format!("up to {}", run.step_control()),
                None if of_method.any(|run| run.useful_error().is_some()) => NOWHERE.into(),
                None => format!("{NOWHERE}, no run succeeded"),
            };
            (name(&best.method, best.stiffness, best.solver), limit)
        };
        best_of_each(&self.runs, self.floor()).into_iter().map(limit).collect()
    }

    /// The best option of each method, in the telling decision.
    fn best_options(&self) -> Option<(String, Vec<String>)> {
        let decision = self.telling_decision()?;
        let each = decision.methods.iter().map(|run| {
            let name = name(run.method, run.stiffness, run.solver);
            format!("{name} with {} ({} force evaluations)", run.step_control(), short(run.cost))
        });
        Some((format!("The best option of each method below {} %", decision.percent()), each.collect()))
    }
}

impl Decision<'_> {
    /// The accuracy in per cent, as [`sentence`](Self::sentence) says it.
    pub fn percent(&self) -> String {
        short(100.0 * self.accuracy)
    }

    /// In words; `None` where no run can be recommended.
    pub fn sentence(&self) -> Option<String> {
        let run = self.cheapest?;
        let against = match self.notes {
            Some(notes) if notes.method != run.method || notes.stiffness != run.stiffness => {
                format!("; linear-backward-euler needs {} times the work", short(notes.cost / run.cost))
            }
            Some(_) => String::new(),
            None => "; linear-backward-euler did not get there".into(),
        };
        let percent = self.percent();
        let (work, milliseconds) = (short(run.cost), short(1e3 * run.wall_seconds));
        Some(format!(
            "For an error below {percent} %: {} with {} ({work} force evaluations, {milliseconds} ms){against}.",
            name(run.method, run.stiffness, run.solver),
            run.step_control()
        ))
    }
}

/// A configuration in words.
pub(super) fn name(method: &str, stiffness: &str, solver: &str) -> String {
    match (stiffness, solver) {
        ("none", _) => method.to_owned(),
        (stiffness, "llt") => format!("{method} ({stiffness})"),
        (stiffness, solver) => format!("{method} ({stiffness}, {solver})"),
    }
}
