//! Answers by DOP853 with steps that follow an error estimate, for motions too uneven for steps of [one length](super::equal). Its first run is
//! compared with the extrapolation of Verlet's pair, which errs for other reasons; further ones have smaller tolerances.
//!
//! **What is believed.** Two runs differ by what the coarser one errs by, and of the finer one that says little. But the steps of both estimate their own
//! errors, L₁ and L₂ added up, and as long as deviations are small a motion magnifies them alike, whatever the tolerance: by some hundreds
//! in scenes that fold, in one run as in the next. So where runs differ by d the finer one errs by about `d L₂/L₁`; three times that is believed, and
//! no less than a tenth of d.
//!
//! Every run begins with a step that its tolerance decides about. Where all of them began with the same step they would share its error,
//! which a motion that amplifies can make the largest of all, and agree on it.

use super::Pace;
use super::audience::Audience;
use super::believed::{CHANCE, RETRIES, USABLE, astray};
use super::course::Course;
use super::horizon::{Outlook, Parting};
use super::price::{Price, of};
use super::search::{Run, Search, Verdict, Went};
use crate::error::Result;
use crate::integrate::Method;

/// The tolerance of the first run, in the accuracy asked for, and what it does not exceed. (Ten times less costs a third more.)
const FIRST_TOLERANCE: f64 = 10.0;
const COARSEST: f64 = 0.1;

/// From the tolerance of the first run to the next: far enough that errors which both share do not pass for small ones.
const NEXT: f64 = 0.03;

/// Below this runs differ by rounding.
const FINEST: f64 = 1e-14;

/// What one that contracts is multiplied with.
const PROVEN: f64 = 2.0 / 3.0;

/// What the difference of a first pair is multiplied with where forces jump on the way. Elsewhere it counts in full, unless runs are [near](NEAR): errors
/// in proportion to the tolerances would leave a tenth of it, but where a motion magnifies them the finer run may err by as much as the other. (A ready
/// chain of ten links did, and half of the difference confirmed one digit that it did not have.)
const JUMPED: f64 = 3.0;

/// Deviations below this, in extents, grow in proportion. (With a tenth of the extent two of 10690 answers more are wrong, by 1.4 and 1.6.)
const NEAR: f64 = 0.01;

/// What the coarser run's errors say of the finer one is multiplied with this, and is at least this part of the difference.
const GROWN: f64 = 3.0;
const LEAST_GROWN: f64 = 0.1;

/// The part of the accuracy that the next run aims at.
const AIM: f64 = 0.5;

/// So many times in a row runs must say that no tolerance is enough.
const BLEAK: u32 = 2;

/// The first step spans so many radians of the fastest motion with a tolerance of one, and at most this part of the run.
const FIRST_STEP: f64 = 3.0;
const FIRST_PART: f64 = 0.1;

/// A run, and what its steps have estimated of their errors, relative to the extent.
struct Ran {
    tolerance: f64,
    local_errors: f64,
    course: Course,
}

/// An answer.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price, other: Option<Course>) -> Result<Verdict> {
    let (accuracy, duration, start) = (search.requirement.accuracy, search.task.duration, search.task.start.time);
    let mut tolerance = (FIRST_TOLERANCE * accuracy).min(COARSEST);
    let mut coarse: Option<Ran> = None;
    let mut history: Vec<f64> = Vec::new();
    let mut parting: Option<Parting> = None;
    let mut bleak = 0;
    let mut other = other;
    let mut failures = 0;
    loop {
        search.left = price.dop853(accuracy);
        // Of eighth order.
        let first_step = (FIRST_STEP / price.radius * tolerance.powf(0.125)).min(FIRST_PART * duration);
        let pace = Pace::Adaptive { rtol: tolerance, first_step: Some(first_step) };
        let (fine, Run { cost, jumps, local_errors, .. }) = match search.run(of(Method::Dop853), pace, f64::INFINITY)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Verdict::Interrupted),
            Went::Wrong if failures < RETRIES => {
                failures += 1;
                tolerance *= 0.1;
                continue;
            }
            Went::Wrong => return Ok(Verdict::Unconfirmed("no run that could confirm it came to the end".into())),
            Went::TooFar => return Ok(Verdict::Unconfirmed("it would take too many steps".into())),
        };
        if let Some(other) = other.take().filter(|_| coarse.is_none()) {
            let apart = search.difference(&fine, &other).envelope();
            if apart <= USABLE * accuracy {
                search.estimate(apart);
                return Ok(Verdict::Confirmed);
            }
        }
        let mut next = NEXT * tolerance;
        if let Some(before) = coarse.take() {
            let difference = search.difference(&fine, &before.course);
            let apart = difference.envelope();
            let (seen, contracts) = estimate(&history, apart, tolerance / before.tolerance, jumps);
            let grows_alike = contracts && !jumps;
            let estimate = if grows_alike { seen.min(grown(apart, [before.local_errors, local_errors])) } else { seen };
            search.estimate(estimate);
            if estimate <= accuracy {
                return Ok(Verdict::Confirmed);
            }
            history.push(apart);
            // What does not contract yet says nothing about how far it has to go.
            let most = if contracts { 1e-2 } else { 0.1 };
            next = tolerance * (AIM * accuracy / estimate).powf(1.1).clamp(most, 0.1);
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
        coarse = Some(Ran { tolerance, local_errors, course: fine });
        tolerance = next;
    }
}

/// What two runs that are so far apart say of the finer one's error, and whether they have come nearer as they should: after earlier
/// differences, the tolerance being that part of the one before.
fn estimate(history: &[f64], apart: f64, ratio: f64, jumps: bool) -> (f64, bool) {
    // Errors are about in proportion to the tolerance; more than half of that decay must be seen, and no more than all.
    match history.iter().copied().reduce(f64::min) {
        None => (if jumps { JUMPED * apart } else { apart }, true),
        Some(least) if apart <= least * ratio.sqrt() => (PROVEN * apart.max(CHANCE * least * ratio), true),
        Some(_) => (astray(history, apart), false),
    }
}

/// What the finer of two runs errs by that are so far apart, where errors of both grow alike.
fn grown(apart: f64, [coarse, fine]: [f64; 2]) -> f64 {
    let is_told = apart <= NEAR && coarse.is_normal() && fine.is_finite();
    if is_told { apart * (GROWN * fine / coarse).max(LEAST_GROWN) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::{NEAR, estimate, grown};

    /// A hundredth of the local errors leaves a tenth of the difference, a twentieth three twentieths; where they say nothing, or where runs are far
    /// apart, nothing is believed.
    #[test]
    fn small_errors_grow_alike() {
        for (apart, errors, expected) in [
            (1e-3, [1e-5, 1e-7], 1e-4),
            (1e-3, [1e-5, 5e-7], 1.5e-4),
            (NEAR, [1e-7, 1e-7], 3.0 * NEAR),
            (1e-3, [1e-5, 0.0], 1e-4),
            (0.0, [1e-5, 1e-7], 0.0),
        ] {
            assert!((grown(apart, errors) - expected).abs() <= 1e-12 * expected, "{apart} {errors:?}");
        }
        for (apart, errors) in
            [(1.01 * NEAR, [1e-5, 1e-7]), (1e-3, [0.0, 0.0]), (1e-3, [f64::INFINITY; 2]), (f64::NAN, [1e-5, 1e-7])]
        {
            assert_eq!(grown(apart, errors), f64::INFINITY);
        }
    }

    /// A first difference counts in full, or three times where forces jump. From a tolerance to a sixteenth of it differences should fall to a
    /// quarter at least; what has fallen by more than the tolerance counts for half of that. Otherwise the largest so far counts, and half again.
    #[test]
    fn differences_count_for_what_they_show() {
        for (history, apart, jumps, expected) in [
            (&[][..], 8.0, false, (8.0, true)),
            (&[], 8.0, true, (24.0, true)),
            (&[96.0, 48.0], 12.0, false, (8.0, true)),
            (&[96.0, 48.0], 12.0, true, (8.0, true)),
            (&[48.0, 96.0], 0.75, false, (1.0, true)),
            (&[48.0, 96.0], 12.5, false, (144.0, false)),
            (&[48.0, 96.0], 100.0, true, (150.0, false)),
        ] {
            assert_eq!(estimate(history, apart, 1.0 / 16.0, jumps), expected, "{history:?} {apart}");
        }
    }
}
