//! Runs that must be the same to the bit: the same run twice, by one thread and by two, in a plane and in space.
//!
//! A planar scene has the same degrees of freedom as its twin in space with the third axis held, hence the same matrices,
//! the same operations and the same rounding.

use super::family::Outcome;
use super::runs::{Way, direct};
use super::{Check, Claim, Subject};
use crate::integrate::{Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::system::State;
use faer::Par;

const STEPS: usize = 10;

pub(super) fn is_flat(subject: &Subject) -> bool {
    subject.system.dimension() < 3
}

/// A planar or one-dimensional scene against its twin in space.
pub(super) fn in_space(subject: &Subject) -> Outcome {
    let twin = subject.in_space()?;
    let mut checks = Vec::new();
    for way in Way::all() {
        let dt = way.step(subject);
        let flat = way.run(subject, direct(), dt, STEPS)?;
        let spatial = way.run(&twin, direct(), dt, STEPS)?;
        let why = "the degrees of freedom are the same, so every operation is: not one bit may differ";
        let name = format!("same in space with the other axes held, {}", way.name());
        checks.push(Check::new(Claim::Constraints, name, &subject.name, differences(&flat, &spatial), 0.0, why));
    }
    Ok(checks)
}

/// The same run twice, and by two threads.
pub(super) fn repeated(subject: &Subject) -> Outcome {
    let mut checks = Vec::new();
    let why = "nothing but the scene and the options decides a result: not one bit may differ";
    for way in Way::all() {
        let dt = way.step(subject);
        let run = || way.run(subject, SolverOptions::default(), dt, STEPS);
        let name = format!("same run twice, {}", way.name());
        checks.push(Check::new(Claim::Solvers, name, &subject.name, differences(&run()?, &run()?), 0.0, why));
    }
    for (solver, name) in [(SolverChoice::Llt, "Cholesky"), (SolverChoice::Ldlt, "LDLᵀ"), (SolverChoice::Cg, "CG")] {
        let way = Way { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::OnDemand };
        let run = |par| way.run(subject, SolverOptions { solver, par, ..SolverOptions::default() }, subject.dt, STEPS);
        let value = differences(&run(Par::Seq)?, &run(Par::rayon(2))?);
        let name = format!("same with one thread and two, {name}");
        checks.push(Check::new(Claim::Solvers, name, &subject.name, value, 0.0, why));
    }
    Ok(checks)
}

/// How many numbers differ, in bits; a run that only one of the two could do differs in everything.
fn differences(a: &Option<Vec<State>>, b: &Option<Vec<State>>) -> f64 {
    let (Some(a), Some(b)) = (a, b) else { return if a.is_none() && b.is_none() { 0.0 } else { f64::INFINITY } };
    let numbers = |states: &[State]| -> Vec<u64> {
        let vectors = states.iter().flat_map(|state| state.positions.iter().chain(&state.velocities));
        // Plus zero makes one of both zeros: they are the same number.
        vectors.flat_map(|v| [v.x, v.y, v.z]).map(|c| (c + 0.0).to_bits()).collect()
    };
    let (a, b) = (numbers(a), numbers(b));
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(&b).filter(|(a, b)| a != b).count() as f64
}
