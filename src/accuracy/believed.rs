//! When a pair of runs by explicit methods is believed.
//!
//! **What is believed.** Differences count with their [envelope](super::course::Difference::envelope), and for no less than half of
//! what the law makes of the one before. One that has not contracted as it should is not believed: it shows that steps were
//! too long for the law, or that the motion forgets. Of the largest difference so far such a run has 1.5 times for its error.

/// What the largest difference so far is multiplied with where the last one has not contracted.
pub(super) const ASTRAY: f64 = 1.5;

/// A difference counts for at least this part of what the law makes of the one before: less is chance.
pub(super) const CHANCE: f64 = 0.5;

/// The part of the accuracy that an estimate may use.
pub(super) const USABLE: f64 = 0.8;

/// Runs that break down are tried with finer steps so many times.
pub(super) const RETRIES: u32 = 6;
