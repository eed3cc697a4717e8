//! Any Jacobian against any force: the wrong entries, with their fault in words.
//!
//! The derivative of a function about which nothing is known comes with an estimate of its own error. Central differences at
//! `h, h/4, h/16, …` have an error series in h². Two neighbours give `R = D(h/4) + (D(h/4) − D(h))/15`, whose error is of
//! order h⁴ (Richardson 1911). As h shrinks R settles, until rounding shakes it; the derivative is where three neighbours agree
//! best, and their spread is the estimate of its error (after Ridders 1982).

use super::coloring::ForceAt;
use super::comparison::{
    CANNOT_BE_MEASURED, check_square, column_entries, entry_of, explain_by_spring, particle_block,
};
use super::{Check, Claim, ColumnGroups, Entry, ForceError, U, WorstEntries, worst};
use crate::error::{Invalid, Result};
use crate::system::{State, System};
use nalgebra_sparse::{CooMatrix, CscMatrix};
use std::fmt;

/// Number of steps, each a quarter of the one before.
const LEVELS: usize = 14;
type Steps = [f64; LEVELS];

/// The force at x + h and at x − h for every step.
type Sides = [[Vec<f64>; 2]; LEVELS];

/// The measurement of [`check_jacobian`], and its assumptions.
#[derive(Debug, Clone)]
pub struct JacobianOptions<'a> {
    /// The distance over which the force changes noticeably, in the unit of the point, such as the shortest spring.
    /// `None` takes the shortest spring at each particle where the springs are given, else the spread of the
    /// coordinates. Steps go from an eighth of it down to 1e-9 of it, so its size matters little.
    pub length: Option<f64>,
    /// Relative difference that counts as agreement, beside the uncertainty of the measurement. Entries below a
    /// thousandth of it, relative to the largest of their column, or below 1e-12 of the largest of all, count as zero.
    pub tolerance: f64,
    /// Columns to measure together; `None` measures one by one and trusts no pattern.
    pub groups: Option<ColumnGroups>,
    /// The springs behind the force, if the point is their free coordinates: lets verdicts speak of springs and their terms.
    pub springs: Option<(&'a System, &'a State)>,
}

impl Default for JacobianOptions<'_> {
    fn default() -> Self {
        Self { length: None, tolerance: 1e-7, groups: None, springs: None }
    }
}

/// The outcome of [`check_jacobian`]: both matrices, and the worst entries with verdicts in words.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct JacobianReport {
    /// The matrix under test.
    pub analytic: CscMatrix<f64>,
    /// The measured Jacobian.
    pub numeric: CscMatrix<f64>,
    /// Number of compared entries.
    pub compared: usize,
    /// Number of wrong ones.
    pub wrong: usize,
    /// The largest difference as a multiple of the allowed one: at most 1 if all entries agree, NaN if one is not a number.
    pub value: f64,
    /// The fault of the matrix as a whole, if it has one: `sign flipped`, `transposed`, `off by the factor 2.00`.
    pub overall: Option<String>,
    /// The worst entries, worst first.
    pub worst: Vec<Entry>,
}

impl JacobianReport {
    /// Whether every entry agrees.
    pub fn passed(&self) -> bool {
        self.value <= 1.0
    }

    /// The reason why the matrix cannot be judged: no entry that disagrees has a derivative that can be measured.
    pub(super) fn unmeasurable(&self) -> Option<String> {
        let wrong = self.worst.get(..self.wrong).filter(|wrong| !wrong.is_empty())?;
        let all = wrong.iter().all(|entry| entry.verdict == CANNOT_BE_MEASURED);
        all.then(|| format!("the derivatives of {} entries are lost in the rounding of forces", self.wrong))
    }

    /// Refines the verdict on a wrong entry: transposed, or the wrong term of its spring.
    fn explain(&self, entry: Entry, springs: Option<&ForceError>, tolerance: f64) -> Entry {
        let Some(column) = entry.column.filter(|_| entry.verdict != CANNOT_BE_MEASURED) else { return entry };
        let mirrored = entry_of(&self.numeric, column, entry.row);
        let is_mirrored = (entry.analytic - mirrored).abs() <= 10.0 * tolerance * mirrored.abs();
        if entry.row != column && entry.analytic != 0.0 && is_mirrored {
            return entry.with_verdict("transposed");
        }
        let Some(error) = springs else { return entry };
        explain_by_spring(entry, error, &self.analytic, |i, j| {
            let block = |matrix| particle_block(error.system, matrix, i, j);
            let (analytic, numeric) = (block(&self.analytic), block(&self.numeric));
            (numeric, 10.0 * tolerance * worst([analytic.amax(), numeric.amax()]))
        })
    }

    /// As a check of the suite.
    pub fn to_check(&self, scene: impl Into<String>) -> Check {
        let why = "1 is the error allowed for an entry: eight times the spread of extrapolated central differences, and the relative \
            tolerance that was asked for";
        Check::new(Claim::Jacobian, "Jacobian against its force", scene, self.value, 1.0, format!("{self:#}; {why}"))
            .with_table(self.worst.clone())
    }
}

/// One sentence in alternate form (`{:#}`), else with the table of worst entries.
impl fmt::Display for JacobianReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { compared, wrong, .. } = self;
        match (wrong, &self.overall) {
            (0, _) => write!(f, "all {compared} entries agree with the force")?,
            (_, Some(overall)) => write!(f, "{wrong} of {compared} entries are wrong; the whole matrix: {overall}")?,
            (_, None) => write!(f, "{wrong} of {compared} entries are wrong")?,
        }
        if f.alternate() {
            return Ok(());
        }
        for entry in self.worst.iter().take(*wrong) {
            let Entry { row, analytic, numeric, verdict, .. } = entry;
            let column = entry.column.map_or(String::new(), |column| format!(", column {column}"));
            let spring = entry.spring.map_or(String::new(), |spring| format!(", spring {spring}"));
            write!(f, "\n  row {row}{column}{spring}: {verdict} ({analytic:e}, measured {numeric:e})")?;
        }
        Ok(())
    }
}

/// Compares a matrix with the derivative of a force at a point.
///
/// `force(x, f)` writes the force at x into f; both have the length n of `point`. `matrix` is n × n: `∂f_row/∂x_column`, as a [`CscMatrix`], or a
/// reference to a dense nalgebra matrix, a [`CooMatrix`] or a [`SymmetricMatrix`](crate::assembly::SymmetricMatrix). It need not be symmetric. The
/// force is evaluated 28 times for each group of columns.
///
/// Detects missing, extra, doubled, transposed, mis-signed and mis-scaled entries down to a relative error of `tolerance`.
/// An error that force and matrix share is not detected; nor are, with groups taken from the matrix itself, some missing entries.
///
/// ```
/// use nalgebra::DMatrix;
/// use sprung::verify::{JacobianOptions, check_jacobian};
///
/// // f = (x y, −x²), with the sign of ∂f_1/∂x wrong.
/// let force = |x: &[f64], f: &mut [f64]| (f[0], f[1]) = (x[0] * x[1], -x[0] * x[0]);
/// let matrix = DMatrix::from_row_slice(2, 2, &[3.0, 2.0, 4.0, 0.0]);
/// let report = check_jacobian(force, &matrix, &[2.0, 3.0], &JacobianOptions::default())?;
/// assert_eq!(report.worst[0].verdict, "sign flipped");
/// # Ok::<(), sprung::Error>(())
/// ```
///
/// # Errors
/// [`Invalid`] for an empty point, coordinates that are not finite, a matrix or groups or springs of another size, a
/// length or tolerance that is not positive. A value that is not finite is reported as a wrong entry.
pub fn check_jacobian(
    force: impl FnMut(&[f64], &mut [f64]),
    matrix: impl Into<CscMatrix<f64>>,
    point: &[f64],
    options: &JacobianOptions,
) -> Result<JacobianReport> {
    let analytic = matrix.into();
    let spread = check_input(&analytic, point, options)?;
    let n = point.len();
    let groups = options.groups.clone().unwrap_or_else(|| ColumnGroups::one_by_one(n));
    let springs = options.springs.and_then(|(system, state)| ForceError::new(system, &state.positions).ok());
    let steps_of = |column: usize| {
        // Without a length from the caller each particle moves by fractions of its own shortest spring.
        let own = springs.as_ref().map(|error| error.shortest(error.system.dofs().dof(column).particle));
        let length = options.length.or(own.filter(|length| length.is_finite())).unwrap_or(spread);
        steps(length).map(|h| representable(h, point[column]))
    };
    let mut force = ForceAt { force, x: point.to_vec() };
    let mut comparisons = Vec::new();
    for group in groups.groups() {
        let columns: Vec<(usize, Steps)> = group.iter().map(|&column| (column, steps_of(column))).collect();
        let sides = std::array::from_fn(|level| {
            [1.0, -1.0].map(|side| force.moved(group, |place, x| x + side * columns[place].1[level]))
        });
        comparisons.extend(compare(&sides, &columns, &groups, &analytic));
    }
    let largest = comparisons.iter().map(|c| c.estimate.value.abs()).fold(0.0, f64::max);
    let mut numeric = CooMatrix::new(n, n);
    let mut entries = WorstEntries::new();
    for comparison in &comparisons {
        let Comparison { row, column, value, estimate, .. } = *comparison;
        entries.compare(row, Some(column), value, estimate.value, comparison.allowed(options.tolerance, largest));
        if estimate.value != 0.0 {
            numeric.push(row, column, estimate.value);
        }
    }
    let numeric = CscMatrix::from(&numeric);
    let (value, compared, wrong) = (entries.worst, entries.compared, entries.wrong);
    let overall = if wrong > 0 { overall(&analytic, &numeric) } else { None };
    let mut report = JacobianReport { analytic, numeric, compared, wrong, value, overall, worst: Vec::new() };
    report.worst = entries.into_table(|entry| report.explain(entry, springs.as_ref(), options.tolerance));
    Ok(report)
}

/// Checks sizes and values; returns the spread of the coordinates.
fn check_input(matrix: &CscMatrix<f64>, point: &[f64], options: &JacobianOptions) -> Result<f64, Invalid> {
    let n = point.len();
    if n == 0 {
        return Err(Invalid::new("point", "[]", "must have at least one coordinate"));
    }
    if let Some((index, x)) = point.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        return Err(Invalid::new("point", x, "must be finite").at(index));
    }
    check_square("matrix", matrix, n)?;
    if let Some(groups) = options.groups.as_ref().filter(|groups| groups.order() != n) {
        return Err(Invalid::new("options.groups", groups.order(), format!("must group {n} columns")));
    }
    if let Some((system, state)) = options.springs
        && (system.dofs().len() != n || state.positions.len() != system.particles())
    {
        let size = format!("{} free coordinates, {} positions", system.dofs().len(), state.positions.len());
        let rule = format!("must have {n} free coordinates and fit each other");
        return Err(Invalid::new("options.springs", size, rule));
    }
    for (key, value) in [("options.tolerance", Some(options.tolerance)), ("options.length", options.length)] {
        if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Invalid::new(key, value, "must be finite and positive"));
        }
    }
    let (least, most) = point.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let largest = least.abs().max(most.abs());
    Ok([most - least, largest].into_iter().find(|size| *size > 0.0).unwrap_or(1.0))
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Estimate {
    value: f64,
    error: f64,
}

/// Steps from an eighth of `length` down by quarters.
fn steps(length: f64) -> Steps {
    std::array::from_fn(|level| length / 8.0 * 0.25_f64.powi(level as i32))
}

/// The step nearest to h by which x + h and x − h differ from x exactly, if any: h rounded to the spacing of numbers at twice x.
fn representable(h: f64, x: f64) -> f64 {
    let coarse = 2.0 * x.abs() + h;
    (coarse + h) - coarse
}

/// The derivative from central differences at [`steps`] and their rounding, without those at which the function is not finite; NaN if none is left.
fn extrapolate(differences: &Steps, rounding: &Steps) -> Estimate {
    let refined: [f64; LEVELS - 1] = std::array::from_fn(|level| {
        let (coarse, fine) = (differences[level], differences[level + 1]);
        fine + (fine - coarse) / 15.0
    });
    let estimates = refined.windows(3).zip(&rounding[2..]).map(|(triple, rounding)| {
        let spread = worst([(triple[1] - triple[0]).abs(), (triple[2] - triple[1]).abs()]);
        Estimate { value: triple[1], error: spread + rounding }
    });
    let best = estimates.filter(|estimate| estimate.error.is_finite()).min_by(|a, b| a.error.total_cmp(&b.error));
    best.unwrap_or(Estimate { value: f64::NAN, error: f64::NAN })
}

/// The derivative of a component of the force.
fn derivative(sides: &Sides, row: usize, steps: &Steps) -> Estimate {
    let of_step = |of: fn(f64, f64, f64) -> f64| -> Steps {
        std::array::from_fn(|level| of(sides[level][0][row], sides[level][1][row], steps[level]))
    };
    let quotients = of_step(|after, before, h| (after - before) / (2.0 * h));
    extrapolate(&quotients, &of_step(|after, before, h| U * after.abs().max(before.abs()) / h))
}

struct Comparison {
    row: usize,
    column: usize,
    value: f64,
    estimate: Estimate,
    /// The largest estimate of the column.
    largest: f64,
}

impl Comparison {
    /// The allowed difference of value and estimate; NaN where the estimate is too uncertain to judge the value.
    fn allowed(&self, tolerance: f64, largest_of_all: f64) -> f64 {
        let size = worst([self.value.abs(), self.estimate.value.abs()]);
        // Below 1e-12 of the largest entry estimates are the rounding of forces and no more.
        let negligible = worst([1e-3 * tolerance * self.largest, 1e-12 * largest_of_all]);
        let uncertainty = 8.0 * self.estimate.error;
        if uncertainty >= size && self.value.abs() > negligible {
            f64::NAN
        } else {
            uncertainty + tolerance * size + negligible
        }
    }
}

/// The comparisons of a group: expected entries, those that only the matrix has, and changes in rows that no column accounts for.
fn compare(
    sides: &Sides,
    columns: &[(usize, Steps)],
    groups: &ColumnGroups,
    matrix: &CscMatrix<f64>,
) -> Vec<Comparison> {
    // f64::max passes over NaN: one component that is not finite must not excuse, or accuse, the others.
    let largest = |column: &[Estimate]| column.iter().map(|estimate| estimate.value.abs()).fold(0.0, f64::max);
    let mut comparisons = Vec::new();
    let mut unclaimed = vec![true; matrix.nrows()];
    for (column, steps) in columns {
        let (column, rows) = (*column, groups.rows(*column));
        let estimates: Vec<_> = rows.iter().map(|&row| derivative(sides, row as usize, steps)).collect();
        let largest = largest(&estimates);
        let mut estimates = estimates.into_iter();
        for (row, value, is_expected) in column_entries(matrix, column, rows) {
            let measured = if is_expected { estimates.next() } else { None };
            unclaimed[row] &= !is_expected;
            let estimate = measured.unwrap_or(Estimate { value: 0.0, error: 0.0 });
            comparisons.push(Comparison { row, column, value, estimate, largest });
        }
    }
    // The matrix lacks an entry in one of the columns, the first for want of knowing better.
    let Some(&(column, steps)) = columns.first() else { return comparisons };
    let estimates: Vec<_> = (0..matrix.nrows()).map(|row| derivative(sides, row, &steps)).collect();
    let largest = largest(&estimates);
    let unclaimed = estimates.into_iter().enumerate().filter(|(row, _)| unclaimed[*row]);
    comparisons.extend(unclaimed.map(|(row, estimate)| Comparison { row, column, value: 0.0, estimate, largest }));
    comparisons
}

/// The one fault that explains the whole matrix, if there is one.
fn overall(analytic: &CscMatrix<f64>, numeric: &CscMatrix<f64>) -> Option<String> {
    let square = |matrix: &CscMatrix<f64>| matrix.values().iter().map(|value| value * value).sum::<f64>();
    let (aa, nn) = (square(analytic), square(numeric));
    let (mut an, mut transposed) = (0.0, 0.0);
    for (row, column, value) in analytic.triplet_iter() {
        an += value * entry_of(numeric, row, column);
        transposed += value * entry_of(numeric, column, row);
    }
    let factor = an / nn;
    let close = |rest: f64| rest <= 1e-10 * worst([aa, nn]);
    if close(aa - 2.0 * transposed + nn) && !close(aa - 2.0 * an + nn) {
        Some("transposed".into())
    } else if aa == 0.0 {
        Some("missing".into())
    } else if !close(aa - 2.0 * factor * an + factor * factor * nn) || (factor - 1.0).abs() < 1e-4 {
        None
    } else if (factor + 1.0).abs() < 1e-4 {
        Some("sign flipped".into())
    } else {
        Some(format!("off by the factor {factor:.2}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn derivative(f: impl Fn(f64) -> f64, x: f64, length: f64) -> Estimate {
        let differences = steps(length).map(|h| (f(x + h) - f(x - h)) / ((x + h) - (x - h)));
        extrapolate(&differences, &steps(length).map(|h| 1e-16 * f(x).abs() / h))
    }

    #[test]
    fn smooth_functions_have_eleven_digits_whatever_the_length() {
        for length in [1e-2, 1.0, 10.0] {
            let estimate = derivative(f64::exp, 1.0, length);
            assert!((estimate.value - 1.0_f64.exp()).abs() < 1e-10, "{estimate:?}");
            assert!((estimate.value - 1.0_f64.exp()).abs() < 100.0 * estimate.error.max(1e-14), "{estimate:?}");
        }
        // Steps out of the domain are passed over.
        let estimate = derivative(f64::sqrt, 0.01, 1.0);
        assert!((estimate.value - 5.0).abs() < 1e-8, "{estimate:?}");
        assert!(derivative(|_| f64::NAN, 1.0, 1.0).value.is_nan());
    }
}
