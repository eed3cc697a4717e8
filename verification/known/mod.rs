//! Known answers: what the solver computes against numbers that were found without it.
//!
//! The files `answers/*.json` hold the numbers, `answers/derive` the programs that derive them in high precision.

mod amplification;
mod compare;
mod critical_steps;
mod damped_spring;
mod hanging_chain;
mod invariants;
mod linearised;
mod manufactured;
mod one_step;
mod orders;
mod spring_blocks;
mod taut_chain;
mod trajectories;
mod two_bodies;
mod w_method;

use crate::collect::{Collector, slug};
use libtest_mimic::Trial;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use sprung::Scene;
use sprung::integrate::{ImplicitOptions, StiffnessPolicy};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::verify::{Check, Claim, TestCase};

/// Checks, or why they could not be carried out.
type Outcome = Result<Vec<Check>, Box<dyn std::error::Error>>;

/// One problem of an answer file.
#[derive(Deserialize)]
pub struct Problem<A> {
    name: String,
    scene: Scene,
    #[serde(flatten)]
    answer: A,
}

#[derive(Deserialize)]
struct File<A> {
    cases: Vec<A>,
}

impl<A> Problem<A> {
    fn subject(&self) -> sprung::Result<TestCase> {
        Ok(TestCase { name: self.name.clone(), ..TestCase::of_scene(&self.scene)? })
    }

    fn check(&self, name: impl Into<String>, value: f64, bound: f64, why: &str) -> Check {
        Check::new(Claim::KnownAnswers, name, &self.name, value, bound, why)
    }
}

/// Steps whose equations are solved by Cholesky, which leaves rounding errors only.
fn direct(stiffness: impl Into<StiffnessPolicy>) -> ImplicitOptions {
    let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
    ImplicitOptions { stiffness: stiffness.into(), linear }
}

/// All known answers as tests.
pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let mut trials = Vec::new();
    for group in [
        spring_blocks::trials,
        one_step::trials,
        invariants::trials,
        damped_spring::trials,
        taut_chain::trials,
        hanging_chain::trials,
        two_bodies::trials,
        trajectories::trials,
        w_method::trials,
        critical_steps::trials,
        linearised::trials,
        manufactured::trials,
    ] {
        trials.extend(group(collector));
    }
    trials
}

/// The cases of an answer file that have the form of A; others are of another kind.
fn cases<A: DeserializeOwned>(text: &str, kind: impl Fn(&serde_json::Value) -> bool) -> Vec<A> {
    let file: File<serde_json::Value> = serde_json::from_str(text).expect("an answer file");
    let chosen = file.cases.into_iter().filter(|case| kind(case));
    chosen.map(|case| serde_json::from_value(case).expect("a case of this kind")).collect()
}

/// One test for every problem of an answer file that is of the kind.
fn each<A: DeserializeOwned + Send + 'static>(
    collector: &mut Collector,
    claim: Claim,
    group: &str,
    problems: Vec<Problem<A>>,
    measure: fn(&Problem<A>) -> Outcome,
) -> Vec<Trial> {
    let test = |problem: Problem<A>| {
        let name = format!("{}::{group}::{}", claim.id().replace('-', "_"), slug(&problem.name));
        let failed = {
            let (group, scene) = (group.to_owned(), problem.name.clone());
            move |error: Box<dyn std::error::Error>| {
                vec![Check::new(claim, group, scene, f64::NAN, 0.0, format!("could not be carried out: {error}"))]
            }
        };
        collector.trial(claim, name, move || measure(&problem).unwrap_or_else(failed))
    };
    problems.into_iter().map(test).collect()
}
