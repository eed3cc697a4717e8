//! Forces and spring laws that are functions of Python.
//!
//! They are called with arrays of all particles or springs, by the thread that computes, which takes the lock of the interpreter for the call; the
//! functions that come here are those of `_functions.py`, which check what the user's own give. What one raises is kept in the flag of the
//! computation and ends it; until it has ended nobody sees a number of that function, and it is not called again.

use crate::arrays::rows;
use crate::compute::Flag;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::{PyTraverseError, PyVisit};
use sprung::nalgebra::{Matrix3, Vector3};
use sprung::spring::{LawValue, SpringLaw, Tension};
use sprung::system::{Derivatives, ExternalForce, StateView};
use sprung::{Spring, State, System};
use std::fmt;
use std::sync::Arc;

/// A force, its derivatives by positions and velocities, and its rate at fixed ones.
pub type GivenForce = (Py<PyAny>, Option<Py<PyAny>>, Option<Py<PyAny>>);

/// The functions of a system.
#[derive(Default)]
pub struct Functions {
    pub forces: Vec<GivenForce>,
    pub law: Option<Py<PyAny>>,
}

impl Functions {
    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.forces.is_empty() && self.law.is_none()
    }

    /// The same system with these functions, for a computation that has this flag.
    pub fn bind(&self, py: Python<'_>, system: &System, flag: &Arc<Flag>) -> System {
        let kept = |function: &Option<Py<PyAny>>| function.as_ref().map(|function| function.clone_ref(py));
        let dimension = system.dimension();
        let mut bound = system.clone();
        for (value, derivatives, rate) in &self.forces {
            let [derivatives, rate] = [derivatives, rate].map(kept);
            let force = Force { value: value.clone_ref(py), derivatives, rate, dimension, flag: flag.clone() };
            bound = bound.with_external_force(force);
        }
        match kept(&self.law) {
            Some(function) => bound.with_spring_law(Law { function, flag: flag.clone() }),
            None => bound,
        }
    }

    /// For the collector of cycles: a function may refer to the system that it is of.
    ///
    /// # Errors
    /// Those of the visit.
    pub fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        for (value, derivatives, rate) in &self.forces {
            visit.call(value)?;
            derivatives.iter().chain(rate).try_for_each(|function| visit.call(function))?;
        }
        self.law.iter().try_for_each(|law| visit.call(law))
    }
}

/// Calls a function; whether it gave what was asked for.
fn call(flag: &Flag, function: impl FnOnce(Python<'_>) -> PyResult<()>) -> bool {
    if flag.has_failed() {
        return false;
    }
    // Where the interpreter is ending there is nobody left who would see an exception.
    match Python::try_attach(function) {
        Some(Ok(())) => true,
        Some(Err(exception)) => {
            flag.fail(exception);
            false
        }
        None => false,
    }
}

struct Force {
    value: Py<PyAny>,
    derivatives: Option<Py<PyAny>>,
    rate: Option<Py<PyAny>>,
    dimension: usize,
    flag: Arc<Flag>,
}

impl fmt::Debug for Force {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a function of Python")
    }
}

impl Force {
    /// Calls a function at a moment. A trial state that has gone astray is none of its business: there it gives nothing, without a call.
    fn call_at(
        &self,
        at: &StateView<'_>,
        function: &Py<PyAny>,
        take: impl FnOnce(Bound<'_, PyAny>) -> PyResult<()>,
    ) -> bool {
        let is_good = |vector: &Vector3<f64>| vector.iter().all(|value| value.abs() <= State::LARGEST);
        if !(at.time.is_finite() && at.positions.iter().chain(at.velocities).all(is_good)) {
            return false;
        }
        call(&self.flag, |py| {
            let [x, v] = [at.positions, at.velocities].map(|vectors| rows(py, vectors, self.dimension));
            take(function.bind(py).call1((x?, v?, at.time))?)
        })
    }

    /// Adds what a function gives, a row for every particle.
    fn add_rows(&self, at: &StateView<'_>, function: &Py<PyAny>, to: &mut [Vector3<f64>]) {
        let added = self.call_at(at, function, |given| {
            let given: PyReadonlyArray2<'_, f64> = given.extract()?;
            for (to, row) in to.iter_mut().zip(given.as_array().outer_iter()) {
                to.iter_mut().zip(row).for_each(|(to, from)| *to += from);
            }
            Ok(())
        });
        if !added {
            to.fill(Vector3::repeat(f64::NAN));
        }
    }
}

impl ExternalForce for Force {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        self.add_rows(at, &self.value, force);
    }

    fn has_derivatives(&self) -> bool {
        self.derivatives.is_some()
    }

    fn add_derivatives(&self, at: &StateView<'_>, derivatives: &mut [Derivatives]) {
        let Some(function) = &self.derivatives else { return };
        let added = self.call_at(at, function, |given| {
            type Blocks<'py> = PyReadonlyArray3<'py, f64>;
            let (stiffness, damping): (Option<Blocks<'_>>, Option<Blocks<'_>>) = given.extract()?;
            let add =
                |blocks: Option<Blocks<'_>>, to: fn(&mut Derivatives) -> &mut Matrix3<f64>, all: &mut [Derivatives]| {
                    let Some(blocks) = blocks else { return };
                    for (derivatives, block) in all.iter_mut().zip(blocks.as_array().outer_iter()) {
                        let to = to(derivatives);
                        for (mut to, row) in to.row_iter_mut().zip(block.outer_iter()) {
                            to.iter_mut().zip(row).for_each(|(to, from)| *to += from);
                        }
                    }
                };
            add(stiffness, |derivatives| &mut derivatives.stiffness, derivatives);
            add(damping, |derivatives| &mut derivatives.damping, derivatives);
            Ok(())
        });
        if !added {
            let unknown = Matrix3::repeat(f64::NAN);
            derivatives.fill(Derivatives { stiffness: unknown, damping: unknown });
        }
    }

    fn add_rate(&self, at: &StateView<'_>, rate: &mut [Vector3<f64>]) {
        if let Some(function) = &self.rate {
            self.add_rows(at, function, rate);
        }
    }
}

/// A law for all springs at once.
struct Law {
    function: Py<PyAny>,
    flag: Arc<Flag>,
}

impl fmt::Debug for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a function of Python")
    }
}

/// What is said of a spring where there is no answer.
const UNKNOWN: LawValue = LawValue { tension: Tension { force: f64::NAN, slope: f64::NAN }, energy: f64::NAN };

impl SpringLaw for Law {
    /// It is asked for all springs, so never for one.
    fn tension(&self, _: usize, _: &Spring, _: f64) -> Tension {
        UNKNOWN.tension
    }

    fn energy(&self, _: usize, _: &Spring, _: f64) -> f64 {
        UNKNOWN.energy
    }

    fn is_asked_at_once(&self) -> bool {
        true
    }

    fn values(&self, springs: &[Spring], lengths: &[f64]) -> Vec<LawValue> {
        let mut values = vec![UNKNOWN; springs.len()];
        if lengths.iter().any(|length| !length.is_finite()) {
            return values;
        }
        call(&self.flag, |py| {
            let each = |value: fn(&Spring) -> f64| PyArray1::from_iter(py, springs.iter().map(value));
            let lengths = PyArray1::from_slice(py, lengths);
            let given = (lengths, each(|spring| spring.rest_length), each(|spring| spring.stiffness));
            type Column<'py> = PyReadonlyArray1<'py, f64>;
            let (force, slope, energy): (Column<'_>, Column<'_>, Column<'_>) =
                self.function.bind(py).call1(given)?.extract()?;
            let each = force.as_array().into_iter().zip(slope.as_array()).zip(energy.as_array());
            for (value, ((&force, &slope), &energy)) in values.iter_mut().zip(each) {
                *value = LawValue { tension: Tension { force, slope }, energy };
            }
            Ok(())
        });
        values
    }
}
