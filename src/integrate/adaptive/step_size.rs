//! Step size control by a PI controller; the error measure, the formula and the rules are in `adaptive`.

use super::AdaptiveStepper;

/// The parameters of the PI controller.
struct Rule {
    aim: f64,
    /// The exponents, times p + 1, of the error over the aim, and of the change of the error.
    whole: f64,
    change: f64,
    /// The step after a rejection, relative to one that would just be accepted.
    shorter: f64,
}

/// Gustafsson, ACM Trans. Math. Softw. 17, 1991.
const ORDINARY: Rule = Rule { aim: 0.9, whole: 0.7, change: 0.4, shorter: 0.8 };

/// For methods whose steps stability bounds: errors grow from step to step as soon as h is a little too long. So the aim is 0.9 of the longest step,
/// as in Hairer's dop853.f; the exponents are near those of his dopri5.f, 0.65 and 0.2.
fn bounded_by_stability(power: f64) -> Rule {
    Rule { aim: 0.9f64.powf(power), whole: 0.6, change: 0.2, shorter: 0.9 }
}

/// The least factor from one step to the next.
const SHRINKAGE: f64 = 0.2;

/// p + 1, estimates falling as h^(p + 1).
fn power(stepper: &dyn AdaptiveStepper) -> f64 {
    f64::from(stepper.estimate_order() + 1)
}

fn rule(stepper: &dyn AdaptiveStepper) -> Rule {
    if stepper.is_bounded_by_stability() { bounded_by_stability(power(stepper)) } else { ORDINARY }
}
pub(super) struct Control {
    /// The step to try next, unless a stop is near.
    pub h: f64,
    last_error: f64,
    /// After a rejection the next step does not grow.
    was_rejected: bool,
    /// The longest step.
    ceiling: f64,
}

impl Control {
    pub fn new(first: f64, duration: f64) -> Self {
        Self { h: first.min(duration), last_error: 1.0, was_rejected: false, ceiling: duration }
    }

    /// The step to take when a stop is `distance` ahead, and whether it lands there. The last two steps are equal, so that none is tiny.
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
        let keeps = stepper.reuses_factorization() && (0.9..=1.3).contains(&factor);
        if !keeps && (is_full || factor < 1.0) {
            let growth = if self.was_rejected { 1.0 } else { stepper.largest_growth() };
            self.h = (h * factor.clamp(SHRINKAGE, growth)).min(self.ceiling);
        }
        self.ceiling *= 1.05;
        self.was_rejected = false;
    }

    /// After a step of h seconds with too large an error.
    pub fn rejected(&mut self, error: f64, h: f64, stepper: &dyn AdaptiveStepper) {
        let Rule { shorter, .. } = rule(stepper);
        self.was_rejected = true;
        self.h = h * (shorter / error.powf(1.0 / power(stepper))).clamp(SHRINKAGE, shorter);
    }

    /// After a step of h seconds that failed.
    pub fn failed(&mut self, h: f64) {
        self.was_rejected = true;
        // Where matrices are indefinite, errors alone would propose the same step again and again.
        self.ceiling = 0.8 * h;
        self.h = 0.5 * h;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Still;
    use super::{Control, SHRINKAGE};

    fn control(h: f64) -> Control {
        Control { h, last_error: 1.0, was_rejected: false, ceiling: f64::MAX }
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b.abs()
    }

    #[test]
    fn the_last_two_steps_before_a_stop_share_what_is_left() {
        let control = control(0.1);
        assert_eq!(control.step_towards(0.1009), (0.1009, true));
        assert_eq!(control.step_towards(0.1011), (0.05055, false));
        assert_eq!(control.step_towards(0.1999), (0.09995, false));
        assert_eq!(control.step_towards(0.21), (0.1, false));
    }

    #[test]
    fn the_next_step_follows_the_error_and_its_change() {
        let next = |mut control: Control, error: f64, h: f64, stepper: Still| {
            control.accepted(error, h, &stepper);
            assert_eq!((control.last_error, control.was_rejected), (error, false));
            control.h
        };
        for p in [1, 2, 4, 8] {
            let power = f64::from(p + 1);
            for gains in [false, true] {
                // h (0.9/e)^(0.7/(p + 1)) (e_last/e)^(0.4/(p + 1)) with e_last = 1.
                let expected = 0.1 * 9.0f64.powf(0.7 / power) * 10.0f64.powf(0.4 / power);
                let largest = 0.1 * Still::GROWTH;
                assert!(close(next(control(0.1), 0.1, 0.1, Still::of(p, gains)), expected.min(largest)), "{p}");
                let falling = Control { last_error: 0.1, ..control(0.1) };
                let expected = 0.1 * 0.9f64.powf(0.7 / power) * 0.1f64.powf(0.4 / power);
                let kept = gains && expected > 0.09;
                assert!(close(next(falling, 1.0, 0.1, Still::of(p, gains)), if kept { 0.1 } else { expected }), "{p}");
            }
        }
        // Within the dead band nothing changes, where that saves work; growth and shrinkage are bounded.
        assert_eq!(next(control(0.1), 0.8, 0.1, Still::of(2, true)), 0.1);
        assert!(next(control(0.1), 0.8, 0.1, Still::of(2, false)) > 0.1);
        assert_eq!(next(control(0.1), 1e-5, 0.1, Still::of(2, true)), 0.1 * Still::GROWTH);
        let rejected = Control { was_rejected: true, ..control(0.1) };
        assert_eq!(next(rejected, 1e-5, 0.1, Still::of(2, true)), 0.1);
        assert_eq!(next(Control { last_error: 1e-6, ..control(0.1) }, 1.0, 0.1, Still::of(1, true)), 0.1 * SHRINKAGE);
        // A step shortened to land on a stop makes no later one longer, but it may make them shorter.
        assert_eq!(next(control(0.1), 0.5, 0.05, Still::of(2, true)), 0.1);
        let expected = 0.095 * 4.5f64.powf(0.7 / 3.0) * 5.0f64.powf(0.4 / 3.0);
        assert!(close(next(control(0.1), 0.2, 0.095, Still::of(2, true)), expected));
        let falling = Control { last_error: 0.1, ..control(0.1) };
        let expected = 0.05 * 0.9f64.powf(0.7 / 3.0) * 0.1f64.powf(0.4 / 3.0);
        assert!(close(next(falling, 1.0, 0.05, Still::of(2, true)), expected));
    }

    #[test]
    fn steps_shrink_after_rejections_and_failures() {
        let after = |error: Option<f64>, p: u32| {
            let mut control = control(0.1);
            match error {
                Some(error) => control.rejected(error, 0.1, &Still::of(p, false)),
                None => control.failed(0.1),
            }
            assert!(control.was_rejected);
            control.h
        };
        assert!(close(after(Some(8.0), 2), 0.04));
        assert!(close(after(Some(4.0), 1), 0.04));
        assert!(close(after(Some(512.0), 8), 0.04));
        assert!(close(after(Some(1.0), 2), 0.08));
        assert!(close(after(Some(1e6), 2), 0.02));
        assert!(close(after(Some(f64::INFINITY), 2), 0.02));
        assert!(close(after(None, 2), 0.05));
    }

    /// An error that stays as it is keeps the step where that is 0.9 of what would just be accepted, whatever the order; and so far it goes back
    /// after a rejection.
    #[test]
    fn steps_that_stability_bounds_keep_away_from_rejections() {
        for p in [2, 4, 7] {
            let (stepper, power) = (Still::bounded(p), f64::from(p + 1));
            let aim = 0.9f64.powf(power);
            let mut control = Control { last_error: aim, ..control(0.1) };
            control.accepted(aim, 0.1, &stepper);
            assert!(close(control.h, 0.1), "{p}");
            control.accepted(0.5 * aim, 0.1, &stepper);
            assert!(close(control.h, 0.1 * 2.0f64.powf(0.8 / power)), "{p}");
            control.rejected(1.0, 0.1, &stepper);
            assert!(close(control.h, 0.09), "{p}");
            control.rejected(2.0f64.powf(power), 0.1, &stepper);
            assert!(close(control.h, 0.045), "{p}");
        }
    }

    /// A step that failed is not proposed again at once, but in time.
    #[test]
    fn steps_come_back_slowly_to_one_that_failed() {
        let mut control = control(0.1);
        control.failed(0.1);
        let mut steps = 0;
        while control.h < 0.1 {
            let (h, stepper) = (control.h, Still::of(2, false));
            control.accepted(1e-6, h, &stepper);
            let expected = 0.1 * 0.8 * 1.05f64.powi(steps);
            assert!(control.h <= 0.05 || close(control.h, expected), "{} {expected}", control.h);
            steps += 1;
        }
        assert_eq!(steps, 6);
    }
}
