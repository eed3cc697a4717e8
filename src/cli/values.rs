//! Option values, checked where they are read.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::num::NonZeroU64;

/// A number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text, "must be finite and positive", |value| value > 0.0)
}

/// A number between zero and one, neither included.
pub fn fraction(text: &str) -> Result<f64, String> {
    number(text, "must lie between 0 and 1", |value| value > 0.0 && value < 1.0)
}

/// A whole number.
pub fn whole(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| "must be a whole number, not negative".to_owned())
}

/// A number of things; which numbers there can be is known where they are made.
pub fn size(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "must be a whole number above zero".to_owned())
}

/// A whole number above zero.
pub fn positive_count(text: &str) -> Result<NonZeroU64, String> {
    text.parse().map_err(|_| "must be a whole number above zero".to_owned())
}

fn number(text: &str, rule: &str, allowed: impl Fn(f64) -> bool) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if value.is_finite() && allowed(value) { Ok(value) } else { Err(rule.to_owned()) }
}

/// One of several choices, each with its name and what it means.
pub fn choice<T: Copy + Send + Sync + 'static>(
    choices: &'static [T],
    name: fn(T) -> &'static str,
    help: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let names = choices.iter().map(move |&choice| PossibleValue::new(name(choice)).help(help(choice)));
    PossibleValuesParser::new(names).try_map(move |text| {
        let named = choices.iter().find(|&&choice| name(choice) == text);
        named.copied().ok_or("is not one of the choices")
    })
}
