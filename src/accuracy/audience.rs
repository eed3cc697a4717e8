//! Who looks on while an answer is looked for, and what they are told.

use crate::error::Result;
use crate::integrate::Monitor;
use crate::system::State;

/// What looks on while an answer is looked for.
pub trait Audience {
    /// What is kept of one run until it is known whether that is the answer.
    type Records;

    /// A run begins.
    ///
    /// # Errors
    /// What ends the search.
    fn begin(&mut self, monitor: &Monitor) -> Result<Self::Records>;

    /// The run is at a multiple of the interval asked for, or at its end.
    ///
    /// # Errors
    /// What ends the search.
    fn record(&mut self, records: &mut Self::Records, number: u64, state: &State, monitor: &Monitor) -> Result<()>;

    /// How the search gets on.
    fn progress(&mut self, _progress: &SearchProgress<'_>) {}
}

/// Nobody.
impl Audience for () {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> Result<()> {
        Ok(())
    }
}

/// How a search gets on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress<'a> {
    /// What is being done.
    pub doing: &'a str,
    /// The part of it that is done.
    pub part: f64,
    /// What has been spent, in force evaluations.
    pub spent: f64,
    /// What is left to do at most, as far as can be seen, in force evaluations.
    pub left: f64,
}
