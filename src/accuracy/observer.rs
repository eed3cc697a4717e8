//! Observers of a search for an answer.

use crate::error::Result;
use crate::integrate::Monitor;
use crate::system::State;

/// An observer of the runs of a search, which records each until it is known whether that is the answer.
pub trait Observer {
    /// The records of one run.
    type Records;

    /// A run begins.
    ///
    /// # Errors
    /// An error ends the search.
    fn begin(&mut self, monitor: &Monitor) -> Result<Self::Records>;

    /// The run is at a multiple of the interval asked for, or at its end.
    ///
    /// # Errors
    /// An error ends the search.
    fn record(&mut self, records: &mut Self::Records, number: u64, state: &State, monitor: &Monitor) -> Result<()>;

    /// Progress of the search.
    fn progress(&mut self, _progress: &SearchProgress<'_>) {}
}

/// No observer.
impl Observer for () {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> Result<()> {
        Ok(())
    }
}

/// Progress of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress<'a> {
    /// The run under way, in words.
    pub run: &'a str,
    /// The part of it that is done.
    pub part: f64,
    /// Work done in the runs before, in force evaluations.
    pub spent: f64,
}
