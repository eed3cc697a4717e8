//! Work–precision data of one scene: the error and cost of every method, stiffness option and solver over a range of steps.

use super::run::Bench;
use super::sweep::sweep;
use super::{Deadline, Progress, Reference, Run};
use crate::error::Result;
use crate::interrupt::Interrupt;
use crate::linear::CostModel;
use crate::system::{State, System};
use faer::Par;
use serde::Serialize;
use std::time::{Duration, Instant};

/// The extent of a sweep.
#[derive(Debug, Clone, Copy)]
pub struct SweepOptions {
    /// Length of the motion, in s.
    pub duration: f64,
    /// A step around which to sweep, in s: larger and smaller ones follow by factors of two.
    pub dt: f64,
    /// The time for everything.
    pub budget: Duration,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// Asks for an end with what was measured until then.
    pub interrupt: Interrupt,
}

/// Work–precision data of one scene.
///
/// # Examples
/// ```no_run
/// use sprung::chart::{SweepOptions, WorkPrecision};
/// use std::time::Duration;
///
/// let (system, start) = sprung::scene::builtin::cloth(8)?.build()?;
/// let budget = Duration::from_secs(30);
/// let interrupt = sprung::interrupt::Interrupt::NEVER;
/// let options = SweepOptions { duration: 0.1, dt: 1e-3, budget, par: sprung::faer::Par::Seq, interrupt };
/// let chart = WorkPrecision::measure("cloth", &system, &start, &options, &mut |_, _: &str| {})?;
/// for sentence in chart.iter().flat_map(|chart| chart.conclusions()) {
///     println!("{sentence}");
/// }
/// # Ok::<(), sprung::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorkPrecision {
    /// The scene's name.
    pub scene: String,
    /// Length of the motion, in s.
    pub duration: f64,
    /// The reference that errors are measured against.
    pub reference: Reference,
    /// Every run, failed ones too, from the largest steps to the smallest.
    pub runs: Vec<Run>,
    /// Positions in `runs` of those that are not recommended, because the same configuration did not hold to the end of the whole scene.
    #[serde(skip)]
    pub excluded: Vec<usize>,
}

impl WorkPrecision {
    /// Measures a scene. `None` when no reference could be computed within a third of the budget.
    ///
    /// # Errors
    /// Coincident ends of a spring in `start`; a matrix that is too large.
    pub fn measure(
        scene: &str,
        system: &System,
        start: &State,
        options: &SweepOptions,
        progress: &mut Progress<'_>,
    ) -> Result<Option<Self>> {
        let SweepOptions { duration, dt, budget, par, interrupt } = *options;
        let whole = Deadline::after(budget, interrupt);
        let begin = Instant::now();
        progress(begin.elapsed(), "reference");
        let reference = Reference::within(system, start, [dt, duration], budget / 3, interrupt)?;
        let Some(reference) = reference else { return Ok(None) };
        let costs = CostModel::of(system);
        let bench = Bench { system, start, duration, reference: &reference, costs };
        let mut shifted = |elapsed: Duration, what: &str| progress(begin.elapsed().max(elapsed), what);
        let runs = sweep(&bench, dt, par, whole, &mut shifted)?;
        Ok(Some(Self { scene: scene.into(), duration, reference, runs, excluded: Vec::new() }))
    }

    /// Excludes recommended runs of which `holds` denies that their configuration completes the whole scene without a warning; then the next best is asked for.
    pub fn verify_recommendations(&mut self, mut holds: impl FnMut(&Run) -> bool) {
        let mut verified: Vec<usize> = Vec::new();
        loop {
            let position = |run: &Run| self.runs.iter().position(|other| std::ptr::eq(run, other));
            let decisions = self.decisions();
            let recommended = decisions.iter().flat_map(|d| [d.cheapest, d.notes]).flatten();
            let next = recommended.filter_map(position).find(|position| !verified.contains(position));
            let Some((next, run)) = next.and_then(|next| Some((next, self.runs.get(next)?))) else { return };
            if holds(run) { verified.push(next) } else { self.excluded.push(next) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::fixtures::oscillator;

    /// Every part of the chart has runs, and is named as it begins. A configuration that does not hold is not recommended, at any accuracy.
    #[test]
    fn a_chart_recommends_only_what_holds_to_the_end() {
        let mut told = Vec::new();
        let mut tell = |_: Duration, what: &str| told.push(what.to_owned());
        let (system, start) = oscillator();
        let budget = Duration::from_secs(4);
        let options = SweepOptions { duration: 2.0, dt: 0.1, budget, par: Par::Seq, interrupt: Interrupt::NEVER };
        let mut chart = WorkPrecision::measure("oscillator", &system, &start, &options, &mut tell).unwrap().unwrap();
        assert_eq!((chart.scene.as_str(), chart.duration), ("oscillator", 2.0));
        assert!((chart.reference.state.positions[1].x - 1.0 - 0.3 * 2.0f64.cos()).abs() < 1e-8);
        assert!(!chart.runs.is_empty() && told[0] == "reference" && told.len() > chart.runs.len());
        let explicit = ["verlet", "symplectic-euler", "forward-euler", "dop853"];
        chart.verify_recommendations(|run| !explicit.contains(&run.method));
        let decisions = chart.decisions();
        assert!(!decisions.is_empty());
        for run in decisions.iter().filter_map(|decision| decision.cheapest) {
            assert!(!explicit.contains(&run.method), "{}", run.method);
        }
    }
}
