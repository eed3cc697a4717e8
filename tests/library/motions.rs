//! Shared by several tests: known answers from `verification/answers` and runs with a fixed step.

#![allow(dead_code, reason = "each program of tests uses its own part")]

use nalgebra::Vector3;
use serde_json::Value;
use sprung::integrate::{ImplicitOptions, Method, Schedule, Status, StiffnessPolicy, run};
use sprung::{Scene, State, Stiffness, System};
use std::ops::ControlFlow;

/// The cases of an answer file.
pub fn cases(name: &str) -> Vec<Value> {
    let path = format!("{}/verification/answers/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let answers: Value = serde_json::from_str(&text).unwrap();
    answers["cases"].as_array().unwrap().clone()
}

/// The case of an answer file with a name.
pub fn case(file: &str, name: &str) -> Value {
    cases(file).into_iter().find(|case| case["name"] == name).unwrap_or_else(|| panic!("{file}: no case {name}"))
}

/// The system and the initial state of a case.
pub fn build(case: &Value) -> (System, State) {
    Scene::from_json(&case["scene"].to_string()).unwrap().build().unwrap()
}

/// Rows of one, two or three numbers as 3-vectors.
pub fn rows(value: &Value) -> Vec<Vector3<f64>> {
    let row = |row: &Value| {
        let mut vector = Vector3::zeros();
        for (component, value) in vector.iter_mut().zip(row.as_array().unwrap()) {
            *component = value.as_f64().unwrap();
        }
        vector
    };
    value.as_array().unwrap().iter().map(row).collect()
}

/// The state of a case at one of its times.
pub fn state_at(case: &Value, time: f64) -> State {
    let states = case["states"].as_array().unwrap();
    let state = states.iter().find(|state| state["time"].as_f64() == Some(time)).unwrap();
    State { time, positions: rows(&state["positions"]), velocities: rows(&state["velocities"]) }
}

pub fn option(name: &str) -> Stiffness {
    Stiffness::ALL.into_iter().find(|option| option.name() == name).unwrap()
}

pub fn policies() -> [StiffnessPolicy; 4] {
    let [full, tension, axial] = [Stiffness::Full, Stiffness::Tension, Stiffness::Axial].map(StiffnessPolicy::Always);
    [full, tension, axial, StiffnessPolicy::OnDemand]
}

pub fn with(stiffness: impl Into<StiffnessPolicy>) -> ImplicitOptions {
    ImplicitOptions { stiffness: stiffness.into(), ..ImplicitOptions::default() }
}

/// The state after a number of equal steps.
pub fn after(
    system: &System,
    start: &State,
    method: Method,
    options: &ImplicitOptions,
    duration: f64,
    steps: u64,
) -> State {
    let mut state = start.clone();
    let mut stepper = method.stepper(system, &state, options).unwrap();
    let schedule = Schedule::steps(duration / steps as f64, steps);
    let outcome = run(&mut *stepper, &mut state, &schedule, |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed, "{}: {outcome:?}", method.name());
    state
}

/// The Euclidean norm of the difference of two lists of vectors; NaN if there is one.
pub fn distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>().sqrt()
}

pub fn norm(a: &[Vector3<f64>]) -> f64 {
    a.iter().map(|a| a.norm_squared()).sum::<f64>().sqrt()
}
