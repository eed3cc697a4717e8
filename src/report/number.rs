//! Numbers for readers: three significant digits, never a NaN in disguise. Files for machines get all digits.

use crate::error::significant;
use std::fmt::Display;

/// `0.0213`, `2.13e-11`, `NaN`: for a terminal.
pub fn plain(value: f64) -> String {
    match digits(value) {
        (digits, None) => digits,
        (mantissa, Some(exponent)) => format!("{mantissa}e{exponent}"),
    }
}

/// `0.0213`, `2.13 × 10⁻¹¹`, `NaN`: for a page or a picture, on one line.
pub fn pretty(value: f64) -> String {
    let (digits, exponent) = digits(value);
    let power = exponent.map(|exponent| format!("\u{a0}×\u{a0}{}", power_of_ten(exponent)));
    digits.replace('-', "−") + &power.unwrap_or_default()
}

/// Characters up to which a number is read at a glance; of longer ones the distance is told.
const GLANCE: usize = 9;

/// Two numbers that are compared: with all digits where three could make different numbers look the same.
pub fn pair(form: fn(f64) -> String, a: f64, b: f64) -> [String; 2] {
    [a, b].map(if are_close(a, b) { all_digits } else { form })
}

/// The same for a page, where there is no room for many digits: the first by its distance from the second.
pub fn short_pair(a: f64, b: f64) -> [String; 2] {
    let pair = pair(pretty, a, b);
    let long = pair.iter().any(|text| text.len() > GLANCE);
    if are_close(a, b) && long { [beside(pretty, a, b), pretty(b)] } else { pair }
}

fn are_close(a: f64, b: f64) -> bool {
    a != b && (a - b).abs() < 0.005 * a.abs().max(b.abs())
}

/// A share of a bound, which shows whether it is below or above 1: with as many digits as that takes, or by its distance from 1.
pub fn share(form: fn(f64) -> String, value: f64) -> String {
    if value == 1.0 || !(0.995..1.005).contains(&value) {
        return form(value);
    }
    let digits = (3..GLANCE - 1).map(|digits| format!("{value:.digits$}"));
    digits.into_iter().find(|text| text.parse() != Ok(1.0)).unwrap_or_else(|| beside(form, value, 1.0))
}

/// `just below 30`, and beyond the bound `30 + 1.2e-9`: a number by its distance from one close to it.
fn beside(form: fn(f64) -> String, value: f64, other: f64) -> String {
    match value < other {
        true => format!("just below {}", form(other)),
        false => format!("{} + {}", form(other), form(value - other)),
    }
}

fn all_digits(value: f64) -> String {
    if (1e-3..1e6).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// Units that stay on the line of their number.
const UNITS: [&str; 8] = ["s", "ms", "m", "%", "N/m", "J", "times", "rad"];

/// A sentence with the numbers of a terminal, as a page shows it: `6.3e-4 s` becomes `6.3 × 10⁻⁴ s`, and spaces that must not be broken hold together.
pub fn typeset(sentence: &str) -> String {
    let mut set = String::with_capacity(sentence.len());
    let [mut after_number, mut after_equals] = [false; 2];
    for (k, word) in sentence.split(' ').enumerate() {
        let bare = word.trim_end_matches([',', ';', '.', ':', ')']);
        if k > 0 {
            let holds = after_number && UNITS.contains(&bare) || bare == "=" || after_equals;
            set.push(if holds { '\u{a0}' } else { ' ' });
        }
        let start = bare.find(|c: char| c.is_ascii_digit()).unwrap_or(bare.len());
        let (before, number) = bare.split_at(start);
        match number.split_once('e').map(|(mantissa, exponent)| (mantissa.parse::<f64>(), exponent.parse())) {
            Some((Ok(mantissa), Ok(exponent))) => {
                let power = match (mantissa, exponent) {
                    (_, 0) => mantissa.to_string(),
                    (1.0, _) => power_of_ten(exponent),
                    _ => format!("{mantissa}\u{a0}×\u{a0}{}", power_of_ten(exponent)),
                };
                set += &format!("{}{power}{}", before.replace('-', "−"), &word[bare.len()..]);
            }
            _ => set += word,
        }
        after_number = bare.ends_with(|c: char| c.is_ascii_digit() || "⁰¹²³⁴⁵⁶⁷⁸⁹".contains(c));
        after_equals = bare == "=";
    }
    set
}

/// `1 check`, `2 checks`.
pub fn count<N: Display + PartialEq + From<u8>>(n: N, noun: &str) -> String {
    let (noun, rest) = noun.split_at(noun.find(" of ").unwrap_or(noun.len()));
    format!("{n} {noun}{}{rest}", if n == N::from(1) { "" } else { "s" })
}

/// Up to six significant digits: `0.35`, `1.66667`, `-1380.19`, `2.5e-7`.
pub fn compact(value: f64) -> String {
    significant(value, 6)
}

/// `10⁻⁵`.
pub fn power_of_ten(exponent: i32) -> String {
    let superscript = |c: char| c.to_digit(10).and_then(|d| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(d as usize)).unwrap_or('⁻');
    format!("10{}", exponent.to_string().chars().map(superscript).collect::<String>())
}

fn digits(value: f64) -> (String, Option<i32>) {
    let size = value.abs();
    let digits = if value.is_nan() {
        "NaN".into()
    } else if value.is_infinite() {
        if value > 0.0 { "∞".into() } else { "-∞".into() }
    } else if size < 1e6 && value.trunc() == value {
        format!("{}", value + 0.0)
    } else if (1e-3..1e4).contains(&size) {
        let decimals = (2 - size.log10().floor() as i32).max(0) as usize;
        format!("{value:.decimals$}")
    } else {
        let text = format!("{value:.2e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return (mantissa.into(), exponent.parse().ok());
    };
    (digits, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits() {
        let found = [0.0, -0.0, 12.0, 0.5, 0.0213, -1234.56, 2.134e-11, 6.02e23, f64::NAN, f64::INFINITY].map(plain);
        assert_eq!(found, ["0", "0", "12", "0.500", "0.0213", "-1235", "2.13e-11", "6.02e23", "NaN", "∞"]);
        assert_eq!(pretty(-2.134e-11), "−2.13\u{a0}×\u{a0}10⁻¹¹");
    }

    #[test]
    fn shares_show_their_side_of_the_bound() {
        let found = [1.0, 0.99996, 0.9999999, 0.99999999, 1.0001, 0.5].map(|value| share(plain, value));
        assert_eq!(found, ["1", "0.99996", "0.9999999", "just below 1", "1.0001", "0.500"]);
        assert_eq!(share(plain, 1.0 - f64::EPSILON), "just below 1");
        assert_eq!(share(pretty, 1.0 + f64::EPSILON), "1 + 2.22\u{a0}×\u{a0}10⁻¹⁶");
    }

    #[test]
    fn sentences_are_set_for_readers() {
        let cases = [
            ("dt = 6.3e-4 s; next", "dt\u{a0}=\u{a0}6.3\u{a0}×\u{a0}10⁻⁴\u{a0}s; next"),
            ("strain -3.8e-4, about 5.2e0", "strain −3.8\u{a0}×\u{a0}10⁻⁴, about 5.2"),
            ("up to 1.07 × 10⁴ N/m.", "up to 1.07 × 10⁴\u{a0}N/m."),
            ("below 1.0e-4 %: w2 (full, 2e3).", "below 10⁻⁴\u{a0}%: w2 (full, 2\u{a0}×\u{a0}10³)."),
            ("has dop853: 0.005 s.", "has dop853: 0.005\u{a0}s."),
            ("nothing e5 to set in w2e", "nothing e5 to set in w2e"),
            ("", ""),
        ];
        for (plain, set) in cases {
            assert_eq!(typeset(plain), set);
        }
    }

    #[test]
    fn different_numbers_look_different() {
        assert_eq!(pair(plain, 1.00001e-8, 1e-8), ["1.00001e-8", "1e-8"]);
        assert_eq!(short_pair(29.9, 30.0), ["29.9", "30"]);
        assert_eq!(short_pair(0.99999999999999, 1.0), ["just below 1", "1"]);
        assert_eq!(short_pair(2.0, 1.0), ["2", "1"]);
        assert_eq!(pair(plain, 2e-8, 1e-8), ["2.00e-8", "1.00e-8"]);
    }
}
