//! What each picture says, in a sentence, from the runs that advice can rest on.

use super::curve::ADAPTIVE;
use super::decision::name;
use super::digits::short;
use super::figures::Figure;
use super::{Run, WorkPrecision};
use crate::figure::Series;

impl WorkPrecision {
    /// The conclusion of one of the chart's pictures; empty where the runs allow none.
    pub(super) fn conclusion(&self, figure: &Figure) -> Option<String> {
        let series = &figure.plot.series;
        match figure.name {
            "time" => self.cheapest(series, "time", |_| true, |run| run.wall_seconds),
            "work" => self.cheapest(series, "work", |_| true, |run| run.cost),
            "solves" => self.cheapest(series, "solves", |run| run.stiffness != "none", |run| run.work.solves as f64),
            "options-euler" => self.best_option("linear-backward-euler"),
            "options-w2" => self.best_option("w2"),
            "error" => self.longest_step(series),
            "energy" | "angular-momentum" => spread(series),
            "tolerance-error" => flat(series),
            "tolerance-work" => growth(series),
            "sizes-cloth" | "sizes-lattice" => crossing(series),
            _ => None,
        }
    }

    /// An accuracy that is worth speaking of: 1 %, or what is nearest to it among those that were reached.
    fn telling_accuracy(&self) -> Option<f64> {
        let decisions = self.decisions();
        decisions.get(1).or(decisions.first()).map(|decision| decision.accuracy)
    }

    /// Sound runs that are accurate enough, by what they cost.
    fn ranked(&self, accuracy: f64, of: impl Fn(&Run) -> bool, cost: impl Fn(&Run) -> f64) -> Vec<&Run> {
        let mut enough = self.sound_runs();
        enough.retain(|run| of(run) && run.useful_error().is_some_and(|error| error <= accuracy));
        enough.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        enough
    }

    /// The cheapest way to a telling accuracy, and how much more the next method takes.
    fn cheapest(
        &self,
        drawn: &[Series],
        what: &str,
        of: impl Fn(&Run) -> bool,
        cost: impl Fn(&Run) -> f64,
    ) -> Option<String> {
        let accuracy = self.telling_accuracy()?;
        let ranked = self.ranked(accuracy, of, &cost);
        let best = ranked.first()?;
        let next = ranked.iter().find(|run| run.way() != best.way()).map_or(String::new(), |next| {
            // Another configuration of the same method is told by its steps.
            let steps = if next.method == best.method { format!(" with {}", next.pace()) } else { String::new() };
            let (name, times) = (called(next, drawn), times(cost(next) / cost(best)));
            format!("; next {name}{steps}, {times}")
        });
        let (percent, steps) = (short(100.0 * accuracy), best.pace());
        Some(format!("Least {what} below {percent} %: {} with {steps}{next}.", called(best, drawn)))
    }

    /// The option and solver with which a method gets to a telling accuracy for least.
    fn best_option(&self, method: &str) -> Option<String> {
        let accuracy = self.telling_accuracy()?;
        let ranked = self.ranked(accuracy, |run| run.method == method && run.rtol.is_none(), |run| run.cost);
        let percent = short(100.0 * accuracy);
        let Some(best) = ranked.first() else { return Some(format!("No option gets below {percent} %.")) };
        let next = ranked.iter().find(|run| (run.stiffness, run.solver) != (best.stiffness, best.solver));
        let next = next.map_or(String::new(), |next| {
            format!(
                "; next {} with {}, {} work",
                next.stiffness,
                next.solver,
                times(next.cost / best.cost).replace("times", "times the")
            )
        });
        Some(format!("Best below {percent} %: {} with {}, {}{next}.", best.stiffness, best.solver, best.pace()))
    }

    /// The method that is accurate enough with the longest steps.
    fn longest_step(&self, drawn: &[Series]) -> Option<String> {
        let accuracy = self.telling_accuracy()?;
        let ranked = self.ranked(accuracy, |run| run.rtol.is_none(), |run| -run.dt);
        let percent = short(100.0 * accuracy);
        let Some(longest) = ranked.first() else { return Some(format!("No fixed step stays below {percent} %.")) };
        let method = called(longest, drawn);
        Some(format!("The longest step that stays below {percent} % has {method}: {} s.", short(longest.dt)))
    }
}

/// A configuration in words. Of each method only one is drawn, so it says where this is another.
fn called(run: &Run, drawn: &[Series]) -> String {
    let suffix = if run.rtol.is_some() { ADAPTIVE } else { "" };
    let legend = name(&format!("{}{suffix}", run.method), run.stiffness, run.solver);
    let name = name(run.method, run.stiffness, run.solver);
    match name.strip_suffix(')') {
        Some(start) if drawn.iter().all(|series| series.name != legend) => format!("{start}, not drawn)"),
        _ => name,
    }
}

/// How many times as much, where three digits show a difference.
fn times(ratio: f64) -> String {
    if ratio < 1.005 { "the same".into() } else { format!("{} times", short(ratio)) }
}

/// Who drifts least and who most, at the step that most series have.
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

/// How loose a tolerance may be before it shows.
fn flat(series: &[Series]) -> Option<String> {
    /// An error that is larger by less than this is the same one.
    const SAME: f64 = 1.1;
    let loosest = |series: &Series| {
        let tightest = series.points.iter().min_by(|a, b| a.0.total_cmp(&b.0))?.1;
        let within = series.points.iter().filter(|point| point.1 <= SAME * tightest).map(|point| point.0);
        Some(format!("{} up to {}", series.name, short(within.fold(0.0, f64::max))))
    };
    let each: Vec<String> = series.iter().filter_map(loosest).collect();
    (!each.is_empty()).then(|| format!("The tolerance adds less than a tenth to the error of {}.", each.join(", of ")))
}

/// How many more iterations the tightest tolerance takes than the loosest.
fn growth(series: &[Series]) -> Option<String> {
    let factor = |series: &Series| {
        let tight = series.points.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let loose = series.points.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(format!("{} times with {}", short(tight.1 / loose.1), series.name))
    };
    let each: Vec<String> = series.iter().filter_map(factor).collect();
    (!each.is_empty())
        .then(|| format!("From the loosest tolerance to the tightest iterations grow {}.", each.join(", ")))
}

/// From which size on iterating is faster than factoring.
fn crossing(series: &[Series]) -> Option<String> {
    let factored = series.iter().find(|series| series.name == "llt")?;
    let iterated = |size: f64| {
        let others = series.iter().filter(|series| series.name != "llt").flat_map(|series| &series.points);
        others.filter(|point| point.0 == size).map(|point| point.1).reduce(f64::min)
    };
    let mut both: Vec<(f64, bool)> =
        factored.points.iter().filter_map(|&(size, time)| Some((size, iterated(size)? < time))).collect();
    both.sort_by(|a, b| a.0.total_cmp(&b.0));
    let from = both.len() - both.iter().rev().take_while(|(_, faster)| *faster).count();
    let (largest, _) = both.last()?;
    Some(match both.get(from) {
        Some((size, _)) => format!("Conjugate gradients are faster from {} degrees of freedom on.", short(*size)),
        None => format!("Sparse Cholesky is as fast or faster up to {} degrees of freedom.", short(*largest)),
    })
}

#[cfg(test)]
mod tests;
