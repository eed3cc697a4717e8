//! Failures that are known beforehand: each must be reported, with its reason and its place.

use crate::collect::Collector;
use faer::Par;
use libtest_mimic::Trial;
use nalgebra::Vector3;
use sprung::force::SpringGeometry;
use sprung::integrate::{
    BackwardEuler, ImplicitOptions, LinearBackwardEuler, NewtonOptions, NotSolved, Schedule, Status, StepFailure,
    StepMatrices, TimeStepper, run,
};
use sprung::linear::{
    CgSolver, Cholesky, Definiteness, Ldlt, LdltSolver, PreconditionerKind, Prepare, SolveFailure, SolverChoice,
    SolverOptions,
};
use sprung::operator::{Combination, SystemOperator};
use sprung::verify::{Check, Claim, TestCase, U, built_in, worst};
use sprung::work::Work;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::ops::ControlFlow;

type Outcome = Result<Vec<Check>, Box<dyn std::error::Error>>;

type Test = fn() -> Outcome;

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let tests: [(&'static str, Test); 6] = [
        ("pivots_are_placed", pivots_are_placed),
        ("vanishing_pivots", vanishing_pivots),
        ("straight_chain", straight_chain),
        ("newton_limit", newton_limit),
        ("run_stops", run_stops),
        ("coincident_ends", coincident_ends),
    ];
    let trial = |(name, measure): (&'static str, Test)| {
        let failed = move |error: Box<dyn std::error::Error>| {
            vec![check(name, "", f64::NAN, 0.0, &format!("could not be carried out: {error}"))]
        };
        collector.trial(Claim::Failure, format!("failure::known::{name}"), move || measure().unwrap_or_else(failed))
    };
    tests.into_iter().map(trial).collect()
}

fn check(name: &str, scene: &str, value: f64, bound: f64, why: &str) -> Check {
    Check::new(Claim::Failure, name, scene, value, bound, why)
}

/// 0 for what is reported, 1 for what is not.
fn silent(reported: bool) -> f64 {
    if reported { 0.0 } else { 1.0 }
}

/// Three free chains of unit masses along x, of 7, n and 5, the middle one compressed and the others stretched; numbered
/// with strides of 5, so that no chain is a range. Returns the particles of the middle one too.
fn three_chains(n: usize) -> Result<(System, State, Vec<usize>), sprung::Error> {
    let links = [(7, 0.2), (n, -0.5), (5, 0.3)];
    let total: usize = links.iter().map(|&(length, _)| length).sum();
    let stride = if total.is_multiple_of(5) { 7 } else { 5 };
    let number = |index: usize| index * stride % total;
    let mut builder = SystemBuilder::new();
    for _ in 0..total {
        builder.particle([0.0; 3], 1.0);
    }
    let (mut index, mut guilty) = (0, Vec::new());
    for (row, (length, strain)) in links.into_iter().enumerate() {
        for p in 0..length {
            // A little crooked, so that every axis matters.
            let x = [p as f64 * (1.0 + strain), 3.0 * row as f64 + 0.01 * (p % 3) as f64, 0.02 * (p % 2) as f64];
            builder.positions[number(index)] = x.into();
            if p > 0 {
                let spring = Spring { stiffness: 50.0, rest_length: 1.0, damping: 0.0 };
                builder.spring(number(index - 1), number(index), spring);
            }
            guilty.extend((row == 1).then_some(number(index)));
            index += 1;
        }
    }
    let (system, state) = builder.build()?;
    Ok((system, state, guilty))
}

/// Only the middle one of three chains is compressed: refused and negative pivots must lie there, whatever the ordering did.
fn pivots_are_placed() -> Outcome {
    let mut checks = Vec::new();
    for compressed in 2..9 {
        let (system, state, guilty) = three_chains(compressed)?;
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?.a;
        let refused = Cholesky::analyse(a.pattern(), Par::Seq)?.factor(&a);
        let right = refused.is_err_and(|pivot| {
            guilty.contains(&pivot.dof.particle) && system.dofs().row(pivot.dof) == Some(pivot.row)
        });
        let scene = format!("three chains, the middle one of {compressed} compressed");
        let why = "A is a block for each chain, and only that of the compressed chain is indefinite";
        checks.push(check("the refused pivot is in the compressed part", &scene, silent(right), 0.0, why));
        let mut ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
        let factored = ldlt.factor(&a).is_ok();
        let negative: Vec<usize> = ldlt.pivots().filter(|&(_, d)| d < 0.0).map(|(row, _)| row).collect();
        let inside = negative.iter().all(|&row| guilty.contains(&system.dofs().dof(row).particle));
        let right = factored && !negative.is_empty() && inside;
        checks.push(check("negative pivots are in the compressed part", &scene, silent(right), 0.0, why));
    }
    Ok(checks)
}

/// At steps where a pivot of LDLᵀ vanishes although A is far from singular, elimination divides by rounding. The answer must
/// be right, if need be after refinement, or refused; nearest to zero refinement does not converge any more.
fn vanishing_pivots() -> Outcome {
    let mut checks = Vec::new();
    for n in [2, 3, 4, 6] {
        let mut builder = SystemBuilder::new();
        for p in 0..n {
            let across = |stride: usize, of: usize| 0.06 * ((p * stride % of) as f64 - 1.5);
            builder.particle([0.6 * p as f64, across(7, 5), across(3, 4)], 1.0 + 0.1 * p as f64);
            if p > 0 {
                let stiffness = 50.0 + 3.0 * p as f64;
                builder.spring(p - 1, p, Spring { stiffness, rest_length: 1.0, damping: 0.0 });
            }
        }
        let (system, state) = builder.build()?;
        let extensions = SpringGeometry::at(&system, &state.positions)?;
        let mut work = Work::default();
        let mut solver = LdltSolver::new(&system, Par::Seq, &mut work)?;
        let (mut accepted, mut refused) = (Vec::new(), 0);
        let vanishing = vanishing_steps(&system, &state)?;
        let at =
            vanishing.iter().flat_map(|dt| [0.0, 1e-15, -1e-15, 1e-14, 1e-12].map(|offset| (dt * (1.0 + offset), 0)));
        // Some way off, elimination loses five digits and refinement gets them back.
        let beside = vanishing.iter().map(|dt| (dt * (1.0 + 1e-11), 1));
        for (dt, counted) in at.chain(beside).collect::<Vec<_>>() {
            let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
            for seed in 1..10 {
                let b: Vec<f64> = (0..system.dofs().len()).map(|row| ((seed * (row + 3)) as f64).sin()).collect();
                let mut x = vec![0.0; b.len()];
                match solver.prepare(&a, &mut work).and_then(|mut solver| solver.solve(&b, &mut x, &mut work)) {
                    Ok(_) => accepted.push(backward_error(&system, &state, dt, &x, &b)?),
                    Err(SolveFailure::Untrusted { .. } | SolveFailure::Indefinite(_)) => refused += counted,
                    Err(failure) => return Err(failure.into()),
                }
            }
        }
        let why = "the largest backward error of an accepted solution: none is vouched for above 1e-12";
        let name = "LDLᵀ with a vanishing pivot is right or refused";
        let scene = format!("crooked compressed chain of {n}");
        checks.push(check(name, &scene, worst(accepted), 1e-12, why));
        let why = "solutions refused at 1e-11 from where a pivot vanishes: elimination loses about five digits there, and every \
                   refinement wins them";
        checks.push(check("refinement recovers a solution", &scene, f64::from(refused), 0.0, why));
    }
    Ok(checks)
}

/// Steps from 0.05 on at which a pivot changes its sign through zero, found by bisection to the last digit: both sides.
fn vanishing_steps(system: &System, state: &State) -> Result<Vec<f64>, sprung::Error> {
    let matrix = |dt: f64| StepMatrices::assemble(system, state, Stiffness::Full, dt).map(|matrices| matrices.a);
    let mut ldlt = Ldlt::analyse(matrix(0.05)?.pattern(), Par::Seq)?;
    let mut pivots = |dt: f64| -> Result<Vec<f64>, sprung::Error> {
        let factored = ldlt.factor(&matrix(dt)?);
        Ok(if factored.is_ok() { ldlt.pivots().map(|(_, pivot)| pivot).collect() } else { Vec::new() })
    };
    let grid: Vec<f64> = (0..400).map(|n| 0.05 * 1.01_f64.powi(n)).collect();
    let mut steps = Vec::new();
    for pair in grid.windows(2) {
        let (before, after) = (pivots(pair[0])?, pivots(pair[1])?);
        // A pivot that is large on one side changes its sign through infinity: the one before it vanishes.
        let small = |&k: &usize| before[k] * after[k] < 0.0 && before[k].abs().max(after[k].abs()) < 1e3;
        for k in (0..before.len().min(after.len())).filter(small).collect::<Vec<_>>() {
            let (mut low, mut high) = (pair[0], pair[1]);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                let same = pivots(middle)?.get(k).is_some_and(|pivot| pivot * before[k] > 0.0);
                (low, high) = if same { (middle, high) } else { (low, middle) };
            }
            steps.extend([low, high]);
        }
    }
    Ok(steps)
}

/// The normwise backward error of x by a dense product.
fn backward_error(system: &System, state: &State, dt: f64, x: &[f64], b: &[f64]) -> Result<f64, sprung::Error> {
    let a = StepMatrices::assemble(system, state, Stiffness::Full, dt)?.a;
    let mut residual = b.to_vec();
    let mut sums = vec![0.0; b.len()];
    for (row, column, value) in a.iter() {
        residual[row] -= value * x[column];
        sums[row] += value.abs();
        if row != column {
            residual[column] -= value * x[row];
            sums[column] += value.abs();
        }
    }
    let largest = |values: &[f64]| worst(values.iter().map(|value| value.abs()));
    Ok(largest(&residual) / (largest(&sums) * largest(x) + largest(b)))
}

/// On an exactly straight compressed chain a load along it excites nothing across: conjugate gradients converge although
/// A is indefinite. They must not claim more than they know; Cholesky must refuse.
fn straight_chain() -> Outcome {
    let mut builder = SystemBuilder::new();
    for p in 0..6 {
        builder.particle([0.7 * p as f64, 0.0, 0.0], 0.3);
        if p > 0 {
            builder.spring(p - 1, p, Spring { stiffness: 40.0, rest_length: 1.0, damping: 0.0 });
        }
    }
    let (system, state) = builder.build()?;
    let extensions = SpringGeometry::at(&system, &state.positions)?;
    let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(1.0));
    let mut b = vec![0.0; system.dofs().len()];
    b.iter_mut().step_by(3).enumerate().for_each(|(p, b)| *b = 1.0 + p as f64);
    let mut work = Work::default();
    let mut cg = CgSolver::matrix_free(&system, PreconditionerKind::None, 1e-12)?;
    let mut prepared = cg.prepare(&a, &mut work)?;
    let known = prepared.definiteness();
    let mut x = vec![0.0; b.len()];
    let residual = prepared.solve(&b, &mut x, &mut work).map(|solution| solution.relative_residual);
    let matrix = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?.a;
    let refused = Cholesky::analyse(matrix.pattern(), Par::Seq)?.factor(&matrix).is_err();
    let mut ldlt = Ldlt::analyse(matrix.pattern(), Par::Seq)?;
    let negative = if ldlt.factor(&matrix).is_ok() { ldlt.pivots().filter(|&(_, d)| d < 0.0).count() } else { 0 };
    let scene = "straight compressed chain of 6";
    Ok(vec![
        check(
            "conjugate gradients converge all the same",
            scene,
            residual.unwrap_or(f64::NAN),
            1e-12 + 30.0 * U,
            "the load has no part across the chain, and along it A is definite: the tolerance",
        ),
        check(
            "and claim nothing about definiteness",
            scene,
            silent(known == Definiteness::Unknown),
            0.0,
            "convergence proves nothing about directions that never occurred",
        ),
        check("Cholesky refuses", scene, silent(refused), 0.0, "A has negative eigenvalues"),
        check(
            "ten negative eigenvalues",
            scene,
            negative.abs_diff(10) as f64,
            0.0,
            "all modes across the chain but the two translations, in two directions",
        ),
    ])
}

/// A Newton iteration that is not allowed to iterate says so.
fn newton_limit() -> Outcome {
    let tumbling = |subject: &TestCase| subject.name == "tetrahedron";
    let subject = built_in()?.into_iter().find(tumbling).ok_or("no scene called tetrahedron")?;
    let newton = NewtonOptions { iteration_limit: 0, ..NewtonOptions::default() };
    let mut stepper = BackwardEuler::new(&subject.system, &subject.state, &ImplicitOptions::default(), newton)?;
    let mut state = subject.state.clone();
    let outcome = stepper.step(&mut state, subject.dt);
    let limit = matches!(outcome, Err(StepFailure::Newton { iterations: 0, reason: NotSolved::IterationLimit, .. }));
    let why = "no iteration is allowed, and neither staying nor coasting solves the equations";
    let kept = "a step that fails leaves the state as it was";
    Ok(vec![
        check("Newton's limit is reported", &subject.name, silent(limit), 0.0, why),
        check("and the state is kept", &subject.name, silent(state == subject.state), 0.0, kept),
    ])
}

/// A run under `full` past the critical step stops as indefinite, with the step, and keeps the last good state; under
/// the other options it goes on.
fn run_stops() -> Outcome {
    let pressed = |subject: &TestCase| subject.name == "compressed chain";
    let subject = built_in()?.into_iter().find(pressed).ok_or("no scene called compressed chain")?;
    let mut checks = Vec::new();
    for (option, expected) in [
        (Stiffness::Full, Status::Indefinite),
        (Stiffness::Tension, Status::Completed),
        (Stiffness::Axial, Status::Completed),
    ] {
        for solver in [SolverChoice::Llt, SolverChoice::Cg] {
            let linear = SolverOptions { solver, ..SolverOptions::default() };
            let options = ImplicitOptions { stiffness: option.into(), linear };
            let mut stepper = LinearBackwardEuler::new(&subject.system, &subject.state, &options)?;
            let mut state = subject.state.clone();
            // At a quarter more than the critical step of a straight chain.
            let schedule = Schedule::steps(0.1, 5);
            let outcome = run(&mut stepper, &mut state, &schedule, |_, _| ControlFlow::Continue(()));
            let reported = outcome.status() == expected && state.is_finite();
            let first = expected == Status::Completed || outcome.steps == 0 && state == subject.state;
            let name = format!("a run past the critical step, {}, {solver:?}", option.name());
            let why =
                "full is indefinite at the start, so that no step can be done; the others are definite at every step";
            checks.push(check(&name, &subject.name, silent(reported && first), 0.0, why));
        }
    }
    Ok(checks)
}

/// Building a system with coincident ends names the spring.
fn coincident_ends() -> Outcome {
    let mut builder = SystemBuilder::new();
    let spring = Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 };
    let particles: Vec<usize> = [0.0, 1.0, 2.0, 2.0].iter().map(|&x| builder.particle([x, 0.0, 0.0], 1.0)).collect();
    for pair in particles.windows(2) {
        builder.spring(pair[0], pair[1], spring);
    }
    let message = builder.build().map(drop).err().map(|error| error.to_string()).unwrap_or_default();
    let named = message.contains("springs.pairs[2]") && message.contains("[2, 3]");
    let why = "the third spring joins two particles at the same place: the message must name it and them";
    let mut checks = vec![check("a system with coincident ends is refused", "chain", silent(named), 0.0, why)];
    // The same while moving: a spring that a motion closes.
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.particle([3.0, 0.0, 0.0], 1.0);
    builder.spring(1, 2, spring);
    builder.spring(0, 1, spring);
    let (system, mut state) = builder.build()?;
    let mut stepper = LinearBackwardEuler::new(&system, &state, &ImplicitOptions::default())?;
    state.positions[1] = Vector3::zeros();
    let outcome = stepper.step(&mut state, 0.01);
    let named =
        matches!(outcome, Err(StepFailure::DegenerateSpring(found)) if found.spring == 1 && found.pair == [0, 1]);
    let why = "the second spring's ends have come together: the step must name it and them";
    checks.push(check("a spring that closes is named", "two springs", silent(named), 0.0, why));
    Ok(checks)
}
