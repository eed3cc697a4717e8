//! Inspections of definiteness.

use crate::arrays::{Given, rows, state};
use crate::compute::{Flag, compute};
use crate::error::raised;
use crate::matrices::positive;
use crate::names;
use crate::system::System;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sprung::State;
use sprung::inspect::{Inspection as Inspected, Pictures};
use sprung::plan::parallelism;
use sprung::report::inspection::InspectionReport;
use std::sync::Arc;

/// Eigenvalues, and eigenvectors as rows.
type Eigenpairs<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// What an inspection found, with what it was made of.
#[pyclass(frozen, module = "sprung._native")]
pub struct Inspection {
    system: Arc<sprung::System>,
    flag: Arc<Flag>,
    name: String,
    state: State,
    found: Inspected,
}

/// Inspects A at a state for steps of dt seconds.
#[pyfunction]
pub fn inspect(py: Python<'_>, system: &System, given: Given<'_>, dt: f64, stiffness: &str) -> PyResult<Inspection> {
    let (name, state) = (system.name.clone(), state(&system.system, &given)?);
    let (option, dt) = (names::stiffness(stiffness)?, positive("dt", dt)?);
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let found = compute(py, &flag, || Inspected::at(&system, &state, dt, option, parallelism(&system)))?;
    Ok(Inspection { found: found.map_err(raised)?, system, flag, name, state })
}

impl Inspection {
    fn report(&self) -> InspectionReport<'_> {
        InspectionReport { scene: &self.name, step: 0, time: self.state.time, inspection: &self.found, losses: None }
    }
}

#[pymethods]
impl Inspection {
    /// Everything as JSON.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.report()).map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }

    /// Everything in words.
    fn text(&self) -> String {
        self.report().text()
    }

    /// Everything as a page.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        let Self { system, flag, state, found, .. } = self;
        let made = compute(py, flag, || Ok(self.report().html(&Pictures::of(system, state, found)?)))?;
        made.map_err(raised)
    }

    /// The lowest eigenvalues of A that were found, ascending, and their eigenvectors as rows.
    fn eigenpairs<'py>(&self, py: Python<'py>) -> PyResult<Eigenpairs<'py>> {
        let lowest = &self.found.spectrum.lowest;
        let values: Vec<f64> = lowest.iter().map(|pair| pair.value).collect();
        let vectors: Vec<f64> = lowest.iter().flat_map(|pair| pair.vector.iter().copied()).collect();
        let shape = [lowest.len(), self.system.dofs().len()];
        Ok((PyArray1::from_vec(py, values), PyArray1::from_vec(py, vectors).reshape(shape)?))
    }

    /// The positions that were inspected.
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, &self.state.positions, self.system.dimension())
    }
}
