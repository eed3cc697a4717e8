//! The matrices of a step, for scipy.

use crate::arrays::{Given, state};
use crate::compute::{Flag, compute};
use crate::error::{invalid, raised};
use crate::names;
use crate::system::System;
use numpy::PyArray1;
use pyo3::prelude::*;
use sprung::assembly::WholeColumns;
use sprung::error::Invalid;
use sprung::integrate::StepMatrices;

/// Starts of columns, rows and values.
pub type Columns<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

/// The matrices as the library keeps them: one triangle each.
#[pyclass(frozen, module = "sprung._native")]
pub struct Assembled {
    pub step: StepMatrices,
}

/// Assembles A, M, G, K and b of a step of dt seconds.
#[pyfunction]
pub fn assemble(py: Python<'_>, system: &System, given: Given<'_>, dt: f64, stiffness: &str) -> PyResult<Assembled> {
    let (system, state) = (&*system.system, state(&system.system, &given)?);
    let (option, dt) = (names::stiffness(stiffness)?, positive("dt", dt)?);
    let assembled = compute(py, &Flag::new(), || StepMatrices::assemble(system, &state, option, dt))?;
    Ok(Assembled { step: assembled.map_err(raised)? })
}

#[pymethods]
impl Assembled {
    /// Both triangles of A, M, G or K: the one copy on the way, whose memory the arrays take over.
    fn whole<'py>(&self, py: Python<'py>, matrix: &str) -> PyResult<Columns<'py>> {
        let StepMatrices { a, m, g, k, .. } = &self.step;
        let matrix = match matrix {
            "A" => a,
            "M" => m,
            "G" => g,
            "K" => k,
            _ => return Err(invalid(Invalid::new("matrix", format!("{matrix:?}"), "must be one of A, M, G, K"))),
        };
        let whole = compute(py, &Flag::new(), || matrix.whole_columns())?;
        let WholeColumns { starts, rows, values } = whole.map_err(raised)?;
        Ok((PyArray1::from_vec(py, starts), PyArray1::from_vec(py, rows), PyArray1::from_vec(py, values)))
    }

    /// The right-hand side.
    fn b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.step.b)
    }

    /// Number of rows.
    #[getter]
    fn order(&self) -> usize {
        self.step.b.len()
    }
}

/// A number that must be finite and positive.
///
/// # Errors
/// One that is not.
pub fn positive(key: &str, value: f64) -> PyResult<f64> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(invalid(Invalid::new(key, value, "must be finite and positive")))
}
