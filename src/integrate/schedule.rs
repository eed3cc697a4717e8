//! The length of a run and of its steps.

use crate::error::Invalid;

/// Length of a run in steps.
///
/// # Examples
/// ```
/// use sprung::integrate::Schedule;
///
/// let schedule = Schedule::duration(0.1, 0.25);
/// let lengths: Vec<f64> = (0..schedule.len()).filter_map(|index| schedule.step(index)).collect();
/// // Runs end exactly at their duration: the last step is shorter.
/// assert_eq!(lengths.len(), 3);
/// assert!((lengths[2] - 0.05).abs() < 1e-15);
/// assert!(Schedule::check(-0.1, 1.0).is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    dt: f64,
    /// Steps of the whole schedule, and the length of the last one: dt, or what is left where dt does not divide the duration.
    steps: u64,
    last_step: f64,
    duration: f64,
    /// The steps done before and at the end of this part.
    first: u64,
    last: u64,
}

/// Times are the same up to this part of the step, or the run, at hand.
pub(super) const SAME: f64 = 1e-9;

/// The most steps of a run, 2⁵³: as many as a double counts one by one.
const MOST_STEPS: f64 = 9_007_199_254_740_992.0;

/// A time is the end of a run, given by its start and end, up to the rounding of times and of a step that divides it.
pub(crate) fn is_end(time: f64, [start, end]: [f64; 2]) -> bool {
    end - time <= SAME * (end - start) + 4.0 * f64::EPSILON * end.abs()
}

impl Schedule {
    /// A number of steps of length dt > 0.
    pub fn steps(dt: f64, steps: u64) -> Self {
        Self::whole(dt, steps, dt, steps as f64 * dt)
    }

    /// Ends exactly at `duration` ≥ 0: the last step is shorter where dt > 0 does not divide it. Arguments that [`check`](Self::check) refuses make a
    /// schedule of very many steps, or of none.
    pub fn duration(dt: f64, duration: f64) -> Self {
        let ratio = duration / dt;
        let nearest = ratio.round();
        // A run that is short beside dt is one short step, not none.
        let divides = (ratio - nearest).abs() <= SAME * nearest.max(1.0) && (nearest > 0.0 || ratio == 0.0);
        if divides || ratio.is_nan() || ratio >= MOST_STEPS {
            return Self::whole(dt, nearest as u64, dt, duration);
        }
        let before = ratio.floor();
        Self::whole(dt, before as u64 + 1, duration - before * dt, duration)
    }

    fn whole(dt: f64, steps: u64, last_step: f64, duration: f64) -> Self {
        Self { dt, steps, last_step, duration, first: 0, last: steps }
    }

    /// The part of the same schedule that begins when `first` steps are done and ends with at most `count` more, with their numbers and times.
    pub fn part(&self, first: u64, count: u64) -> Self {
        Self { first, last: self.last.min(first.saturating_add(count)), ..*self }
    }

    /// Length of the whole schedule of which this is a part, in s.
    pub fn duration_of_whole(&self) -> f64 {
        self.duration
    }

    /// Steps that are done before it begins.
    pub fn first(&self) -> u64 {
        self.first
    }

    /// Checks that steps of dt seconds end at `duration` and can be counted.
    ///
    /// # Errors
    /// A dt that is not positive, a duration that is negative, either not finite; more than 2⁵³ steps.
    pub fn check(dt: f64, duration: f64) -> Result<(), Invalid> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Invalid::new("dt", format!("{dt:e}"), "must be finite and positive"));
        }
        if !(duration.is_finite() && duration >= 0.0) {
            return Err(Invalid::new("duration", format!("{duration:e}"), "must be finite and not negative"));
        }
        if duration / dt < MOST_STEPS {
            return Ok(());
        }
        let rule = format!("is too short for a run of {duration:?} s: it would take more than 2^53 steps");
        Err(Invalid::new("dt", format!("{dt:e}"), rule))
    }

    /// Number of steps that are done when it ends.
    pub fn len(&self) -> u64 {
        self.last
    }

    /// There is no step.
    pub fn is_empty(&self) -> bool {
        self.first >= self.last
    }

    /// The step size of all steps but perhaps the last.
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// The last step is as long as all others and ends, to the bit, when that of a longer schedule does.
    pub fn ends_with_whole_step(&self) -> bool {
        self.last_step == self.dt && self.duration == self.steps as f64 * self.dt
    }

    /// Length of step `index`, from 0; `None` when there is no such step.
    pub fn step(&self, index: u64) -> Option<f64> {
        (index < self.last).then(|| if index + 1 < self.steps { self.dt } else { self.last_step })
    }

    /// Time since the start after `done` steps: a product, and the duration itself at the end.
    pub fn elapsed(&self, done: u64) -> f64 {
        if done >= self.steps { self.duration } else { done as f64 * self.dt }
    }
}

#[cfg(test)]
mod tests {
    use super::{SAME, Schedule, is_end};

    /// Within a part of the run and four units in the last place of its end.
    #[test]
    fn a_run_ends_up_to_rounding() {
        for (left, run, expected) in [
            (0.5 * SAME, [99.0, 100.0], true),
            (2.0 * SAME, [99.0, 100.0], false),
            (0.5, [1e15 - 1.0, 1e15], true),
            (-1.0, [99.0, 100.0], true),
            (1.0, [99.0, 100.0], false),
        ] {
            assert_eq!(is_end(run[1] - left, run), expected, "{left} before the end of {run:?}");
        }
    }

    #[test]
    fn steps_divide_a_duration_up_to_rounding() {
        assert_eq!(Schedule::duration(1.0, 1e6 + 0.9e-3).len(), 1_000_000);
        assert_eq!(Schedule::duration(1.0, 1e6 + 1.1e-3).len(), 1_000_001);
    }

    #[test]
    fn the_last_step_is_what_is_left() {
        let schedule = Schedule::duration(0.25, 0.625);
        let lengths: Vec<Option<f64>> = (0..4).map(|step| schedule.step(step)).collect();
        assert_eq!(lengths, [Some(0.25), Some(0.25), Some(0.125), None]);
        assert_eq!((schedule.duration_of_whole(), schedule.part(1, 1).duration_of_whole()), (0.625, 0.625));
    }

    /// The parts of a schedule have its steps, with their numbers and times.
    #[test]
    fn parts_are_the_schedule() {
        let whole = Schedule::duration(0.1, 0.75);
        let parts = [whole.part(0, 3), whole.part(3, 3), whole.part(6, 3), whole.part(8, 3)];
        assert_eq!(
            parts.map(|part| (part.first(), part.len(), part.is_empty())),
            [(0, 3, false), (3, 6, false), (6, 8, false), (8, 8, true)]
        );
        let steps = parts
            .iter()
            .flat_map(|part| (part.first()..).map_while(|step| Some((step, part.step(step)?, part.elapsed(step + 1)))));
        let expected = (0..8).map(|step| (step, whole.step(step).unwrap(), whole.elapsed(step + 1)));
        assert!(steps.eq(expected));
        assert_eq!(whole.part(6, 3).elapsed(8), 0.75);
    }

    /// However short beside dt, a run goes to its end.
    #[test]
    fn short_runs_are_one_short_step() {
        for duration in [1.1e-9, 0.9e-9, 1e-10, 1e-300, 5e-324] {
            let schedule = Schedule::duration(1.0, duration);
            assert_eq!((schedule.len(), schedule.step(0), schedule.elapsed(1)), (1, Some(duration), duration));
        }
    }

    #[test]
    fn steps_that_cannot_be_counted_are_refused() {
        for (dt, duration, value) in [
            (1e-310, 1.0, "dt = 1e-310: is too short for a run of 1.0 s"),
            (1.0, 9_007_199_254_740_992.0, "dt = 1e0: is too short"),
            (0.0, 1.0, "dt = 0e0: must be finite and positive"),
            (0.0, 0.0, "dt = 0e0: must be finite and positive"),
            (f64::INFINITY, 1.0, "dt = inf"),
            (1.0, f64::NAN, "duration = NaN"),
            (1.0, -1.0, "duration = -1e0: must be finite and not negative"),
        ] {
            let error = Schedule::check(dt, duration).unwrap_err().to_string();
            assert!(error.starts_with(value), "{error}");
        }
        for (dt, duration) in [(1.0, 9_007_199_254_740_991.0), (1.0, 0.0), (1.0, 1e-300)] {
            assert_eq!(Schedule::check(dt, duration), Ok(()));
        }
        for (empty, expected) in [
            (Schedule::duration(0.0, 0.0), true),
            (Schedule::steps(0.1, 0), true),
            (Schedule::duration(0.1, 0.0), true),
            (Schedule::steps(0.1, 1), false),
            (Schedule::duration(0.1, 0.05), false),
        ] {
            assert_eq!(empty.is_empty(), expected, "{empty:?}");
        }
    }
}
