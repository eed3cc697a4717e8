//! The conclusion of each picture, in a sentence, from the runs that advice can rest on.

use super::decision::name;
use super::run::short;
use super::work_precision_figure::Figure;
use super::{Run, WorkPrecision};
use crate::figure::Series;

impl WorkPrecision {
    /// The conclusion of one of the chart's pictures; empty where the runs allow none.
    pub(super) fn conclusion(&self, figure: &Figure) -> Option<String> {
        let series = &figure.plot.series;
        let none_holds = || {
            let are_excluded = self.decisions().is_empty() && !self.excluded.is_empty();
            are_excluded.then(|| "Of this motion alone: no run holds to the end of the whole scene.".into())
        };
        let conclusion = match figure.name {
            "time" => self.cheapest(series, "time", |run| run.wall_seconds),
            "work" => self.cheapest(series, "work", |run| run.cost),
            "options-euler" => self.best_option("linear-backward-euler"),
            "options-w2" => self.best_option("w2"),
            "error" => self.longest_step(series),
            "energy" | "angular-momentum" => spread(series),
            _ => None,
        };
        conclusion.or_else(none_holds)
    }

    /// Sound runs that are accurate enough and have a cost, by that.
    pub(super) fn ranked(&self, accuracy: f64, cost: impl Fn(&Run) -> Option<f64>) -> Vec<(f64, &Run)> {
        let enough = self.sound_runs().into_iter().filter(|run| run.useful_error().is_some_and(|e| e <= accuracy));
        let mut ranked: Vec<(f64, &Run)> = enough.filter_map(|run| Some((cost(run)?, run))).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked
    }

    /// The cheapest run of a telling accuracy, and how much more the next method takes.
    fn cheapest(&self, drawn: &[Series], what: &str, cost: impl Fn(&Run) -> f64) -> Option<String> {
        let accuracy = self.telling_decision()?.accuracy;
        let ranked = self.ranked(accuracy, |run| Some(cost(run)));
        let &(least, best) = ranked.first()?;
        let next = ranked.iter().find(|(_, run)| run.variant() != best.variant());
        let next = next.map_or(String::new(), |(cost, next)| {
            // Another configuration of the same method is told by its steps.
            let steps =
                if next.method == best.method { format!(" with {}", next.step_control()) } else { String::new() };
            format!("; next {}{steps}, {}", called(next, drawn), times(cost / least))
        });
        let (percent, steps) = (short(100.0 * accuracy), best.step_control());
        Some(format!("Least {what} below {percent} %: {} with {steps}{next}.", called(best, drawn)))
    }

    fn best_option(&self, method: &str) -> Option<String> {
        let accuracy = self.telling_decision()?.accuracy;
        let cost = |run: &Run| (run.method == method && run.rtol.is_none()).then_some(run.cost);
        let ranked = self.ranked(accuracy, cost);
        let percent = short(100.0 * accuracy);
        let Some(&(least, best)) = ranked.first() else { return Some(format!("No option gets below {percent} %.")) };
        let next = ranked.iter().find(|(_, run)| (run.stiffness, run.solver) != (best.stiffness, best.solver));
        let next = next.map_or(String::new(), |(cost, next)| {
            let times = times(cost / least).replace("times", "times the");
            format!("; next {} with {}, {times} work", next.stiffness, next.solver)
        });
        let steps = best.step_control();
        Some(format!("Best below {percent} %: {} with {}, {steps}{next}.", best.stiffness, best.solver))
    }

    fn longest_step(&self, drawn: &[Series]) -> Option<String> {
        let accuracy = self.telling_decision()?.accuracy;
        let ranked = self.ranked(accuracy, |run| run.rtol.is_none().then_some(-run.dt));
        let percent = short(100.0 * accuracy);
        let Some((_, longest)) = ranked.first() else {
            return Some(format!("No fixed step stays below {percent} %."));
        };
        let method = called(longest, drawn);
        Some(format!("The longest step that stays below {percent} % has {method}: {} s.", short(longest.dt)))
    }
}

/// A configuration in words. Of each method only one is drawn, so it says where this is another.
fn called(run: &Run, drawn: &[Series]) -> String {
    let legend = name(&run.variant(), run.stiffness, run.solver);
    let name = name(run.method, run.stiffness, run.solver);
    match name.strip_suffix(')') {
        Some(start) if drawn.iter().all(|series| series.name != legend) => format!("{start}, not drawn)"),
        _ => name,
    }
}

/// A ratio, where three digits show a difference.
fn times(ratio: f64) -> String {
    if ratio < 1.005 { "the same".into() } else { format!("{} times", short(ratio)) }
}

/// The least and the largest drift, at the step that most series have.
fn spread(series: &[Series]) -> Option<String> {
    let steps = series.iter().flat_map(|series| &series.points).map(|point| point.0);
    let sharing = |step: f64| series.iter().filter(|series| series.points.iter().any(|point| point.0 == step)).count();
    let step = steps.max_by_key(|&step| sharing(step))?;
    let at = |series: &Series| series.points.iter().find(|point| point.0 == step).map(|point| point.1);
    let mut drifts: Vec<(f64, &str)> =
        series.iter().filter_map(|series| Some((at(series)?, series.name.as_str()))).collect();
    drifts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ((least, gentle), (most, rough)) = drifts.first().zip(drifts.last())?;
    Some(format!("With steps of {} s {gentle} is off by {}, {rough} by {}.", short(step), short(*least), short(*most)))
}

#[cfg(test)]
mod tests;
