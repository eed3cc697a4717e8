//! The matrices of a step, for scipy.

use crate::arrays::{Given, state};
use crate::compute::{Flag, compute};
use crate::error::{invalid, raised};
use crate::names;
use crate::system::System;
use numpy::PyArray1;
use pyo3::prelude::*;
use sprung::assembly::{SymmetricMatrix, WholePattern};
use sprung::error::Invalid;
use sprung::integrate::StepMatrices;
use std::sync::{Arc, Mutex, PoisonError};

/// Starts of columns, rows and values.
pub type Columns<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

/// The matrices as the library keeps them: one triangle each.
#[pyclass(frozen, module = "sprung._native")]
pub struct Assembled {
    pub step: StepMatrices,
    /// Of A and K, and of G where every spring is damped; made when one of them is first asked for.
    pattern: Mutex<Option<Arc<WholePattern>>>,
}

/// Assembles A, M, G, K and b of a step of dt seconds.
#[pyfunction]
pub fn assemble(py: Python<'_>, system: &System, given: Given<'_>, dt: f64, stiffness: &str) -> PyResult<Assembled> {
    let (system, state) = (&*system.system, state(&system.system, &given)?);
    let (option, dt) = (names::stiffness(stiffness)?, positive("dt", dt)?);
    let assembled = compute(py, &Flag::new(), || StepMatrices::assemble(system, &state, option, dt))?;
    Ok(Assembled { step: assembled.map_err(raised)?, pattern: Mutex::new(None) })
}

impl Assembled {
    /// Where both triangles of a matrix have their entries. Springs that enter G enter K, so as many entries are the same ones.
    fn pattern(&self, matrix: &SymmetricMatrix) -> sprung::Result<Arc<WholePattern>> {
        let of_a = self.step.a.pattern();
        if matrix.pattern().entries() != of_a.entries() {
            return WholePattern::of(matrix.pattern()).map(Arc::new);
        }
        if let Some(known) = &*self.pattern.lock().unwrap_or_else(PoisonError::into_inner) {
            return Ok(known.clone());
        }
        let made = Arc::new(WholePattern::of(of_a)?);
        Ok(self.pattern.lock().unwrap_or_else(PoisonError::into_inner).insert(made).clone())
    }
}

#[pymethods]
impl Assembled {
    /// Both triangles of A, G or K, or the diagonal of M: the one copy on the way, whose memory the arrays take over.
    fn whole<'py>(&self, py: Python<'py>, matrix: &str) -> PyResult<Columns<'py>> {
        let StepMatrices { a, m, g, k, .. } = &self.step;
        let matrix = match matrix {
            "A" => a,
            "M" => return Ok(diagonal(py, m)),
            "G" => g,
            "K" => k,
            _ => return Err(invalid(Invalid::new("matrix", format!("{matrix:?}"), "must be one of A, M, G, K"))),
        };
        let whole = compute(py, &Flag::new(), || -> sprung::Result<_> {
            let pattern = self.pattern(matrix)?;
            Ok((pattern.starts.clone(), pattern.rows.clone(), pattern.values(matrix)))
        })?;
        let (starts, rows, values) = whole.map_err(raised)?;
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

/// The diagonal of a matrix that has nothing beside it but zeros.
fn diagonal<'py>(py: Python<'py>, matrix: &SymmetricMatrix) -> Columns<'py> {
    let order = matrix.dofs().len() as u32;
    let values: Vec<f64> = matrix.iter().filter(|(row, column, _)| row == column).map(|(_, _, value)| value).collect();
    (PyArray1::from_iter(py, 0..=order), PyArray1::from_iter(py, 0..order), PyArray1::from_vec(py, values))
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
