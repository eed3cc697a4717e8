//! Compared entries of matrices and vectors, the worst ones in a table, with the difference in words.

use super::force_error::Step;
use super::{ColumnGroups, ForceError, Link};
use crate::error::Invalid;
use crate::system::System;
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;
use serde::Serialize;

/// The largest of some errors, NaN if any of them is NaN and NaN if there are none.
///
/// `fold(0.0, f64::max)` swallows NaN, and a check over nothing would pass: both must fail.
///
/// # Examples
/// ```
/// use sprung::verify::worst;
///
/// assert_eq!(worst([1.0, 3.0, 2.0]), 3.0);
/// assert!(worst([1.0, f64::NAN]).is_nan());
/// ```
pub fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().reduce(|a, b| if a.is_nan() || a > b { a } else { b }).unwrap_or(f64::NAN)
}

/// `error/unit`; zero where there is no error, whatever the unit.
pub(super) fn ratio(error: f64, unit: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / unit }
}

/// The verdict on an entry whose derivative is lost in rounding.
pub(super) const CANNOT_BE_MEASURED: &str = "cannot be measured";

/// One compared entry of a matrix or a vector.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    /// The row.
    pub row: usize,
    /// The column; `None` in a vector.
    pub column: Option<usize>,
    /// The spring that the entry belongs to, where there is one.
    pub spring: Option<usize>,
    /// The value under test, from a formula.
    pub analytic: f64,
    /// The independent measurement that it is compared with.
    pub numeric: f64,
    /// `|analytic − numeric|`.
    pub absolute: f64,
    /// `|analytic − numeric| / max(|analytic|, |numeric|)`, at most 2; 0 where both are zero.
    pub relative: f64,
    /// The difference in words: `missing`, `sign flipped`, `30 % too small`.
    pub verdict: String,
}

impl Entry {
    /// Compares two values; differences up to `tolerance`, in their unit, count as agreement.
    pub fn new(row: usize, column: Option<usize>, analytic: f64, numeric: f64, tolerance: f64) -> Self {
        let absolute = (analytic - numeric).abs();
        let largest = worst([analytic.abs(), numeric.abs()]);
        let relative = if largest == 0.0 { 0.0 } else { absolute / largest };
        let verdict = verdict(analytic, numeric, tolerance);
        Self { row, column, spring: None, analytic, numeric, absolute, relative, verdict }
    }

    /// Names the spring that the entry belongs to.
    pub fn of_spring(self, spring: usize) -> Self {
        Self { spring: Some(spring), ..self }
    }

    /// Replaces the verdict by one that knows more, such as `30 % of the transverse term missing`.
    pub fn with_verdict(self, verdict: impl Into<String>) -> Self {
        Self { verdict: verdict.into(), ..self }
    }

    /// Whether a number of the entry is NaN.
    pub fn has_nan(&self) -> bool {
        [self.analytic, self.numeric, self.absolute, self.relative].iter().any(|number| number.is_nan())
    }
}

/// The fault of `analytic` if `numeric` is right.
fn verdict(analytic: f64, numeric: f64, tolerance: f64) -> String {
    if !analytic.is_finite() || !numeric.is_finite() {
        "not finite".into()
    } else if (analytic - numeric).abs() <= tolerance {
        "agrees".into()
    } else if analytic == 0.0 {
        "missing".into()
    } else if numeric.abs() <= tolerance {
        "extra".into()
    } else if (analytic + numeric).abs() <= tolerance {
        "sign flipped".into()
    } else if analytic.signum() != numeric.signum() {
        "wrong sign and size".into()
    } else {
        let ratio = analytic / numeric;
        match (ratio - 1.0).abs() {
            _ if !(2.0 / 3.0..1.5).contains(&ratio) => format!("off by the factor {ratio:.2}"),
            size if size < 1e-3 => format!("relative difference {size:.1e}"),
            size => format!("{:.1} % too {}", 100.0 * size, if ratio > 1.0 { "large" } else { "small" }),
        }
    }
}

/// The ten entries with the largest error relative to the allowed one, worst first, and the statistics of all.
#[derive(Debug, Clone)]
pub(super) struct WorstEntries {
    ranked: Vec<(f64, Entry)>,
    /// The spring that the entries compared from now on belong to, where there is one.
    pub spring: Option<usize>,
    /// The largest error as a multiple of the allowed one: NaN if any is, and as long as nothing was compared.
    pub worst: f64,
    pub compared: usize,
    pub wrong: usize,
}

impl WorstEntries {
    pub fn new() -> Self {
        Self { ranked: Vec::new(), spring: None, worst: f64::NAN, compared: 0, wrong: 0 }
    }

    /// Compares two values. An allowed error that is NaN or infinite says nothing of the entry: it fails.
    pub fn compare(&mut self, row: usize, column: Option<usize>, analytic: f64, numeric: f64, allowed: f64) {
        let error = (analytic - numeric).abs();
        let ratio = if allowed.is_finite() { ratio(error, allowed) } else { f64::NAN };
        self.worst = if self.compared == 0 { ratio } else { worst([self.worst, ratio]) };
        self.compared += 1;
        self.wrong += if ratio <= 1.0 { 0 } else { 1 };
        let rank = |ratio: f64| if ratio.is_nan() { f64::INFINITY } else { ratio };
        let place = self.ranked.partition_point(|(other, _)| rank(*other) >= rank(ratio));
        if place < 10 {
            let entry = Entry { spring: self.spring, ..Entry::new(row, column, analytic, numeric, allowed) };
            let unsure = !allowed.is_finite() && analytic.is_finite() && numeric.is_finite();
            let entry = if unsure { entry.with_verdict(CANNOT_BE_MEASURED) } else { entry };
            self.ranked.insert(place, (ratio, entry));
            self.ranked.truncate(10);
        }
    }

    /// Compares a column of a matrix with `expected(row)`, a value and its allowed error; where springs couple no row to it, with zero.
    pub fn compare_column(
        &mut self,
        matrix: &CscMatrix<f64>,
        column: usize,
        coupled: &[u32],
        mut expected: impl FnMut(usize) -> (f64, f64),
    ) {
        for (row, value, is_coupled) in column_entries(matrix, column, coupled) {
            let (numeric, allowed) = if is_coupled { expected(row) } else { (0.0, 0.0) };
            self.compare(row, Some(column), value, numeric, allowed);
        }
    }

    /// Compares all columns of a matrix with difference quotients: `differences` gives the steps of a group of columns and the changes of every row
    /// over them, `allowed(row, column, step)` the allowed error.
    pub fn compare_differences(
        &mut self,
        matrix: &CscMatrix<f64>,
        groups: &ColumnGroups,
        mut differences: impl FnMut(&[usize]) -> (Vec<Step>, Vec<f64>),
        allowed: impl Fn(usize, usize, Step) -> f64,
    ) {
        for group in groups.groups() {
            let (steps, differences) = differences(group);
            for (&column, &step) in group.iter().zip(&steps) {
                self.compare_column(matrix, column, groups.rows(column), |row| {
                    (differences[row] / step.width(), allowed(row, column, step))
                });
            }
        }
    }

    /// The entries, worst first; `explain` refines the verdicts on wrong ones.
    pub fn into_table(self, mut explain: impl FnMut(Entry) -> Entry) -> Vec<Entry> {
        let explained = |(ratio, entry): (f64, Entry)| if ratio <= 1.0 { entry } else { explain(entry) };
        self.ranked.into_iter().map(explained).collect()
    }
}

/// Names the spring of a wrong entry of K, and the term of its block that is wrong, if exactly one spring is behind the block.
///
/// `numeric(i, j)` is the block that ∂f_i/∂x_j should be, with the difference that counts as agreement.
pub(super) fn explain_by_spring(
    entry: Entry,
    error: &ForceError,
    matrix: &CscMatrix<f64>,
    numeric: impl FnOnce(usize, usize) -> (Matrix3<f64>, f64),
) -> Entry {
    let Some(column) = entry.column else { return entry };
    let system = error.system;
    let dofs = system.dofs();
    let (i, j) = (dofs.dof(entry.row).particle, dofs.dof(column).particle);
    let mut links = error.links_between(i, j);
    let (Some(link), None) = (links.next(), links.next()) else { return entry };
    let entry = entry.of_spring(link.index);
    let dimension = system.dimension();
    if dofs.rows(i).len() != dimension || dofs.rows(j).len() != dimension {
        return entry;
    }
    let analytic = particle_block(system, matrix, i, j);
    let (numeric, tolerance) = numeric(i, j);
    match block_verdict(link, [&analytic, &numeric], dimension, tolerance) {
        Some(words) => entry.with_verdict(words),
        None => entry,
    }
}

/// The entries of a reduced matrix at the rows of particle i and the columns of particle j, both free along all axes.
pub(super) fn particle_block(system: &System, matrix: &CscMatrix<f64>, i: usize, j: usize) -> Matrix3<f64> {
    let (rows, columns) = (system.dofs().rows(i).start, system.dofs().rows(j).start);
    let modelled = |r, c| r < system.dimension() && c < system.dimension();
    Matrix3::from_fn(|r, c| if modelled(r, c) { entry_of(matrix, rows + r, columns + c) } else { 0.0 })
}

/// The coefficients `(α, β)` of the block `α (I − nnᵀ) + β nnᵀ` over the first `dimension` axes, and the largest entry of the remainder.
fn coefficients(block: &Matrix3<f64>, n: &Vector3<f64>, dimension: usize) -> (f64, f64, f64) {
    let axial = n.dot(&(block * n));
    let transverse = if dimension > 1 { (block.trace() - axial) / (dimension - 1) as f64 } else { 0.0 };
    let identity = Matrix3::from_fn(|r, c| if r == c && r < dimension { 1.0 } else { 0.0 });
    let form = identity * transverse + n * n.transpose() * (axial - transverse);
    (transverse, axial, (block - form).amax())
}

/// The fault of the first of two blocks of a spring in words, if the second is right and both have the form of one; differences up to `tolerance`,
/// in N/m, count as agreement.
fn block_verdict(link: &Link, blocks: [&Matrix3<f64>; 2], dimension: usize, tolerance: f64) -> Option<String> {
    let [(transverse, axial, rest), (true_transverse, true_axial, true_rest)] =
        blocks.map(|block| coefficients(block, &link.direction, dimension));
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
        return Some(if (factor / link.rest_length - 1.0).abs() < 1e-6 {
            format!("off by the factor l0 = {:.4}: k in place of k/l0", link.rest_length)
        } else {
            format!("off by the factor {factor:.2}")
        });
    }
    let terms = [("transverse", transverse, true_transverse), ("axial", axial, true_axial)];
    let wrong = terms.into_iter().filter(|&(_, term, truth)| !agree(term, truth));
    let words: Vec<String> = wrong.map(|(name, term, truth)| term_verdict(name, term, truth, tolerance)).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

fn term_verdict(name: &str, term: f64, truth: f64, tolerance: f64) -> String {
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

pub(super) fn entry_of(matrix: &CscMatrix<f64>, row: usize, column: usize) -> f64 {
    matrix.get_entry(row, column).map_or(0.0, |entry| entry.into_value())
}

/// The entries in the rows that springs couple to a column, stored or not, and those that only the matrix has: (row, stored value or zero, coupled).
pub(super) fn column_entries(matrix: &CscMatrix<f64>, column: usize, coupled: &[u32]) -> Vec<(usize, f64, bool)> {
    let stored = matrix.col(column);
    let mut stored = stored.row_indices().iter().copied().zip(stored.values().iter().copied()).peekable();
    let mut entries = Vec::with_capacity(coupled.len());
    for row in coupled.iter().map(|&row| row as usize) {
        while let Some((extra, value)) = stored.next_if(|&(other, _)| other < row) {
            entries.push((extra, value, false));
        }
        let value = stored.next_if(|&(other, _)| other == row).map_or(0.0, |(_, value)| value);
        entries.push((row, value, true));
    }
    entries.extend(stored.map(|(extra, value)| (extra, value, false)));
    entries
}

pub(super) fn check_square(name: &str, matrix: &CscMatrix<f64>, n: usize) -> Result<(), Invalid> {
    if (matrix.nrows(), matrix.ncols()) == (n, n) {
        return Ok(());
    }
    let size = format!("{} × {}", matrix.nrows(), matrix.ncols());
    Err(Invalid::new(name, size, format!("must be {n} × {n} for a point of {n} coordinates")))
}

#[cfg(test)]
mod tests;
