//! The step size controller.

use super::AdaptiveStepper;

/// Proposals within these factors of h keep it, where that saves work.
const DEAD_BAND: std::ops::RangeInclusive<f64> = 0.9..=1.3;

/// How steps follow their errors.
struct Rule {
    /// The error aimed at.
    aim: f64,
    /// The powers, times p + 1, with which a step follows what its error is of the aim, and how errors change.
    whole: f64,
    change: f64,
    /// After a rejection a step has this part of what would just have been accepted.
    shorter: f64,
}

const ORDINARY: Rule = Rule { aim: 0.9, whole: 0.7, change: 0.4, shorter: 0.8 };

/// Of methods whose steps stability bounds. Errors grow from step to step there as soon as h is a little too long, and steps hardly follow them:
/// with eighth powers an error of 0.9 is a step of 0.987 of the longest that is accepted. Where that was the aim steps were rejected, made shorter
/// by a fifth and lengthened until they were rejected again, up to every third. So the aim is 0.9 of the longest step, as in Hairer's dop853.f, and
/// the same after a rejection. The powers are near those of his dopri5.f, 0.65 and 0.2.
fn bounded_by_stability(power: f64) -> Rule {
    Rule { aim: 0.9f64.powf(power), whole: 0.6, change: 0.2, shorter: 0.9 }
}

/// The most by which one step may be shorter than the last.
const SHRINKAGE: f64 = 0.2;

/// After a step that could not be done others stay below this part of it, and come nearer by the second factor a step: where
/// matrices are indefinite, errors alone would propose again and again what cannot be done.
const BELOW_FAILURE: f64 = 0.8;
const APPROACH: f64 = 1.05;

/// p + 1, estimates falling as h^(p + 1).
fn power(stepper: &dyn AdaptiveStepper) -> f64 {
    f64::from(stepper.estimate_order() + 1)
}

fn rule(stepper: &dyn AdaptiveStepper) -> Rule {
    if stepper.is_bounded_by_stability() { bounded_by_stability(power(stepper)) } else { ORDINARY }
}

/// Proposes steps from the errors of those before.
pub(super) struct Control {
    /// The step to try next, but for landing on a stop.
    pub h: f64,
    last_error: f64,
    /// Whether the step before this one was rejected: it is not to grow at once.
    was_rejected: bool,
    /// No step longer than this.
    ceiling: f64,
}

impl Control {
    pub fn new(first: f64, duration: f64) -> Self {
        Self { h: first.min(duration), last_error: 1.0, was_rejected: false, ceiling: duration }
    }

    /// The step to take when a stop is `distance` ahead, and whether it lands there. The last two steps share what is
    /// left, so that none is tiny.
    pub fn step_towards(&self, distance: f64) -> (f64, bool) {
        let left = distance / self.h;
        if left <= 1.01 {
            (distance, true)
        } else if left < 2.0 {
            (0.5 * distance, false)
        } else {
            (self.h, false)
        }
    }

    /// After a step of h seconds with an error of at most one.
    pub fn accepted(&mut self, error: f64, h: f64, stepper: &dyn AdaptiveStepper) {
        let power = power(stepper);
        let error = error.max(1e-6);
        let Rule { aim, whole, change, .. } = rule(stepper);
        let factor = (aim / error).powf(whole / power) * (self.last_error / error).powf(change / power);
        self.last_error = error;
        // A step shortened to land on a stop says nothing against the longer one.
        let is_full = h >= 0.9 * self.h;
        let keeps = stepper.reuses_factorization() && DEAD_BAND.contains(&factor);
        if !keeps && (is_full || factor < 1.0) {
            let growth = if self.was_rejected { 1.0 } else { stepper.largest_growth() };
            self.h = (h * factor.clamp(SHRINKAGE, growth)).min(self.ceiling);
        }
        self.ceiling *= APPROACH;
        self.was_rejected = false;
    }

    /// After a step of h seconds with too large an error.
    pub fn rejected(&mut self, error: f64, h: f64, stepper: &dyn AdaptiveStepper) {
        let Rule { shorter, .. } = rule(stepper);
        self.was_rejected = true;
        self.h = h * (shorter / error.powf(1.0 / power(stepper))).clamp(SHRINKAGE, shorter);
    }

    /// After a step of h seconds that could not be done.
    pub fn failed(&mut self, h: f64) {
        self.was_rejected = true;
        self.ceiling = BELOW_FAILURE * h;
        self.h = 0.5 * h;
    }
}

#[cfg(test)]
mod tests;
