//! Products with A, M, G or K without a matrix.

use crate::arrays::{Given, state};
use crate::compute::{Flag, compute};
use crate::error::{invalid, raised};
use crate::matrices::positive;
use crate::names;
use crate::system::System;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use self_cell::self_cell;
use sprung::error::Invalid;
use sprung::force::SpringGeometry;
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use std::sync::Arc;

type Owner = Arc<sprung::System>;

self_cell!(
    struct Cell {
        owner: Owner,
        #[covariant]
        dependent: SystemOperator,
    }
);

/// A matrix known by its products.
#[pyclass(frozen, module = "sprung._native")]
pub struct Operator {
    cell: Cell,
}

/// The operator of A, M, G or K at a state.
#[pyfunction]
pub fn operator(
    py: Python<'_>,
    system: &System,
    given: Given<'_>,
    dt: f64,
    stiffness: &str,
    matrix: &str,
) -> PyResult<Operator> {
    let state = state(&system.system, &given)?;
    let option = names::stiffness(stiffness)?;
    let combination = match matrix {
        "A" => Combination::step(positive("dt", dt)?),
        "M" => Combination::MASS,
        "G" => Combination::DAMPING,
        "K" => Combination::STIFFNESS,
        _ => return Err(invalid(Invalid::new("matrix", format!("{matrix:?}"), "must be one of A, M, G, K"))),
    };
    let flag = Flag::new();
    let system = system.bound(py, &flag);
    let cell = compute(py, &flag, || {
        Cell::try_new(system, |system| {
            let extensions = SpringGeometry::at(system, &state)?;
            Ok(SystemOperator::new(system, &extensions, option, combination))
        })
    })?;
    Ok(Operator { cell: cell.map_err(|error: sprung::force::DegenerateSpring| raised(error.into()))? })
}

#[pymethods]
impl Operator {
    /// The product with a vector.
    fn apply<'py>(&self, py: Python<'py>, w: PyReadonlyArray1<'py, f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let w: Vec<f64> = w.as_array().to_vec();
        let operator = self.cell.borrow_dependent();
        let mut y = vec![0.0; operator.order()];
        if w.len() != y.len() {
            let rule = format!("must have {} entries", y.len());
            return Err(invalid(Invalid::new("w", format!("a vector of {}", w.len()), rule)));
        }
        compute(py, &Flag::new(), || operator.apply(&w, &mut y))?;
        Ok(PyArray1::from_vec(py, y))
    }
}
