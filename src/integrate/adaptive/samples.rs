//! What the observer of a run with error control sees.

use super::{AdaptiveStepper, OutputTimes};
use crate::integrate::is_end;
use crate::system::{State, System};
use std::ops::ControlFlow;

/// Hands out states as often as is asked.
pub(super) struct Samples {
    sampling: OutputTimes,
    start: f64,
    count: u64,
    sample: State,
}

impl Samples {
    pub fn new(sampling: OutputTimes, state: &State) -> Self {
        Self { sampling, start: state.time, count: 0, sample: state.clone() }
    }

    /// After a step of `stepper` from `before` to `after`.
    pub fn observe(
        &mut self,
        system: &System,
        stepper: &mut dyn AdaptiveStepper,
        before: &State,
        after: &State,
        is_last: bool,
        observe: &mut impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        // An interval of no length would have no end; one that is not positive is none.
        if let OutputTimes::Every(interval) = self.sampling
            && interval > 0.0
        {
            loop {
                let time = self.start + (self.count + 1) as f64 * interval;
                if time >= after.time || is_last && is_end(time, [self.start, after.time]) {
                    break;
                }
                self.count += 1;
                stepper.interpolate(before, after, time, &mut self.sample);
                self.sample.time = time;
                self.sample.prescribe(system);
                observe(self.count, &self.sample)?;
            }
            if !is_last {
                return ControlFlow::Continue(());
            }
        }
        self.count += 1;
        observe(self.count, after)
    }
}
