//! Two bodies that circle each other at `l = l0/(1 − μ ω² l0/k)`: the balance of forces, and the motion in the limit.

use super::compare::{U, number};
use super::one_step::Energies;
use super::orders::{Known, towards};
use super::{Outcome, Problem, cases, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::force::{Energy, SpringGeometry, add_elastic_force, angular_momentum, linear_momentum};
use sprung::verify::{Claim, worst};

#[derive(Deserialize)]
struct Answer {
    omega: f64,
    length: f64,
    tension: f64,
    energy: Energies,
    angular_momentum_about_centre: f64,
    states: Vec<Known>,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = || cases::<Problem<Answer>>(include_str!("../answers/two_bodies.json"), |_| true);
    let mut trials = each(collector, Claim::KnownAnswers, "two_bodies", problems(), balance);
    trials.extend(each(collector, Claim::Convergence, "two_bodies", problems(), limit));
    trials
}

fn balance(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let (system, answer) = (&subject.system, &problem.answer);
    let masses = system.masses();
    let total: f64 = masses.iter().sum();
    let circle = answer.states.iter().map(Known::state);
    let spring = system.springs()[0];
    // A length off by u changes a force of T by u k l/l0.
    let sensitivity = spring.stiffness * answer.length / spring.rest_length / answer.tension;
    let bound = 30.0 * U * (1.0 + sensitivity);
    let why = "relative: roundings of a few operations, times k l/(l0 T) for what a rounded length does to the tension";
    let mut checks = Vec::new();
    for state in std::iter::once(subject.state.clone()).chain(circle) {
        let at = |name: &str| format!("{name} at {} s", state.time);
        let mut force = vec![Vector3::zeros(); 2];
        add_elastic_force(system, &SpringGeometry::at(system, &state.positions)?, &mut force);
        let length = (state.positions[0] - state.positions[1]).norm();
        checks.push(problem.check(at("length"), number(length, answer.length), bound, why));
        checks.push(problem.check(at("tension"), number(force[0].norm(), answer.tension), bound, why));
        let centre = (state.positions[0] * masses[0] + state.positions[1] * masses[1]) / total;
        let drift = linear_momentum(system, &state) / total;
        let centripetal = worst((0..2).map(|p| {
            let expected = (centre - state.positions[p]) * (masses[p] * answer.omega * answer.omega);
            (force[p] - expected).norm() / answer.tension
        }));
        checks.push(problem.check(at("centripetal force"), centripetal, bound, why));
        let relative = angular_momentum(system, &state) - centre.cross(&drift) * total;
        // About z in a planar scene, along an axis of its own in space: the sign is that of ω.
        let found = relative.norm() * answer.angular_momentum_about_centre.signum();
        let reach = worst(state.positions.iter().map(|x| x.norm())) * worst(state.velocities.iter().map(|v| v.norm()));
        let cancelled = bound * (1.0 + total * reach / answer.angular_momentum_about_centre.abs());
        let about = "relative: roundings, with the orbital part about the origin that cancels";
        let value = number(found, answer.angular_momentum_about_centre);
        checks.push(problem.check(at("angular momentum"), value, cancelled, about));
        let energy = answer.energy.distance(&Energy::of(system, &state));
        checks.push(problem.check(at("energy"), energy, bound, why));
    }
    Ok(checks)
}

fn limit(problem: &Problem<Answer>) -> Outcome {
    towards(&problem.subject()?, &problem.answer.states[1])
}
