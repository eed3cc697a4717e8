//! Answers for motions whose fast part displaces nothing: bodies that creep, settle or hang still, however stiff their springs are. A few long
//! implicit steps follow them, where explicit ones would have to follow vibrations that are not there.
//!
//! Long steps that damp what they do not resolve agree on a motion without it. So they are not even tried before that is known
//! to be right: what [they do not resolve](super::resolution) has a small amplitude, that of kinks of prescribed paths included, and pushes little,
//! and no compressed spring makes the state unstable within a step, which long implicit steps would calm as they calm everything. Where one does,
//! steps of half the length are thought of, as long as they pay. Then runs of the second-order backward differentiation formula follow. The first is enough
//! where what its steps [neglect](super::own) is far below the accuracy. By its order the difference d of two with steps h and h/r leaves `d/(r² − 1)` of the
//! finer one. Three times that is believed, and what is left out beside; the next has steps so much shorter that it will do by the same law, as long as that
//! costs less than half of an explicit answer.

use super::attempt::Task;
use super::audience::Audience;
use super::course::Course;
use super::price::Price;
use super::resolution::{Unresolved, unresolved};
use super::search::{Run, Search, Verdict, Went};
use super::stability::{LARGEST, is_stable};
use super::stiff::linear_options;
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method};
use nalgebra::Vector3;

/// Steps of the first two runs, where no spring asks for more.
const STEPS: [f64; 2] = [6.0, 12.0];

/// How many times the price of the first two runs an explicit answer must have, for them to be tried, to one digit; and by what power of the accuracy
/// more for more digits, for which what is fast seldom is slight enough.
const WORTH: f64 = 2.0;
const MORE_DIGITS: f64 = 0.12;

/// The part of what an explicit answer costs that a run may.
const RUN_PART: f64 = 0.5;

/// What the law makes of a difference is multiplied with this.
const SAFETY: f64 = 3.0;

/// The part of the accuracy that an estimate may use, and the part that the next run aims at.
const USABLE: f64 = 0.9;
const AIM: f64 = 0.5;

/// Steps become shorter by at most this from run to run: of much shorter ones a difference says little.
const SHORTER: f64 = 3.0;

/// What cannot be resolved may have this part of the accuracy, and what it pushes may drift by that one. (A motion may amplify both: in 1500 random scenes
/// one answer that leaves something out is wrong, by 1.5. With twice the amplitude two are, by as much, and with twice the drift two, by up to 8.)
const UNRESOLVED: f64 = 0.5;
const DRIFTING: f64 = 0.7;

/// Of each kink of a path it is looked for what it sets off, which costs several solves.
const MOST_KINKS: usize = 4;

/// An answer, or `None` where other methods are to find one.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Option<Verdict>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let (system, start, costs) = (search.task.system, search.task.start, search.task.costs);
    let explicit = price.answer(accuracy);
    let step = 2.0 + costs.assembly() + costs.least_factorization() + costs.least_direct_solve();
    let worth = WORTH * (0.1 / accuracy).powf(MORE_DIGITS);
    if search.task.kinks().nth(MOST_KINKS).is_some() || system.dofs().len() > LARGEST {
        return Ok(None);
    }
    search.left = explicit;
    let linear = linear_options(search);
    let [mut first, mut second] = STEPS;
    loop {
        if explicit <= worth * (first + second) * step {
            return Ok(None);
        }
        if is_stable(search, duration / second, &linear, explicit)? {
            break;
        }
        [first, second] = [2.0 * first, 2.0 * second];
    }
    let harmless = Unresolved { amplitude: UNRESOLVED * accuracy, drift: DRIFTING * accuracy };
    let spans = [duration / second, duration];
    let (left, cost) = unresolved(system, start, spans, &jumps(search.task), &harmless, &linear, &costs)?;
    search.spend(cost);
    if !left.is_within(&harmless) {
        return Ok(None);
    }
    let configuration =
        Configuration { method: Method::Bdf2, options: ImplicitOptions { linear, ..Default::default() } };
    let mut coarse: Option<(Course, f64)> = None;
    let mut steps = first;
    loop {
        let (fine, Run { cost, own, .. }) =
            match search.run(configuration, Pace::Step(duration / steps), RUN_PART * explicit)? {
                Went::Well(course, run) => (course, run),
                Went::Stopped => return Ok(Some(Verdict::Interrupted)),
                Went::Wrong | Went::TooFar => return Ok(None),
            };
        let mut next = second;
        if coarse.is_none() && own.error + left.amplitude <= USABLE * accuracy {
            search.estimate(own.error + left.amplitude);
            return Ok(Some(Verdict::Confirmed));
        }
        if let Some((coarse, before)) = coarse.take() {
            let by_law = search.difference(&fine, &coarse).largest() / ((steps / before).powi(2) - 1.0);
            let estimate = SAFETY * by_law + left.amplitude;
            search.estimate(estimate);
            if estimate <= USABLE * accuracy {
                return Ok(Some(Verdict::Confirmed));
            }
            let shorter = (estimate / (AIM * accuracy)).sqrt();
            if cost * shorter > RUN_PART * explicit || !shorter.is_finite() {
                return Ok(None);
            }
            next = (steps * shorter.min(SHORTER)).ceil();
        }
        coarse = Some((fine, steps));
        steps = next;
    }
}

/// By how much prescribed velocities jump at each kink, in m/s; zero where nothing is prescribed.
fn jumps(task: &Task) -> Vec<Vec<Vector3<f64>>> {
    let after = |time: f64| {
        let mut velocities = vec![Vector3::zeros(); task.system.particles()];
        task.system.prescribed().set_velocities(time, &mut velocities);
        velocities
    };
    let mut before = after(task.start.time);
    let jump = |kink: f64| {
        let then = after(kink);
        let jump = then.iter().zip(&before).map(|(then, before)| then - before).collect();
        before = then;
        jump
    };
    task.kinks().map(jump).collect()
}
