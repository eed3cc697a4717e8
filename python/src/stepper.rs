//! A stepper: a system, the state it has come to, and the method that leads on.

use crate::arrays::{Given, Handed, handed, state};
use crate::compute::{Flag, compute};
use crate::error::raised;
use crate::matrices::positive;
use crate::names;
use crate::system::System;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use self_cell::self_cell;
use sprung::State;
use sprung::integrate::{Statistics, TimeStepper, advance};
use sprung::plan::RunOptions;
use std::sync::{Arc, Mutex, MutexGuard};

type Owner = Arc<sprung::System>;
type Method<'s> = Box<dyn TimeStepper + Send + 's>;

self_cell!(
    /// A method and the system that it is for.
    pub struct Kept {
        owner: Owner,
        #[covariant]
        dependent: Method,
    }
);

/// What changes.
pub struct Moving {
    pub state: State,
    /// The method with its memory of the steps before; none before the first step, and after a run.
    pub kept: Option<Kept>,
    /// What methods did that are not kept any more.
    pub done: Statistics,
}

/// A stepper.
#[pyclass(frozen, module = "sprung._native")]
pub struct Stepper {
    pub system: Arc<sprung::System>,
    pub name: String,
    pub run_options: RunOptions,
    pub flag: Arc<Flag>,
    moving: Mutex<Moving>,
}

impl Stepper {
    /// What changes, for whoever comes first.
    ///
    /// # Errors
    /// When another thread, or a callback of a run of this very stepper, asks while it computes.
    pub fn moving(&self) -> PyResult<MutexGuard<'_, Moving>> {
        self.moving.try_lock().map_err(|_| {
            PyRuntimeError::new_err("this stepper is computing: in another thread, or in the run that calls back")
        })
    }
}

#[pymethods]
impl Stepper {
    #[new]
    fn new(
        py: Python<'_>,
        system: &System,
        given: Given<'_>,
        method: Option<&str>,
        stiffness: Option<&str>,
        solver: Option<&str>,
        preconditioner: Option<&str>,
        tolerance: Option<f64>,
    ) -> PyResult<Self> {
        let start = state(&system.system, &given)?;
        let flag = Flag::new();
        let run_options = RunOptions {
            method: method.map(names::method).transpose()?,
            stiffness: stiffness.map(names::policy).transpose()?,
            solver: solver.map(names::solver).transpose()?,
            preconditioner: preconditioner.map(names::preconditioner).transpose()?.flatten(),
            tolerance: tolerance.map(|value| positive("tolerance", value)).transpose()?,
            interrupt: flag.interrupt(),
            ..RunOptions::default()
        };
        let moving = Mutex::new(Moving { state: start, kept: None, done: Statistics::default() });
        Ok(Self { system: system.bound(py, &flag), name: system.name.clone(), run_options, flag, moving })
    }

    /// One step of dt seconds; why it could not be done, by status and in words.
    fn step(&self, py: Python<'_>, dt: f64) -> PyResult<Option<(&'static str, String)>> {
        let dt = positive("dt", dt)?;
        let mut moving = self.moving()?;
        let moving = &mut *moving;
        let stepped = compute(py, &self.flag, || -> sprung::Result<_> {
            let Moving { state, kept, .. } = moving;
            let kept = match kept {
                Some(kept) => kept,
                None => {
                    let plan = self.run_options.plan(&self.system, state, [dt, dt], None)?;
                    let (method, options) = (plan.configuration.method, plan.configuration.options);
                    let made = Kept::try_new(self.system.clone(), |system| method.stepper(system, state, &options))?;
                    kept.insert(made)
                }
            };
            Ok(kept.with_dependent_mut(|_, stepper| advance(&mut **stepper, state, dt)))
        });
        if stepped.is_err() {
            // What the method keeps may come of a function that raised an exception.
            moving.forget();
        }
        let failed = stepped?.map_err(raised)?.err();
        Ok(failed.map(|failure| (failure.status().name(), failure.to_string())))
    }

    /// The state that it has come to.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Handed<'py>> {
        handed(py, &self.system, &self.moving()?.state)
    }

    /// Goes on from another state; the method forgets the steps before.
    fn set_state(&self, given: Given<'_>) -> PyResult<()> {
        let state = state(&self.system, &given)?;
        let mut moving = self.moving()?;
        moving.state = state;
        moving.forget();
        Ok(())
    }

    /// What single steps did so far, as JSON.
    fn statistics(&self) -> PyResult<String> {
        let moving = self.moving()?;
        let mut all = moving.done;
        if let Some(kept) = &moving.kept {
            all.add(kept.borrow_dependent().statistics());
        }
        serde_json::to_string(&all).map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }
}

impl Moving {
    /// Lets the method go with its memory.
    pub fn forget(&mut self) {
        if let Some(kept) = self.kept.take() {
            self.done.add(kept.borrow_dependent().statistics());
        }
    }
}
