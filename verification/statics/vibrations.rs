//! Modes of planted scenes, held to dense eigenvalues.

use super::mechanics::Model;
use super::scenes::net;
use super::{Section, caught, list};
use nalgebra::{DMatrix, DVector};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use sprung::modes::{Mode, modes};
use sprung::{Constraint, Spring, State, System, SystemBuilder};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::ops::Range;

/// Kinds of scenes; a seed has the kind of its remainder.
pub const KINDS: [&str; 8] = [
    "free body",
    "three copies",
    "twelve copies",
    "cluster of 1e-9",
    "taut chain",
    "ring",
    "prestressed net",
    "indefinite",
];

/// The largest error of an eigenvalue, over the largest eigenvalue.
const ERROR: f64 = 1e-10;

/// The scene of a seed, with the number of modes to ask for.
pub fn scene(seed: u64) -> sprung::Result<(System, State, usize)> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed ^ 0x4d6f_6465_7300);
    let kind = (seed % KINDS.len() as u64) as usize;
    let mut builder = SystemBuilder::new();
    let body = |builder: &mut SystemBuilder, rng: &mut ChaCha8Rng, copies: usize, count: usize, spread: f64| {
        let layout = net(rng, 3, count);
        let strain = [0.0, 0.0, 0.05][rng.random_range(0..3)];
        let springs: Vec<f64> = layout.pairs.iter().map(|_| rng.random_range(10.0..1000.0)).collect();
        let masses: Vec<f64> = (0..count).map(|_| rng.random_range(0.1..2.0)).collect();
        let is_held = rng.random_bool(0.4);
        for copy in 0..copies {
            let first = copy * count;
            for (x, mass) in layout.places.iter().zip(&masses) {
                builder.particle([x.x, x.y, x.z + 64.0 * copy as f64], *mass);
            }
            for (&[i, j], k) in layout.pairs.iter().zip(&springs) {
                let rest_length = (layout.places[i] - layout.places[j]).norm() / (1.0 + strain);
                let stiffness = k * (1.0 + spread * copy as f64);
                builder.spring(first + i, first + j, Spring { stiffness, rest_length, damping: 0.0 });
            }
            if is_held {
                builder.hold(first).hold(first + 1);
            }
        }
    };
    let count = rng.random_range(4..=12);
    match kind {
        0 => body(&mut builder, rng, 1, 3 * count, 0.0),
        1 => body(&mut builder, rng, 3, count, 0.0),
        2 => body(&mut builder, rng, 12, 3 + count / 3, 0.0),
        3 => body(&mut builder, rng, 3 + count % 4, count, 1e-9),
        4 => {
            let links = 4 * count;
            let stretch = rng.random_range(1.0..2.0);
            for p in 0..=links {
                builder.particle([stretch * p as f64, 0.0, 0.0], 0.5);
            }
            for p in 0..links {
                builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
            }
            builder.hold(0).hold(links);
        }
        5 => {
            let corners = 4 * count;
            let rest = [1.0, 0.9][rng.random_range(0..2)] * 2.0 * (TAU / 2.0 / corners as f64).sin();
            for p in 0..corners {
                let angle = TAU * p as f64 / corners as f64;
                builder.particle([angle.cos(), angle.sin(), 0.0], 0.5);
            }
            for p in 0..corners {
                builder.spring(p, (p + 1) % corners, Spring { stiffness: 100.0, rest_length: rest, damping: 0.0 });
            }
            builder.dimension = rng.random_range(2..=3);
        }
        _ => {
            let side = 3 + count / 2;
            let factor = if kind == 6 { rng.random_range(1.01..1.5) } else { rng.random_range(0.7..0.99) };
            for p in 0..side * side {
                builder.particle([(p % side) as f64, (p / side) as f64, 0.0], rng.random_range(0.5..1.0));
            }
            for j in 0..side {
                for i in 0..side {
                    for (a, b) in [(1, 0), (0, 1)] {
                        if i + a < side && j + b < side {
                            let spring = Spring { stiffness: 100.0, rest_length: 1.0 / factor, damping: 0.0 };
                            builder.spring(j * side + i, (j + b) * side + i + a, spring);
                        }
                    }
                }
            }
            let edge = |p: usize| [0, side - 1].contains(&(p % side)) || [0, side - 1].contains(&(p / side));
            builder.constrain(Constraint::hold((0..side * side).filter(|p| edge(*p))));
        }
    }
    let (system, state) = builder.build()?;
    Ok((system, state, rng.random_range(1..=if kind == 2 { 40 } else { 15 })))
}

/// How the modes of a scene were judged.
#[derive(Default)]
pub struct Judged {
    pub order: usize,
    pub found: usize,
    /// Distinct eigenvalues among those found that occur more than once, up to 1e-8 of themselves.
    pub multiple: usize,
    /// The largest error over the largest eigenvalue.
    pub error: f64,
    pub factorizations: usize,
    pub wrong: Vec<String>,
}

/// Modes held to all eigenvalues of `M^{-1/2} (−K) M^{-1/2}`, ascending.
pub fn judged(system: &System, state: &State, count: usize) -> sprung::Result<Judged> {
    let found = modes(system, state, count)?;
    let model = Model::new(system);
    let matrix = model.scaled_stiffness(&state.positions);
    let mut reference: Vec<f64> = matrix.clone().symmetric_eigenvalues().iter().copied().collect();
    reference.sort_by(f64::total_cmp);
    let largest = reference.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
    let rounding = 1e-13 * largest;
    let mut all: Vec<&Mode> = found.zero_modes.iter().chain(&found.modes).collect();
    all.sort_by(|a, b| a.eigenvalue.total_cmp(&b.eigenvalue));
    let mut judged = Judged { order: model.order, found: all.len(), ..Judged::default() };
    judged.factorizations = found.work.factorizations as usize;
    judged.multiple = all
        .windows(2)
        .filter(|pair| {
            let [a, b] = [pair[0].eigenvalue, pair[1].eigenvalue];
            (a - b).abs() <= 1e-8 * b.abs()
        })
        .count();
    let wrong = &mut judged.wrong;
    if all.len() > reference.len() {
        wrong.push(format!("{} modes of {}", all.len(), reference.len()));
    }
    judged.error =
        all.iter().zip(&reference).map(|(mode, value)| (mode.eigenvalue - value).abs()).fold(0.0, f64::max) / largest;
    if judged.error > ERROR || judged.error.is_nan() {
        wrong.push(format!("an eigenvalue missed or invented: {:.1e} of the largest off", judged.error));
    }
    let others = reference.iter().filter(|value| value.abs() > 1e-11 * largest).count();
    if found.modes.len() != count.min(others) {
        wrong.push(format!("{} modes of {}", found.modes.len(), count.min(others)));
    }
    // All zero modes, unless modes that grow are all that was asked for.
    let last = found.modes.last().map_or(0.0, |mode| mode.eigenvalue);
    let zeros = reference.len() - others;
    if (last >= 0.0 && found.zero_modes.len() != zeros) || found.zero_modes.len() > zeros {
        wrong.push(format!(
            "{} zero modes of {zeros}; the next is {:.1e} of the largest",
            found.zero_modes.len(),
            found.gap[1] / largest
        ));
    }
    if !found.complete {
        wrong.push("not counted".into());
    }
    let below = |shift: f64| reference.iter().filter(|value| **value < shift).count();
    let shift = found.counted_below;
    let counted = all.iter().filter(|mode| mode.eigenvalue < shift).count();
    if found.complete && !(below(shift - rounding)..=below(shift + rounding)).contains(&counted) {
        wrong.push(format!("{counted} counted below {shift:e}, where there are {}", below(shift)));
    }
    // Of independent vectors, each with the residual that it is said to have.
    let root = model.row_masses().map(f64::sqrt);
    let vectors = DMatrix::from_fn(model.order, all.len(), |row, k| all[k].vector[row] * root[row]);
    let gram = vectors.transpose() * &vectors - DMatrix::identity(all.len(), all.len());
    if !gram.is_empty() && gram.amax() > 1e-8 {
        wrong.push(format!("modes are orthonormal up to {:.1e}", gram.amax()));
    }
    for (k, mode) in all.iter().enumerate() {
        let vector: DVector<f64> = vectors.column(k).into_owned();
        let residual = (&matrix * &vector - &vector * mode.eigenvalue).norm();
        if residual > 10.0 * mode.residual + rounding {
            wrong.push(format!("a residual of {residual:.1e}, said to be {:.1e}", mode.residual));
        }
    }
    Ok(judged)
}

pub fn all(seeds: Range<u64>) -> Vec<(u64, Result<Judged, String>)> {
    let of = |seed: u64| {
        caught(|| {
            let (system, state, count) = scene(seed)?;
            judged(&system, &state, count)
        })
    };
    seeds.collect::<Vec<u64>>().into_par_iter().with_max_len(1).map(|seed| (seed, of(seed))).collect()
}

pub fn section(seeds: Range<u64>) -> Section {
    let all = all(seeds.clone());
    let mut text = format!(
        "## Modes of planted scenes\n\nSeeds {} to {}: eight kinds of scenes whose eigenvalues are multiple, close together, zero or negative; 1 to 15 modes are asked for, of twelve \
         copies up to 40. Those found, zero modes among them, are held one by one to all eigenvalues of a dense decomposition (nalgebra) of a matrix written a second time; the number below the shift of \
         the count, orthonormality in M and residuals are checked as well.\n\n\
         | kind | scenes | degrees of freedom | modes found | of which equal to the one before | largest error, of the largest eigenvalue | factorizations, most | wrong |\n|---|---|---|---|---|---|---|---|\n",
        seeds.start,
        seeds.end - 1
    );
    let kind_of = |seed: u64| KINDS[(seed % KINDS.len() as u64) as usize];
    for kind in KINDS.iter().copied().chain(["all"]) {
        let of: Vec<_> = all.iter().filter(|(seed, _)| kind == "all" || kind_of(*seed) == kind).collect();
        let judged: Vec<&Judged> = of.iter().filter_map(|(_, judged)| judged.as_ref().ok()).collect();
        let wrong = of.len() - judged.iter().filter(|judged| judged.wrong.is_empty()).count();
        let [least, most] = [
            judged.iter().map(|judged| judged.order).min().unwrap_or(0),
            judged.iter().map(|judged| judged.order).max().unwrap_or(0),
        ];
        let sum = |of: &dyn Fn(&Judged) -> usize| judged.iter().map(|judged| of(judged)).sum::<usize>();
        let _ = writeln!(
            text,
            "| {kind} | {} | {least}–{most} | {} | {} | {:.1e} | {} | {wrong} |",
            of.len(),
            sum(&|judged| judged.found),
            sum(&|judged| judged.multiple),
            judged.iter().fold(0.0f64, |largest, judged| largest.max(judged.error)),
            judged.iter().map(|judged| judged.factorizations).max().unwrap_or(0)
        );
    }
    let mut failures = Vec::new();
    for (seed, judged) in &all {
        let why = match judged {
            Ok(judged) => judged.wrong.join("; "),
            Err(error) => error.clone(),
        };
        if !why.is_empty() {
            failures.push(format!("seed {seed}, {}: {why}", kind_of(*seed)));
        }
    }
    text.push('\n');
    text.push_str(&list(&failures));
    Section { text, failures: failures.len() }
}
