//! How long runs may take.

use std::cell::Cell;
use std::time::{Duration, Instant};

/// A run that takes longer is broken off.
pub const LONGEST: Duration = Duration::from_secs(8);

/// The cause of a run that was broken off.
pub const TOO_LONG: &str = "longer than 8 s";

/// A ladder ends with a good run that takes longer, in s.
const LAST: f64 = 1.0;

/// And with one that takes so many times as long as the fastest run yet that errs less than all that is asked for.
const HOPELESS: f64 = 50.0;

/// The longest good run after which a ladder goes on, in s, where the fastest run to the smallest error takes so long.
pub fn last(fastest: Option<f64>) -> f64 {
    fastest.map_or(LAST, |fastest| LAST.min(HOPELESS * fastest))
}

/// Says whether a run may go on. It looks at the clock about every tenth of a millisecond only, since a step of a small scene takes no
/// longer than that look.
pub struct Patience {
    begin: Instant,
    calls: Cell<u32>,
    next_look: Cell<u32>,
    excused: Cell<Duration>,
}

impl Patience {
    const BETWEEN: Duration = Duration::from_micros(100);

    pub fn new() -> Self {
        Self { begin: Instant::now(), calls: Cell::new(0), next_look: Cell::new(1), excused: Cell::new(Duration::ZERO) }
    }

    pub fn lasts(&self) -> bool {
        let calls = self.calls.get().saturating_add(1);
        self.calls.set(calls);
        if calls < self.next_look.get() {
            return true;
        }
        let elapsed = self.begin.elapsed();
        let mean = elapsed / calls;
        let calls_between = Self::BETWEEN.as_nanos() / mean.as_nanos().max(1);
        self.next_look.set(calls.saturating_add(calls_between.clamp(1, 10_000) as u32));
        elapsed < LONGEST + self.excused.get()
    }

    /// So much of the run does not count.
    pub fn excuse(&self, time: Duration) {
        self.excused.set(self.excused.get() + time);
    }

    pub fn excused(&self) -> Duration {
        self.excused.get()
    }
}
