//! Answers by an implicit method, where explicit ones are dear: runs of RODAS4 with smaller and smaller tolerances, as long as they cost
//! less than explicit answers would.

use super::audience::Audience;
use super::course::Course;
use super::price::Price;
use super::resolution::{Unresolved, unresolved};
use super::search::{Search, Verdict, Went};
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method};
use crate::linear::{CostModel, SolverOptions, Tolerance};
use crate::system::System;

/// Explicit answers that cost less than this many implicit steps are not worth a try: for one digit, and by what power of the accuracy
/// they are more. (With 12 answers to the study's scenes cost 3.64 times the cheapest run in the median, with 100 3.57 times.)
const FEWEST_STEPS: f64 = 60.0;
const MORE_STEPS: f64 = 0.3;

/// The tolerance of the first run, and by what the next is smaller.
const FIRST_TOLERANCE: f64 = 4.0;
const COARSEST: f64 = 0.3;
const FIRST_RATIO: f64 = 6.7;

/// The part of what explicit answers cost that the first run may.
const FIRST_PART: f64 = 0.15;

/// The power of the tolerance by which runs become more expensive.
const GROWTH: f64 = 0.35;

/// What cannot be resolved may have this part of the accuracy.
const UNRESOLVED: f64 = 0.5;

/// The least that a step costs: six solves, two each where there is damping, with one factorization.
pub(super) fn step_price(system: &System, costs: &CostModel) -> f64 {
    let solves = if system.is_damped() { 12.0 } else { 6.0 };
    7.0 + costs.assembly() + costs.least_factorization() + solves * costs.least_direct_solve()
}

/// An answer, or `None` where explicit methods are to find one.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Option<Verdict>> {
    let (accuracy, duration, system) = (search.requirement.accuracy, search.task.duration, search.task.system);
    let explicit = price.answer(accuracy);
    let fewest = FEWEST_STEPS * (0.1 / accuracy).powf(MORE_STEPS);
    if explicit <= fewest * step_price(system, &search.task.costs) {
        return Ok(None);
    }
    let linear = linear_options(search);
    let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
    let configuration = Configuration { method: Method::Rodas4, options };
    let mut tolerance = (FIRST_TOLERANCE * accuracy).min(COARSEST);
    let mut next = tolerance / FIRST_RATIO;
    let mut limit = FIRST_PART * explicit;
    let mut coarse: Option<Course> = None;
    let mut last = f64::INFINITY;
    loop {
        search.left = explicit;
        let pace = Pace::Adaptive { rtol: tolerance, first_step: None };
        let (fine, run) = match search.run(configuration, pace, limit)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Some(Verdict::Interrupted)),
            Went::Wrong | Went::TooFar => return Ok(None),
        };
        if let Some(coarse) = coarse.take() {
            let apart = search.difference(&fine, &coarse).envelope();
            let estimate = estimate(apart, last);
            last = last.min(apart);
            let step = 2.0 * duration / run.steps.max(1) as f64;
            let mut resolved = true;
            if estimate <= accuracy {
                let harmless = Unresolved { amplitude: UNRESOLVED * accuracy, drift: f64::INFINITY };
                let (start, costs) = (search.task.start, &search.task.costs);
                let (left, cost) = unresolved(system, start, [step, duration], &[], &harmless, &linear, costs)?;
                search.spend(cost);
                resolved = left.is_within(&harmless);
            }
            if resolved {
                search.estimate(estimate);
            }
            if resolved && estimate <= accuracy {
                return Ok(Some(Verdict::Confirmed));
            }
            next = tolerance * tighter(accuracy, estimate);
        }
        if run.cost * (tolerance / next).powf(GROWTH) > 1.2 * explicit {
            return Ok(None);
        }
        limit = 1.5 * explicit;
        coarse = Some(fine);
        tolerance = next;
    }
}

/// What is believed of the finer of two runs that are so far apart: half of that, as long as no earlier pair was hardly farther.
fn estimate(apart: f64, last: f64) -> f64 {
    if apart < 0.6 * last { 0.5 * apart } else { 1.5 * apart }
}

/// The next tolerance in the one before.
fn tighter(accuracy: f64, estimate: f64) -> f64 {
    (0.5 * accuracy / estimate).powf(1.2).clamp(0.02, 0.3)
}

/// How linear systems are solved: far more exactly than the accuracy needs.
pub(super) fn linear_options<A: Audience>(search: &Search<'_, A>) -> SolverOptions {
    let requirement = search.requirement;
    let tolerance = Tolerance::Fixed((1e-3 * requirement.accuracy).clamp(1e-12, 1e-4));
    let defaults = SolverOptions::default();
    SolverOptions { solver: requirement.solver.unwrap_or(defaults.solver), par: requirement.par, tolerance, ..defaults }
}

#[cfg(test)]
mod tests {
    use super::{estimate, tighter};

    #[test]
    fn runs_that_come_nearer_are_believed() {
        for (apart, last, expected) in
            [(4.0, f64::INFINITY, 2.0), (1.0, 2.0, 0.5), (1.25, 2.0, 1.875), (0.6, 1.0, 0.9), (3.0, 2.0, 4.5)]
        {
            assert!((estimate(apart, last) / expected - 1.0).abs() < 1e-15, "{apart} after {last}");
        }
        assert_eq!(estimate(f64::INFINITY, f64::INFINITY), f64::INFINITY);
    }

    /// Half of the accuracy is aimed at. Of an estimate five times the accuracy that is a tenth, of much smaller and larger ones the ends.
    #[test]
    fn tolerances_follow_the_estimate() {
        assert!((tighter(0.1, 0.5) - 0.1f64.powf(1.2)).abs() < 1e-15);
        assert_eq!([tighter(0.1, 0.1), tighter(0.1, 10.0), tighter(1e-3, 1e-9)], [0.3, 0.02, 0.3]);
    }
}
