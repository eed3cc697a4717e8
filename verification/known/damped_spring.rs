//! A damped spring along its line: the iterates of linearised backward Euler exactly, and the true motion in the limit.

use super::compare::{U, rows};
use super::orders::{Known, towards};
use super::{Outcome, Problem, cases, direct, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use serde::Deserialize;
use sprung::Stiffness;
use sprung::integrate::{LinearBackwardEuler, TimeStepper};
use sprung::verify::{Claim, worst};

#[derive(Deserialize)]
struct Answer {
    dt: f64,
    kappa: f64,
    reduced_mass: f64,
    exact: Vec<Known>,
    linear_backward_euler: Vec<Iterate>,
}

#[derive(Deserialize)]
pub struct Iterate {
    pub steps: usize,
    pub positions: Vec<Vec<f64>>,
    pub velocities: Vec<Vec<f64>>,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = || cases::<Problem<Answer>>(include_str!("../answers/damped_spring.json"), |_| true);
    let mut trials = each(collector, Claim::KnownAnswers, "damped_spring", problems(), iterates);
    trials.extend(each(collector, Claim::Convergence, "damped_spring", problems(), limit));
    trials
}

fn iterates(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let answer = &problem.answer;
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let mut stepper = LinearBackwardEuler::new(&subject.system, &subject.state, &direct(option))?;
        let mut state = subject.state.clone();
        let mut done = 0;
        for iterate in &answer.linear_backward_euler {
            while done < iterate.steps {
                stepper.step(&mut state, answer.dt)?;
                done += 1;
            }
            let value =
                worst([rows(&state.positions, &iterate.positions), rows(&state.velocities, &iterate.velocities)]);
            // κ(A) ≤ 1 + (κ + b/dt) dt²/m, doubled for two ends; the velocity is a difference over dt.
            let condition = 1.0 + 4.0 * answer.kappa * answer.dt * answer.dt / answer.reduced_mass;
            let bound = 30.0 * U * condition * (1 + done) as f64 * 10.0;
            let why = "relative to the largest: a step adds 30 u κ(A), none shrinks away entirely, and a velocity that has \
                       decayed to a tenth of its start shows ten times that";
            checks.push(problem.check(format!("{done} steps, {}", option.name()), value, bound, why));
        }
    }
    Ok(checks)
}

fn limit(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let chosen = [&problem.answer.exact[1], &problem.answer.exact[4]];
    let mut checks = Vec::new();
    for known in chosen {
        checks.extend(towards(&subject, known)?);
    }
    Ok(checks)
}
