//! Numbers and counts as people read them; files for machines have all digits.

/// Up to six significant digits: `0.35`, `1.66667`, `-1.38019e3` as `-1380.19`, `2.5e-7`.
pub fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    // Zero has no sign.
    let rounded = rounded + 0.0;
    let is_plain = rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) || !rounded.is_finite();
    if is_plain { rounded.to_string() } else { format!("{rounded:e}") }
}

/// `1 step`, `2 steps`.
pub fn count(n: u64, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::{count, number};

    #[test]
    fn numbers_are_read_at_a_glance() {
        let cases = [
            (1.6666666666666667, "1.66667"),
            (-1380.194123, "-1380.19"),
            (0.1 + 0.2, "0.3"),
            (20.0, "20"),
            (-0.0, "0"),
            (2.5e-7, "2.5e-7"),
            (31557600.0, "3.15576e7"),
            (f64::NAN, "NaN"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
        assert_eq!([0, 1, 2].map(|n| count(n, "step")), ["0 steps", "1 step", "2 steps"]);
    }
}
