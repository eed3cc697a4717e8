//! Definite up to the critical step and not beyond: factorizations at dt_crit (1 ∓ 1e-6), with the exact inertia.

use super::compare::U;
use super::one_step::Inertia;
use super::{Outcome, Problem, cases, each};
use crate::collect::Collector;
use faer::Par;
use libtest_mimic::Trial;
use serde::Deserialize;
use sprung::Stiffness;
use sprung::integrate::StepMatrices;
use sprung::linear::{Cholesky, Ldlt};
use sprung::verify::{Check, Claim, TestCase};

#[derive(Deserialize)]
struct Answer {
    critical_dt: Option<f64>,
    below: Option<Side>,
    above: Option<Side>,
    long_step: Option<Side>,
    compressed_springs: usize,
}

#[derive(Deserialize)]
struct Side {
    dt: f64,
    inertia: Inertia,
    lambda_min: Option<f64>,
    lambda_max: Option<f64>,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = cases::<Problem<Answer>>(include_str!("../answers/critical_steps.json"), |_| true);
    each(collector, Claim::Definiteness, "critical_steps", problems, measure)
}

fn measure(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let answer = &problem.answer;
    let links = subject.system.pairs().iter().zip(subject.system.springs());
    let compressed = links.filter(|([i, j], spring)| {
        let x = &subject.state.positions;
        (x[*i as usize] - x[*j as usize]).norm() < spring.rest_length
    });
    let wrong = compressed.count().abs_diff(answer.compressed_springs) as f64;
    let why = "counted from the positions";
    let mut checks = vec![check(problem, "compressed springs", wrong, why)];
    let sides = [("below", &answer.below), ("above", &answer.above), ("at a long step", &answer.long_step)];
    for (name, side) in sides {
        if let Some(side) = side {
            checks.extend(verdicts(problem, &subject, name, side)?);
        }
    }
    if answer.critical_dt.is_none() {
        // Definite at every step: also at one at which only K counts, as far as rounding can tell.
        let n = subject.system.dofs().len();
        let dt = 100.0 * subject.dt;
        let mut cholesky = None;
        let a = StepMatrices::assemble(&subject.system, &subject.state, Stiffness::Full, dt)?.a;
        let scale = a.norm_inf(&mut vec![0.0; n]);
        let lightest = subject.system.masses().iter().copied().fold(f64::INFINITY, f64::min);
        if lightest / (dt * dt) > 4.0 * n as f64 * U * scale {
            cholesky = Some(Cholesky::analyse(a.pattern(), Par::Seq)?.factor(&a).is_ok());
        }
        let why = "A is definite for every step: at a hundred times the scene's too";
        checks.push(check(problem, "Cholesky accepts a long step", silent(cholesky != Some(false)), why));
    }
    Ok(checks)
}

fn verdicts(problem: &Problem<Answer>, subject: &TestCase, name: &str, side: &Side) -> sprung::Result<Vec<Check>> {
    let n = subject.system.dofs().len();
    let known = &side.inertia;
    let told = side.lambda_min.zip(side.lambda_max).is_none_or(|(least, most)| least.abs() > 2.0 * n as f64 * U * most);
    if !told {
        return Ok(Vec::new());
    }
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let a = StepMatrices::assemble(&subject.system, &subject.state, option, side.dt)?.a;
        let accepted = Cholesky::analyse(a.pattern(), Par::Seq)?.factor(&a).is_ok();
        if option != Stiffness::Full {
            let why = "tension, axial and absolute leave no negative term";
            checks.push(check(problem, &format!("Cholesky, {}, {name}", option.name()), silent(accepted), why));
            continue;
        }
        let definite = known.negative == 0 && known.zero == 0;
        let why =
            "the verdict changes between dt_crit(1 − 1e-6) and dt_crit(1 + 1e-6): λ_min there is above 2 n u λ_max";
        checks.push(check(problem, &format!("Cholesky, full, {name}"), silent(accepted == definite), why));
        let mut ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
        let factored = ldlt.factor(&a).is_ok();
        let count = |sign: fn(f64) -> bool| ldlt.pivots().filter(|&(_, pivot)| sign(pivot)).count();
        let agrees = factored && count(|d| d < 0.0) == known.negative && count(|d| d > 0.0) == known.positive;
        let why = "by Sylvester's law the signs of the pivots are those of the eigenvalues, known from 50 digits";
        checks.push(check(problem, &format!("inertia {name}"), silent(agrees), why));
    }
    Ok(checks)
}

fn check(problem: &Problem<Answer>, name: &str, value: f64, why: &str) -> Check {
    Check::new(Claim::Definiteness, name, &problem.name, value, 0.0, why)
}

/// 0 for what is as it must be, 1 for what is not.
fn silent(right: bool) -> f64 {
    if right { 0.0 } else { 1.0 }
}
