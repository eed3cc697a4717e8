//! Answers by DOP853 with steps of one length.
//!
//! The fastest vibration of a mass–spring system hardly changes as it moves, so that steps of one length are as good as any. Steps as long
//! as is stable, z = ωh = 5.4 for the fastest vibration, err by `7.5e-8 z⁸ = 8e-6` a radian in one of a third of its frequency: often
//! they have all the accuracy that is asked for. Steps that follow an error estimate take two to three times the work there, since
//! they guard in every step against what two runs show in the end.
//!
//! **Runs.** The first has the longest stable steps, or where more than four digits are asked for a little shorter ones: of errors that are far
//! too large one learns little. It is never the answer, and what is seen of it takes forces only in the last part of its way, where it is
//! compared. Each that follows has steps so much shorter as the estimates of the one before say, by the
//! eighth root, and 1.2 times at least. Errors of eighth order make caution cheap, twice the accuracy costs a tenth more, and a third run
//! costs far more than that: a twentieth of the accuracy is aimed at.
//!
//! **What is believed.** Where two runs differ by d, the finer one is believed to err by 0.7 d: that is its error where fast vibrations have
//! lost their phases in both. It is believed to err by less where d is what had to be expected:
//!
//! - at most twenty times the sum L₁ of the errors that the coarser run's N₁ steps have [estimated of
//!   themselves](crate::integrate::Dop853): then those estimates miss nothing that this motion magnifies. Errors grow on the way by
//!   `g = d/L₁`, and the finer run errs by about `g L₂`, or by the law of eighth order `d (N₁/N₂)⁸`; three times the larger is believed, with a g of
//!   0.1 at least. (Of the study's runs with L below 10⁻⁵ half err by at most L, and nine of ten by twice that.)
//! - at most four times what the law made of the difference before. Then four times what it makes of this one is believed.
//!
//! A fifth of the accuracy asked for must be left.
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
use super::attempt::Purpose;
use super::audience::Audience;
use super::believed::USABLE;
use super::course::Course;
use super::price::{DOP853_ANSWER, DOP853_STEP, Price, of};
use super::search::{Run, Search, Verdict, Went};
use super::verlet::Extrapolated;
use crate::error::Result;
use crate::integrate::Method;

/// The part of a difference that the finer run errs by where fast vibrations have lost their phases in both.
const OUT_OF_PHASE: f64 = 0.7;

/// What died out is multiplied with this.
const CAUTION: f64 = 1.5;

/// Vibrations of so many radians a step, and more, die out.
const RADIANS: f64 = 3.0;

/// What local errors say of the finer run is multiplied with this.
const SAFETY: f64 = 3.0;

/// The least growth that is believed: local errors are estimated too large where they are tiny.
const LEAST_GROWTH: f64 = 0.1;

/// A difference follows the law up to this factor; then the finer run errs by at least the second part of it.
const FOLLOWS: f64 = 4.0;
const CHANCE: f64 = 0.1;

/// Steps become shorter by at least and at most this, and by at least the third where vibrations have died out.
const SHORTER: [f64; 2] = [1.2, 3.5];
const SHORTER_WHERE_DEAD: f64 = 1.5;

/// The part of the accuracy that the next run aims at.
const AIM: f64 = 0.05;

/// Where steps would have to be so many times shorter than is stable, for three digits, they had better follow an error estimate; and by what
/// power of the accuracy they may be shorter for more.
const SHORTEST: f64 = 4.0;
const SHORTER_FOR_MORE: f64 = 0.1;

/// From this accuracy on the first steps are shorter than is stable, by this power of what is finer.
const MANY_DIGITS: f64 = 1e-4;
const FIRST_SHORTER: f64 = 0.05;

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

/// What is known of one run beside its course. Errors are relative to the extent.
#[derive(Debug, Clone, Copy)]
struct Ran {
    /// N.
    steps: f64,
    /// L.
    local_errors: f64,
    /// See [`Run::strayed`].
    strayed: f64,
    /// What the difference from the run before shows.
    shown: Option<Shown>,
}

/// What the difference of two runs shows of the finer one.
#[derive(Debug, Clone, Copy)]
struct Shown {
    /// d.
    apart: f64,
    /// `d (N₁/N₂)⁸`.
    law: f64,
    /// `d/L₁`.
    growth: f64,
    /// What is believed of its error as far as the runs could disagree about it.
    disagreed: f64,
    /// What died out in both.
    died_out: f64,
}

impl Ran {
    /// That this run is `apart` from a coarser one.
    fn shows(&self, coarse: &Self, apart: f64) -> Shown {
        let law = apart * (coarse.steps / self.steps).powi(8);
        let growth = apart / coarse.local_errors;
        let expected = if coarse.shown.is_some_and(|before| apart <= FOLLOWS * before.law) {
            (FOLLOWS * law).max(CHANCE * apart)
        } else if growth <= MAGNIFIED {
            SAFETY * law.max(growth.max(LEAST_GROWTH) * self.local_errors)
        } else {
            f64::INFINITY
        };
        let disagreed = expected.min(OUT_OF_PHASE * apart);
        let died_out = CAUTION * self.local_errors.min(self.strayed / RADIANS);
        Shown { apart, law, growth, disagreed, died_out }
    }

    /// Whether steps of one length are not the reason for its error, or not alone.
    fn is_uneven(&self, before: &Self) -> bool {
        self.shown.is_some_and(|shown| {
            let stays = before.shown.is_some_and(|before| shown.apart > CONTRACTION * before.apart);
            shown.growth > MAGNIFIED || (stays && shown.died_out < shown.disagreed)
        })
    }

    /// How much shorter the steps of the next run are.
    fn shorter(&self, accuracy: f64) -> f64 {
        let [least, most] = SHORTER;
        let (expected, least) = match self.shown {
            None => (self.local_errors, least),
            Some(Shown { law, died_out, disagreed, .. }) if died_out > disagreed => {
                (law + died_out, SHORTER_WHERE_DEAD)
            }
            Some(Shown { law, died_out, disagreed, .. }) => (law.min(disagreed) + died_out, least),
        };
        (expected / (AIM * accuracy)).powf(0.125).clamp(least, most)
    }
}

impl Shown {
    fn error(&self) -> f64 {
        self.disagreed + self.died_out
    }
}

/// An answer, or what other runs may be compared with: what went before these. Of a motion that is not for equal steps their runs prove nothing.
pub(super) fn answer<A: Audience>(
    search: &mut Search<'_, A>,
    price: Price,
    other: Option<Course>,
) -> Result<std::result::Result<Verdict, Extrapolated>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let most_steps = (SHORTEST * price.steps * (1e-3 / accuracy).max(1.0).powf(SHORTER_FOR_MORE)).max(FEW_STEPS);
    let mut steps = (price.steps * (MANY_DIGITS / accuracy).max(1.0).powf(FIRST_SHORTER)).ceil();
    let (mut other, mut coarse): (Option<Course>, Option<(Ran, Course)>) = (other, None);
    let mut breakdowns = 0;
    loop {
        let cost = DOP853_STEP * steps;
        search.left = DOP853_ANSWER * cost;
        if steps > most_steps || breakdowns > MOST_BREAKDOWNS || !search.affords(cost) {
            return Ok(Err(Extrapolated(other)));
        }
        let pace = Pace::Step(duration / steps);
        let purpose = if coarse.is_none() { Purpose::Comparison } else { Purpose::Answer };
        let (course, run) = match search.run_for(purpose, of(Method::Dop853), pace, f64::INFINITY)? {
            Went::Well(course, run) => (course, run),
            Went::Stopped => return Ok(Ok(Verdict::Interrupted)),
            Went::TooFar => return Ok(Err(Extrapolated(None))),
            Went::Wrong => {
                breakdowns += 1;
                coarse = None;
                steps = (AFTER_BREAKDOWN * steps).ceil();
                continue;
            }
        };
        let Run { local_errors, strayed, jumps, .. } = run;
        if jumps || local_errors > HOPELESS {
            return Ok(Err(Extrapolated(other)));
        }
        let mut fine = Ran { steps, local_errors, strayed, shown: None };
        if let Some((before, coarser)) = &coarse {
            let shown = fine.shows(before, search.difference(&course, coarser).envelope());
            search.estimate(shown.error());
            if shown.error() <= USABLE * accuracy {
                return Ok(Ok(Verdict::Confirmed));
            }
            fine.shown = Some(shown);
            if fine.is_uneven(before) {
                return Ok(Err(Extrapolated(None)));
            }
        }
        steps = (fine.shorter(accuracy) * steps).ceil();
        (coarse, other) = (Some((fine, course)), None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ran(steps: f64, local_errors: f64, strayed: f64) -> Ran {
        Ran { steps, local_errors, strayed, shown: None }
    }

    fn is_close(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 1e-12
    }

    /// Twice as many steps leave 1/256 by the law, and here 1/100 by their own estimates.
    #[test]
    fn differences_that_were_expected_leave_little() {
        let (coarse, fine) = (ran(100.0, 1e-3, 0.0), ran(200.0, 1e-5, 0.0));
        let shown = fine.shows(&coarse, 2e-3);
        assert!(is_close(shown.law, 2e-3 / 256.0) && is_close(shown.growth, 2.0));
        assert!(is_close(shown.error(), 3.0 * 2.0 * 1e-5), "{shown:?}");
        // Much larger ones were not, and of smaller ones local errors are left.
        for (apart, error) in
            [(21e-3, 0.7 * 21e-3), (20e-3, 3.0 * 20.0 * 1e-5), (1e-4, 3e-6), (2e-5, 3e-6), (2e-6, 0.7 * 2e-6)]
        {
            assert!(is_close(fine.shows(&coarse, apart).error(), error), "{apart}");
        }
        // The law, where it says more than those.
        let modest = ran(110.0, 1e-9, 0.0);
        assert!(is_close(modest.shows(&coarse, 1e-3).error(), 0.7e-3));
        let finer = ran(150.0, 1e-9, 0.0);
        assert!(is_close(finer.shows(&coarse, 1e-3).error(), 3.0 * 1e-3 * (2.0f64 / 3.0).powi(8)));
        // With the law seen to hold once, four times what it leaves, and no less than a tenth.
        let finer = ran(300.0, 1e-9, 0.0);
        let before = Ran { shown: Some(shown), local_errors: 1e-6, ..fine };
        let apart = 3.9 * shown.law;
        assert!(is_close(finer.shows(&before, apart).error(), 4.0 * apart * (200.0f64 / 300.0).powi(8)));
        assert!(is_close(ran(400.0, 1e-9, 0.0).shows(&before, apart).error(), 0.1 * apart));
        assert!(is_close(finer.shows(&before, 4.1 * shown.law).error(), 0.7 * 4.1 * shown.law));
    }

    /// Runs may agree to rounding: what died out in both counts, by the lesser of its two bounds, and the next steps are much shorter.
    #[test]
    fn what_died_out_counts_where_runs_agree() {
        let coarse = ran(100.0, 1e-5, 3e-6);
        for (local_errors, strayed, error) in [(1e-5, 3e-6, 1.5e-6), (4e-7, 3e-6, 6e-7)] {
            let mut fine = ran(120.0, local_errors, strayed);
            let shown = fine.shows(&coarse, 1e-15);
            assert!((shown.error() / error - 1.0).abs() < 1e-8, "{shown:?}");
            fine.shown = Some(shown);
            assert!(fine.shorter(1e-5) == SHORTER_WHERE_DEAD && !fine.is_uneven(&coarse));
        }
    }

    #[test]
    fn motions_that_magnify_errors_are_not_for_equal_steps() {
        let (coarse, mut fine, mut finer) = (ran(100.0, 1e-6, 0.0), ran(120.0, 1e-7, 0.0), ran(150.0, 1e-8, 0.0));
        fine.shown = Some(fine.shows(&coarse, 1.9e-5));
        assert!(!fine.is_uneven(&coarse));
        // Runs that do not come nearer to each other.
        finer.shown = Some(Shown { growth: 1.0, ..finer.shows(&fine, 1e-5) });
        assert!(finer.is_uneven(&fine));
        finer.shown = Some(Shown { growth: 1.0, ..finer.shows(&fine, 9e-6) });
        assert!(!finer.is_uneven(&fine));
        fine.shown = Some(fine.shows(&coarse, 2.1e-5));
        assert!(fine.is_uneven(&coarse));
    }

    /// At the borders themselves.
    #[test]
    fn borders_belong_to_what_is_believed() {
        let coarse = ran(100.0, 1e-6, 0.0);
        let shown = Shown { apart: 1e-5, law: 1e-6, growth: MAGNIFIED, disagreed: 1e-7, died_out: 1e-7 };
        let with = |shown: Shown| Ran { shown: Some(shown), ..ran(120.0, 1e-7, 0.0) };
        let before = with(Shown { apart: 2e-5, ..shown });
        // Magnified by just as much; half as far apart, which is just enough; and as much died out as was seen.
        assert!(!with(Shown { died_out: 0.0, ..shown }).is_uneven(&coarse));
        assert!(!with(Shown { died_out: 0.0, ..shown }).is_uneven(&before));
        assert!(!with(Shown { apart: 2e-5, ..shown }).is_uneven(&before));
        assert!(with(Shown { apart: 2e-5, died_out: 9e-8, ..shown }).is_uneven(&before));
        let shorter =
            |died_out: f64, disagreed: f64, accuracy| with(Shown { died_out, disagreed, ..shown }).shorter(accuracy);
        assert_eq!(shorter(1e-7, 1e-7, 1.0), SHORTER[0]);
        assert_eq!(shorter(2e-7, 1e-7, 1.0), SHORTER_WHERE_DEAD);
        // Of what the law leaves, one part in a million, and as much that died out.
        assert!(is_close(shorter(1e-6, 1e-7, 2e-6 / AIM / 50.0), 50f64.powf(0.125)));
    }
}
