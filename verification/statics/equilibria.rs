//! Equilibria of random scenes, their verdicts held to second methods.

use super::mechanics::{Model, Return, relax};
use super::scenes::{Drawn, KINDS, scene};
use super::{Section, caught, list, median_and_most};
use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use sprung::equilibrium::{Equilibrium, EquilibriumOptions, Stability, equilibrium};
use std::fmt::Write;
use std::ops::Range;

/// The largest force left over those that act, at most.
const RESIDUAL: f64 = 1e-10;

/// Steps of a damped motion at most.
const STEPS: usize = 60_000;

/// One scene.
pub struct Record {
    pub seed: u64,
    pub kind: &'static str,
    pub particles: usize,
    pub leaves_saddles: bool,
    pub status: Option<Stability>,
    pub iterations: usize,
    pub factorizations: usize,
    /// The residual by the second writing of the forces.
    pub residual: f64,
    pub motion: Option<Return>,
    /// Contradictions of a second method.
    pub wrong: Vec<String>,
}

impl Record {
    /// Neither an equilibrium with its residual nor a proof that there is none.
    pub fn is_unfinished(&self) -> bool {
        matches!(self.status, Some(Stability::NotConverged))
    }
}

/// The counts of eigenvalues below the negative and the positive edge of the band that counts as zero, each between the two numbers that its last digits
/// leave open.
fn counts(model: &Model, x: &[Vector3<f64>], left: f64) -> [[usize; 2]; 2] {
    let matrix = model.stiffness(x);
    let norm = matrix.row_iter().map(|row| row.abs().sum()).fold(0.0, f64::max);
    let values = Model::eigenvalues(matrix);
    let band = 1e-11 * norm + 10.0 * left / model.shortest(x);
    let rounding = f64::EPSILON * model.order as f64 * norm;
    // Whatever lies on an upper edge may count or not.
    let edge = |at: f64| {
        let [low, high] = [(0.9 * at).min(1.1 * at) - rounding, (0.9 * at).max(1.1 * at) + rounding];
        let sure = values.iter().filter(|value| **value < low).count();
        let possible = values.iter().filter(|value| **value < high || **value == high && at >= 0.0).count();
        [sure, possible]
    };
    [edge(-band), edge(band)]
}

fn judged(drawn: &Drawn, seed: u64, found: &Equilibrium, record: &mut Record) {
    let model = Model::new(&drawn.system);
    let x = &found.state.positions;
    let mut wrong = Vec::new();
    let falling = model.falling();
    let says_falling = found.stability == Stability::None;
    let mut named = found.falling.clone();
    named.sort_unstable();
    if says_falling == falling.is_empty() || named != falling {
        wrong.push(format!("{} falling particles, named {}", falling.len(), named.len()));
    }
    let (force, acting) = model.force(x);
    let left = force.amax();
    let acting = acting.max(model.least_acting(&drawn.state.positions));
    record.residual = if left == 0.0 { 0.0 } else { left / acting };
    let is_equilibrium = matches!(found.stability, Stability::Stable | Stability::Indifferent | Stability::Unstable);
    if is_equilibrium {
        if !(record.residual <= 1.01 * RESIDUAL && found.residual <= RESIDUAL) {
            wrong.push(format!("a residual of {:.1e}, said to be {:.1e}", record.residual, found.residual));
        }
        let moved = |p: usize| {
            (x[p] - drawn.state.positions[p]).iter().zip(model.rows[p]).any(|(u, row)| *u != 0.0 && row.is_none())
        };
        if (0..x.len()).any(moved) {
            wrong.push("a held coordinate moved".into());
        }
        let [negative, not_positive] = counts(&model, x, left);
        let is_within = |count: usize, [low, high]: [usize; 2]| (low..=high).contains(&count);
        let signs = found.inertia;
        if !is_within(signs.negative, negative)
            || !is_within(signs.negative + signs.zero, not_positive)
            || signs.negative + signs.zero + signs.positive != model.order
        {
            wrong.push(format!("{signs:?} beside {negative:?} negative and {not_positive:?} not positive"));
        }
        let by_signs = match (signs.negative, signs.zero) {
            (0, 0) => Stability::Stable,
            (0, _) => Stability::Indifferent,
            _ => Stability::Unstable,
        };
        if by_signs != found.stability {
            wrong.push(format!("{} with {signs:?}", found.stability.name()));
        }
        if found.stability == Stability::Unstable && drawn.leaves_saddles {
            wrong.push("a saddle, though saddles are to be left".into());
        }
    }
    if found.stability == Stability::Stable && model.order > 0 {
        let motion = returned(&model, found, seed);
        if motion == Return::Escaped {
            wrong.push("a damped motion from close by ends lower".into());
        }
        record.motion = Some(motion);
    }
    record.wrong = wrong;
}

/// Displaced at random by a part of what the softest direction bears, and left to a damped motion.
fn returned(model: &Model, found: &Equilibrium, seed: u64) -> Return {
    let x = &found.state.positions;
    let values = model.stiffness(x).symmetric_eigenvalues();
    let shortest = model.shortest(x);
    let size = (1e-2 * values.min() / values.max()).min(1e-3) * if shortest.is_finite() { shortest } else { 1.0 };
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let displacement: Vec<Vector3<f64>> = model
        .rows
        .iter()
        .map(|rows| Vector3::from_fn(|axis, _| rows[axis].map_or(0.0, |_| size * rng.random_range(-1.0..1.0))))
        .collect();
    relax(model, &found.state, &displacement, STEPS)
}

pub fn record(seed: u64, most: usize) -> Record {
    let mut record = Record {
        seed,
        kind: KINDS[(seed % KINDS.len() as u64) as usize],
        particles: 0,
        leaves_saddles: true,
        status: None,
        iterations: 0,
        factorizations: 0,
        residual: f64::NAN,
        motion: None,
        wrong: Vec::new(),
    };
    let found = caught(|| {
        let drawn = scene(seed, most)?;
        let options = EquilibriumOptions { leave_saddles: drawn.leaves_saddles, ..EquilibriumOptions::default() };
        let found = equilibrium(&drawn.system, &drawn.state, options)?;
        Ok((drawn, found))
    });
    match found {
        Ok((drawn, found)) => {
            record.particles = drawn.system.particles();
            record.leaves_saddles = drawn.leaves_saddles;
            record.status = Some(found.stability);
            record.iterations = found.iterations;
            record.factorizations = found.work.factorizations as usize;
            judged(&drawn, seed, &found, &mut record);
        }
        Err(error) => record.wrong.push(error),
    }
    record
}

pub fn records(seeds: Range<u64>, most: usize) -> Vec<Record> {
    seeds.collect::<Vec<u64>>().into_par_iter().with_max_len(1).map(|seed| record(seed, most)).collect()
}

const STATUSES: [Stability; 5] =
    [Stability::Stable, Stability::Indifferent, Stability::Unstable, Stability::None, Stability::NotConverged];

pub fn section(seeds: Range<u64>) -> Section {
    let all = records(seeds.clone(), 200);
    let mut text = format!(
        "## Equilibria of random scenes\n\nSeeds {} to {}: ten kinds of scenes of 3 to 200 particles, with and without supports, loads and gravity, disturbed and not, slack and \
         prestressed; seven of ten searches leave saddles. Forces, residuals and −K are written a second time. The signs of the eigenvalues are held to those of a dense \
         decomposition (nalgebra) in the same band about zero, `none` to the sums of loads on bodies without support, `stable` besides to a damped motion from a random \
         displacement, which must come back to a thousandth of the energy it was given.\n\n",
        seeds.start,
        seeds.end - 1
    );
    text.push_str("| kind | scenes | stable | indifferent | unstable | none | not converged | wrong | Newton steps, median | most | factorizations, median | most |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    for kind in KINDS.iter().copied().chain(["all"]) {
        let of: Vec<&Record> = all.iter().filter(|record| kind == "all" || record.kind == kind).collect();
        let statuses: String = STATUSES
            .iter()
            .map(|status| format!(" {} |", of.iter().filter(|record| record.status == Some(*status)).count()))
            .collect();
        let wrong = of.iter().filter(|record| !record.wrong.is_empty()).count();
        let searched = || of.iter().filter(|record| record.status != Some(Stability::None));
        let steps = median_and_most(searched().map(|record| record.iterations).collect());
        let factorizations = median_and_most(searched().map(|record| record.factorizations).collect());
        let _ = writeln!(
            text,
            "| {kind} | {} |{statuses} {wrong} | {} | {} | {} | {} |",
            of.len(),
            steps[0],
            steps[1],
            factorizations[0],
            factorizations[1]
        );
    }
    let residual = all
        .iter()
        .filter(|record| !matches!(record.status, None | Some(Stability::None | Stability::NotConverged)))
        .fold(0.0f64, |largest, record| largest.max(record.residual));
    let motions = |of: Return| all.iter().filter(|record| record.motion == Some(of)).count();
    let _ = writeln!(
        text,
        "\nA search that does not arrive says so; it counts as a failure here. The largest residual of an equilibrium is {residual:.1e}. Of the damped motions from stable equilibria {} come back, {} end lower, {} are not back after {STEPS} steps, and \
         in {} the energy of so small a displacement, a hundredth of what the softest direction bears, is lost in rounding.\n",
        motions(Return::Returned),
        motions(Return::Escaped),
        motions(Return::Slow),
        motions(Return::Unclear)
    );
    let mut failures: Vec<String> = Vec::new();
    for record in &all {
        let Record { seed, kind, particles, .. } = record;
        failures.extend(record.wrong.iter().map(|why| format!("seed {seed}, {kind}, {particles} particles: {why}")));
        if record.is_unfinished() {
            failures.push(format!(
                "seed {seed}, {kind}, {particles} particles, saddles {}left: not converged after {} steps, residual {:.1e}",
                if record.leaves_saddles { "" } else { "not " },
                record.iterations,
                record.residual
            ));
        }
    }
    text.push_str(&list(&failures));
    Section { text, failures: failures.len() }
}
