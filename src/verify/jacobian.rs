//! Any Jacobian against any force: which entries are wrong, and how.

use super::check::{Check, Entry, worst};
use super::claim::Claim;
use super::coloring::ColumnGroups;
use super::entries::{entry_of, for_each_entry};
use super::extrapolation::{Estimate, steps};
use super::force_error::ForceError;
use super::measurement::{Measurement, representable};
use super::verdict::{CANNOT_BE_MEASURED, TABLE_ROWS, WorstEntries, of_block};
use crate::error::{Invalid, Result};
use crate::force::SpringGeometry;
use crate::system::{State, System};
use nalgebra::Matrix3;
use nalgebra_sparse::{CooMatrix, CscMatrix};
use std::fmt;

/// How [`check_jacobian`] measures and what it may take for granted.
#[derive(Debug, Clone)]
pub struct JacobianOptions<'a> {
    /// The distance over which the force changes noticeably, in the unit of the point, such as the shortest spring.
    /// `None` takes the shortest spring at each particle where the springs are given, else the spread of the
    /// coordinates. Steps go from an eighth of it down to 1e-9 of it, so its size matters little.
    pub length: Option<f64>,
    /// Relative difference that counts as agreement, beside what the measurement itself is unsure of. Entries below a
    /// thousandth of it, relative to the largest of their column, or below 1e-12 of the largest of all, count as zero.
    pub tolerance: f64,
    /// Columns to measure together; `None` measures one by one and trusts no pattern.
    pub groups: Option<ColumnGroups>,
    /// The springs behind the force, if the point is their free coordinates: lets verdicts speak of springs and their
    /// terms.
    pub springs: Option<(&'a System, &'a State)>,
}

impl Default for JacobianOptions<'_> {
    fn default() -> Self {
        Self { length: None, tolerance: 1e-7, groups: None, springs: None }
    }
}

/// What [`check_jacobian`] found: both matrices, and the worst entries with verdicts in words.
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
    /// The largest difference as a multiple of what is allowed for its entry: at most 1 if all entries agree, NaN if
    /// one is not a number.
    pub value: f64,
    /// What is wrong with the matrix as a whole, if one thing is: `sign flipped`, `transposed`, `off by the factor
    /// 2.00`.
    pub overall: Option<String>,
    /// The worst entries, worst first.
    pub worst: Vec<Entry>,
}

impl JacobianReport {
    /// Whether every entry agrees.
    pub fn passed(&self) -> bool {
        self.value <= 1.0
    }

    /// Why nothing can be said of the matrix: every entry that does not agree is one whose derivative cannot be measured.
    pub(super) fn unmeasurable(&self) -> Option<String> {
        let wrong = self.worst.get(..self.wrong).filter(|wrong| !wrong.is_empty())?;
        let all = wrong.iter().all(|entry| entry.verdict == CANNOT_BE_MEASURED);
        all.then(|| format!("the derivatives of {} entries are lost in the rounding of forces", self.wrong))
    }

    /// As a check of the suite.
    pub fn to_check(&self, scene: impl Into<String>) -> Check {
        let why = "1 is what the measurement allows for an entry: eight times the spread of extrapolated central differences, and the \
            relative tolerance that was asked for";
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
/// `force(x, f)` writes the force at x into f; both have the length n of `point`. `matrix` is n × n:
/// `∂f_row/∂x_column`, as a [`CscMatrix`], or a reference to a dense nalgebra matrix, a [`CooMatrix`] or a
/// [`SymmetricMatrix`](crate::assembly::SymmetricMatrix). It need not be symmetric. The force is evaluated 28 times for
/// each group of columns.
///
/// Sees missing, extra, doubled, transposed, mis-signed and mis-scaled entries down to a relative error of `tolerance`.
/// Is blind to what force and matrix have both wrong; and with groups taken from the matrix itself, to some of what the
/// matrix lacks.
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
/// length or tolerance that is not positive. A force or a matrix that is not finite is no error but a wrong entry.
pub fn check_jacobian(
    force: impl FnMut(&[f64], &mut [f64]),
    matrix: impl Into<CscMatrix<f64>>,
    point: &[f64],
    options: &JacobianOptions,
) -> Result<JacobianReport> {
    let analytic = matrix.into();
    let spread = check_input(&analytic, point, options)?;
    let one_by_one;
    let groups = match &options.groups {
        Some(groups) => groups,
        None => {
            one_by_one = ColumnGroups::one_by_one(point.len());
            &one_by_one
        }
    };
    let extensions = options.springs.and_then(|(system, state)| {
        SpringGeometry::at(system, &state.positions).ok().map(|extensions| (system, extensions))
    });
    let springs = extensions.as_ref().map(|(system, extensions)| (*system, ForceError::new(system, extensions)));
    let steps = (0..point.len()).map(|column| {
        // Without a length from the caller each particle moves by fractions of its own shortest spring.
        let own = springs.as_ref().map(|(system, error)| error.shortest(system.dofs().dof(column).particle));
        let length = options.length.or(own.filter(|length| length.is_finite())).unwrap_or(spread);
        steps(length).map(|h| representable(h, point[column]))
    });
    let mut measurement = Measurement { force, x: point.to_vec(), steps: steps.collect() };
    let mut comparisons = Vec::new();
    for group in groups.groups() {
        compare_group(&mut measurement, group, groups, &analytic, &mut comparisons);
    }
    let largest = comparisons.iter().map(|c: &Comparison| c.estimate.value.abs()).fold(0.0, f64::max);
    let mut numeric = CooMatrix::new(point.len(), point.len());
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for comparison in &comparisons {
        let Comparison { row, column, value, estimate, .. } = *comparison;
        entries.compare(row, Some(column), value, estimate.value, comparison.allowed(options.tolerance, largest));
        if estimate.value != 0.0 {
            numeric.push(row, column, estimate.value);
        }
    }
    let numeric = CscMatrix::from(&numeric);
    let (value, compared, wrong) = (entries.worst(), entries.compared(), entries.wrong());
    let overall = if wrong > 0 { overall(&analytic, &numeric) } else { None };
    let worst = entries.into_table(|entry| explain(entry, &analytic, &numeric, springs.as_ref(), options.tolerance));
    Ok(JacobianReport { analytic, numeric, compared, wrong, value, overall, worst })
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
    if (matrix.nrows(), matrix.ncols()) != (n, n) {
        let size = format!("{} × {}", matrix.nrows(), matrix.ncols());
        return Err(Invalid::new("matrix", size, format!("must be {n} × {n} for a point of {n} coordinates")));
    }
    if let Some(groups) = options.groups.as_ref().filter(|groups| groups.order() != n) {
        return Err(Invalid::new("options.groups", groups.order(), format!("must group {n} columns")));
    }
    if let Some((system, state)) = options.springs
        && (system.dofs().len() != n || state.positions.len() != system.particles())
    {
        let size = format!("{} free coordinates, {} positions", system.dofs().len(), state.positions.len());
        return Err(Invalid::new(
            "options.springs",
            size,
            format!("must have {n} free coordinates and fit each other"),
        ));
    }
    let positive = |key: &str, value: f64| match value {
        value if value.is_finite() && value > 0.0 => Ok(()),
        value => Err(Invalid::new(key, value, "must be finite and positive")),
    };
    positive("options.tolerance", options.tolerance)?;
    options.length.map_or(Ok(()), |length| positive("options.length", length))?;
    let (least, most) = point.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let largest = least.abs().max(most.abs());
    Ok([most - least, largest].into_iter().find(|size| *size > 0.0).unwrap_or(1.0))
}

/// An entry of the matrix and what is measured in its place.
struct Comparison {
    row: usize,
    column: usize,
    value: f64,
    estimate: Estimate,
    /// The largest estimate of the column.
    largest: f64,
}

impl Comparison {
    /// How far the value may be from the estimate; NaN where that is too unsure to say anything about the value.
    fn allowed(&self, tolerance: f64, largest_of_all: f64) -> f64 {
        let size = worst([self.value.abs(), self.estimate.value.abs()]);
        // Below 1e-12 of the largest entry estimates are the rounding of forces and no more.
        let negligible = worst([1e-3 * tolerance * self.largest, 1e-12 * largest_of_all]);
        let unsure = 8.0 * self.estimate.error;
        if unsure >= size && self.value.abs() > negligible { f64::NAN } else { unsure + tolerance * size + negligible }
    }
}

/// Measures a group of columns and lists what is to be compared: expected entries, those that only the matrix has, and
/// in rows that no column of the group accounts for the change that should not be there.
fn compare_group<F: FnMut(&[f64], &mut [f64])>(
    measurement: &mut Measurement<F>,
    group: &[usize],
    groups: &ColumnGroups,
    analytic: &CscMatrix<f64>,
    comparisons: &mut Vec<Comparison>,
) {
    let changes = measurement.along(group);
    // f64::max passes over NaN: one component that is not finite must not excuse, or accuse, the others.
    let largest = |column: &[Estimate]| column.iter().map(|estimate| estimate.value.abs()).fold(0.0, f64::max);
    let mut unclaimed = vec![true; changes.len()];
    for &column in group {
        let steps = &measurement.steps[column];
        let estimates: Vec<_> = groups.rows(column).iter().map(|&row| changes[row as usize].over(steps)).collect();
        let largest = largest(&estimates);
        let mut estimates = estimates.into_iter();
        for_each_entry(analytic, column, groups.rows(column), |row, value, expected| {
            let nothing = Estimate { value: 0.0, error: 0.0 };
            let estimate = if expected { estimates.next().unwrap_or(nothing) } else { nothing };
            unclaimed[row] &= !expected;
            comparisons.push(Comparison { row, column, value, estimate, largest });
        });
    }
    // The matrix lacks an entry in one of the columns, the first for want of knowing better.
    let Some(&column) = group.first() else { return };
    let estimates: Vec<_> = changes.iter().map(|change| change.over(&measurement.steps[column])).collect();
    let largest = largest(&estimates);
    for (row, &estimate) in estimates.iter().enumerate().filter(|(row, _)| unclaimed[*row]) {
        comparisons.push(Comparison { row, column, value: 0.0, estimate, largest });
    }
}

/// Whether one fault explains the whole matrix.
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

/// Says more of a wrong entry than its two numbers: transposed, or which term of which spring.
fn explain(
    entry: Entry,
    analytic: &CscMatrix<f64>,
    numeric: &CscMatrix<f64>,
    springs: Option<&(&System, ForceError)>,
    tolerance: f64,
) -> Entry {
    if entry.verdict == CANNOT_BE_MEASURED {
        return entry;
    }
    let Some(column) = entry.column else { return entry };
    let mirrored = entry_of(numeric, column, entry.row);
    if entry.row != column
        && entry.analytic != 0.0
        && (entry.analytic - mirrored).abs() <= 10.0 * tolerance * mirrored.abs()
    {
        return entry.with_verdict("transposed");
    }
    let Some((system, error)) = springs else { return entry };
    let dofs = system.dofs();
    let (i, j) = (dofs.dof(entry.row).particle, dofs.dof(column).particle);
    let mut links = error.links_between(i, j);
    let (Some(link), None) = (links.next(), links.next()) else { return entry };
    let entry = entry.of_spring(link.index);
    let (rows, columns, dimension) = (dofs.rows(i), dofs.rows(j), system.dimension());
    if rows.len() != dimension || columns.len() != dimension {
        return entry;
    }
    let block = |matrix: &CscMatrix<f64>| {
        Matrix3::from_fn(|r, c| {
            let modelled = r < dimension && c < dimension;
            if modelled { entry_of(matrix, rows.start + r, columns.start + c) } else { 0.0 }
        })
    };
    let (analytic, numeric) = (block(analytic), block(numeric));
    let tolerance = 10.0 * tolerance * worst([analytic.amax(), numeric.amax()]);
    match of_block(&analytic, &numeric, &link.at.direction, link.spring.rest_length, dimension, tolerance) {
        Some(words) => entry.with_verdict(words),
        None => entry,
    }
}
