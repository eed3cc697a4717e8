//! When a run ends, and how long each step is.

/// Length of a run in steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    dt: f64,
    whole_steps: u64,
    /// A shorter last step, when dt does not divide the duration.
    remainder: Option<f64>,
    duration: f64,
}

/// How near to a whole number `duration/dt` must be, relatively, for dt to divide the duration.
const DIVIDES: f64 = 1e-9;

impl Schedule {
    /// A number of steps of length dt > 0.
    pub fn steps(dt: f64, steps: u64) -> Self {
        Self { dt, whole_steps: steps, remainder: None, duration: steps as f64 * dt }
    }

    /// Ends exactly at `duration` ≥ 0: the last step is shorter where dt > 0 does not divide it.
    pub fn duration(dt: f64, duration: f64) -> Self {
        let ratio = duration / dt;
        let nearest = ratio.round();
        if (ratio - nearest).abs() <= DIVIDES * nearest.max(1.0) {
            return Self { dt, whole_steps: nearest as u64, remainder: None, duration };
        }
        let whole_steps = ratio.floor();
        let remainder = Some(duration - whole_steps * dt);
        Self { dt, whole_steps: whole_steps as u64, remainder, duration }
    }

    /// Number of steps.
    pub fn len(&self) -> u64 {
        self.whole_steps + u64::from(self.remainder.is_some())
    }

    /// Whether there is nothing to do.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The step size of all steps but perhaps the last.
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// Length of step `index`, from 0; `None` when there is no such step.
    pub fn step(&self, index: u64) -> Option<f64> {
        match self.remainder {
            _ if index < self.whole_steps => Some(self.dt),
            Some(remainder) if index == self.whole_steps => Some(remainder),
            _ => None,
        }
    }

    /// Time since the start after `done` steps: no sum of rounding errors, and the duration itself at the end.
    pub fn elapsed(&self, done: u64) -> f64 {
        if done >= self.len() { self.duration } else { done as f64 * self.dt }
    }
}

#[cfg(test)]
mod tests {
    use super::Schedule;

    #[test]
    fn nothing_to_do_is_empty() {
        assert!(Schedule::steps(0.1, 0).is_empty() && Schedule::duration(0.1, 0.0).is_empty());
        assert!(!Schedule::steps(0.1, 1).is_empty() && !Schedule::duration(0.1, 0.05).is_empty());
    }

    /// What rounding does to the quotient grows with it, so the bound is relative.
    #[test]
    fn steps_divide_a_duration_up_to_rounding() {
        assert_eq!(Schedule::duration(1.0, 1e6 + 0.9e-3).len(), 1_000_000);
        assert_eq!(Schedule::duration(1.0, 1e6 + 1.1e-3).len(), 1_000_001);
        assert_eq!(Schedule::duration(1.0, 0.9e-9).len(), 0);
        assert_eq!(Schedule::duration(1.0, 1.1e-9).len(), 1);
    }
}
