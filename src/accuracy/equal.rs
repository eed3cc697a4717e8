//! Answers by DOP853 with steps of one length.
//!
//! The fastest vibration of a mass–spring system hardly changes as it moves, so that steps of one length are as good as any. Steps as long
//! as is stable, z = ωh = 5.4 for the fastest vibration, err by `7.5e-8 z⁸ = 8e-6` a radian in one of a third of its frequency: often
//! they have all the accuracy that is asked for. Steps that follow an error estimate take two to three times the work there, since
//! they guard in every step against what two runs show in the end.
//!
//! **Runs.** The first has the longest stable steps. Each that follows has steps so much shorter as the estimates of the one before say, by the
//! eighth root, and 1.2 times at least. Errors of eighth order make caution cheap: twice the accuracy costs a tenth more.
//!
//! **What is believed.** Where two runs differ by d, the finer one is believed to err by 0.7 d: that is its error where fast vibrations have
//! lost their phases in both. It is believed to err by less where d is what had to be expected:
//!
//! - about the sum L₁ of the errors that the coarser run's N₁ steps have [estimated of themselves](crate::integrate::Dop853). Then those
//!   estimates are right for this motion, and errors grow on the way by `d/L₁`. The finer run errs by about `L₂ d/L₁`, or by the
//!   law of eighth order `d (N₁/N₂)⁸`; five times the larger of both is believed.
//! - at most twice what the law made of the difference before. Then twice what it makes of this one is believed.
//!
//! Half of the accuracy asked for must be left.
//!
//! **What no difference shows.** Vibrations of more than about three radians a step die out in long steps, |R(iz)| being 0.9985, 0.93 and 0.70
//! at z = 3, 4.5 and 5.5. Two runs without them agree. But their energy E is missing in the [ledger](crate::integrate::Balance): it was that of an
//! amplitude `√(2E/m̄)/ω` with `ω ≥ 3/h`. What a run lost is also at most what its steps have estimated of their errors. One and a half times
//! the lesser of the two is added to what is believed of the difference. (Damping takes energy too, and the ledger's account
//! of that is rough in long steps; the second bound is the better one then.)
//!
//! Where six digits would take steps five times shorter than is stable, errors are so large that they say nothing, or the motion magnifies
//! them, it is not as even as that: steps had better follow [an error estimate](super::dop853).

use super::Pace;
use super::audience::Audience;
use super::believed::USABLE;
use super::course::Course;
use super::price::{DOP853_STEP, Price, of};
use super::search::{Run, Search, Verdict, Went};
use crate::error::Result;
use crate::integrate::Method;

/// A difference is multiplied with this.
const LOST: f64 = 0.7;

/// What vanished is multiplied with this.
const DAMPED: f64 = 1.5;

/// Radians of vibrations that may vanish in a step.
const LOST_RADIANS: f64 = 3.0;

/// The first difference is that of the estimates up to this factor, and what then follows for the finer run is multiplied with it.
const AGREE: f64 = 5.0;

/// A difference follows the law up to this factor; then that leaves of it at least this part.
const FOLLOWS: f64 = 2.0;
const CHANCE: f64 = 0.1;

/// The part of the accuracy that an estimate may use: some of the study's scenes amplify what both runs have wrong.
const USABLE_PART: f64 = 0.5;

/// Steps become shorter by at least and at most this, and by at least the third where vibrations have vanished.
const SHORTER: [f64; 2] = [1.2, 2.5];
const SHORTER_WHERE_LOST: f64 = 1.5;

/// The part of the accuracy that the next run aims at.
const AIM: f64 = 0.3;

/// Where steps would have to be so many times shorter than is stable, for three digits, they had better follow an error estimate; and by what
/// power of the accuracy they may be shorter for more.
const SHORTEST: f64 = 2.5;
const SHORTER_FOR_MORE: f64 = 0.1;

/// So many steps may be tried in any case.
const FEW_STEPS: f64 = 24.0;

/// Motions that magnify errors by more than this forget how they began, or have moments that steps of one length miss.
const MAGNIFIED: f64 = 20.0;

/// Differences of further runs become smaller by this at least, where it is the steps that they come from.
const CONTRACTION: f64 = 0.5;

/// Errors that say nothing any more.
const HOPELESS: f64 = 0.3;

/// Breakdowns, and by how much steps are shorter after one.
const MOST_BREAKDOWNS: u32 = 3;
const AFTER_BREAKDOWN: f64 = 1.2;

/// One run.
struct Ran {
    steps: f64,
    course: Course,
    local_errors: f64,
    /// Its difference from the run before, and what the law makes of that.
    apart: Option<[f64; 2]>,
}

/// What steps of one length leave to others: what went before them. Of a motion that is not for them their own runs prove nothing.
pub(super) struct Left(pub Option<Course>);

/// An answer, or what other runs may be compared with.
pub(super) fn answer<A: Audience>(
    search: &mut Search<'_, A>,
    price: Price,
    other: Option<Course>,
) -> Result<std::result::Result<Verdict, Left>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let [least, most] = SHORTER;
    let mut steps = price.steps;
    let most_steps = (SHORTEST * steps * (1e-3 / accuracy).max(1.0).powf(SHORTER_FOR_MORE)).max(FEW_STEPS);
    let (mut other, mut coarse): (Option<Course>, Option<Ran>) = (other, None);
    let mut breakdowns = 0;
    loop {
        let cost = DOP853_STEP * steps;
        search.left = 2.2 * cost;
        if steps > most_steps || breakdowns > MOST_BREAKDOWNS || !search.affords(cost) {
            return Ok(Err(Left(other)));
        }
        let pace = Pace::Step(duration / steps);
        let (course, run) = match search.run(of(Method::Dop853), pace, f64::INFINITY)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Ok(Verdict::Interrupted)),
            Went::TooFar => return Ok(Err(Left(None))),
            Went::Wrong => {
                breakdowns += 1;
                coarse = None;
                steps = (AFTER_BREAKDOWN * steps).ceil();
                continue;
            }
        };
        let Run { local_errors, strayed, jumps, .. } = run;
        if jumps || local_errors > HOPELESS {
            return Ok(Err(Left(other)));
        }
        let mut fine = Ran { steps, course, local_errors, apart: None };
        let (expected, is_lost) = match &coarse {
            None => {
                let apart = other.take().map(|other| search.difference(&fine.course, &other).envelope());
                if let Some(apart) = apart.filter(|apart| *apart <= USABLE * accuracy) {
                    search.estimate(apart);
                    return Ok(Ok(Verdict::Confirmed));
                }
                (local_errors, false)
            }
            Some(coarse) => {
                let apart = search.difference(&fine.course, &coarse.course).envelope();
                let law = (coarse.steps / fine.steps).powi(8) * apart;
                fine.apart = Some([apart, law]);
                let known = apart / coarse.local_errors;
                let differs = if coarse.apart.is_some_and(|[_, law]| apart <= FOLLOWS * law) {
                    (FOLLOWS * law).max(CHANCE * apart).min(LOST * apart)
                } else if (1.0 / AGREE..=AGREE).contains(&known) {
                    (AGREE * law.max(known * fine.local_errors)).min(LOST * apart)
                } else {
                    LOST * apart
                };
                let lost = DAMPED * fine.local_errors.min(strayed / LOST_RADIANS);
                search.estimate(differs + lost);
                if differs + lost <= USABLE_PART * accuracy {
                    return Ok(Ok(Verdict::Confirmed));
                }
                let stays = coarse.apart.is_some_and(|[before, _]| apart > CONTRACTION * before);
                if known > MAGNIFIED || (stays && lost < differs) {
                    return Ok(Err(Left(None)));
                }
                (law + lost, lost > differs)
            }
        };
        let least = if is_lost { SHORTER_WHERE_LOST } else { least };
        let shorter = (expected / (AIM * accuracy)).powf(0.125).clamp(least, most);
        steps = (shorter * steps).ceil();
        coarse = Some(fine);
    }
}
