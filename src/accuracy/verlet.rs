//! Answers by Verlet's method: it goes first, with the longest stable steps, and where it has to with shorter ones.
//!
//! **One run** is enough where what its steps [neglect](super::own) is far below the accuracy, and nothing [buckles](super::stability). Otherwise steps follow that
//! are 1.25 times shorter, or as much more as what is neglected asks for.
//!
//! **The law.** Its error is `C h²`, C a motion of its own. So the difference d of runs with steps h and h/r leaves `d/(r² − 1)`
//! of the finer one. Where that is too much, steps follow that are shorter by what the estimate says, each compared with the
//! one before. Of steps much shorter the difference shows the coarser run's error alone, and two runs could not disagree about the
//! finer one: a way that long is believed only where the third run is where it should be.
//!
//! **Whether it holds** two runs do not tell, three do: from the first two it follows where the third will be,
//!
//! ```text
//! x₃ = x₂ + (x₂ − x₁) (h₂² − h₃²)/(h₁² − h₂²).
//! ```
//!
//! Of fast vibrations whose phases are lost after `24/(ωh)²` radians the runs differ by as much as each of them errs, whatever their
//! steps, and differences that happen to have the right size point anywhere. By how much the third run strays from where it should be is
//! therefore a part of its estimate: of errors of one size A that know nothing of each other it is about `√6 A`, and seldom do all three err
//! by as much. Two runs that both have lost their phases may agree; their energy tells: a run errs by no less than a part of the vibrations
//! that its energy strays by.

use super::Pace;
use super::audience::Audience;
use super::believed::{CHANCE, RETRIES, astray};
use super::course::Course;
use super::own::Own;
use super::price::{FIRST_RATIO, Price, of};
use super::search::{Search, Verdict, Went};
use super::stability::is_stable;
use super::stiff::linear_options;
use crate::error::Result;
use crate::integrate::Method;

/// What the difference of a first pair is multiplied with, of which nothing shows yet that it follows the law. (Without it the ready column of 9 was
/// confirmed to one digit, and wrong by 1.2 of it.)
const UNPROVEN: f64 = 1.75;

/// What the larger of both is multiplied with where that agrees with what the finer run neglects, up to this factor, and what of that the error is as a rule.
const AGREED: f64 = 1.2;
const AGREE: f64 = 3.0;
const AS_A_RULE: f64 = 0.9;

/// The part of the accuracy that the second run is hoped to have, and by how much shorter its steps are at most: of what is far too much nothing is hoped.
const HOPED: f64 = 0.7;
const HOPED_FROM: f64 = 2.0;

/// One run says nothing of its error where it may grow by more than this power of e.
const GROWING: f64 = 12.0;

/// The part of the accuracy that an estimate may use. (With 0.8 the same eight of 6568 answers to random scenes are wrong, and
/// all cost a hundredth more.)
const USABLE: f64 = 0.9;

/// A difference is not believed above this many times what the law makes of the one before.
const CONTRACTION: f64 = 2.0;

/// What a run strays from where the law leads counts with this for its error, six tenths of `1/√6`. (With 0.22, six of 1011 answers of the study with 1e-4
/// are wrong instead of five.)
const STRAYED: f64 = 0.25;

/// The part of the vibrations that its energy strays by which a run errs by at least. (With the longest steps half of the study's runs err by as
/// much as they are, and nine of ten by more than a fifteenth.)
const VIBRATING: f64 = 0.01;

/// Steps become shorter by at least and at most this from run to run; longer ways are made in two.
const SHORTER: [f64; 2] = [1.4, 3.0];

/// Runs that are apart by more than ten times the extent have blown up.
const BLOWN_UP: f64 = 10.0;

/// The part of the accuracy that the next run aims at.
const AIM: f64 = 0.5;

/// Steps shorter than this from one run to the next are a long way.
const FAR: f64 = 2.5;

/// What ways that are made in two cost more.
const IN_TWO: f64 = 1.6;

/// What runs that do not follow the law are said to cost more: they are seldom the last.
const SELDOM_LAST: f64 = 3.0;

/// What Verlet's method leaves to DOP853: the motion without its leading error.
pub(super) struct Extrapolated(pub Option<Course>);

/// A run, and how many steps it had.
struct Ran {
    steps: f64,
    /// See [`Run::strayed`](super::search::Run::strayed).
    strayed: f64,
    own: Own,
    course: Course,
}

/// What the law says of the run to come: how far it will be from the one before, and where.
struct Expected {
    apart: f64,
    course: Course,
}

/// `h₁² − h₂²`, times the square of the duration.
fn share(coarse: f64, fine: f64) -> f64 {
    coarse.powi(-2) - fine.powi(-2)
}

/// What is believed by the first pair, of which the law makes so much.
fn unproven(law: f64, own: &Own) -> f64 {
    let agrees = law <= AGREE * own.neglected && own.neglected <= AGREE * law;
    let agreed = AGREED * own.way * law.max(AS_A_RULE * own.neglected);
    if agrees { agreed.min(UNPROVEN * law) } else { UNPROVEN * law }
}

/// How much shorter steps are after a run by itself.
fn second(own: &Own, accuracy: f64) -> f64 {
    let needed = (UNPROVEN * own.neglected / (HOPED * accuracy)).sqrt();
    if needed > HOPED_FROM { FIRST_RATIO } else { needed.max(FIRST_RATIO) }
}

/// With what an estimate is multiplied where steps have become so much shorter: `(h₁/h₂)² − 1`, in that of a way that is not long.
fn distrust(gain: f64) -> f64 {
    (gain / (FAR.powi(2) - 1.0)).max(1.0)
}

/// What the way to steps that are so much shorter will cost.
fn cost(steps: f64, shorter: f64, follows: bool) -> f64 {
    let [_, largest] = SHORTER;
    steps * shorter * if shorter > largest { IN_TWO } else { 1.0 } * if follows { 1.0 } else { SELDOM_LAST }
}

/// An answer, or what DOP853 may be compared with.
pub(super) fn answer<A: Audience>(
    search: &mut Search<'_, A>,
    price: Price,
) -> Result<std::result::Result<Verdict, Extrapolated>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let (too_dear, linear) = (price.dop853(accuracy), linear_options(search));
    let [least, largest] = SHORTER;
    let mut steps = price.verlet.ceil();
    let mut coarse: Option<Ran> = None;
    let mut history: Vec<f64> = Vec::new();
    let mut expected: Option<Expected> = None;
    let (mut extrapolated, mut is_smooth) = (None, true);
    for failures in 0.. {
        // Between here and the next failure every run is compared with the one before.
        loop {
            search.left = (FIRST_RATIO * steps).max(price.dop853(accuracy));
            if !search.affords(steps) {
                return Ok(Ok(Verdict::Unconfirmed("it would take too many steps".into())));
            }
            let fine = match search.run(of(Method::Verlet), Pace::Step(duration / steps), f64::INFINITY)? {
                Went::Well(course, run) => {
                    is_smooth &= !run.jumps;
                    Ran { steps, strayed: run.strayed, own: run.own, course }
                }
                Went::Stopped => return Ok(Ok(Verdict::Interrupted)),
                Went::Wrong | Went::TooFar => break,
            };
            let Some(before) = coarse.take() else {
                let own = fine.own.error.max(VIBRATING * fine.strayed);
                let may_suffice = is_smooth && own <= USABLE * accuracy;
                if may_suffice && is_stable(search, duration / GROWING, &linear, FIRST_RATIO * steps)? {
                    search.estimate(own);
                    return Ok(Ok(Verdict::Confirmed));
                }
                steps = (second(&fine.own, accuracy) * steps).ceil();
                coarse = Some(fine);
                continue;
            };
            let gain = (steps / before.steps).powi(2) - 1.0;
            // Errors made where forces jump do not follow the law. At kinks of prescribed paths steps end, and it holds.
            let believed = if is_smooth { gain } else { gain.min(1.0) };
            let apart = search.difference(&fine.course, &before.course).envelope();
            if apart > BLOWN_UP {
                break;
            }
            let mut strays = 0.0;
            // A long way is not believed to its end, unless it leads where it should.
            let mut distrust = distrust(gain);
            let follows = expected.as_ref().is_none_or(|law| apart <= CONTRACTION * law.apart);
            let by_law = match &expected {
                None if is_smooth => unproven(apart / believed, &fine.own),
                None => UNPROVEN * apart / believed,
                Some(law) if follows => {
                    strays = STRAYED * search.difference(&fine.course, &law.course).envelope();
                    distrust = 1.0;
                    apart.max(CHANCE * law.apart) / believed
                }
                Some(_) => astray(&history, apart),
            };
            let estimate = (by_law * distrust + strays).max(VIBRATING * fine.strayed);
            search.estimate(estimate);
            if estimate <= USABLE * accuracy {
                return Ok(Ok(Verdict::Confirmed));
            }
            history.push(apart);
            extrapolated = Some(fine.course.extrapolated(&before.course, 1.0 / gain));
            let needed = if expected.is_none() { UNPROVEN * apart / believed } else { by_law };
            let shorter = (needed / (AIM * accuracy)).sqrt().max(least);
            if cost(steps, shorter, follows) > too_dear || !shorter.is_finite() {
                return Ok(Err(Extrapolated(extrapolated)));
            }
            let shorter = if shorter > largest { shorter.sqrt().max(shorter / largest) } else { shorter };
            let next = (steps * shorter).ceil();
            let factor = share(steps, next) / share(before.steps, steps);
            let course = fine.course.extrapolated(&before.course, factor);
            expected = Some(Expected { apart: factor * apart, course });
            coarse = Some(fine);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Ways to steps up to 2.5 times shorter, of a gain of 5.25, are not long.
    #[test]
    fn long_ways_are_not_believed_to_their_end() {
        assert_eq!([0.5625, 5.25, 10.5, 15.75].map(distrust), [1.0, 1.0, 2.0, 3.0]);
    }

    fn own(neglected: f64, way: f64) -> Own {
        Own { neglected, way, error: f64::INFINITY }
    }

    /// Of a law of 1e-3 what two estimates agree on, up to three times, and what a long way may have magnified.
    #[test]
    fn a_pair_is_believed_more_where_the_run_agrees() {
        for (neglected, way, expected) in [
            (1e-3, 1.0, 1.2e-3),
            (1.2e-3, 1.0, 1.296e-3),
            (2.9e-3, 1.0, 1.75e-3),
            (1e-3, 1.4, 1.68e-3),
            (1e-3, 1.5, 1.75e-3),
            (0.33e-3, 1.0, 1.75e-3),
            (3.1e-3, 1.0, 1.75e-3),
            (f64::INFINITY, 1.0, 1.75e-3),
        ] {
            assert!((unproven(1e-3, &own(neglected, way)) / expected - 1.0).abs() < 1e-12, "{neglected} {way}");
        }
    }

    /// 1.75 times what is neglected is to be 0.7 of the accuracy.
    #[test]
    fn second_steps_are_as_short_as_is_hoped() {
        for (neglected, expected) in
            [(0.0, FIRST_RATIO), (0.6, FIRST_RATIO), (1.0, 2.5f64.sqrt()), (1.59, 1.993_74), (1.61, FIRST_RATIO)]
        {
            assert!((second(&own(neglected * 1e-3, 1.0), 1e-3) / expected - 1.0).abs() < 1e-5, "{neglected}");
        }
        assert_eq!(second(&own(f64::INFINITY, 1.0), 1e-3), FIRST_RATIO);
    }

    #[test]
    fn ways_cost_more_in_two_and_where_the_law_does_not_hold() {
        for (shorter, follows, expected) in
            [(2.0, true, 200.0), (3.0, true, 300.0), (5.0, true, 800.0), (2.0, false, 600.0), (5.0, false, 2400.0)]
        {
            assert_eq!(cost(100.0, shorter, follows), expected, "{shorter} {follows}");
        }
    }
}
