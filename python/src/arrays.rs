//! Between numpy's arrays and the library's vectors.

use crate::error::invalid;
use numpy::{PyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use sprung::error::Invalid;
use sprung::nalgebra::Vector3;
use sprung::{State, System};

/// Positions and velocities, one row per particle, and the time.
pub type Given<'py> = (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, f64);

/// What a state is handed out as.
pub type Handed<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, f64);

/// Rows of at most three entries as vectors.
pub fn vectors(rows: &PyReadonlyArray2<'_, f64>) -> Vec<Vector3<f64>> {
    let rows = rows.as_array();
    rows.outer_iter()
        .map(|row| {
            let mut vector = Vector3::zeros();
            vector.iter_mut().zip(row).for_each(|(component, &value)| *component = value);
            vector
        })
        .collect()
}

/// The first `dimension` components of every vector, one after the other.
pub fn flat(vectors: &[Vector3<f64>], dimension: usize) -> Vec<f64> {
    vectors.iter().flat_map(|vector| vector.iter().take(dimension).copied()).collect()
}

/// An array of rows, which takes the values over.
///
/// # Errors
/// Values that do not fill the shape.
pub fn shaped<const N: usize>(
    py: Python<'_>,
    values: Vec<f64>,
    shape: [usize; N],
) -> PyResult<Bound<'_, PyArray<f64, numpy::ndarray::Dim<[usize; N]>>>>
where
    numpy::ndarray::Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = numpy::ndarray::Dim<[usize; N]>>,
{
    PyArray1::from_vec(py, values).reshape(shape)
}

/// Vectors as an array of rows.
///
/// # Errors
/// None that could be caused.
pub fn rows<'py>(py: Python<'py>, of: &[Vector3<f64>], dimension: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    shaped(py, flat(of, dimension), [of.len(), dimension])
}

/// A state that was given, checked.
///
/// # Errors
/// Another number of rows or entries than the system has; numbers that are not finite.
pub fn state(system: &System, (positions, velocities, time): &Given<'_>) -> PyResult<State> {
    let shape = [system.particles(), system.dimension()];
    for (key, rows) in [("positions", positions), ("velocities", velocities)] {
        let found = rows.as_array().dim();
        if [found.0, found.1] != shape {
            let rule = format!("must have the system's shape, {} × {}", shape[0], shape[1]);
            return Err(invalid(Invalid::new(key, format!("an array of {} × {}", found.0, found.1), rule)));
        }
        for (index, row) in rows.as_array().outer_iter().enumerate() {
            if row.iter().any(|value| value.is_nan() || value.abs() > State::LARGEST) {
                let rule = format!("must be finite, and at most {:e}", State::LARGEST);
                return Err(invalid(Invalid::new(key, format!("{:?}", row.to_vec()), rule).at(index)));
            }
        }
    }
    if !time.is_finite() {
        return Err(invalid(Invalid::new("time", time, "must be finite")));
    }
    Ok(State { time: *time, positions: vectors(positions), velocities: vectors(velocities) })
}

/// A state as it is handed out.
///
/// # Errors
/// None that could be caused.
pub fn handed<'py>(py: Python<'py>, system: &System, state: &State) -> PyResult<Handed<'py>> {
    let rows = |of| rows(py, of, system.dimension());
    Ok((rows(&state.positions)?, rows(&state.velocities)?, state.time))
}
