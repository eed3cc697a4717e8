//! Gradients through runs.

use crate::arrays::{Given, flat, rows, shaped, state, vectors};
use crate::compute::{Flag, compute};
use crate::error::raised;
use crate::names;
use crate::system::System;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use self_cell::self_cell;
use sprung::gradient::{Cotangent, DifferentiableRun, Parameters};
use sprung::nalgebra::Vector3;
use sprung::plan::MethodChoice;
use std::sync::Arc;

/// Stiffness, rest lengths, damping, masses, gravity; loads, positions and velocities by rows.
pub type Arrays<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// Parameters as arrays.
///
/// # Errors
/// None that could be caused.
pub fn arrays<'py>(py: Python<'py>, found: &Parameters, dimension: usize) -> PyResult<Arrays<'py>> {
    let array = |values: &[f64]| PyArray1::from_slice(py, values);
    Ok((
        array(&found.stiffness),
        array(&found.rest_lengths),
        array(&found.damping),
        array(&found.masses),
        array(&found.gravity.as_slice()[..dimension]),
        rows(py, &found.loads, dimension)?,
        rows(py, &found.positions, dimension)?,
        rows(py, &found.velocities, dimension)?,
    ))
}

type Owner = Arc<sprung::System>;
type Run<'s> = DifferentiableRun<'s>;

self_cell!(
    struct Kept {
        owner: Owner,
        #[covariant]
        dependent: Run,
    }
);

/// A run that can be differentiated.
#[pyclass(frozen, module = "sprung._native")]
pub struct Differentiable {
    kept: Kept,
    flag: Arc<Flag>,
}

/// Runs by a method that has a gradient.
#[pyfunction]
#[pyo3(signature = (system, given, method, dt, duration, checkpoints=None))]
pub fn differentiable_run(
    py: Python<'_>,
    system: &System,
    given: Given<'_>,
    method: &str,
    dt: f64,
    duration: f64,
    checkpoints: Option<usize>,
) -> PyResult<Differentiable> {
    let start = state(&system.system, &given)?;
    let MethodChoice::Named(method) = names::method(method)? else {
        return Err(PyValueError::new_err(
            "method: must be named for a gradient; backward-euler, implicit-midpoint, bdf2 and verlet have one",
        ));
    };
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let made = compute(py, &flag, || {
        Kept::try_new(system, |system| {
            DifferentiableRun::interruptible(system, &start, method, [dt, duration], checkpoints, flag.interrupt())
        })
    })?;
    Ok(Differentiable { kept: made.map_err(raised)?, flag })
}

/// The number of a step, ∂J/∂x and ∂J/∂v.
type GivenCotangent<'py> = (usize, PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>);

/// Changes of stiffness, rest lengths, damping, masses and gravity; of loads, positions and velocities by rows.
type GivenChange<'py> = (
    Vec<f64>,
    Vec<f64>,
    Vec<f64>,
    Vec<f64>,
    Vec<f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

fn parameters(given: &GivenChange<'_>) -> Parameters {
    let (stiffness, rest_lengths, damping, masses, gravity, loads, positions, velocities) = given;
    let mut vector = Vector3::zeros();
    vector.iter_mut().zip(gravity).for_each(|(component, &value)| *component = value);
    Parameters {
        stiffness: stiffness.clone(),
        rest_lengths: rest_lengths.clone(),
        damping: damping.clone(),
        masses: masses.clone(),
        gravity: vector,
        loads: vectors(loads),
        positions: vectors(positions),
        velocities: vectors(velocities),
    }
}

#[pymethods]
impl Differentiable {
    /// Times, positions and velocities of the states that are kept, by states, particles and axes flattened to rows.
    #[allow(clippy::type_complexity)]
    fn states<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let dimension = self.kept.borrow_owner().dimension();
        let run = self.kept.borrow_dependent();
        let count = run.states().len();
        let times = PyArray1::from_iter(py, run.states().map(|state| state.time));
        let width = dimension * self.kept.borrow_owner().particles();
        let positions = run.states().flat_map(|state| flat(&state.positions, dimension)).collect();
        let velocities = run.states().flat_map(|state| flat(&state.velocities, dimension)).collect();
        Ok((times, shaped(py, positions, [count, width])?, shaped(py, velocities, [count, width])?))
    }

    fn steps(&self) -> usize {
        self.kept.borrow_dependent().steps()
    }

    fn gradient<'py>(&self, py: Python<'py>, given: Vec<GivenCotangent<'py>>) -> PyResult<Arrays<'py>> {
        let cotangents: Vec<Cotangent> = given
            .iter()
            .map(|(step, x, v)| Cotangent { step: *step, positions: vectors(x), velocities: vectors(v) })
            .collect();
        let found = compute(py, &self.flag, || self.kept.borrow_dependent().gradient(&cotangents))?;
        arrays(py, &found.map_err(raised)?, self.kept.borrow_owner().dimension())
    }

    /// How positions and velocities after some steps change with parameters: by changes, steps, and particles and axes flattened to rows.
    #[allow(clippy::type_complexity)]
    fn tangents<'py>(
        &self,
        py: Python<'py>,
        changes: Vec<GivenChange<'py>>,
        steps: Vec<usize>,
    ) -> PyResult<(Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>)> {
        let system = self.kept.borrow_owner();
        let changes: Vec<Parameters> = changes.iter().map(parameters).collect();
        let found = compute(py, &self.flag, || self.kept.borrow_dependent().tangents(&changes, &steps))?;
        let found = found.map_err(raised)?;
        let shape = [changes.len(), steps.len(), system.particles() * system.dimension()];
        let part = |of: usize| {
            let values = found.iter().flatten().flat_map(|state| flat(&state[of], system.dimension())).collect();
            shaped(py, values, shape)
        };
        Ok((part(0)?, part(1)?))
    }

    /// The time from which gradients say little.
    fn predictable_until(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        compute(py, &self.flag, || self.kept.borrow_dependent().predictable_until())?.map_err(raised)
    }
}
