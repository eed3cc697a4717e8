//! The verification suite on a system.

use crate::arrays::{Given, state};
use crate::compute::{Flag, compute};
use crate::error::raised;
use crate::matrices::positive;
use crate::system::System;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sprung::report;
use sprung::verify::{FAMILIES, Results, TestCase};

/// Runs every family of checks that applies to a system at a state; hands out a dictionary.
#[pyfunction]
pub fn verify<'py>(
    py: Python<'py>,
    system: &System,
    given: Given<'py>,
    dt: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let state = state(&system.system, &given)?;
    let dt = dt.or(system.time.dt).map(|dt| positive("dt", dt)).transpose()?;
    let subject = TestCase::new(&system.name, (*system.system).clone(), state, dt).map_err(raised)?;
    let flag = Flag::new();
    let results: Results = compute(py, &flag, || {
        let applying = FAMILIES.iter().filter(|family| !flag.is_raised() && (family.applies)(&subject));
        applying.flat_map(|family| family.check(&subject)).collect()
    })?;
    let handed_out = PyDict::new(py);
    let json = report::json(&results).map_err(|source| raised(sprung::Error::io("report.json", source)))?;
    handed_out.set_item("json", json)?;
    handed_out.set_item("text", report::text(&results))?;
    handed_out.set_item("html", report::html(&results))?;
    handed_out.set_item("dt", subject.dt)?;
    Ok(handed_out)
}
