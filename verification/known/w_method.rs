//! Two steps of the second-order W-method in 50 digits.

use super::compare::rows;
use super::one_step::Option3;
use super::{Outcome, Problem, cases, direct, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use serde::Deserialize;
use sprung::integrate::{TimeStepper, WMethod};
use sprung::verify::{Claim, worst};

#[derive(Deserialize)]
struct Answer {
    stiffness: Option3,
    dt: f64,
    steps: usize,
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    // The coupling to a moving particle is that of the matrix of the step, as in linearised backward Euler.
    let of_the_option = |case: &serde_json::Value| matches!(case["time_derivative"].as_str(), None | Some("option"));
    let problems = cases::<Problem<Answer>>(include_str!("../answers/wmethod.json"), of_the_option);
    each(collector, Claim::KnownAnswers, "w_method", problems, measure)
}

fn measure(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let answer = &problem.answer;
    let mut stepper = WMethod::new(&subject.system, &subject.state, &direct(answer.stiffness.stiffness()))?;
    let mut state = subject.state.clone();
    for _ in 0..answer.steps {
        stepper.step(&mut state, answer.dt)?;
    }
    let why = "relative to the largest: two solves a step, each with 30 u κ(A), below 1e2 in these scenes";
    let value = worst([rows(&state.positions, &answer.positions), rows(&state.velocities, &answer.velocities)]);
    Ok(vec![problem.check("two steps of the W-method", value, 1e-12, why)])
}
