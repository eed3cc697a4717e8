//! Anybody's Jacobian against anybody's force.

use crate::arrays::{Given, state};
use crate::error::{invalid, raised};
use crate::system::System;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sprung::error::Invalid;
use sprung::nalgebra_sparse::CscMatrix;
use sprung::report;
use sprung::verify::{ColumnGroups, Entry, JacobianOptions, JacobianReport, Results, check_jacobian as check};

/// Starts of columns, rows and values of a square matrix, rows ascending in each column.
type Columns<'py> = (PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, f64>);

/// Compares a matrix with the derivative of `force(x)`, which gives a vector; hands out a dictionary.
///
/// The force is Python's, so it is called with the lock of the interpreter. What it raises ends the check: the evaluations that are
/// left see no number, which takes no time.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one for each argument of the function that calls it")]
pub fn check_jacobian<'py>(
    py: Python<'py>,
    name: String,
    force: Bound<'py, PyAny>,
    matrix: Columns<'py>,
    point: PyReadonlyArray1<'py, f64>,
    length: Option<f64>,
    tolerance: f64,
    coloured: bool,
    springs: Option<(Bound<'py, System>, Given<'py>)>,
) -> PyResult<Bound<'py, PyDict>> {
    let point = point.as_array().to_vec();
    let matrix = csc(&matrix, point.len())?;
    let springs = match &springs {
        Some((system, given)) => Some((system.get(), state(&system.get().system, given)?)),
        None => None,
    };
    let groups = match &springs {
        _ if !coloured => None,
        Some((system, _)) => Some(ColumnGroups::of_system(&system.system)),
        None => Some(ColumnGroups::of_matrix(&matrix)),
    };
    let evaluations = groups.as_ref().map_or(point.len(), |groups| groups.groups().len());
    let springs = springs.as_ref().map(|(system, state)| (&*system.system, state));
    let options = JacobianOptions { length, tolerance, groups, springs };
    let mut broken = None;
    let evaluate = |x: &[f64], f: &mut [f64]| {
        f.fill(f64::NAN);
        if broken.is_none() {
            broken = py.check_signals().and_then(|()| call(py, &force, x, f)).err();
        }
    };
    let found = check(evaluate, matrix, &point, &options).map_err(raised)?;
    if let Some(error) = broken {
        return Err(error);
    }
    hand_out(py, name, &found, evaluations)
}

/// One evaluation.
fn call(py: Python<'_>, force: &Bound<'_, PyAny>, x: &[f64], f: &mut [f64]) -> PyResult<()> {
    let value = force.call1((PyArray1::from_slice(py, x),))?;
    let value: PyReadonlyArray1<'_, f64> = value.extract()?;
    let value = value.as_array();
    if value.len() != f.len() {
        let rule = format!("must have {} entries, as x has", f.len());
        return Err(invalid(Invalid::new("force(x)", format!("a vector of {}", value.len()), rule)));
    }
    f.iter_mut().zip(value).for_each(|(to, from)| *to = *from);
    Ok(())
}

fn csc((starts, rows, values): &Columns<'_>, order: usize) -> PyResult<CscMatrix<f64>> {
    let wide = |list: &PyReadonlyArray1<'_, i64>| -> Vec<usize> {
        list.as_array().iter().map(|&entry| usize::try_from(entry).unwrap_or(usize::MAX)).collect()
    };
    let values = values.as_array().to_vec();
    CscMatrix::try_from_csc_data(order, order, wide(starts), wide(rows), values)
        .map_err(|error| invalid(Invalid::new("jacobian", "a sparse matrix", format!("is not well formed: {error}"))))
}

fn hand_out<'py>(
    py: Python<'py>,
    name: String,
    found: &JacobianReport,
    evaluations: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let handed_out = PyDict::new(py);
    handed_out.set_item("passed", found.passed())?;
    handed_out.set_item("compared", found.compared)?;
    handed_out.set_item("wrong", found.wrong)?;
    handed_out.set_item("value", found.value)?;
    handed_out.set_item("overall", found.overall.as_deref())?;
    handed_out.set_item("groups", evaluations)?;
    handed_out.set_item("text", found.to_string())?;
    handed_out.set_item("html", report::html(&[found.to_check(name)].into_iter().collect::<Results>()))?;
    let entry =
        |entry: &Entry| (entry.row, entry.column, entry.spring, entry.analytic, entry.numeric, entry.verdict.clone());
    handed_out.set_item("worst", found.worst.iter().map(entry).collect::<Vec<_>>())?;
    let numeric = &found.numeric;
    let wide = |list: &[usize]| -> Vec<i64> { list.iter().map(|&entry| entry as i64).collect() };
    let columns = (
        PyArray1::from_vec(py, wide(numeric.col_offsets())),
        PyArray1::from_vec(py, wide(numeric.row_indices())),
        PyArray1::from_slice(py, numeric.values()),
    );
    handed_out.set_item("numeric", columns)?;
    Ok(handed_out)
}
