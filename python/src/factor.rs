//! Factorizations of A.

use crate::compute::{Flag, compute};
use crate::error::{invalid, raised};
use crate::matrices::Assembled;
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sprung::error::Invalid;
use sprung::faer::Par;
use sprung::linear::{Cholesky, FactorReport, Ldlt};
use std::sync::Mutex;

enum Kind {
    Llt(Cholesky),
    Ldlt(Ldlt),
}

impl Kind {
    fn solve_in_place(&mut self, x: &mut [f64]) -> sprung::Result<()> {
        match self {
            Self::Llt(factor) => factor.solve_in_place(x),
            Self::Ldlt(factor) => factor.solve_in_place(x),
        }
    }

    fn report(&self) -> FactorReport {
        match self {
            Self::Llt(factor) => factor.report(),
            Self::Ldlt(factor) => factor.report(),
        }
    }
}

/// A factored matrix.
#[pyclass(frozen, module = "sprung._native")]
pub struct Factor {
    kind: Mutex<Kind>,
    order: usize,
    entries: usize,
    ordering: String,
}

/// Degrees of freedom from which splitting pays, as in a run.
const LARGE: usize = 30_000;

/// A pivot that stopped a factorization: row, particle, axis.
type Stopped = (usize, usize, usize);

/// The factorization `llt` or `ldlt` of A, or the pivot that stopped it.
#[pyfunction]
pub fn factor(py: Python<'_>, assembled: &Assembled, kind: &str) -> PyResult<(Option<Factor>, Option<Stopped>)> {
    let matrix = &assembled.step.a;
    let order = matrix.dofs().len();
    let is_definite = match kind {
        "llt" => true,
        "ldlt" => false,
        _ => return Err(invalid(Invalid::new("kind", format!("{kind:?}"), "must be one of llt, ldlt"))),
    };
    let factored = compute(py, &Flag::new(), || -> sprung::Result<_> {
        let par = if order < LARGE { Par::Seq } else { Par::rayon(2) };
        if is_definite {
            let mut factor = Cholesky::analyse(matrix.pattern(), par)?;
            let done = factor.factor(matrix);
            Ok((Kind::Llt(factor), done))
        } else {
            let mut factor = Ldlt::analyse(matrix.pattern(), par)?;
            let done = factor.factor(matrix);
            Ok((Kind::Ldlt(factor), done))
        }
    })?;
    let (kind, done) = factored.map_err(raised)?;
    if let Err(pivot) = done {
        return Ok((None, Some((pivot.row, pivot.dof.particle, pivot.dof.axis))));
    }
    let size = kind.report().size;
    let ordering = format!("{:?}", size.ordering);
    Ok((Some(Factor { kind: Mutex::new(kind), order, entries: size.entries, ordering }), None))
}

#[pymethods]
impl Factor {
    /// `A⁻¹` times every row of an array: the columns of the right-hand sides as rows.
    fn solve<'py>(&self, py: Python<'py>, columns: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let columns = columns.as_array();
        let shape = [columns.dim().0, columns.dim().1];
        if shape[1] != self.order {
            let rule = format!("must have {} rows, as A has", self.order);
            return Err(invalid(Invalid::new("b", format!("an array of {} rows", shape[1]), rule)));
        }
        let mut x: Vec<f64> = columns.iter().copied().collect();
        let Ok(mut kind) = self.kind.try_lock() else {
            return Err(PyRuntimeError::new_err("this factorization is in use by another thread"));
        };
        let kind = &mut *kind;
        let order = self.order.max(1);
        compute(py, &Flag::new(), || x.chunks_exact_mut(order).try_for_each(|column| kind.solve_in_place(column)))?
            .map_err(raised)?;
        numpy::PyArray1::from_vec(py, x).reshape(shape)
    }

    #[getter]
    fn order(&self) -> usize {
        self.order
    }

    /// Stored values of L.
    #[getter]
    fn entries(&self) -> usize {
        self.entries
    }

    /// How rows were ordered.
    #[getter]
    fn ordering(&self) -> &str {
        &self.ordering
    }
}
