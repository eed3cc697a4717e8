//! Observed orders of convergence towards a known state.

use super::compare::vector;
use super::direct;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::integrate::{Method, Schedule, Status, StiffnessPolicy, run};
use sprung::verify::{Check, Claim, ErrorCurve, TestCase, order_checks};
use sprung::{State, Stiffness};
use std::ops::ControlFlow;

/// A known state.
#[derive(Deserialize)]
pub struct Known {
    pub time: f64,
    pub positions: Vec<Vec<f64>>,
    pub velocities: Vec<Vec<f64>>,
}

impl Known {
    pub fn state(&self) -> State {
        let vectors = |rows: &[Vec<f64>]| rows.iter().map(|row| vector(row)).collect();
        State { time: self.time, positions: vectors(&self.positions), velocities: vectors(&self.velocities) }
    }
}

/// Halvings of the coarsest step; the last two runs give the order.
const HALVINGS: u32 = 3;

/// Every method towards a known state: the observed order within 0.2 of theory, with the curves; and of methods of order above
/// two, whose errors are below rounding soon after they are asymptotic, the error itself.
pub fn towards(subject: &TestCase, known: &Known) -> Result<Vec<Check>, Box<dyn std::error::Error>> {
    let mut curves = Vec::new();
    let (low, high): (Vec<Method>, Vec<Method>) = Method::ALL.into_iter().partition(|method| method.order() <= 2);
    for method in low {
        let always = Stiffness::ALL.map(StiffnessPolicy::Always);
        let policies = if method.is_implicit() { &always[..] } else { &always[..1] };
        for &policy in policies {
            curves.push(curve(subject, known, method, policy)?);
        }
        if method.is_implicit() {
            curves.push(curve(subject, known, method, StiffnessPolicy::OnDemand)?);
        }
    }
    let name = format!("order towards the known state at {} s", known.time);
    let mut checks = order_checks(&name, &subject.name, "error, m", curves);
    for method in high {
        checks.push(error(subject, known, method)?);
    }
    Ok(checks)
}

/// The error of a method of high order at a step that resolves every vibration.
fn error(subject: &TestCase, known: &Known, method: Method) -> Result<Check, Box<dyn std::error::Error>> {
    let order = method.order();
    let z: f64 = if order <= 4 { 1.0 / 8.0 } else { 1.0 / 4.0 };
    // z = 1/2 is the resolving step.
    let steps = (known.time / (subject.resolving_step() * 2.0 * z)).ceil() as u64;
    let schedule = Schedule::steps(known.time / steps as f64, steps);
    let end = end(subject, method, StiffnessPolicy::OnDemand, &schedule)?;
    let left_out = (1..=order + 1).fold(1.0, |product, k| product * z / f64::from(k));
    let particles = (subject.system.particles() as f64).sqrt();
    let reach = subject.extent() + subject.centre().norm();
    let bound = steps as f64 * particles * (left_out * subject.extent() + 30.0 * f64::EPSILON * reach);
    let name = format!("error at the known state at {} s, {}", known.time, method.name());
    let why = "z^(p + 1)/(p + 1)! of the extent a step, the first term of the exponential that a method of order p leaves out, at \
               z = ω h; with 30 roundings of the positions a step";
    Ok(Check::new(Claim::Convergence, name, &subject.name, distance(&end, known), bound, why))
}

/// The state at the end of a run.
fn end(
    subject: &TestCase,
    method: Method,
    stiffness: StiffnessPolicy,
    schedule: &Schedule,
) -> Result<State, Box<dyn std::error::Error>> {
    let mut state = subject.state.clone();
    let mut stepper = method.stepper(&subject.system, &subject.state, &direct(stiffness))?;
    let outcome = run(&mut *stepper, &mut state, schedule, |_, _| ControlFlow::Continue(()));
    if outcome.status() != Status::Completed {
        return Err(format!("{}, {}: {outcome:?}", method.name(), stiffness.name()).into());
    }
    Ok(state)
}

fn curve(
    subject: &TestCase,
    known: &Known,
    method: Method,
    stiffness: StiffnessPolicy,
) -> Result<ErrorCurve, Box<dyn std::error::Error>> {
    let name = match method.is_implicit() {
        true => format!("{}, {}", method.name(), stiffness.name()),
        false => method.name().to_owned(),
    };
    // z = ω h ≤ 1/16 resolves every vibration of the start twofold over what the order needs.
    let first = (known.time / (subject.resolving_step() / 8.0)).ceil() as u64;
    let mut points = Vec::new();
    for halving in 0..=HALVINGS {
        let dt = known.time / (first << halving) as f64;
        let end = end(subject, method, stiffness, &Schedule::duration(dt, known.time))?;
        points.push((dt, distance(&end, known)));
    }
    Ok(ErrorCurve { method: name, order: method.order(), points })
}

/// The Euclidean distance of all positions from the known ones.
fn distance(state: &State, known: &Known) -> f64 {
    let apart = |(x, row): (&Vector3<f64>, &Vec<f64>)| (x - vector(row)).norm_squared();
    state.positions.iter().zip(&known.positions).map(apart).sum::<f64>().sqrt()
}
