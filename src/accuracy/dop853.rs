//! Answers by DOP853 with steps that follow an error estimate, for motions too uneven for steps of [one length](super::equal). Its first run is
//! compared with the extrapolation of Verlet's pair, which errs for other reasons; further ones have smaller tolerances.
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

/// What the difference of a first pair is multiplied with where forces jump on the way. Elsewhere it counts in full: errors in proportion to the
/// tolerances would leave a tenth of it, but where a motion magnifies them the finer run may err by as much as the other. (A ready chain of ten links
/// did, and half of the difference confirmed one digit that it did not have.)
const JUMPED: f64 = 3.0;

/// So many times in a row runs must say that no tolerance is enough.
const BLEAK: u32 = 2;

/// The first step spans so many radians of the fastest motion with a tolerance of one, and at most this part of the run.
const FIRST_STEP: f64 = 3.0;
const FIRST_PART: f64 = 0.1;

/// An answer.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price, other: Option<Course>) -> Result<Verdict> {
    let (accuracy, duration, start) = (search.requirement.accuracy, search.task.duration, search.task.start.time);
    let mut tolerance = (FIRST_TOLERANCE * accuracy).min(COARSEST);
    let mut coarse: Option<(f64, Course)> = None;
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
        let (fine, Run { cost, jumps, .. }) = match search.run(of(Method::Dop853), pace, f64::INFINITY)? {
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
        if let Some((before, course)) = coarse.take() {
            let difference = search.difference(&fine, &course);
            let apart = difference.envelope();
            let (estimate, contracts) = estimate(&history, apart, tolerance / before, jumps);
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

#[cfg(test)]
mod tests {
    use super::estimate;

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
