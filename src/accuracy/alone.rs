//! Answers by one method that was asked for: steps halved, or tolerances a tenth, until runs agree.
//!
//! Of three runs in a row the last is believed when their differences contract, by more than the order ½, and when its steps
//! resolve what moves: methods that damp may agree on a motion without its vibrations.

use super::audience::Audience;
use super::course::Course;
use super::rates::Rates;
use super::resolution::{Unresolved, unresolved};
use super::search::{Search, Verdict, Went};
use super::stiff::linear_options;
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method};

/// Steps of the first run.
const FEWEST_STEPS: f64 = 8.0;

/// Runs that break down are tried with shorter steps so many times.
const RETRIES: u32 = 24;

/// The lowest order that counts as convergence.
const LOWEST_ORDER: f64 = 0.5;

/// From one tolerance to the next.
const TIGHTER: f64 = 0.1;

/// The tolerance of the first run, in the accuracy asked for; the largest and the smallest.
const FIRST_TOLERANCE: f64 = 4.0;
const COARSEST: f64 = 0.1;
const FINEST: f64 = 1e-14;

/// What cannot be resolved may have this part of the accuracy.
const UNRESOLVED: f64 = 0.5;

/// An answer by this method.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, method: Method, rates: &Rates) -> Result<Verdict> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let linear = linear_options(search);
    let stiffness = search.requirement.stiffness.unwrap_or(ImplicitOptions::default().stiffness);
    let configuration = Configuration { method, options: ImplicitOptions { stiffness, linear } };
    let stable = if method.is_implicit() { 0.0 } else { duration / rates.verlet_step() };
    let mut pace = if method.estimates_errors() {
        Pace::Adaptive { rtol: (FIRST_TOLERANCE * accuracy).min(COARSEST), first_step: None }
    } else {
        Pace::Step(duration / stable.max(FEWEST_STEPS).ceil())
    };
    let mut coarse: Option<Course> = None;
    let mut before: Option<f64> = None;
    let mut failures = 0;
    loop {
        let (fine, run) = match search.run(configuration, pace, f64::INFINITY)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Verdict::Interrupted),
            Went::Wrong if failures < RETRIES => {
                failures += 1;
                (coarse, before) = (None, None);
                pace = finer(pace);
                continue;
            }
            Went::Wrong => return Ok(Verdict::Unconfirmed("no run that could confirm it came to the end".into())),
            Went::TooFar => return Ok(Verdict::Unconfirmed("it would take too many steps".into())),
        };
        if let Some(coarse) = &coarse {
            let apart = search.difference(&fine, coarse).envelope();
            let order = before.map(|before| (before / apart).log2());
            let estimate = match order {
                _ if apart == 0.0 => Some(0.0),
                Some(order) if order > LOWEST_ORDER => {
                    let order = order.min(if method.estimates_errors() { 1.0 } else { f64::from(method.order()) });
                    Some(1.2 * apart / (order.exp2() - 1.0))
                }
                _ => None,
            };
            if let Some(estimate) = estimate {
                let step = 2.0 * duration / run.steps.max(1) as f64;
                let mut resolved = true;
                if method.is_implicit() && estimate <= accuracy {
                    let (system, start, costs) = (search.task.system, search.task.start, &search.task.costs);
                    let harmless = Unresolved { amplitude: UNRESOLVED * accuracy, drift: f64::INFINITY };
                    let (left, cost) = unresolved(system, start, [step, duration], &[], &harmless, &linear, costs)?;
                    search.spend(cost);
                    resolved = left.is_within(&harmless);
                }
                if resolved {
                    search.estimate(estimate);
                }
                if resolved && estimate <= accuracy {
                    return Ok(Verdict::Confirmed);
                }
            }
            before = Some(apart);
        }
        pace = finer(pace);
        search.left = 2.0 * run.cost;
        if !search.affords(2.0 * run.cost) {
            return Ok(Verdict::Unconfirmed("it would take too many steps".into()));
        }
        if matches!(pace, Pace::Adaptive { rtol, .. } if rtol < FINEST) {
            return Ok(Verdict::Unconfirmed("runs differ by more than the accuracy down to rounding".into()));
        }
        coarse = Some(fine);
    }
}

fn finer(pace: Pace) -> Pace {
    match pace {
        Pace::Step(dt) => Pace::Step(0.5 * dt),
        Pace::Adaptive { rtol, first_step } => Pace::Adaptive { rtol: TIGHTER * rtol, first_step },
    }
}
