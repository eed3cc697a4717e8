//! Distances between computed and known numbers.

use nalgebra::Vector3;
pub use sprung::verify::U;
use sprung::verify::worst;

/// A vector of an answer file: as many numbers as the scene has axes.
pub fn vector(row: &[f64]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| row.get(axis).copied().unwrap_or(0.0))
}

/// The largest difference of two rows of vectors over the largest known component; the difference itself where all known
/// ones are zero. NaN where the lengths differ.
pub fn rows(found: &[Vector3<f64>], known: &[Vec<f64>]) -> f64 {
    let known: Vec<f64> = known.iter().flat_map(|row| vector(row).iter().copied().collect::<Vec<_>>()).collect();
    let found: Vec<f64> = found.iter().flat_map(|v| v.iter().copied().collect::<Vec<_>>()).collect();
    numbers(&found, &known)
}

/// As [`rows`] for plain numbers.
pub fn numbers(found: &[f64], known: &[f64]) -> f64 {
    if found.len() != known.len() {
        return f64::NAN;
    }
    let difference = worst(found.iter().zip(known).map(|(found, known)| (found - known).abs()));
    let largest = worst(known.iter().map(|value| value.abs()));
    if difference == 0.0 || largest == 0.0 { difference } else { difference / largest }
}

/// `|found − known| / |known|`; the difference itself where zero is known.
pub fn number(found: f64, known: f64) -> f64 {
    numbers(&[found], &[known])
}
