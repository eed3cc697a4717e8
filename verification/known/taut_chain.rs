//! A stretched chain between walls: its frequencies, what a step does to each mode, whole runs, and the limit of `axial`.

use super::amplification::{Mode, Way, phase, spectral_radius};
use super::compare::{U, number, numbers, rows, vector};
use super::one_step::Option3;
use super::{Outcome, Problem, cases, direct, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::{DMatrix, Vector3};
use serde::Deserialize;
use sprung::Stiffness;
use sprung::force::Energy;
use sprung::integrate::{LinearBackwardEuler, Method, StepMatrices, TimeStepper};
use sprung::verify::{Check, Claim, TestCase, worst};

#[derive(Deserialize)]
struct Modes {
    dt: f64,
    axial_modes: Vec<KnownMode>,
    transverse_modes: Vec<KnownMode>,
    stable_dt: StableSteps,
}

#[derive(Deserialize)]
struct KnownMode {
    omega: f64,
    energy_factor: f64,
    amplitude_factor: f64,
    phase: f64,
    shape: Vec<f64>,
}

#[derive(Deserialize)]
struct StableSteps {
    axial: Option<f64>,
}

#[derive(Deserialize)]
struct Spectrum {
    omegas_undamped: Vec<f64>,
}

#[derive(Deserialize)]
struct Run {
    stiffness: Option<Option3>,
    dt: f64,
    steps: usize,
    energy_factor: Option<f64>,
    energy_at_rest: Option<f64>,
    energies_above_rest: Option<Vec<f64>>,
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Growth {
    omega_max_transverse: f64,
    rows: Vec<GrowthRow>,
}

#[derive(Deserialize)]
struct GrowthRow {
    z: f64,
    dt: f64,
    spectral_radius: f64,
}

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let text = include_str!("../answers/taut_chain.json");
    let mut trials = each(collector, Claim::KnownAnswers, "taut_chain", cases(text, of("modes")), modes);
    trials.extend(each(collector, Claim::KnownAnswers, "taut_chain", cases(text, of("spectrum")), spectrum));
    trials.extend(each(collector, Claim::KnownAnswers, "taut_chain", cases(text, of("run")), run));
    trials.extend(each(collector, Claim::Failure, "taut_chain", cases(text, of("growth")), growth));
    trials
}

fn of(kind: &'static str) -> impl Fn(&serde_json::Value) -> bool {
    move |case| case["kind"] == kind
}

/// ω² of all modes under an option, ascending: the eigenvalues of `M^{−1/2}(−K)M^{−1/2}`.
fn squared_frequencies(subject: &TestCase, option: Stiffness) -> sprung::Result<Vec<f64>> {
    let matrices = StepMatrices::assemble(&subject.system, &subject.state, option, subject.dt)?;
    let n = subject.system.dofs().len();
    let masses = matrices.m;
    let mut scaled = DMatrix::zeros(n, n);
    for (row, column, value) in matrices.k.iter() {
        scaled[(row, column)] = -value / (masses[row] * masses[column]).sqrt();
        scaled[(column, row)] = scaled[(row, column)];
    }
    let mut squares: Vec<f64> = scaled.symmetric_eigenvalues().iter().copied().collect();
    squares.sort_by(f64::total_cmp);
    Ok(squares)
}

fn compare_frequencies<A>(problem: &Problem<A>, option: Stiffness, mut known: Vec<f64>) -> sprung::Result<Check> {
    let found = squared_frequencies(&problem.subject()?, option)?;
    known.iter_mut().for_each(|omega| *omega *= *omega);
    known.sort_by(f64::total_cmp);
    let why =
        "ω², relative to the largest: an eigenvalue moves by no more than the matrix's rounding, 30 u n of its norm";
    let bound = 30.0 * U * known.len() as f64;
    Ok(problem.check(format!("frequencies, {}", option.name()), numbers(&found, &known), bound, why))
}

fn spectrum(problem: &Problem<Spectrum>) -> Outcome {
    let known = problem.answer.omegas_undamped.clone();
    Ok(vec![compare_frequencies(problem, Stiffness::Full, known)?])
}

fn modes(problem: &Problem<Modes>) -> Outcome {
    let subject = problem.subject()?;
    let answer = &problem.answer;
    let across = subject.system.dimension() - 1;
    let omegas = |modes: &[KnownMode]| modes.iter().map(|mode| mode.omega).collect::<Vec<f64>>();
    let (along, transverse) = (omegas(&answer.axial_modes), omegas(&answer.transverse_modes));
    let all = |transverse: &[f64]| along.iter().copied().chain(transverse.repeat(across)).collect::<Vec<f64>>();
    let mut checks = vec![
        compare_frequencies(problem, Stiffness::Full, all(&transverse))?,
        compare_frequencies(problem, Stiffness::Tension, all(&transverse))?,
        compare_frequencies(problem, Stiffness::Axial, all(&vec![0.0; transverse.len()]))?,
    ];
    // Damping acts along the chain only: its axial modes are not those of this answer.
    let axial_modes = if subject.system.is_damped() { &[][..] } else { &answer.axial_modes };
    let spacing = (subject.state.positions[1] - subject.state.positions[0]).norm();
    for (axis, modes, amplitude) in [(0, axial_modes, 0.01 * spacing), (1, &answer.transverse_modes[..], 1e-30)] {
        for option in Stiffness::ALL {
            if axis == 1 && option == Stiffness::Axial {
                continue;
            }
            let mut errors = Vec::new();
            for known in modes {
                let shape = shape(&subject, &known.shape, axis);
                let mode = Mode { shape: &shape, amplitude };
                let way = Way { method: Method::LinearBackwardEuler, option };
                let matrix = mode.amplification(&subject, way, answer.dt)?;
                let radius = spectral_radius(&matrix);
                errors.push(number(radius, known.amplitude_factor));
                errors.push(number(radius * radius, known.energy_factor));
                errors.push(number(phase(&matrix), known.phase));
            }
            let direction = ["along", "across"][axis];
            let why = "relative: rounding of the positions over the amplitude along the chain, 1e2 u, times κ(A) below 1e2; \
                       next to the line nothing cancels";
            let name = format!("energy factor 1/(1 + z²) and phase atan z of the modes {direction}, {}", option.name());
            if !errors.is_empty() {
                checks.push(problem.check(name, worst(errors), 1e-12, why));
            }
        }
    }
    if let (Some(limit), Some(highest)) = (answer.stable_dt.axial, answer.transverse_modes.last()) {
        let shape = shape(&subject, &highest.shape, 1);
        let mode = Mode { shape: &shape, amplitude: 1e-30 };
        let way = Way { method: Method::LinearBackwardEuler, option: Stiffness::Axial };
        let radius = |dt| mode.amplification(&subject, way, dt).map(|matrix| spectral_radius(&matrix));
        let why =
            "two eigenvalues on the circle have modulus 1 to rounding, whose root the double one at the limit shows";
        let below = (radius(limit * (1.0 - 1e-6))? - 1.0).abs();
        checks.push(problem.check("axial is stable just below 2/ω", below, 1e-9, why));
        let above = (radius(limit * (1.0 + 1e-6))? - 1.0 - 8e-6_f64.sqrt()).abs();
        let why = "at z = 2(1 + ε) the spectral radius is 1 + √(8ε) + 4ε + …";
        checks.push(problem.check("axial is unstable just above 2/ω", above, 5e-6, why));
    }
    Ok(checks)
}

/// A shape over the free particles as displacements along an axis.
fn shape(subject: &TestCase, shape: &[f64], axis: usize) -> Vec<Vector3<f64>> {
    let mut field = vec![Vector3::zeros(); subject.system.particles()];
    let free = (0..field.len()).filter(|&p| subject.system.dofs().free_axes(p).contains(axis));
    for (p, value) in free.collect::<Vec<_>>().into_iter().zip(shape) {
        field[p][axis] = *value;
    }
    field
}

fn run(problem: &Problem<Run>) -> Outcome {
    let subject = problem.subject()?;
    let (system, answer) = (&subject.system, &problem.answer);
    let options = match &answer.stiffness {
        Some(option) => vec![option.stiffness()],
        None => Stiffness::ALL.to_vec(),
    };
    let mut checks = Vec::new();
    for option in options {
        let mut stepper = LinearBackwardEuler::new(system, &subject.state, &direct(option))?;
        let mut state = subject.state.clone();
        let mut energies = vec![Energy::of(system, &state).total()];
        for _ in 0..answer.steps {
            stepper.step(&mut state, answer.dt)?;
            energies.push(Energy::of(system, &state).total());
        }
        let reach = worst(state.positions.iter().map(|x| x.norm()));
        let speed = worst(answer.velocities.iter().map(|v| vector(v).norm()));
        // Velocities are differences of positions over dt; late in a decay they are small beside their rounding.
        let bound = 30.0 * U * answer.steps as f64 * 10.0 * (1.0 + reach / (answer.dt * speed));
        let why = "relative to the largest: every step adds 30 u κ(A), κ(A) below 10, and rounding of the positions over dt to \
                   the velocities";
        let value = worst([rows(&state.positions, &answer.positions), rows(&state.velocities, &answer.velocities)]);
        let name = format!("state after {} steps, {}", answer.steps, option.name());
        checks.push(problem.check(name, value, bound, why));
        if let (Some(rest), Some(known), Some(factor)) =
            (answer.energy_at_rest, &answer.energies_above_rest, answer.energy_factor)
        {
            let above: Vec<f64> = energies.iter().map(|energy| energy - rest).collect();
            let why = "relative to the first: the energy at rest, of which these are the excess, is rounded, 30 u";
            let bound = 30.0 * U * rest / known[0] * 10.0;
            checks.push(problem.check(format!("energies, {}", option.name()), numbers(&above, known), bound, why));
            let ratios = above.windows(2).map(|pair| (pair[1] / pair[0] - factor).abs() * pair[0] / known[0]);
            let why = "as for the energies, weighted by what is left of the first";
            let name = format!("energy factor of each step, {}", option.name());
            checks.push(problem.check(name, worst(ratios), 2.0 * bound, why));
        }
    }
    Ok(checks)
}

/// Under `axial` every matrix is positive definite, and yet the highest transverse mode is stable only up to 2/ω.
fn growth(problem: &Problem<Growth>) -> Outcome {
    let subject = problem.subject()?;
    let answer = &problem.answer;
    let n = subject.system.dofs().len() / subject.system.dimension();
    let shape = shape(&subject, &highest(n), 1);
    let (system, rest) = (&subject.system, &subject.state);
    let options = direct(Stiffness::Axial);
    let mut checks = Vec::new();
    let failing = |name: String, value: f64, bound: f64, why: &str| {
        Check::new(Claim::Failure, name, &problem.name, value, bound, why)
    };
    for row in &answer.rows {
        let amplitude = 1e-30;
        let mut state = rest.clone();
        for (x, s) in state.positions.iter_mut().zip(&shape) {
            *x += s * amplitude;
        }
        let mut stepper = LinearBackwardEuler::new(system, rest, &options)?;
        let stable = row.spectral_radius <= 1.0;
        // The second eigenvalue is 1/ρ: after this many steps it is 1e-10 of the first.
        let steps = if stable { 2000 } else { (1e10_f64.ln() / (2.0 * row.spectral_radius.ln())).ceil() as usize };
        let mut sizes = vec![amplitude];
        for _ in 0..steps {
            stepper.step(&mut state, row.dt)?;
            sizes.push(
                state.positions.iter().map(|x| x.y.abs()).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a }),
            );
        }
        let name = format!("highest transverse mode, axial, ω dt = {}", row.z);
        if stable {
            let bound = 1.01 / (1.0 - row.z * row.z / 4.0).sqrt();
            let why = "symplectic Euler keeps q² − z q v dt + (v dt)²: from rest no amplitude exceeds (1 − z²/4)^(−1/2), in 2000 \
                       steps";
            checks.push(failing(name, worst(sizes.iter().map(|size| size / amplitude)), bound, why));
        } else {
            let ratio = sizes[steps] / sizes[steps - 1];
            let why =
                "relative distance of the growth a step from the spectral radius; the other mode is down to 1e-10";
            checks.push(failing(name, number(ratio, row.spectral_radius), 1e-8, why));
        }
    }
    let found = squared_frequencies(&subject, Stiffness::Full)?;
    let square = answer.omega_max_transverse * answer.omega_max_transverse;
    let nearest = found.iter().map(|value| (value / square - 1.0).abs()).fold(f64::INFINITY, f64::min);
    let why = "relative, of ω²: an eigenvalue moves by no more than the matrix's rounding";
    checks.push(failing("highest transverse frequency".into(), nearest, 30.0 * U * found.len() as f64, why));
    Ok(checks)
}

/// The highest mode of a chain of n equal masses, `sin(n j π/(n + 1))` at mass j.
fn highest(n: usize) -> Vec<f64> {
    let angle = n as f64 * std::f64::consts::PI / (n + 1) as f64;
    (1..=n).map(|j| (j as f64 * angle).sin()).collect()
}
