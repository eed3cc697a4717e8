//! Scenes × steps × answers: costs against those of on-demand, performance profiles.

use super::scenes::{Drawn, KINDS, scene};
use sprung::chart::definiteness::{Ratios, Solve, profile_figure, ratios, solve_equilibrium, solve_step};
use sprung::figure::Plot;
use sprung::integrate::StiffnessPolicy;
use std::fmt::Write;
use std::ops::Range;

/// Steps over √(m l0/k).
pub const FACTORS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];

/// A step of a scene, or the search for its equilibrium, under every option and policy.
pub struct Problem {
    pub seed: u64,
    pub name: String,
    /// `None` for the equilibrium.
    pub factor: Option<f64>,
    pub solves: Vec<Solve>,
}

/// The problems of some seeds.
pub fn problems(seeds: Range<u64>) -> sprung::Result<Vec<Problem>> {
    let mut problems = Vec::new();
    for seed in seeds {
        let Drawn { name, system, state, spring_time } = scene(seed)?;
        for factor in FACTORS.map(Some).into_iter().chain([None]) {
            let solve = |policy| match factor {
                Some(factor) => solve_step(&system, &state, factor * spring_time, policy),
                None => solve_equilibrium(&system, &state, policy),
            };
            let solves = StiffnessPolicy::ALL.into_iter().map(solve).collect::<sprung::Result<_>>()?;
            problems.push(Problem { seed, name: name.clone(), factor, solves });
        }
    }
    Ok(problems)
}

/// The solves of the problems that satisfy a condition.
pub fn of<'a>(problems: &'a [Problem], is_meant: impl Fn(&Problem) -> bool) -> Vec<&'a [Solve]> {
    problems.iter().filter(|problem| is_meant(problem)).map(|problem| problem.solves.as_slice()).collect()
}

/// Steps alone.
pub fn steps(problems: &[Problem]) -> Vec<&[Solve]> {
    of(problems, |problem| problem.factor.is_some())
}

fn row(text: &mut String, name: &str, problems: &[&[Solve]], policy: usize) {
    let Ratios { means, largest, solved } = ratios(problems, policy);
    let all = problems.len();
    let sum =
        |count: fn(&Solve) -> Option<u64>| problems.iter().filter_map(|solves| count(&solves[policy])).sum::<u64>();
    let _ = writeln!(
        text,
        "| {name} | {} | {solved} of {all} | {:.2} | {:.2} | {:.1} | {:.1} | {} | {} | {} |",
        StiffnessPolicy::ALL[policy].name(),
        means[0],
        means[1],
        largest[0],
        largest[1],
        sum(|solve| Some(solve.iterations)),
        sum(|solve| solve.refused),
        sum(|solve| solve.changed_terms),
    );
}

const HEAD: &str = "| | stiffness | solved | iterations | factorizations | most iterations | most factorizations | iterations in all | refused | terms \
    changed |\n|---|---|---|---|---|---|---|---|---|---|\n";

/// The table by kinds of scenes, by steps, and of all.
pub fn table(problems: &[Problem]) -> String {
    let mut text = String::from(HEAD);
    let mut rows = |name: &str, meant: Vec<&[Solve]>| {
        for policy in 0..StiffnessPolicy::ALL.len() {
            row(&mut text, name, &meant, policy);
        }
    };
    rows("**all steps**", steps(problems));
    for factor in FACTORS {
        rows(&format!("dt √(k/(m l0)) = {factor}"), of(problems, |problem| problem.factor == Some(factor)));
    }
    for (kind, name) in KINDS.into_iter().enumerate() {
        let is_kind = |problem: &Problem| problem.factor.is_some() && problem.seed % KINDS.len() as u64 == kind as u64;
        rows(name, of(problems, is_kind));
    }
    rows("equilibria", of(problems, |problem| problem.factor.is_none()));
    text
}

/// The performance profile of all steps.
pub fn picture(problems: &[Problem]) -> Plot {
    profile_figure(&steps(problems))
}
