//! Answers by explicit methods: a pair of runs of Verlet's method, or of DOP853 where that is not fine enough.
//!
//! **Verlet** goes first, with the longest stable steps and with steps 1.35 times shorter. Its error is `C h²`, so that the
//! difference d of runs with h and h/r leaves `d/(r² − 1)` of the finer one. Where that is too much, steps follow that are
//! as much shorter as the estimate says, each compared with the one before.
//!
//! **DOP853** takes over where the steps of Verlet's method that the accuracy needs would cost more. Its first run is compared with the
//! extrapolation of Verlet's pair, which errs for other reasons; further ones have smaller tolerances.
//!
//! **What is believed.** Differences count with their [envelope](super::course::Difference::envelope), and for no less than half of
//! what the law makes of the one before. One that has not contracted as it should is not believed: it shows that steps were
//! too long for the law, or that the motion forgets. Of the largest difference so far such a run has 1.5 times for its error.

use super::attempt::Audience;
use super::course::Course;
use super::horizon::{Outlook, Parting};
use super::rates::Rates;
use super::search::{Run, Search, Verdict, Went};
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method};

/// Steps of Verlet's method, in the longest stable ones: the state changes on the way.
const STABLE: f64 = 0.93;

/// A run has at least this many steps.
const FEWEST_STEPS: f64 = 8.0;

/// From the first run of a pair to the second.
const FIRST_RATIO: f64 = 1.35;

/// What the difference of a first pair is multiplied with, of which nothing shows yet that it follows the law.
const UNPROVEN: f64 = 2.0;

/// The same for one that contracts.
const PROVEN: f64 = 1.5;

/// A difference is not believed above this many times what the law makes of the one before, and a chance below this part of it.
const CONTRACTION: f64 = 2.0;
const CHANCE: f64 = 0.5;

/// Runs that are apart by more than ten times the extent have blown up.
const BLOWN_UP: f64 = 10.0;

/// The part of the accuracy that an estimate may use, and that the next run aims at.
const USABLE: f64 = 0.8;
const AIM: f64 = 0.5;

/// Steps that break down are made shorter so many times.
const RETRIES: u32 = 6;

/// The tolerance of DOP853's first run, in the accuracy asked for, and what it does not exceed. (Ten times less costs a third
/// more.)
const FIRST_TOLERANCE: f64 = 3.0;
const COARSEST: f64 = 0.1;

/// Below this runs differ by rounding.
const FINEST: f64 = 1e-14;

/// So many times in a row runs must say that no tolerance is enough.
const BLEAK: u32 = 2;

/// A step of DOP853 takes twelve evaluations and spans six radians of the fastest motion; a quarter more for rejected ones.
const DOP853_COST: f64 = 12.0 / 6.0 * 1.25;

/// What explicit answers are said to cost, in force evaluations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Price {
    /// A run of Verlet's method with the longest steps.
    pub verlet: f64,
    /// A run of DOP853, as far as stability decides.
    pub dop853: f64,
}

impl Price {
    pub fn of(rates: &Rates, duration: f64) -> Self {
        let verlet = (duration / (STABLE * rates.verlet_step())).max(FEWEST_STEPS);
        Self { verlet, dop853: DOP853_COST * duration * rates.radius() }
    }

    /// An answer of this accuracy, as a rule.
    pub fn answer(&self, accuracy: f64) -> f64 {
        if accuracy >= 2e-5 { (1.0 + FIRST_RATIO) * self.verlet } else { 1.6 * self.dop853(accuracy) }
    }

    /// A run of DOP853 that accuracy may decide about too: some fifteen steps for 1e-3.
    fn dop853(&self, accuracy: f64) -> f64 {
        self.dop853.max(150.0 * (1e-3 / accuracy).powf(0.125))
    }
}

/// What Verlet's method leaves to DOP853.
struct Extrapolated(Option<Course>);

/// An answer by explicit methods.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Verdict> {
    match verlet(search, price)? {
        Ok(verdict) => Ok(verdict),
        Err(Extrapolated(course)) => dop853(search, price, course),
    }
}

fn of(method: Method) -> Configuration {
    Configuration { method, options: ImplicitOptions::default() }
}

fn verlet<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<std::result::Result<Verdict, Extrapolated>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let too_dear = 0.9 * price.dop853(accuracy);
    let mut steps = price.verlet.ceil();
    let mut coarse: Option<(f64, Course)> = None;
    let mut history: Vec<f64> = Vec::new();
    let mut expected = None;
    let mut extrapolated = None;
    for failures in 0.. {
        // Between here and the next failure every run is compared with the one before.
        loop {
            search.left = (FIRST_RATIO * steps).max(2.0 * price.dop853(accuracy));
            if !search.affords(steps) {
                return Ok(Ok(Verdict::Unconfirmed("it would take too many steps".into())));
            }
            let fine = match search.run(of(Method::Verlet), Pace::Step(duration / steps), f64::INFINITY)? {
                Went::Well(course, _) => course,
                Went::Stopped => return Ok(Ok(Verdict::Interrupted)),
                Went::Wrong | Went::TooFar => break,
            };
            let Some((before, course)) = coarse.take() else {
                coarse = Some((steps, fine));
                steps = (FIRST_RATIO * steps).ceil();
                continue;
            };
            let gain = (steps / before).powi(2) - 1.0;
            let difference = search.difference(&fine, &course);
            let apart = difference.envelope();
            if apart > BLOWN_UP {
                break;
            }
            let estimate = match expected {
                None => UNPROVEN * apart / gain,
                Some(law) if apart <= CONTRACTION * law => PROVEN * apart.max(CHANCE * law) / gain,
                Some(_) => history.iter().fold(apart, |a, b| a.max(*b)) * PROVEN,
            };
            search.estimate(estimate);
            if estimate <= USABLE * accuracy {
                return Ok(Ok(Verdict::Confirmed));
            }
            history.push(apart);
            extrapolated = Some(fine.extrapolated(&course, 1.0 / gain));
            let next = (steps * (estimate / (AIM * accuracy)).sqrt().clamp(1.4, 64.0)).ceil();
            if next > too_dear || !next.is_finite() {
                return Ok(Err(Extrapolated(extrapolated)));
            }
            // The law: differences are C h² (1 − 1/r²).
            let share = |coarse: f64, fine: f64| coarse.powi(-2) - fine.powi(-2);
            expected = Some(apart * share(steps, next) / share(before, steps));
            coarse = Some((steps, fine));
            steps = next;
        }
        // Broken down: the fastest motion is faster than at the start.
        (coarse, expected) = (None, None);
        history.clear();
        steps = (1.5 * steps).ceil();
        if failures >= RETRIES {
            break;
        }
    }
    Ok(Err(Extrapolated(extrapolated)))
}

fn dop853<A: Audience>(search: &mut Search<'_, A>, price: Price, other: Option<Course>) -> Result<Verdict> {
    let (accuracy, duration, start) = (search.requirement.accuracy, search.task.duration, search.task.start.time);
    let mut tolerance = (FIRST_TOLERANCE * accuracy).min(COARSEST);
    let mut coarse: Option<(f64, Course)> = None;
    let mut history: Vec<f64> = Vec::new();
    let mut parting: Option<Parting> = None;
    let mut bleak = 0;
    let mut other = other;
    let mut failures = 0;
    loop {
        search.left = 1.5 * price.dop853(accuracy);
        let pace = Pace::Adaptive { rtol: tolerance, first_step: None };
        let (fine, Run { cost, .. }) = match search.run(of(Method::Dop853), pace, f64::INFINITY)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Verdict::Interrupted),
            Went::Wrong if failures < RETRIES => {
                failures += 1;
                tolerance *= 0.1;
                continue;
            }
            Went::Wrong => return Ok(Verdict::Unconfirmed("no run came to the end".into())),
            Went::TooFar => return Ok(Verdict::Unconfirmed("it would take too many steps".into())),
        };
        if let Some(other) = other.take().filter(|_| coarse.is_none()) {
            let apart = search.difference(&fine, &other).envelope();
            if apart <= USABLE * accuracy {
                search.estimate(apart);
                return Ok(Verdict::Confirmed);
            }
        }
        let mut next = 0.1 * tolerance;
        if let Some((before, course)) = coarse.take() {
            let difference = search.difference(&fine, &course);
            let apart = difference.envelope();
            // Errors are about in proportion to the tolerance; more than half of that decay must be seen, and no more than all.
            let least = history.iter().copied().reduce(f64::min);
            let ratio = tolerance / before;
            let (estimate, contracts) = match least {
                None => (apart, true),
                Some(least) if apart <= least * ratio.sqrt() => (apart.max(CHANCE * least * ratio) / PROVEN, true),
                Some(_) => (history.iter().fold(apart, |a, b| a.max(*b)) * PROVEN, false),
            };
            search.estimate(estimate);
            if estimate <= accuracy {
                return Ok(Verdict::Confirmed);
            }
            history.push(apart);
            // What does not contract yet says nothing about how far it has to go.
            let most = if contracts { 1e-2 } else { 0.1 };
            next = tolerance * (0.3 * accuracy / estimate).powf(1.1).clamp(most, 0.1);
            let parted = Parting::of(&difference, accuracy, tolerance, start);
            let outlook = parting.and_then(|before| parted.outlook(&before, duration));
            bleak = match outlook {
                Some(Outlook::Unpredictable(horizon)) => {
                    search.horizon = Some(horizon);
                    bleak + 1
                }
                Some(Outlook::Needs(_)) => {
                    search.horizon = None;
                    0
                }
                // Runs that say nothing take nothing back.
                None => 0,
            };
            if bleak >= BLEAK {
                return Ok(Verdict::Unconfirmed("the motion forgets how it began".into()));
            }
            parting = Some(parted);
        }
        if next < FINEST {
            return Ok(Verdict::Unconfirmed("runs differ by more than the accuracy down to rounding".into()));
        }
        if !search.affords(cost) {
            return Ok(Verdict::Unconfirmed("it would take too many steps".into()));
        }
        coarse = Some((tolerance, fine));
        tolerance = next;
    }
}
