//! Which entries are worst, and what is wrong with them in words.

use super::check::{Entry, worst};
use nalgebra::{Matrix3, Vector3};

/// How many entries a table shows.
pub(super) const TABLE_ROWS: usize = 10;

/// The verdict on an entry whose derivative is lost in rounding.
pub(super) const CANNOT_BE_MEASURED: &str = "cannot be measured";

/// Keeps the entries with the largest error for what is allowed, worst first.
#[derive(Debug, Clone)]
pub(super) struct WorstEntries {
    limit: usize,
    ranked: Vec<(f64, Entry)>,
    /// The largest error as a multiple of what is allowed: NaN if any is, and as long as nothing was compared.
    worst: f64,
    compared: usize,
    wrong: usize,
}

impl WorstEntries {
    pub fn new(limit: usize) -> Self {
        Self { limit, ranked: Vec::new(), worst: f64::NAN, compared: 0, wrong: 0 }
    }

    /// Compares two values. Where what is allowed is not a number or infinite, nothing can be said: that fails.
    pub fn compare(&mut self, row: usize, column: Option<usize>, analytic: f64, numeric: f64, allowed: f64) {
        self.insert(None, (row, column), analytic, numeric, allowed);
    }

    /// Compares two values of one spring.
    pub fn compare_spring(
        &mut self,
        spring: usize,
        place: (usize, Option<usize>),
        analytic: f64,
        numeric: f64,
        allowed: f64,
    ) {
        self.insert(Some(spring), place, analytic, numeric, allowed);
    }

    fn insert(
        &mut self,
        spring: Option<usize>,
        (row, column): (usize, Option<usize>),
        analytic: f64,
        numeric: f64,
        allowed: f64,
    ) {
        let error = (analytic - numeric).abs();
        let ratio = match error / allowed {
            _ if !allowed.is_finite() => f64::NAN,
            _ if error == 0.0 => 0.0,
            ratio => ratio,
        };
        self.worst = if self.compared == 0 { ratio } else { worst([self.worst, ratio]) };
        self.compared += 1;
        self.wrong += if ratio <= 1.0 { 0 } else { 1 };
        let rank = |ratio: f64| if ratio.is_nan() { f64::INFINITY } else { ratio };
        let place = self.ranked.partition_point(|(other, _)| rank(*other) >= rank(ratio));
        if place < self.limit {
            let entry = in_plain_words(Entry::new(row, column, analytic, numeric, allowed));
            let entry = Entry { spring, ..entry };
            let unsure = !allowed.is_finite() && analytic.is_finite() && numeric.is_finite();
            let entry = if unsure { entry.with_verdict(CANNOT_BE_MEASURED) } else { entry };
            self.ranked.insert(place, (ratio, entry));
            self.ranked.truncate(self.limit);
        }
    }

    pub fn worst(&self) -> f64 {
        self.worst
    }

    pub fn compared(&self) -> usize {
        self.compared
    }

    pub fn wrong(&self) -> usize {
        self.wrong
    }

    /// The entries, worst first; `explain` may know more of those that are wrong.
    pub fn into_table(self, mut explain: impl FnMut(Entry) -> Entry) -> Vec<Entry> {
        let explained = |(ratio, entry): (f64, Entry)| if ratio <= 1.0 { entry } else { explain(entry) };
        self.ranked.into_iter().map(explained).collect()
    }
}

/// Says "extra" and "off by the factor" where a vector's verdict would speak of sizes.
fn in_plain_words(entry: Entry) -> Entry {
    let ratio = entry.analytic / entry.numeric;
    match entry.verdict.as_str() {
        "should be zero" => entry.with_verdict("extra"),
        verdict if verdict.ends_with("too large") || verdict.ends_with("too small") => {
            let far_off = !(2.0 / 3.0..1.5).contains(&ratio);
            if far_off { entry.with_verdict(format!("off by the factor {ratio:.2}")) } else { entry }
        }
        _ => entry,
    }
}

/// The coefficients `(α, β)` of the block `α (I − nnᵀ) + β nnᵀ` over the first `dimension` axes, and the largest entry
/// of what is left over.
fn coefficients(block: &Matrix3<f64>, n: &Vector3<f64>, dimension: usize) -> (f64, f64, f64) {
    let axial = n.dot(&(block * n));
    let transverse = if dimension > 1 { (block.trace() - axial) / (dimension - 1) as f64 } else { 0.0 };
    let identity = Matrix3::from_fn(|r, c| if r == c && r < dimension { 1.0 } else { 0.0 });
    let form = identity * transverse + n * n.transpose() * (axial - transverse);
    (transverse, axial, (block - form).amax())
}

/// What is wrong with one spring's block, where both blocks have the form of one; differences up to `tolerance`, in
/// N/m, count as agreement.
pub(super) fn of_block(
    analytic: &Matrix3<f64>,
    numeric: &Matrix3<f64>,
    n: &Vector3<f64>,
    rest_length: f64,
    dimension: usize,
    tolerance: f64,
) -> Option<String> {
    let (transverse, axial, rest) = coefficients(analytic, n, dimension);
    let (true_transverse, true_axial, true_rest) = coefficients(numeric, n, dimension);
    if !(rest <= tolerance && true_rest <= tolerance) {
        return None;
    }
    let agree = |a: f64, b: f64| (a - b).abs() <= tolerance;
    let both = |factor: f64| agree(transverse, factor * true_transverse) && agree(axial, factor * true_axial);
    if both(-1.0) {
        return Some("sign flipped".into());
    }
    if both(0.0) {
        return Some("missing".into());
    }
    let factor = axial / true_axial;
    if !agree(axial, true_axial) && both(factor) {
        return Some(if (factor / rest_length - 1.0).abs() < 1e-6 {
            format!("off by the factor l0 = {rest_length:.4}: k in place of k/l0")
        } else {
            format!("off by the factor {factor:.2}")
        });
    }
    let terms = [("transverse", transverse, true_transverse), ("axial", axial, true_axial)];
    let wrong = terms.into_iter().filter(|&(_, term, truth)| !agree(term, truth));
    let words: Vec<String> = wrong.map(|(name, term, truth)| of_term(name, term, truth, tolerance)).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

fn of_term(name: &str, term: f64, truth: f64, tolerance: f64) -> String {
    if term.abs() <= tolerance {
        return format!("the {name} term missing");
    }
    if truth.abs() <= tolerance {
        return format!("a {name} term that should not be there");
    }
    match term / truth {
        _ if (term + truth).abs() <= tolerance => format!("the {name} term with its sign flipped"),
        ratio if ratio < 0.0 => format!("the {name} term of the wrong sign and {:.2} times its size", -ratio),
        ratio if ratio < 1.0 => format!("{:.0} % of the {name} term missing", 100.0 * (1.0 - ratio)),
        ratio => format!("the {name} term {ratio:.2} times too large"),
    }
}

#[cfg(test)]
mod tests;
