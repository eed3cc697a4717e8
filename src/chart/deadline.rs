//! Until when something may go on.

use crate::interrupt::Interrupt;
use std::time::{Duration, Instant};

/// A time, or the moment before it at which someone asks for an end.
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

    /// Whether there is more time than this.
    pub fn allows(self, time: Duration) -> bool {
        self.left() > time
    }

    /// The time that is left.
    pub fn left(self) -> Duration {
        self.since(Instant::now())
    }

    /// The time from then on; none where an end was asked for.
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
