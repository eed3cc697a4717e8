//! Right and wrong runs, and ordinary scenes.

use super::record::Record;
use super::runs::{Ask, Run};

/// A true error above this must not pass in silence.
pub const WRONG: f64 = 0.3;

/// A true error below this is not to be warned of.
pub const RIGHT: f64 = 0.01;

/// Growth of deviations beyond which a scene is not ordinary: two digits are lost on the way.
pub const SENSITIVE: f64 = 100.0;

/// A run is judged where the reference is better known than its error by this.
const MARGIN: f64 = 10.0;

/// A scene with one of its runs.
#[derive(Clone, Copy)]
pub struct Case<'r> {
    /// The scene.
    pub record: &'r Record,
    /// The run.
    pub run: &'r Run,
}

impl Case<'_> {
    /// Whether the reference is good enough to tell an error of this size.
    pub fn tells(&self, error: f64) -> bool {
        self.record.reference_error.is_some_and(|own| MARGIN * own <= error)
    }

    /// Whether deviations stay small and no spring collapses, which makes forces jump or turn at once.
    pub fn is_ordinary(&self) -> bool {
        is_ordinary(self.record)
    }

    /// Completed, wrong, and without a word.
    pub fn is_silent(&self) -> bool {
        self.run.is_completed() && self.run.error() > WRONG && self.run.warnings.is_empty() && self.tells(WRONG)
    }

    /// Right, and a warning.
    pub fn is_false_alarm(&self) -> bool {
        self.is_right() && !self.run.warnings.is_empty()
    }

    /// Completed and right.
    pub fn is_right(&self) -> bool {
        self.run.is_completed() && self.run.error() < RIGHT && self.tells(RIGHT)
    }

    /// Estimate over truth, where both are known.
    pub fn ratio(&self) -> Option<f64> {
        let error = self.run.error.filter(|&error| self.run.is_completed() && error > 0.0 && self.tells(error))?;
        Some(self.run.estimate? / error)
    }
}

/// See [`Case::is_ordinary`].
pub fn is_ordinary(record: &Record) -> bool {
    record.amplification.is_some_and(|growth| growth <= SENSITIVE) && record.shortest.is_some_and(|ratio| ratio > 0.05)
}

/// Every run of every scene.
pub fn cases(records: &[Record]) -> Vec<Case<'_>> {
    records.iter().flat_map(|record| record.runs.iter().map(move |run| Case { record, run })).collect()
}

/// The tolerance or accuracy that was asked for.
pub fn asked(case: &Case) -> f64 {
    match case.run.ask {
        Ask::Dt(value) | Ask::Rtol(value) | Ask::Accuracy(value) => value,
    }
}
