//! Figures of a measurement, held to those that a file in `tests/records` lists.
//!
//! A figure that a closed form gives has a test of its own. What is left of a report, how near to its bound a right number comes,
//! how many directions were tried, what a sentence says, has none; and yet a slip in its formula changes it. So all of it is
//! written down once and compared. How exactly says the measurement itself: when the list is written it is repeated on
//! inputs that differ in their last bits. A figure that stays the same to 10⁻⁹ is held to 10⁻⁶; one that moves is held to a
//! hundred times that movement, or, where nothing but rounding is in it, to its order of magnitude. Other processors round
//! otherwise, and move no more.
//!
//! `SPRUNG_RENEW=NAME` writes lists whose names contain this anew, an empty one all of them; the difference belongs into the change
//! that makes it, looked at.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// What is known of one thing: its numbers, and its words.
#[derive(Default)]
pub struct Row {
    pub key: String,
    pub numbers: Vec<f64>,
    /// Sums of logarithms of long lists, which are held to absolute differences.
    pub sums: Vec<f64>,
    /// Numbers in sentences, rounded there.
    pub rounded: Vec<f64>,
    words: String,
}

/// Lists of more numbers are summed up.
const LONG: usize = 12;

impl Row {
    pub fn of(key: impl Into<String>, value: &Value) -> Self {
        let mut row = Self { key: key.into(), ..Self::default() };
        row.take(value);
        row
    }

    fn take(&mut self, value: &Value) {
        match value {
            Value::Null => self.words += "null,",
            Value::Bool(is) => self.words += if *is { "yes," } else { "no," },
            Value::Number(number) => self.numbers.push(number.as_f64().unwrap_or(f64::NAN)),
            Value::String(text) => self.say(text),
            Value::Array(list) => {
                let numbers = numbers(list);
                if numbers.len() > LONG {
                    let weighted = |(at, number): (usize, &f64)| {
                        let weight = 1.0 + (0.618 * at as f64).fract();
                        if *number == 0.0 { weight } else { weight * (number.abs().ln() + number.signum()) }
                    };
                    self.numbers.push(numbers.len() as f64);
                    self.sums.push(numbers.iter().enumerate().map(weighted).sum());
                } else {
                    self.numbers.push(list.len() as f64);
                    list.iter().for_each(|value| self.take(value));
                }
            }
            Value::Object(fields) => fields.iter().for_each(|(name, value)| {
                self.words += name;
                self.take(value);
            }),
        }
    }

    /// Takes the numbers of a sentence apart from its words.
    fn say(&mut self, text: &str) {
        let is_number = |c: char| c.is_ascii_digit() || ".+-−e".contains(c);
        for word in text.split_inclusive(|c: char| !is_number(c)) {
            let (number, rest) = word.split_at(word.find(|c| !is_number(c)).unwrap_or(word.len()));
            match number.trim_end_matches('.').replace('−', "-").parse() {
                Ok(number) => self.rounded.push(number),
                Err(_) => self.words += number,
            }
            self.words += rest;
        }
    }

    /// FNV-1a of the words: a list of sentences is longer than what it is a list of.
    fn mark(&self) -> String {
        let hash = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        format!("{:08x}", self.words.bytes().fold(0x811c_9dc5, hash))
    }

    fn all(&self) -> impl Iterator<Item = (Sort, f64)> {
        let of = |sort, numbers: &[f64]| numbers.iter().map(move |&number| (sort, number)).collect::<Vec<_>>();
        [of(Sort::Plain, &self.numbers), of(Sort::Sum, &self.sums), of(Sort::Rounded, &self.rounded)].into_iter().flatten()
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Sort {
    Plain,
    Sum,
    Rounded,
}

/// The numbers of a list of numbers or of lists of them; none if there is anything else in it.
fn numbers(list: &[Value]) -> Vec<f64> {
    let of = |value: &Value| match value {
        Value::Array(list) => Some(numbers(list)).filter(|numbers| numbers.len() == list.len() && !numbers.is_empty()),
        value => value.as_f64().map(|number| vec![number]),
    };
    list.iter().map(of).collect::<Option<Vec<_>>>().unwrap_or_default().concat()
}

/// From where to where a figure may be, given it on the input and on inputs beside it.
fn range(sort: Sort, at: f64, beside: &[f64]) -> (f64, f64) {
    let moved = beside.iter().fold(0.0_f64, |moved, other| moved.max((other - at).abs()));
    let size = beside.iter().fold(at.abs(), |size, other| size.max(other.abs()));
    let about = |by: f64| (at - by, at + by);
    match sort {
        _ if !at.is_finite() || !moved.is_finite() => (at, at),
        Sort::Sum => about(1e-6 + 10.0 * moved),
        Sort::Rounded if at.fract() == 0.0 && moved == 0.0 => (at, at),
        Sort::Rounded => about(0.02 * size + 3.0 * moved),
        Sort::Plain if moved <= 1e-9 * size => about(1e-6 * size),
        Sort::Plain if moved <= 1e-4 * size => about(100.0 * moved),
        Sort::Plain => {
            let of_one_sign = beside.iter().all(|other| other * at > 0.0);
            let least = beside.iter().fold(at.abs(), |least, other| least.min(other.abs()));
            match of_one_sign {
                true if at > 0.0 => (least / 10.0, 10.0 * size),
                true => (-10.0 * size, -least / 10.0),
                false => (-10.0 * size, 10.0 * size),
            }
        }
    }
}

/// Holds rows to the list of this name. `measure` gets 0 for the input itself, and others for inputs beside it.
pub fn hold(name: &str, measure: impl Fn(u64) -> Vec<Row>) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/records").join(format!("{name}.txt"));
    let rows = measure(0);
    assert!(!rows.is_empty(), "{name}: nothing was measured");
    if std::env::var("SPRUNG_RENEW").is_ok_and(|of| name.contains(&of)) {
        let beside: Vec<Vec<Row>> = (1..4).map(&measure).collect();
        std::fs::write(file, written(&rows, &beside)).unwrap();
        return;
    }
    let known = std::fs::read_to_string(file).unwrap();
    let known: BTreeMap<&str, &str> = known.lines().filter_map(|line| line.split_once(" = ")).collect();
    let faults: Vec<String> = rows.iter().filter_map(|row| differs(row, known.get(row.key.as_str())?.trim())).collect();
    let new: Vec<&str> = rows.iter().map(|row| &*row.key).filter(|key| !known.contains_key(key)).collect();
    assert!(
        faults.is_empty() && new.is_empty() && rows.len() == known.len(),
        "{name}: {} rows, {} known; new: {new:?}; others:\n{}",
        rows.len(),
        known.len(),
        faults.join("\n")
    );
}

fn written(rows: &[Row], beside: &[Vec<Row>]) -> String {
    let mut text = String::new();
    for row in rows {
        let others: Vec<Vec<f64>> = beside
            .iter()
            .filter_map(|rows| rows.iter().find(|other| other.key == row.key))
            .map(|other| other.all().map(|(_, number)| number).collect())
            .collect();
        let _ = write!(text, "{} = {}", row.key, row.mark());
        for (index, (sort, at)) in row.all().enumerate() {
            let beside: Vec<f64> = others.iter().map(|of| of.get(index).copied().unwrap_or(f64::NAN)).collect();
            let (low, high) = range(sort, at, &beside);
            if low == high {
                let _ = write!(text, " {at}");
            } else if high - low <= 2.1e-6 * at.abs() && sort == Sort::Plain {
                let _ = write!(text, " {at:.9e}");
            } else {
                let _ = write!(text, " {low:.4e}..{high:.4e}");
            }
        }
        text.push('\n');
    }
    text
}

/// What is other than in the list.
fn differs(row: &Row, known: &str) -> Option<String> {
    let mut known = known.split_whitespace();
    let mut faults = Vec::new();
    if known.next() != Some(&*row.mark()) {
        faults.push(format!("its words are {}", row.words));
    }
    let numbers: Vec<f64> = row.all().map(|(_, number)| number).collect();
    let ranges: Vec<&str> = known.collect();
    if numbers.len() != ranges.len() {
        faults.push(format!("{} numbers, not {}", numbers.len(), ranges.len()));
    }
    for (number, range) in numbers.iter().zip(ranges) {
        let is_within = match range.split_once("..") {
            // Rounded outwards, as the ends are in the list.
            Some((low, high)) => {
                let (low, high): (f64, f64) = (low.parse().unwrap(), high.parse().unwrap());
                (low - 1e-4 * low.abs()..=high + 1e-4 * high.abs()).contains(number)
            }
            None => {
                let at: f64 = range.parse().unwrap();
                // What is zero here may be a rounding error on another processor.
                let room = if at == 0.0 { 1e-12 } else { 1e-6 * at.abs() };
                *number == at || (number - at).abs() <= room || number.is_nan() && at.is_nan()
            }
        };
        if !is_within {
            faults.push(format!("{number:e}, not {range}"));
        }
    }
    (!faults.is_empty()).then(|| format!("{}: {}", row.key, faults.join("; ")))
}
