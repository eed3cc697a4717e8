//! When a pair of runs by explicit methods is believed.
//!
//! **What is believed.** Differences count with their [envelope](super::course::Difference::envelope), and for no less than half of
//! what the law makes of the one before. One that has not contracted as it should is not believed: it shows that steps were
//! too long for the law, or that the motion forgets. Of the largest difference so far such a run has 1.5 times for its error.

/// What the largest difference so far is multiplied with where the last one has not contracted.
const ASTRAY: f64 = 1.5;

/// A difference counts for at least this part of what the law makes of the one before: less is chance.
pub(super) const CHANCE: f64 = 0.5;

/// The part of the accuracy that an estimate may use.
pub(super) const USABLE: f64 = 0.8;

/// Runs that break down are tried with finer steps so many times.
pub(super) const RETRIES: u32 = 6;

/// What a run is believed to err by whose difference from the one before has not contracted as earlier ones have.
pub(super) fn astray(earlier: &[f64], apart: f64) -> f64 {
    ASTRAY * earlier.iter().copied().fold(apart, f64::max)
}

#[cfg(test)]
mod tests {
    use super::astray;

    #[test]
    fn the_largest_difference_counts() {
        assert_eq!([astray(&[], 2.0), astray(&[1.0, 8.0, 4.0], 2.0), astray(&[1.0], 2.0)], [3.0, 12.0, 3.0]);
    }
}
