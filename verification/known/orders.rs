//! Observed orders of convergence towards a known state.

use super::compare::vector;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::State;
use sprung::figure::{Guide, Plot, Series};
use sprung::integrate::{ImplicitOptions, Method, Schedule, Status, StiffnessPolicy, run};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::verify::{Check, Claim, Subject};
use std::ops::ControlFlow;

/// A known state.
#[derive(Deserialize)]
pub struct Known {
    pub time: f64,
    pub positions: Vec<Vec<f64>>,
    pub velocities: Vec<Vec<f64>>,
}

/// How often the coarsest step is halved; the last two runs give the order.
const HALVINGS: u32 = 3;

/// Every method towards a known state: the observed order within 0.2 of theory, with the curve.
pub fn towards(subject: &Subject, known: &Known) -> Result<Vec<Check>, Box<dyn std::error::Error>> {
    let mut checks = Vec::new();
    for method in Method::ALL {
        let options: &[&str] =
            if method.is_implicit() { &["full", "tension", "axial", "on-demand"] } else { &["full"] };
        for option in options {
            checks.extend(order(subject, known, method, option)?);
        }
    }
    Ok(checks)
}

fn policy(name: &str) -> StiffnessPolicy {
    let always = sprung::Stiffness::ALL.into_iter().find(|option| option.name() == name);
    always.map_or(StiffnessPolicy::OnDemand, StiffnessPolicy::Always)
}

fn order(
    subject: &Subject,
    known: &Known,
    method: Method,
    option: &str,
) -> Result<Option<Check>, Box<dyn std::error::Error>> {
    let Subject { system, state, .. } = subject;
    let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: policy(option), linear };
    // z = ω h ≤ 1/16 resolves every vibration of the start twofold over what the order needs.
    let first = (known.time / (subject.resolving_step() / 8.0)).ceil() as u64;
    let mut points = Vec::new();
    for halving in 0..=HALVINGS {
        let dt = known.time / (first << halving) as f64;
        let mut end = state.clone();
        let mut stepper = method.stepper(system, state, &options)?;
        let outcome =
            run(&mut *stepper, &mut end, &Schedule::duration(dt, known.time), |_, _| ControlFlow::Continue(()));
        if outcome.status() != Status::Completed {
            return Err(format!("{}, {option}: {outcome:?}", method.name()).into());
        }
        points.push((dt, distance(&end, known)));
    }
    let name = format!("{}, {option}", method.name());
    let errors: Vec<f64> = points.iter().map(|point| point.1).collect();
    let measured = (errors[HALVINGS as usize - 1] / errors[HALVINGS as usize]).log2();
    let expected = f64::from(method.order());
    let plot = Plot::log_log(format!("{}, {name}", subject.name), "step, s", format!("error at {} s, m", known.time))
        .with_guide(Guide::Slope { slope: expected, through: points[0] })
        .with_series(Series::line(&name, points).with_slope(measured));
    let why = "distance of the observed order from theory; what is left of the next order at these steps is below 0.2";
    let check = Check::new(
        Claim::Convergence,
        format!("order towards the known state at {} s, {name}", known.time),
        &subject.name,
        (measured - expected).abs(),
        0.2,
        why,
    );
    Ok(Some(check.with_curves(plot)))
}

/// The Euclidean distance of all positions from the known ones.
fn distance(state: &State, known: &Known) -> f64 {
    let apart = |(x, row): (&Vector3<f64>, &Vec<f64>)| (x - vector(row)).norm_squared();
    state.positions.iter().zip(&known.positions).map(apart).sum::<f64>().sqrt()
}
