//! One step of linearised backward Euler and its matrices against 50 digits: free, held, moving, on paths, partly held, planar and
//! one-dimensional, and past the critical step.

use super::compare::{U, number, numbers, rows};
use super::{Outcome, Problem, cases, each};
use crate::collect::Collector;
use faer::Par;
use libtest_mimic::Trial;
use serde::Deserialize;
use sprung::assembly::SymmetricMatrix;
use sprung::force::Energy;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StepMatrices, TimeStepper};
use sprung::linear::{Ldlt, SolverChoice, SolverOptions};
use sprung::verify::{Check, Claim, Entry, worst};
use sprung::{Scene, State, Stiffness};

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Option3 {
    Full,
    Tension,
    Axial,
}

impl Option3 {
    pub fn stiffness(&self) -> Stiffness {
        match self {
            Self::Full => Stiffness::Full,
            Self::Tension => Stiffness::Tension,
            Self::Axial => Stiffness::Axial,
        }
    }
}

#[derive(Deserialize)]
pub struct Inertia {
    pub negative: usize,
    pub zero: usize,
    pub positive: usize,
}

#[derive(Deserialize)]
struct Answer {
    stiffness: Option3,
    dt: f64,
    dofs: Vec<(usize, char)>,
    inertia: Inertia,
    energy_initial: Energies,
    #[serde(rename = "A")]
    a: Vec<Vec<f64>>,
    b: Vec<f64>,
    #[serde(rename = "M")]
    m: Vec<Vec<f64>>,
    #[serde(rename = "G")]
    g: Vec<Vec<f64>>,
    #[serde(rename = "K")]
    k: Vec<Vec<f64>>,
    dx: Vec<f64>,
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
pub struct Energies {
    pub kinetic: f64,
    pub elastic: f64,
    #[serde(default)]
    pub gravitational: f64,
}

impl Energies {
    /// The largest difference of a kind over the largest of all kinds.
    pub fn distance(&self, found: &Energy) -> f64 {
        let Energy { kinetic, elastic, gravitational } = *found;
        let sum = self.kinetic + self.elastic + self.gravitational;
        let expected = [self.kinetic, self.elastic, self.gravitational, sum];
        numbers(&[kinetic, elastic, gravitational, found.total()], &expected)
    }
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let problems = cases::<Problem<Answer>>(include_str!("../answers/one_step.json"), |_| true);
    each(collector, Claim::KnownAnswers, "one_step", problems, measure)
}

fn measure(problem: &Problem<Answer>) -> Outcome {
    let subject = problem.subject()?;
    let (system, state, answer) = (&subject.system, &subject.state, &problem.answer);
    let option = answer.stiffness.stiffness();
    let dofs: Vec<(usize, char)> = system.dofs().iter().map(|dof| (dof.particle, dof.axis_name())).collect();
    let wrong = if dofs == answer.dofs { 0.0 } else { 1.0 };
    let mut checks = vec![problem.check("degrees of freedom", wrong, 0.0, "ordered by particle, then axis")];
    let why = "relative to the largest kind: a dozen rounded operations a spring";
    // The answer's kinetic energy is that of the velocities as written; a prescribed particle starts with its motion's.
    let (_, as_written) = Scene { constraints: Vec::new(), ..problem.scene.clone() }.build()?;
    let value = answer.energy_initial.distance(&Energy::of(system, &as_written));
    checks.push(problem.check("energy", value, 30.0 * U, why));

    let matrices = StepMatrices::assemble(system, state, option, answer.dt)?;
    let entries = |matrix: &SymmetricMatrix| matrix.iter().collect::<Vec<_>>();
    for (name, found, known) in [
        ("A", entries(&matrices.a), &answer.a),
        ("M", matrices.m.iter().enumerate().map(|(row, mass)| (row, row, *mass)).collect(), &answer.m),
        ("G", entries(&matrices.g), &answer.g),
        ("K", entries(&matrices.k), &answer.k),
    ] {
        checks.push(compare_matrix(problem, name, &found, known));
    }
    let why = "relative to its largest entry: 30 roundings in every entry's sum";
    checks.push(problem.check("b", numbers(&matrices.b, &answer.b), 30.0 * U, why));
    checks.push(compare_inertia(problem, &matrices.a)?);

    let definite = answer.inertia.negative == 0;
    for (solver, name) in [(SolverChoice::Llt, "Cholesky"), (SolverChoice::Ldlt, "LDLᵀ")] {
        let linear = SolverOptions { solver, ..SolverOptions::default() };
        let mut stepper =
            LinearBackwardEuler::new(system, state, &ImplicitOptions { stiffness: option.into(), linear })?;
        let mut after = state.clone();
        let outcome = stepper.step(&mut after, answer.dt);
        if !definite && solver == SolverChoice::Llt {
            let silent = if outcome.is_err() { 0.0 } else { 1.0 };
            checks.push(problem.check("Cholesky refuses", silent, 0.0, "A has negative eigenvalues"));
            continue;
        }
        outcome?;
        checks.extend(compare_state(problem, name, state, &after));
    }
    Ok(checks)
}

fn compare_state(problem: &Problem<Answer>, solver: &str, before: &State, after: &State) -> [Check; 3] {
    let answer = &problem.answer;
    let why = "relative to the largest: the 30 u of a backward stable solve times κ(A), below 1e2 in these scenes but for \
               those close to a critical step, is far below 1e-12";
    let axis = |letter: char| letter as usize - 'x' as usize;
    let free = answer.dofs.iter().map(|&(p, letter)| after.velocities[p][axis(letter)] * answer.dt);
    let dx: Vec<f64> = free.collect();
    let moved = after.time - before.time;
    let time = number(moved, answer.dt);
    let late = "in the time the step takes, one rounded sum";
    [
        problem.check(format!("δx by {solver}"), numbers(&dx, &answer.dx), 1e-12, why),
        problem.check(
            format!("state after the step by {solver}"),
            worst([rows(&after.positions, &answer.positions), rows(&after.velocities, &answer.velocities)]),
            1e-12,
            why,
        ),
        problem.check(format!("time after the step by {solver}"), time, 4.0 * U, late),
    ]
}

fn compare_matrix(problem: &Problem<Answer>, name: &str, found: &[(usize, usize, f64)], known: &[Vec<f64>]) -> Check {
    let largest = worst(known.iter().flatten().map(|value| value.abs()));
    let n = known.len();
    let mut entries = vec![vec![0.0; n]; n];
    for &(row, column, value) in found {
        entries[row][column] = value;
        entries[column][row] = value;
    }
    let bound = 30.0 * U;
    let all = (0..n).flat_map(|row| (0..n).map(move |column| (row, column)));
    let value = worst(all.clone().map(|(r, c)| {
        let difference = (entries[r][c] - known[r][c]).abs();
        if difference == 0.0 { 0.0 } else { difference / largest.max(f64::MIN_POSITIVE) }
    }));
    let table = all
        .map(|(r, c)| Entry::new(r, Some(c), entries[r][c], known[r][c], bound * largest))
        .filter(|entry| entry.absolute > bound * largest)
        .take(10);
    let why = "relative to the largest entry: a sum of the blocks of at most five springs, ten roundings each";
    problem.check(name, value, bound, why).with_table(table.collect())
}

fn compare_inertia(problem: &Problem<Answer>, a: &SymmetricMatrix) -> sprung::Result<Check> {
    let known = &problem.answer.inertia;
    let mut ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
    let agrees = ldlt.factor(a).is_ok() && {
        let count = |sign: fn(f64) -> bool| ldlt.pivots().filter(|&(_, pivot)| sign(pivot)).count();
        count(|d| d < 0.0) == known.negative
            && count(|d| d == 0.0) == known.zero
            && count(|d| d > 0.0) == known.positive
    };
    let why = "by Sylvester's law the signs of the pivots are those of the eigenvalues";
    Ok(problem.check("inertia", if agrees { 0.0 } else { 1.0 }, 0.0, why))
}
