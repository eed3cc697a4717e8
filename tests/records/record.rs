//! Figures of a measurement, held to those that a file in `lists` holds.
//!
//! A figure that a closed form gives has a test of its own. What is left of a report, how near to its bound a right number comes,
//! how many directions were tried, what a sentence says, has none; and yet a slip in its formula changes it. So all of it is
//! written down once and compared. How exactly says the measurement itself: when the list is written it is repeated on
//! inputs that differ in their last bits. A figure that stays the same to 10⁻⁹ is held to 10⁻⁶; one that moves is held to a
//! hundred times that movement, or, where nothing but rounding is in it, to its order of magnitude. That holds on
//! processors with registers of 256 bits and of 512; on others only the names of rows are held.
//!
//! `cargo xtask records` writes the lists anew, `SPRUNG_RENEW=NAME` those whose names contain this; the difference belongs into the change
//! that makes it, looked at.

use serde_json::Value;
use sprung::verify::Subject;
use std::collections::BTreeMap;
use std::fmt::{Debug, Write as _};
use std::path::Path;

/// The subject, or for another seed than 0 one beside it: free coordinates and velocities moved by some units in the last place.
pub fn beside(subject: &Subject, seed: u64) -> Subject {
    let mut subject = subject.clone();
    for row in (0..subject.system.dofs().len()).filter(|_| seed > 0) {
        let dof = subject.system.dofs().dof(row);
        let by = 1.0 + (seed as f64 * (3.0 + row as f64)).sin() * 2e-15;
        subject.state.positions[dof.particle][dof.axis] *= by;
        subject.state.velocities[dof.particle][dof.axis] *= by;
    }
    subject
}

/// What is known of one thing: its numbers, and its words.
#[derive(Default)]
pub struct Row {
    pub key: String,
    pub numbers: Vec<f64>,
    /// Sums of logarithms of long lists, which are held to absolute differences.
    pub sums: Vec<f64>,
    /// Numbers in sentences, rounded there.
    pub rounded: Vec<f64>,
    /// Of work done: that of iterations depends on rounding.
    pub counts: Vec<f64>,
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

    /// Of everything that a value shows when it is debugged.
    pub fn shown(key: impl Into<String>, value: &impl Debug) -> Self {
        let text = format!("{value:?}");
        let mut row = Self { key: key.into(), ..Self::default() };
        let mut rest = &*text;
        while let Some((before, after)) = rest.split_once('[') {
            row.read(before);
            let list = after.split_once(']').map(|(list, after)| (list.split(", ").map(str::parse).collect(), after));
            rest = match list {
                Some((Ok(numbers), after)) => {
                    row.list(numbers);
                    after
                }
                _ => after,
            };
        }
        row.read(rest);
        row
    }

    /// A list of numbers; a long one by a sum.
    fn list(&mut self, numbers: Vec<f64>) {
        self.numbers.push(numbers.len() as f64);
        if numbers.len() <= LONG {
            return self.numbers.extend(numbers);
        }
        self.sums.push(weighed(numbers.into_iter().enumerate()));
    }

    /// Takes numbers and words apart; those between the braces of `Work` are counts, and times are left out.
    fn read(&mut self, text: &str) {
        for part in text.split_inclusive('}') {
            let (mut is_work, mut is_time) = (false, false);
            let is_within = |c: char| c.is_alphanumeric() || "._-+".contains(c);
            for token in part.split(|c: char| !is_within(c)).filter(|token| !token.is_empty()) {
                match token.parse::<f64>() {
                    Ok(_) if is_time => {}
                    Ok(number) if is_work => self.counts.push(number),
                    Ok(number) => self.numbers.push(number),
                    Err(_) => self.words += token,
                }
                is_work |= token == "Work";
                is_time = token.ends_with("_seconds");
            }
        }
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
                    self.list(numbers);
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
        [
            of(Sort::Plain, &self.numbers),
            of(Sort::Sum, &self.sums),
            of(Sort::Rounded, &self.rounded),
            of(Sort::Count, &self.counts),
        ]
        .into_iter()
        .flatten()
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Sort {
    Plain,
    Sum,
    Rounded,
    Count,
}

/// The numbers of a list of numbers or of lists of them; none if there is anything else in it.
fn numbers(list: &[Value]) -> Vec<f64> {
    let of = |value: &Value| match value {
        Value::Array(list) => Some(numbers(list)).filter(|numbers| numbers.len() == list.len() && !numbers.is_empty()),
        value => value.as_f64().map(|number| vec![number]),
    };
    list.iter().map(of).collect::<Option<Vec<_>>>().unwrap_or_default().concat()
}

/// How a figure is held.
enum Held {
    /// To 10⁻⁶, by a sum over all of the row.
    Stable,
    /// Nothing, or what rounding leaves of it elsewhere.
    Zero,
    /// To a range.
    Within(f64, f64),
}

/// How a figure is held, given it on the input and on inputs beside it.
fn held(sort: Sort, at: f64, beside: &[f64]) -> Held {
    let moved = beside.iter().fold(0.0_f64, |moved, other| moved.max((other - at).abs()));
    let size = beside.iter().fold(at.abs(), |size, other| size.max(other.abs()));
    let about = |by: f64| Held::Within(at - by, at + by);
    match sort {
        _ if !at.is_finite() || !moved.is_finite() => Held::Within(f64::NEG_INFINITY, f64::INFINITY),
        Sort::Sum => about(1e-6 + 10.0 * moved),
        _ if at == 0.0 && moved == 0.0 => Held::Zero,
        Sort::Rounded if at.fract() == 0.0 && moved == 0.0 => Held::Stable,
        Sort::Rounded => about(0.02 * size + 3.0 * moved),
        // Up to a fifth more or less, which of less than five is none.
        Sort::Count => about(0.2 * size + 3.0 * moved),
        Sort::Plain if moved <= 1e-9 * size => Held::Stable,
        Sort::Plain if moved <= 1e-4 * size => about(100.0 * moved),
        Sort::Plain => {
            let of_one_sign = beside.iter().all(|other| other * at > 0.0);
            let least = beside.iter().fold(at.abs(), |least, other| least.min(other.abs()));
            match of_one_sign {
                true if at > 0.0 => Held::Within(least / 10.0, 10.0 * size),
                true => Held::Within(-10.0 * size, -least / 10.0),
                false => Held::Within(-10.0 * size, 10.0 * size),
            }
        }
    }
}

/// A sum that changes by about as much as any of the numbers, relatively.
fn weighed(numbers: impl Iterator<Item = (usize, f64)>) -> f64 {
    let term = |(at, number): (usize, f64)| {
        let weight = 1.0 + (0.618 * at as f64).fract();
        if number == 0.0 { weight } else { weight * (number.abs().ln() + number.signum()) }
    };
    numbers.map(term).sum()
}

/// Whether this processor rounds as those that the lists were written on: with fused multiplications and additions in wide registers. On others
/// figures that are all rounding fall outside of their ranges (5 of 86 tests on one without), and only names of rows are held to lists.
fn rounds_as_the_lists() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Holds rows to the list of this name. `measure` gets 0 for the input itself, and others for inputs beside it.
pub fn hold(name: &str, measure: impl Fn(u64) -> Vec<Row>) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/records/lists").join(format!("{name}.txt"));
    let rows = measure(0);
    assert!(!rows.is_empty(), "{name}: nothing was measured");
    if std::env::var("SPRUNG_RENEW").is_ok_and(|of| of == "1" || name.contains(&of)) {
        let beside: Vec<Vec<Row>> = (1..4).map(&measure).collect();
        std::fs::write(file, written(&rows, &beside)).unwrap();
        return;
    }
    let known = std::fs::read_to_string(file).unwrap();
    let known: BTreeMap<&str, &str> = known.lines().filter_map(|line| line.split_once(" = ")).collect();
    let held = rows.iter().filter(|_| rounds_as_the_lists());
    let faults: Vec<String> = held.filter_map(|row| differs(row, known.get(row.key.as_str())?)).collect();
    let new: Vec<&str> = rows.iter().map(|row| &*row.key).filter(|key| !known.contains_key(key)).collect();
    assert!(
        faults.is_empty() && new.is_empty() && rows.len() == known.len(),
        "{name}: {} rows, {} known; new: {new:?}; others:\n{}",
        rows.len(),
        known.len(),
        faults.iter().take(20).map(String::as_str).collect::<Vec<_>>().join("\n")
    );
}

/// A row: the mark of its words, how many figures it has, the sum of those that are stable, and the others with their places.
fn written(rows: &[Row], beside: &[Vec<Row>]) -> String {
    let mut text = String::new();
    for row in rows {
        let others: Vec<Vec<f64>> = beside
            .iter()
            .filter_map(|rows| rows.iter().find(|other| other.key == row.key))
            .map(|other| other.all().map(|(_, number)| number).collect())
            .collect();
        let (mut stable, mut zeros, mut ranges) = (Vec::new(), String::new(), String::new());
        for (place, (sort, at)) in row.all().enumerate() {
            let beside: Vec<f64> = others.iter().map(|of| of.get(place).copied().unwrap_or(f64::NAN)).collect();
            match held(sort, at, &beside) {
                Held::Stable => stable.push((place, at)),
                Held::Zero => zeros += &format!(" {place}:0"),
                // A row that has another length beside the input, or what is no number: anything.
                Held::Within(low, high) if !(low.is_finite() && high.is_finite()) => ranges += &format!(" {place}:any"),
                Held::Within(low, high) => ranges += &format!(" {place}:{}", range(low, high)),
            }
        }
        let (many, sum) = (row.all().count(), weighed(stable.into_iter()));
        let _ = writeln!(text, "{} = {} {many} {sum:.7}{zeros}{ranges}", row.key, row.mark());
    }
    text
}

/// A range rounded outwards, to two digits where it is wide.
fn range(low: f64, high: f64) -> String {
    let (by, digits) = if high - low > low.abs().max(high.abs()) / 2.0 { (0.06, 1) } else { (1e-7, 7) };
    format!("{:.digits$e}..{:.digits$e}", low - by * low.abs(), high + by * high.abs())
}

/// What is other than in the list.
fn differs(row: &Row, known: &str) -> Option<String> {
    let numbers: Vec<f64> = row.all().map(|(_, number)| number).collect();
    let mut known = known.split_whitespace();
    let mut faults = Vec::new();
    if known.next() != Some(&*row.mark()) {
        faults.push(format!("its words are {}", row.words));
    }
    let many = known.next().and_then(|many| many.parse().ok());
    if many != Some(numbers.len()) {
        faults.push(format!("{} figures, not {many:?}", numbers.len()));
        return Some(format!("{}: {}", row.key, faults.join("; ")));
    }
    let sum: f64 = known.next().unwrap().parse().unwrap();
    let mut stable: Vec<bool> = vec![true; numbers.len()];
    for (place, range) in known.filter_map(|held| held.split_once(':')) {
        let place: usize = place.parse().unwrap();
        stable[place] = false;
        let number = numbers[place];
        let is_within = match range.split_once("..") {
            Some((low, high)) => (low.parse().unwrap()..=high.parse::<f64>().unwrap()).contains(&number),
            None => range == "any" || number.abs() <= 1e-12,
        };
        if !is_within {
            faults.push(format!("figure {place} is {number:e}, not {range}"));
        }
    }
    let stable = weighed(numbers.iter().copied().enumerate().filter(|(place, _)| stable[*place]));
    if (stable - sum).abs() > 2e-6 || stable.is_nan() {
        let first = numbers.iter().take(LONG).collect::<Vec<_>>();
        faults.push(format!("the stable ones sum up to {stable}, not {sum}; they begin with {first:?}"));
    }
    (!faults.is_empty()).then(|| format!("{}: {}", row.key, faults.join("; ")))
}
