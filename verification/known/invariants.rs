//! Rigid motions in 50 digits, and what a step does to modes that oscillate or grow, for every method that has a matrix.

use super::amplification::{Mode, Way, phase, spectral_radius};
use super::compare::{number, numbers, rows, vector};
use super::{Outcome, Problem, cases, direct, each};
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::force::{SpringGeometry, add_elastic_force};
use sprung::integrate::{LinearBackwardEuler, Method, TimeStepper};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::verify::{Check, Claim, TestCase, worst};
use sprung::{Spring, Stiffness, SystemBuilder};

#[derive(Deserialize)]
struct Identities {
    elastic_force: Vec<Vec<f64>>,
    omega_cross_x: Vec<Vec<f64>>,
    #[serde(rename = "K_omega_cross_x")]
    k_omega_cross_x: ByOption<Vec<Vec<f64>>>,
    #[serde(rename = "K_x")]
    k_x: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct ByOption<T> {
    full: T,
    tension: T,
    axial: T,
}

impl<T> ByOption<T> {
    fn iter(&self) -> impl Iterator<Item = (Stiffness, &T)> {
        Stiffness::ALL.into_iter().zip([&self.full, &self.tension, &self.axial])
    }
}

#[derive(Deserialize)]
struct Pressed {
    dt: f64,
    steps: usize,
    options: ByOption<Heights>,
}

#[derive(Deserialize)]
struct Heights {
    heights: Vec<f64>,
}

#[derive(Deserialize)]
struct Rows<R> {
    rows: Vec<R>,
}

#[derive(Deserialize)]
struct Growing {
    sigma_dt: f64,
    kept: f64,
    dropped: f64,
    w_method_kept: f64,
    w_method_dropped: f64,
}

#[derive(Deserialize)]
struct Oscillating {
    z: f64,
    energy_factor: f64,
    amplitude_factor: f64,
    phase: f64,
    radius_dropped: f64,
    w_method_radius_kept: f64,
    w_method_radius_dropped: f64,
}

#[derive(Deserialize)]
struct Limits {
    linear_backward_euler_dropped: f64,
    w_method_dropped: f64,
}

const ANSWERS: &str = include_str!("../answers/invariants.json");

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let of = |kind: &'static str| move |case: &serde_json::Value| case["kind"] == kind;
    let mut trials = each(collector, Claim::KnownAnswers, "rigid_motion", cases(ANSWERS, of("identities")), identities);
    trials.extend(each(collector, Claim::KnownAnswers, "buckling", cases(ANSWERS, of("run")), pressed));
    for (name, measure) in [
        ("known_answers::modes::growth_factors", growth as fn() -> Outcome),
        ("known_answers::modes::oscillation_factors", oscillation),
        ("known_answers::modes::stability_limits", limits),
    ] {
        let failed = move |error: Box<dyn std::error::Error>| {
            vec![Check::new(Claim::KnownAnswers, name, "", f64::NAN, 0.0, format!("could not be carried out: {error}"))]
        };
        let test = move || measure().unwrap_or_else(failed);
        trials.push(collector.trial(Claim::KnownAnswers, name.into(), test));
    }
    trials
}

fn identities(problem: &Problem<Identities>) -> Outcome {
    let subject = problem.subject()?;
    let (system, state, answer) = (&subject.system, &subject.state, &problem.answer);
    let extensions = SpringGeometry::at(system, &state.positions)?;
    let mut force = vec![Vector3::zeros(); system.particles()];
    add_elastic_force(system, &extensions, &mut force);
    let why = "relative to the largest component: sums of three springs' terms, some ten roundings each";
    let bound = 1e-14;
    let mut checks = vec![problem.check("elastic force", rows(&force, &answer.elastic_force), bound, why)];
    let largest = worst(answer.k_omega_cross_x.full.iter().flatten().map(|value| value.abs()));
    let product = |option, field: &[Vec<f64>]| {
        let operator = SystemOperator::new(system, &extensions, option, Combination::STIFFNESS);
        let w: Vec<f64> = field.iter().flat_map(|row| vector(row).iter().copied().collect::<Vec<_>>()).collect();
        let mut y = vec![0.0; w.len()];
        operator.apply(&w, &mut y);
        y
    };
    for (option, known) in answer.k_omega_cross_x.iter() {
        let found = product(option, &answer.omega_cross_x);
        // Relative to the largest under full: under axial the answer is zero.
        let known: Vec<f64> = known.iter().flatten().copied().collect();
        let value = worst(found.iter().zip(&known).map(|(a, b)| (a - b).abs())) / largest;
        checks.push(problem.check(format!("K (ω × x), {}", option.name()), value, 10.0 * bound, why));
        let positions: Vec<Vec<f64>> = state.positions.iter().map(|x| x.iter().copied().collect()).collect();
        let known: Vec<f64> = answer.k_x.iter().flatten().copied().collect();
        let value = numbers(&product(option, &positions), &known);
        checks.push(problem.check(format!("K x, {}", option.name()), value, bound, why));
    }
    Ok(checks)
}

/// A mass pressed between two walls buckles: the first steps from next to nothing.
fn pressed(problem: &Problem<Pressed>) -> Outcome {
    let subject = problem.subject()?;
    let mut checks = Vec::new();
    for (option, known) in problem.answer.options.iter() {
        let mut stepper = LinearBackwardEuler::new(&subject.system, &subject.state, &direct(option))?;
        let mut state = subject.state.clone();
        let mut errors = Vec::new();
        for height in known.heights.iter().take(problem.answer.steps + 1) {
            errors.push(number(state.positions[1].y, *height));
            stepper.step(&mut state, problem.answer.dt)?;
        }
        let why = "relative: 30 u a step, times 1/(1 − q²) below 6 by which the matrix is nearer to singular";
        checks.push(problem.check(format!("heights, {}", option.name()), worst(errors), 1e-13, why));
    }
    Ok(checks)
}

/// One mass in the middle between two walls, its springs of length l; its rate² across the line is `2k(1/l0 − 1/l)/m`.
fn between_walls(name: &str, length: f64, rest_length: f64) -> sprung::Result<(TestCase, f64)> {
    let (stiffness, mass) = (52.0, 0.3);
    let mut builder = SystemBuilder::new();
    let particles = [0.0, 1.0, 2.0].map(|n| builder.particle([n * length, 0.0, 0.0], mass));
    for pair in particles.windows(2) {
        builder.spring(pair[0], pair[1], Spring { stiffness, rest_length, damping: 0.0 });
    }
    builder.hold(particles[0]).hold(particles[2]);
    let (system, state) = builder.build()?;
    let rate = 2.0 * stiffness * (1.0 / rest_length - 1.0 / length) / mass;
    Ok((TestCase { name: name.into(), system, state, dt: 0.01, loaded: None }, rate))
}

/// The amplification of the mode across the line.
fn across(subject: &TestCase, way: Way, dt: f64) -> Result<nalgebra::Matrix2<f64>, Box<dyn std::error::Error>> {
    let shape = [Vector3::zeros(), Vector3::y(), Vector3::zeros()];
    Mode { shape: &shape, amplitude: 1e-30 }.amplification(subject, way, dt)
}

const NOTES: Method = Method::LinearBackwardEuler;

/// A way to step and what its factor is known to be in a row of a table.
type Factor<R> = (Method, Stiffness, fn(&R) -> f64);

fn growth() -> Outcome {
    let (subject, rate) = between_walls("mass between walls, pressed", 0.75, 1.25)?;
    let rows = table::<Growing>("growth");
    let known: [Factor<Growing>; 6] = [
        (NOTES, Stiffness::Full, |row| row.kept),
        (NOTES, Stiffness::Tension, |row| row.dropped),
        (NOTES, Stiffness::Axial, |row| row.dropped),
        (Method::W2, Stiffness::Full, |row| row.w_method_kept),
        (Method::W2, Stiffness::Tension, |row| row.w_method_dropped),
        (Method::W2, Stiffness::Axial, |row| row.w_method_dropped),
    ];
    let mut checks = Vec::new();
    for (method, option, known) in known {
        let mut errors = Vec::new();
        for row in &rows {
            let matrix = across(&subject, Way { method, option }, row.sigma_dt / (-rate).sqrt())?;
            errors.push(number(spectral_radius(&matrix), known(row).abs()));
        }
        let why =
            "relative, σ dt from 0.01 to 5: a dozen roundings, times at most 1e4 where A is nearly singular at 0.99";
        let name = format!("growth factors of a buckling mode, {}, {}", method.name(), option.name());
        checks.push(Check::new(Claim::KnownAnswers, name, &subject.name, worst(errors), 1e-11, why));
    }
    Ok(checks)
}

fn oscillation() -> Outcome {
    let (subject, rate) = between_walls("mass between walls, stretched", 0.75, 0.55)?;
    let rows = table::<Oscillating>("oscillation");
    let mut checks = Vec::new();
    let mut compare = |name: &str,
                       way: Way,
                       measure: fn(&nalgebra::Matrix2<f64>) -> f64,
                       known: fn(&Oscillating) -> f64| {
        let mut errors = Vec::new();
        for row in &rows {
            errors.push(number(measure(&across(&subject, way, row.z / rate.sqrt())?), known(row)));
        }
        let why = "relative, ω dt from 0.01 to 100: a dozen roundings, times at most 1e4 where eigenvalues nearly meet or the \
                   matrix is stiff";
        let name = format!("{name}, {}, {}", way.method.name(), way.option.name());
        checks.push(Check::new(Claim::KnownAnswers, name, &subject.name, worst(errors), 1e-11, why));
        Ok::<(), Box<dyn std::error::Error>>(())
    };
    for option in [Stiffness::Full, Stiffness::Tension] {
        let way = Way { method: NOTES, option };
        compare("energy factor 1/(1 + z²)", way, |a| spectral_radius(a).powi(2), |row| row.energy_factor)?;
        compare("amplitude factor", way, spectral_radius, |row| row.amplitude_factor)?;
        compare("phase atan z", way, phase, |row| row.phase)?;
    }
    let w2 = |option| Way { method: Method::W2, option };
    compare("amplification", Way { method: NOTES, option: Stiffness::Axial }, spectral_radius, |row| {
        row.radius_dropped
    })?;
    compare("amplification", w2(Stiffness::Full), spectral_radius, |row| row.w_method_radius_kept)?;
    compare("amplification", w2(Stiffness::Axial), spectral_radius, |row| row.w_method_radius_dropped)?;
    Ok(checks)
}

fn table<R: serde::de::DeserializeOwned>(kind: &str) -> Vec<R> {
    cases::<Rows<R>>(ANSWERS, |case| case["kind"] == kind).into_iter().flat_map(|table| table.rows).collect()
}

fn limits() -> Outcome {
    let (subject, rate) = between_walls("mass between walls, stretched", 0.75, 0.55)?;
    let known = cases::<Limits>(ANSWERS, |case| case["kind"] == "limits");
    let mut checks = Vec::new();
    for known in &known {
        for (method, limit) in [(NOTES, known.linear_backward_euler_dropped), (Method::W2, known.w_method_dropped)] {
            let way = Way { method, option: Stiffness::Axial };
            let excess = |z: f64| across(&subject, way, z / rate.sqrt()).map(|matrix| spectral_radius(&matrix) - 1.0);
            let why = "by how much the spectral radius exceeds 1 just below the limit: rounding, of which a double root shows the \
                       square root";
            let below = excess(limit * (1.0 - 1e-6))?.max(0.0);
            let name = format!("stable just below the limit, {}, axial", method.name());
            checks.push(Check::new(Claim::KnownAnswers, name, &subject.name, below, 1e-9, why));
            let why = "1 if the spectral radius does not exceed 1 just above the limit, by more than rounding";
            let above = if excess(limit * (1.0 + 1e-6))? > 1e-9 { 0.0 } else { 1.0 };
            let name = format!("unstable just above the limit, {}, axial", method.name());
            checks.push(Check::new(Claim::KnownAnswers, name, &subject.name, above, 0.0, why));
        }
    }
    Ok(checks)
}
