//! The matrices of a step, for scipy.

use crate::arrays::{Given, state};
use crate::compute::{Flag, compute};
use crate::error::{invalid, raised};
use crate::names;
use crate::system::System;
use numpy::{PyArray1, PyReadwriteArray1};
use pyo3::prelude::*;
use sprung::assembly::{SymmetricMatrix, WholePattern};
use sprung::error::Invalid;
use sprung::integrate::StepMatrices;
use std::sync::{Arc, Mutex, PoisonError};

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
    let state = state(&system.system, &given)?;
    let (option, dt) = (names::stiffness(stiffness)?, positive("dt", dt)?);
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let assembled = compute(py, &flag, || StepMatrices::assemble(&system, &state, option, dt))?;
    Ok(Assembled { step: assembled.map_err(raised)?, pattern: Mutex::new(None) })
}

impl Assembled {
    /// A, G or K by name; nothing for M, which is a diagonal.
    fn matrix(&self, name: &str) -> PyResult<Option<&SymmetricMatrix>> {
        match name {
            "A" => Ok(Some(&self.step.a)),
            "M" => Ok(None),
            "G" => Ok(Some(&self.step.g)),
            "K" => Ok(Some(&self.step.k)),
            _ => Err(invalid(Invalid::new("matrix", format!("{name:?}"), "must be one of A, M, G, K"))),
        }
    }

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
    /// How many entries both triangles of A, G or K have, or the diagonal of M.
    fn entries(&self, py: Python<'_>, matrix: &str) -> PyResult<usize> {
        match self.matrix(matrix)? {
            None => Ok(self.step.b.len()),
            Some(matrix) => {
                let pattern = compute(py, &Flag::new(), || self.pattern(matrix))?;
                Ok(pattern.map_err(raised)?.rows.len())
            }
        }
    }

    /// Writes them to arrays: the one copy on the way.
    fn fill(
        &self,
        py: Python<'_>,
        matrix: &str,
        mut starts: PyReadwriteArray1<'_, i32>,
        mut rows: PyReadwriteArray1<'_, i32>,
        mut values: PyReadwriteArray1<'_, f64>,
    ) -> PyResult<()> {
        let (starts, rows) = (starts.as_slice_mut()?, rows.as_slice_mut()?);
        let values = values.as_slice_mut()?;
        let Some(matrix) = self.matrix(matrix)? else {
            values.iter_mut().zip(&self.step.m).for_each(|(to, mass)| *to = *mass);
            starts.iter_mut().zip(0..).for_each(|(to, start)| *to = start);
            rows.iter_mut().zip(0..).for_each(|(to, row)| *to = row);
            return Ok(());
        };
        let filled = compute(py, &Flag::new(), || -> sprung::Result<_> {
            let pattern = self.pattern(matrix)?;
            let fits = values.len() == pattern.rows.len();
            if fits {
                // All of them are below 2³¹.
                let copy =
                    |to: &mut [i32], from: &[u32]| to.iter_mut().zip(from).for_each(|(to, &from)| *to = from as i32);
                copy(starts, &pattern.starts);
                rayon::join(|| copy(rows, &pattern.rows), || pattern.fill(matrix, values));
            }
            Ok(fits)
        })?;
        if filled.map_err(raised)? {
            return Ok(());
        }
        Err(invalid(Invalid::new("values", "an array", "must have one for each entry")))
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
