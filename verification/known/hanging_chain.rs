//! A hanging chain rests where every spring bears the weight below it; a step from there moves nothing.

use super::compare::{U, rows, vector};
use super::{Outcome, Problem, cases, direct, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::force::{SpringGeometry, add_elastic_force, add_weight};
use sprung::integrate::{Method, StiffnessPolicy};
use sprung::verify::{Claim, worst};

#[derive(Deserialize)]
struct Answer {
    dt: f64,
    positions: Vec<Vec<f64>>,
    lengths: Vec<f64>,
    tensions: Vec<f64>,
    support_force: Vec<f64>,
    largest_force_of_rounded_positions: f64,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = cases::<Problem<Answer>>(include_str!("../answers/hanging_chain.json"), |_| true);
    each(collector, Claim::KnownAnswers, "hanging_chain", problems, measure)
}

fn measure(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let (system, state, answer) = (&subject.system, &subject.state, &problem.answer);
    let extensions = SpringGeometry::at(system, &state.positions)?;
    let springs: Vec<_> = extensions.iter().zip(system.springs()).collect();
    // The change of a force by the rounding of a position.
    let pull = worst(
        springs.iter().map(|(at, spring)| spring.stiffness * (at.length + spring.rest_length) / spring.rest_length),
    );
    let reach = worst(state.positions.iter().map(|x| x.norm()));
    let stiffest = worst(springs.iter().map(|(_, spring)| spring.stiffness / spring.rest_length));
    let force_rounding = 30.0 * U * (pull + stiffest * reach);
    let why = "rounding of the positions and of the force, 30 u k (|x| + l + l0)/l0";
    let lengths = worst(springs.iter().zip(&answer.lengths).map(|((at, _), l)| (at.length - l).abs()));
    let tensions = worst(
        springs.iter().zip(&answer.tensions).map(|((at, spring), t)| (spring.elastic_force(at).norm() - t).abs()),
    );
    let mut force = vec![Vector3::zeros(); system.particles()];
    add_elastic_force(system, &extensions, &mut force);
    add_weight(system, &mut force);
    let support = (force[0] + vector(&answer.support_force)).norm();
    let unbalanced = worst(force.iter().skip(1).map(|f| f.norm()));
    let balance = force_rounding + answer.largest_force_of_rounded_positions;
    let lengths_why = "rounding of the positions, 30 u |x|";
    let mut checks = vec![
        problem.check("lengths", lengths, 30.0 * U * reach, lengths_why),
        problem.check("tensions", tensions, force_rounding, why),
        problem.check("force of the support", support, system.particles() as f64 * force_rounding, why),
        problem.check("balance of forces", unbalanced, balance, why),
    ];
    let always = sprung::Stiffness::ALL.map(StiffnessPolicy::Always);
    for method in Method::ALL {
        let policies = if method.is_implicit() { &always[..] } else { &always[..1] };
        for &stiffness in policies {
            // A hundred times the step too: an equilibrium is one at every step of an implicit method.
            let steps: &[f64] = if method.is_implicit() { &[1.0, 100.0] } else { &[1.0] };
            for factor in steps {
                let dt = answer.dt * factor;
                let mut after = state.clone();
                method.stepper(system, state, &direct(stiffness))?.step(&mut after, dt)?;
                let moved = rows(&after.positions, &answer.positions) * reach;
                let name = format!("rest is kept by {}, {}, dt = {dt}", method.name(), stiffness.name());
                let lightest = system.masses().iter().copied().fold(f64::INFINITY, f64::min);
                // A ≥ M/dt² moves a force by at most dt²/m.
                let bound = 30.0 * U * reach + dt * dt / lightest * balance * (system.particles() as f64).sqrt();
                let why = "rounding of the positions, 30 u |x|, and what is left of the forces times dt²/m";
                checks.push(problem.check(name, moved, bound, why));
            }
        }
    }
    Ok(checks)
}
