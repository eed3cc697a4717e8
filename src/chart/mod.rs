//! Speed against accuracy, and the limits of stability, as plain data.
//!
//! [`WorkPrecision`] sweeps methods, stiffness options, solvers and steps over one scene and measures what each run costs and how far it ends from a
//! [`Reference`] of independent origin. Pages are made from it in [`report`](crate::report).

mod conclusion;
mod curve;
mod decision;
pub mod definiteness;
mod dop853;
mod reference;
mod run;
pub mod stability;
mod sweep;
mod work_precision;
mod work_precision_figure;

pub use decision::Decision;
pub use dop853::dop853;
pub use reference::Reference;
pub use run::{LARGEST_ERROR, Quality, Run};
pub use stability::StabilityMap;
pub use sweep::configurations;
pub use work_precision::{SweepOptions, WorkPrecision};
pub use work_precision_figure::Figure;

use crate::interrupt::Interrupt;
use std::time::{Duration, Instant};

/// Hears how far a study is: the time that has passed, and what is being done.
pub type Progress<'a> = dyn FnMut(Duration, &str) + 'a;

/// The time until which something may go on, unless someone asks for an end before.
#[derive(Debug, Clone, Copy)]
pub struct Deadline {
    at: Instant,
    interrupt: Interrupt,
}

impl From<Instant> for Deadline {
    fn from(at: Instant) -> Self {
        Self { at, interrupt: Interrupt::NEVER }
    }
}

impl Deadline {
    /// So long from now.
    pub fn after(time: Duration, interrupt: Interrupt) -> Self {
        Self { at: Instant::now() + time, interrupt }
    }

    /// True where there is more time than this.
    pub fn allows(self, time: Duration) -> bool {
        self.left() > time
    }

    /// The time that is left.
    pub fn left(self) -> Duration {
        self.since(Instant::now())
    }

    /// The time from `begin` on; none where an end was asked for.
    pub fn since(self, begin: Instant) -> Duration {
        if self.interrupt.is_requested() { Duration::ZERO } else { self.at.saturating_duration_since(begin) }
    }
}

#[cfg(test)]
mod tests {
    use super::Deadline;
    use crate::interrupt::Interrupt;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::{Duration, Instant};

    #[test]
    fn no_time_is_left_after_the_deadline_or_an_interruption() {
        static FLAG: AtomicBool = AtomicBool::new(false);
        let hours = Duration::from_secs(7200);
        let deadline = Deadline::after(hours, Interrupt::on(&FLAG));
        assert!(deadline.allows(hours / 2) && !deadline.allows(2 * hours));
        FLAG.store(true, Ordering::Relaxed);
        assert!(!deadline.allows(Duration::ZERO) && deadline.since(Instant::now() - hours).is_zero());
        assert!(!Deadline::from(Instant::now()).allows(Duration::ZERO));
    }
}
