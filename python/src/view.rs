//! The page that plays a motion.

use crate::error::{invalid, raised};
use crate::system::System;
use numpy::{PyReadonlyArray1, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use sprung::error::Invalid;
use sprung::figure::{Animation, SceneTopology};
use sprung::nalgebra::Vector3;
use sprung::output::{describe, energy_tracks};
use sprung::report::view::within;

/// The page of frames of a system, with what a run's summary says of them and its energies over the times of its records below; of at
/// most so many bytes of data.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one for each thing that the page shows")]
pub fn view(
    py: Python<'_>,
    system: &System,
    title: String,
    summary: Option<String>,
    times: PyReadonlyArray1<'_, f64>,
    positions: PyReadonlyArray3<'_, f64>,
    record_times: Vec<f64>,
    energies: Vec<(String, Vec<f64>)>,
    limit: usize,
) -> PyResult<String> {
    let shape = positions.as_array().dim();
    if shape != (times.as_array().len(), system.system.particles(), system.system.dimension()) {
        let found = format!("an array of {} × {} × {}", shape.0, shape.1, shape.2);
        return Err(invalid(Invalid::new("positions", found, "must have a row for each time and particle")));
    }
    let mut animation = Animation::new(title, SceneTopology::of(&system.system, &system.triangles));
    animation.tracks = energy_tracks(&record_times, energies);
    for (&time, frame) in times.as_array().iter().zip(positions.as_array().outer_iter()) {
        let frame: Vec<Vector3<f64>> = frame
            .outer_iter()
            .map(|row| {
                let mut vector = Vector3::zeros();
                vector.iter_mut().zip(row).for_each(|(component, &value)| *component = value);
                vector
            })
            .collect();
        animation.push(time, &frame);
    }
    let summary = summary.map(|text| serde_json::from_str(&text)).transpose();
    let summary: Option<serde_json::Value> = summary.map_err(|error| PyValueError::new_err(error.to_string()))?;
    describe(&mut animation, summary.as_ref());
    let page = py.detach(|| within(&animation, limit));
    page.map_err(|source| raised(sprung::Error::io("view.html", source)))
}
