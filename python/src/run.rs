//! A whole run, as the command makes it.

use crate::answer::search;
use crate::arrays::{Handed, handed};
use crate::compute::converse;
use crate::error::raised;
use crate::recorded::Recorded;
use crate::stepper::{Moving, Stepper};
use crate::task::{Done, Pacing, Subject, fraction};
use pyo3::exceptions::{PyRuntimeError, PyStopIteration};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sprung::integrate::{Monitor, Schedule, Status};
use sprung::output::{ChoiceReport, RunRecord};
use sprung::plan::RunOptions;
use sprung::{State, System};
use std::ops::ControlFlow;
use std::time::Instant;

/// Runs a stepper from its state for `duration` seconds; hands out a dictionary.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one for each argument of the method that calls it")]
pub fn run<'py>(
    py: Python<'py>,
    stepper: &Stepper,
    duration: f64,
    dt: Option<f64>,
    rtol: Option<f64>,
    accuracy: Option<f64>,
    allow_unstable: bool,
    every: u64,
    callback: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let run_options =
        RunOptions { rtol: fraction("rtol", rtol)?, accuracy: fraction("accuracy", accuracy)?, ..stepper.run_options };
    let pacing = Pacing::new(&run_options, duration, dt, !allow_unstable, every)?;
    let mut guard = stepper.moving()?;
    let moving = &mut *guard;
    let calls_back = callback.is_some();
    let done = converse(
        py,
        &stepper.flag,
        |line| {
            let observe = |number, state: &State| {
                if calls_back { line.ask((number, state.clone())) } else { ControlFlow::Continue(()) }
            };
            let done = of_stepper(stepper, &run_options, &pacing, moving, observe);
            moving.forget();
            done
        },
        |py, (number, state): (u64, State)| called(py, callback.as_ref(), &stepper.system, number, &state),
    )?;
    let Some(Done { summary, recorded }) = done.map_err(raised)? else {
        let accuracy = run_options.accuracy.unwrap_or(0.0);
        let why = format!("no run comes to the end of this motion: there is no answer to an accuracy of {accuracy:e}");
        return Err(PyRuntimeError::new_err(why));
    };
    let handed_out = PyDict::new(py);
    let text = serde_json::to_string(&summary).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    handed_out.set_item("summary", text)?;
    handed_out.set_item("state", handed(py, &stepper.system, &guard.state)?)?;
    recorded.hand_out(py, &handed_out)?;
    Ok(handed_out)
}

/// Calls the user's function; one that raises `StopIteration` ends the run in order.
fn called(
    py: Python<'_>,
    callback: Option<&Py<PyAny>>,
    system: &System,
    number: u64,
    state: &State,
) -> PyResult<ControlFlow<()>> {
    let Some(callback) = callback else { return Ok(ControlFlow::Continue(())) };
    let state: Handed<'_> = handed(py, system, state)?;
    match callback.call1(py, (number, state)) {
        Ok(_) => Ok(ControlFlow::Continue(())),
        Err(error) if error.is_instance_of::<PyStopIteration>(py) => Ok(ControlFlow::Break(())),
        Err(error) => Err(error),
    }
}

/// Runs on; `None` where there is no answer to an accuracy.
fn of_stepper(
    stepper: &Stepper,
    run_options: &RunOptions,
    pacing: &Pacing,
    moving: &mut Moving,
    observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> sprung::Result<Option<Done>> {
    let system = &*stepper.system;
    let subject = Subject { name: &stepper.name, system };
    if let Some(options) = run_options.accuracy_options(system, pacing.duration, pacing.interval) {
        return search(&subject, &options, pacing, &stepper.flag, &mut moving.state);
    }
    simulate(&subject, run_options, pacing, &mut moving.state, observe).map(Some)
}

fn simulate(
    subject: &Subject<'_>,
    run_options: &RunOptions,
    pacing: &Pacing,
    state: &mut State,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> sprung::Result<Done> {
    let Subject { name, system } = subject;
    let schedule = Schedule::duration(pacing.interval, pacing.duration);
    let clock = Instant::now();
    let plan = run_options.plan(system, state, [schedule.dt(), pacing.duration], pacing.rtol)?;
    let mut monitor = Monitor::new(system, state, plan.monitor(pacing.stops_unstable, true))?;
    let mut stepper = plan.stepper(system, state)?;
    let mut recorded = Recorded::new(system, schedule.len(), pacing.every)?;
    recorded.push(0, state, &monitor);
    let outcome = stepper.run(system, state, &schedule, &mut monitor, |number, state, monitor| {
        recorded.push(number, state, monitor);
        // Of steps without systems to solve nobody else looks whether to stop.
        match run_options.interrupt.is_requested() {
            true => ControlFlow::Break(()),
            false if recorded.is_frame(number) => observe(number, state),
            false => ControlFlow::Continue(()),
        }
    });
    let status = outcome.status();
    if matches!(status, Status::Completed | Status::Interrupted) {
        recorded.end(state);
    }
    let stepper = stepper.get();
    let record = RunRecord {
        scene: (*name).to_owned(),
        system,
        plan: &plan,
        schedule: &schedule,
        stepper,
        monitor: &monitor,
        outcome: &outcome,
        statistics: *stepper.statistics(),
        state,
        wall_seconds: clock.elapsed().as_secs_f64(),
        choice: ChoiceReport::of_plan(&plan, pacing.is_chosen),
    };
    Ok(Done { summary: record.summary(), recorded })
}
