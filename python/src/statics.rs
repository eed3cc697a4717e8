//! Equilibrium, normal modes and mechanisms.

use crate::arrays::{Given, rows, shaped, state, vectors};
use crate::compute::{Flag, compute};
use crate::error::raised;
use crate::gradient::{Arrays, arrays};
use crate::names;
use crate::system::System;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sprung::equilibrium::{EquilibriumOptions, equilibrium as find_equilibrium};
use sprung::mechanisms::mechanisms as find_mechanisms;
use sprung::modes::{Mode, modes as find_modes};
use std::sync::Arc;

/// A computed equilibrium.
#[pyclass(frozen, module = "sprung._native")]
pub struct Equilibrium {
    system: Arc<sprung::System>,
    found: sprung::equilibrium::Equilibrium,
}

/// The equilibrium downhill from a state, under a factor of the loads.
#[pyfunction]
pub fn equilibrium(
    py: Python<'_>,
    system: &System,
    given: Given<'_>,
    load: f64,
    leave_saddles: bool,
    tolerance: f64,
    iterations: usize,
    stiffness: &str,
) -> PyResult<Equilibrium> {
    let stiffness = names::policy(stiffness)?;
    let state = state(&system.system, &given)?;
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let options = EquilibriumOptions { tolerance, iterations, load, leave_saddles, stiffness };
    let found = compute(py, &flag, || find_equilibrium(&system, &state, options))?.map_err(raised)?;
    Ok(Equilibrium { system, found })
}

#[pymethods]
impl Equilibrium {
    /// Status, residual, energy, iterations, signs, whether these were counted, and particles that fall.
    #[allow(clippy::type_complexity)]
    fn figures(&self) -> (&'static str, f64, f64, usize, [usize; 3], bool, Vec<usize>) {
        let found = &self.found;
        let signs = found.inertia;
        let signs = [signs.negative, signs.zero, signs.positive];
        (
            found.stability.name(),
            found.residual,
            found.energy,
            found.iterations,
            signs,
            found.counted,
            found.falling.clone(),
        )
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, &self.found.state.positions, self.system.dimension())
    }

    fn gradient<'py>(&self, py: Python<'py>, positions: PyReadonlyArray2<'py, f64>) -> PyResult<Arrays<'py>> {
        let found = self.found.gradient(&self.system, &vectors(&positions)).map_err(raised)?;
        arrays(py, &found, self.system.dimension())
    }
}

/// Computed normal modes.
#[pyclass(frozen, module = "sprung._native")]
pub struct Modes {
    dimension: usize,
    found: sprung::modes::Modes,
}

/// The lowest modes at a state.
#[pyfunction]
pub fn modes(py: Python<'_>, system: &System, given: Given<'_>, count: usize) -> PyResult<Modes> {
    let state = state(&system.system, &given)?;
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let found = compute(py, &flag, || find_modes(&system, &state, count))?.map_err(raised)?;
    Ok(Modes { dimension: system.dimension(), found })
}

#[pymethods]
impl Modes {
    /// ω², residuals, bounds of errors, damping ratios (NaN where there is none), and effective masses by rows.
    #[allow(clippy::type_complexity)]
    fn values<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
    )> {
        let of = |value: fn(&Mode) -> f64| PyArray1::from_iter(py, self.found.modes.iter().map(value));
        let masses = self.found.modes.iter().flat_map(|mode| mode.effective_mass[..self.dimension].to_vec()).collect();
        Ok((
            of(|mode| mode.eigenvalue),
            of(|mode| mode.residual),
            of(|mode| mode.error_bound),
            of(|mode| mode.damping_ratio.unwrap_or(f64::NAN)),
            shaped(py, masses, [self.found.modes.len(), self.dimension])?,
        ))
    }

    /// Zero modes, rigid motions, the gap, completeness and whether it is proven, the shift of the count, and the imbalance of the state.
    #[allow(clippy::type_complexity)]
    fn figures(&self) -> (Option<usize>, usize, [f64; 2], [bool; 2], f64, f64) {
        let found = &self.found;
        let complete = [found.complete, found.proven];
        (found.zero_count, found.rigid_motions, found.gap, complete, found.counted_below, found.imbalance)
    }

    /// The particles of each loose part, and of each part that hangs by one spring.
    fn parts(&self) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
        (self.found.parts.clone(), self.found.hanging.clone())
    }

    /// Displacements by modes, particles and axes: of the modes, or of the zero modes.
    fn shapes<'py>(&self, py: Python<'py>, of_zero_modes: bool) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let modes = if of_zero_modes { &self.found.zero_modes } else { &self.found.modes };
        let shapes: Vec<_> = modes.iter().map(|mode| self.found.shape(mode)).collect();
        let particles = match shapes.first() {
            Some(shape) => shape.len(),
            None => 0,
        };
        let values = shapes.iter().flat_map(|shape| crate::arrays::flat(shape, self.dimension)).collect();
        shaped(py, values, [modes.len(), particles, self.dimension])
    }

    /// A, B and C.
    #[allow(clippy::type_complexity)]
    fn state_space<'py>(
        &self,
        py: Python<'py>,
        inputs: Vec<usize>,
        outputs: Vec<usize>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let space = self.found.state_space(&inputs, &outputs).map_err(raised)?;
        let array = |matrix: &sprung::nalgebra::DMatrix<f64>| {
            let values = matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect();
            shaped(py, values, [matrix.nrows(), matrix.ncols()])
        };
        Ok((array(&space.a)?, array(&space.b)?, array(&space.c)?))
    }

    /// Real and imaginary parts of the response, a row for each frequency.
    #[allow(clippy::type_complexity)]
    fn harmonic_response<'py>(
        &self,
        py: Python<'py>,
        force: Vec<f64>,
        frequencies: Vec<f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let found = self.found.harmonic_response(&force, &frequencies).map_err(raised)?;
        let part = |of: fn(&sprung::faer::c64) -> f64| {
            shaped(py, found.iter().flatten().map(of).collect(), [frequencies.len(), force.len()])
        };
        Ok((part(|x| x.re)?, part(|x| x.im)?))
    }
}

/// The mechanisms at a state: figures as JSON, motions, states of self-stress.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub fn mechanisms<'py>(
    py: Python<'py>,
    system: &System,
    given: Given<'py>,
) -> PyResult<(String, Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>)> {
    let state = state(&system.system, &given)?;
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let found = compute(py, &flag, || find_mechanisms(&system, &state))?.map_err(raised)?;
    let dimension = system.dimension();
    let motions =
        found.motions.iter().flat_map(|motion| crate::arrays::flat(&found.shape(motion), dimension)).collect();
    let record = sprung::report::statics::MechanismsRecord { scene: "", found: &found };
    let json = serde_json::to_string(&record).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    let rows = found.self_stress.first().map_or(found.springs, Vec::len);
    Ok((
        json,
        shaped(py, motions, [found.motions.len(), system.particles(), dimension])?,
        shaped(py, found.self_stress.concat(), [found.self_stress.len(), rows])?,
    ))
}
