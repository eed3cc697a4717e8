//! Force, energy and blocks of one spring in 50 digits, from near rest to collapsed, tiny, huge and far from the origin.

use super::compare::{U, vector};
use super::{Outcome, Problem, cases, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use sprung::spring::{Extension, Stiffness};
use sprung::verify::{Claim, Entry, worst};

#[derive(Deserialize)]
struct Answer {
    length: f64,
    strain: f64,
    force: Vec<f64>,
    energy: f64,
    stiffness_blocks: Blocks,
    damping_force: Vec<f64>,
    damping_block: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Blocks {
    full: Vec<Vec<f64>>,
    tension: Vec<Vec<f64>>,
    axial: Vec<Vec<f64>>,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = cases::<Problem<Answer>>(include_str!("../answers/spring_blocks.json"), |_| true);
    each(collector, Claim::KnownAnswers, "spring_blocks", problems, measure)
}

fn measure(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let (state, spring) = (&subject.state, subject.system.springs()[0]);
    let [i, j] = subject.system.pair(0);
    let at = Extension::between(&state.positions[i], &state.positions[j]).ok_or("the ends coincide")?;
    let answer = &problem.answer;
    // k/l0 bounds the axial and, with k/l, the transverse stiffness; a length off by u changes the force by this much.
    let (stiffness, reach) = (spring.stiffness / spring.rest_length, at.length.max(spring.rest_length));
    let slack = stiffness * reach;
    let why = "in units of rounding of k (l + l0)/l0: about ten roundings from the positions to the force";
    let mut checks = vec![
        problem.check(
            "length",
            share(at.length - answer.length, answer.length),
            8.0,
            "in units of rounding of l: three squares, two sums, a root",
        ),
        problem.check(
            "strain",
            share(spring.strain(&at) - answer.strain, reach / spring.rest_length),
            8.0,
            "in units of rounding of (l + l0)/l0",
        ),
        problem.check("elastic force", vectors(&spring.elastic_force(&at), &answer.force, slack), 10.0, why),
    ];
    let energy = slack * reach * (answer.strain.abs() * spring.rest_length / reach).max(U);
    let why = "in units of rounding of k |l/l0 − 1| (l + l0): the strain enters squared";
    checks.push(problem.check("elastic energy", share(spring.elastic_energy(&at) - answer.energy, energy), 20.0, why));
    for (option, known) in Stiffness::ALL.into_iter().zip([
        &answer.stiffness_blocks.full,
        &answer.stiffness_blocks.tension,
        &answer.stiffness_blocks.axial,
    ]) {
        let block = spring.stiffness_block(&at, option);
        let size = stiffness + spring.stiffness / at.length;
        let why = "in units of rounding of k/l0 + k/l, the terms that cancel near rest";
        let (value, table) = blocks(&block.matrix(), known, size);
        let check = problem.check(format!("stiffness block, {}", option.name()), value, 10.0, why);
        checks.push(check.with_table(table));
        let direction = Vector3::new(0.6, -0.7, 1.1);
        let product = block.apply(&direction) - block.matrix() * direction;
        let value = share(product.amax(), size * direction.norm());
        let why = "in units of rounding of (k/l0 + k/l) |d|: both products add up the same terms";
        checks.push(problem.check(format!("block times vector, {}", option.name()), value, 10.0, why));
    }
    let velocity = state.velocities[i] - state.velocities[j];
    let damping = spring.damping * (state.velocities[i].norm() + state.velocities[j].norm());
    let why = "in units of rounding of b |v|";
    let value = vectors(&spring.damping_force(&at, &velocity), &answer.damping_force, damping);
    checks.push(problem.check("damping force", value, 10.0, why));
    let (value, table) = blocks(&spring.damping_block(&at).matrix(), &answer.damping_block, spring.damping);
    checks.push(problem.check("damping block", value, 10.0, "in units of rounding of b").with_table(table));
    Ok(checks)
}

fn share(difference: f64, size: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference.abs() / (U * size) }
}

fn vectors(found: &Vector3<f64>, known: &[f64], size: f64) -> f64 {
    worst((found - vector(known)).iter().map(|difference| share(*difference, size)))
}

/// The largest difference of the modelled entries in units of rounding, and the entries that differ by more than ten.
fn blocks(found: &Matrix3<f64>, known: &[Vec<f64>], size: f64) -> (f64, Vec<Entry>) {
    let all =
        known.iter().enumerate().flat_map(|(r, row)| row.iter().enumerate().map(move |(c, value)| (r, c, *value)));
    let entries: Vec<_> = all.collect();
    let value = worst(entries.iter().map(|&(r, c, known)| share(found[(r, c)] - known, size)));
    let differs = |&&(r, c, known): &&(usize, usize, f64)| share(found[(r, c)] - known, size) > 10.0;
    let table = entries
        .iter()
        .filter(differs)
        .map(|&(r, c, known)| Entry::new(r, Some(c), found[(r, c)], known, 10.0 * U * size).of_spring(0));
    (value, table.collect())
}
