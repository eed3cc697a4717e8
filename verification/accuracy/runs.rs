//! A search, run by run.

use sprung::State;
use sprung::accuracy::{Observer, SearchProgress};
use sprung::integrate::Monitor;

/// Says what a search does, where that is asked for.
#[derive(Default)]
pub struct Runs {
    says: bool,
    doing: String,
    before: f64,
    spent: f64,
}

impl Runs {
    pub fn new(says: bool) -> Self {
        Self { says, ..Self::default() }
    }

    /// Says what the run that is over has cost.
    pub fn say(&self) {
        if self.says && !self.doing.is_empty() {
            eprintln!("    {:>9.0}  {}", self.spent - self.before, self.doing);
        }
    }
}

impl Observer for Runs {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> sprung::Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> sprung::Result<()> {
        Ok(())
    }

    fn progress(&mut self, now: &SearchProgress<'_>) {
        if now.run != self.doing {
            self.say();
            (self.doing, self.before) = (now.run.into(), self.spent);
        }
        self.spent = now.spent;
    }
}
