//! Quantities that change in time.

use crate::error::Invalid;
use std::ops::{Add, Mul, Sub};

/// Times that differ by less than this, relatively, are the same but for rounding: ten thousand steps added up.
pub(crate) const SAME_TIME: f64 = 1e-12;

/// A quantity that is piecewise linear in time, and constant before its first time and behind its last.
///
/// # Examples
/// ```
/// use sprung::system::Curve;
///
/// let curve = Curve { times: vec![1.0, 3.0], values: vec![10.0, 14.0] };
/// assert_eq!([0.0, 2.0, 9.0].map(|t| curve.at(t)), [10.0, 12.0, 14.0]);
/// assert_eq!([0.0, 2.0, 9.0].map(|t| curve.rate(t)), [0.0, 2.0, 0.0]);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve<T> {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time.
    pub values: Vec<T>,
}

impl<T: Copy + Default + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>> Curve<T> {
    /// The value at time t; zero of a curve without values.
    pub fn at(&self, t: f64) -> T {
        let next = self.times.partition_point(|&time| time <= t);
        let last = self.values.len().saturating_sub(1);
        let value = |k: usize| self.values.get(k.min(last)).copied().unwrap_or_default();
        match (next.checked_sub(1).and_then(|k| self.times.get(k)), self.times.get(next)) {
            (Some(t0), Some(t1)) => value(next - 1) + (value(next) - value(next - 1)) * ((t - t0) / (t1 - t0)),
            _ => value(next.saturating_sub(1)),
        }
    }

    /// The derivative just after time t, per second. A time within rounding of a kink is the kink.
    pub fn rate(&self, t: f64) -> T {
        let next = self.times.partition_point(|&time| time <= t + SAME_TIME * t.abs());
        match (next.checked_sub(1), self.times.get(next)) {
            (Some(k), Some(t1)) => match (self.times.get(k), self.values.get(k), self.values.get(next)) {
                (Some(t0), Some(&from), Some(&to)) => (to - from) * (1.0 / (t1 - t0)),
                _ => T::default(),
            },
            _ => T::default(),
        }
    }

    /// What is left of the curve from time t on, with t as time zero.
    pub fn after(&self, t: f64) -> Self {
        let current = self.times.partition_point(|&time| time <= t).saturating_sub(1);
        let mut rest = Self { times: Vec::new(), values: Vec::new() };
        for (time, &value) in self.times.iter().zip(&self.values).skip(current) {
            // Times nearer than rounding may fall together: the first of them stands for all.
            if rest.times.last().is_none_or(|&last| time - t > last) {
                rest.times.push(time - t);
                rest.values.push(value);
            }
        }
        rest
    }
}

/// Times that are finite and increase, with as many values.
pub(super) fn check_times(key: &str, times: &[f64], values: (&str, usize)) -> Result<(), Invalid> {
    let times_key = format!("{key}.times");
    if times.is_empty() {
        return Err(Invalid::new(times_key, "[]", "must have at least one entry"));
    }
    check_length(&format!("{key}.{}", values.0), values.1, times.len(), "times")?;
    for (at, &time) in times.iter().enumerate() {
        if !time.is_finite() {
            return Err(Invalid::new(times_key, time, "must be finite").at(at));
        }
        if at > 0 && time <= times[at - 1] {
            return Err(Invalid::new(times_key, time, "times must increase").at(at));
        }
    }
    Ok(())
}

pub(crate) fn check_length(key: &str, found: usize, expected: usize, of: &str) -> Result<(), Invalid> {
    if found == expected {
        return Ok(());
    }
    Err(Invalid::new(key, format!("a list of {found}"), format!("must have one entry for each of the {expected} {of}")))
}
