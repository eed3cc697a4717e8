//! True motions of nonlinear scenes, approached at the order of each method.

use super::compare::U;
use super::one_step::Energies;
use super::orders::{Known, towards};
use super::{Outcome, Problem, cases, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use serde::Deserialize;
use sprung::force::Energy;
use sprung::verify::Claim;

#[derive(Deserialize)]
struct Answer {
    states: Vec<Snapshot>,
}

#[derive(Deserialize)]
struct Snapshot {
    #[serde(flatten)]
    known: Known,
    energy: Energies,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = || cases::<Problem<Answer>>(include_str!("../answers/trajectories.json"), |_| true);
    let mut trials = each(collector, Claim::Convergence, "trajectories", problems(), orders);
    trials.extend(each(collector, Claim::KnownAnswers, "energies", problems(), energies));
    trials
}

fn orders(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let mut checks = Vec::new();
    for snapshot in [&problem.answer.states[1], &problem.answer.states[2]] {
        checks.extend(towards(&subject, &snapshot.known)?);
    }
    Ok(checks)
}

/// The energies of the known states.
fn energies(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let check = |snapshot: &Snapshot| {
        let known = &snapshot.known;
        let found = Energy::of(&subject.system, &known.state());
        let why =
            "relative to the largest kind: a dozen rounded operations a spring, and the known state is rounded too";
        problem.check(format!("energy at {} s", known.time), snapshot.energy.distance(&found), 60.0 * U, why)
    };
    Ok(problem.answer.states.iter().map(check).collect())
}
