//! Mechanisms and states of self-stress, held to dense singular values.

use super::mechanics::Model;
use super::scenes::{net, prism};
use super::{Section, caught, list};
use nalgebra::{DMatrix, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use sprung::mechanisms::{Mechanisms, mechanisms};
use sprung::system::Axes;
use sprung::{Constraint, Spring, State, System, SystemBuilder};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::ops::Range;

/// Kinds of frameworks; a seed has the kind of its remainder.
pub const KINDS: [&str; 10] = [
    "generic, plane",
    "generic, space",
    "minimally rigid, plane",
    "over-braced",
    "floppy",
    "collinear",
    "coplanar in space",
    "grid",
    "symmetric",
    "nearly degenerate",
];

/// Of this many seeds one is so large that its rank is counted by inertia.
const LARGE_EVERY: u64 = 50;

pub struct Framework {
    pub dimension: usize,
    pub places: Vec<Vector3<f64>>,
    pub pairs: Vec<[usize; 2]>,
    /// Held particles and axes.
    pub held: Vec<(usize, Vec<usize>)>,
}

impl Framework {
    pub fn free(dimension: usize, places: Vec<Vector3<f64>>, pairs: Vec<[usize; 2]>) -> Self {
        Self { dimension, places, pairs, held: Vec::new() }
    }

    pub fn build(&self) -> sprung::Result<(System, State)> {
        let mut builder = SystemBuilder { dimension: self.dimension, ..SystemBuilder::new() };
        self.places.iter().for_each(|x| {
            builder.particle((*x).into(), 1.0);
        });
        for &[i, j] in &self.pairs {
            let rest_length = (self.places[i] - self.places[j]).norm();
            builder.spring(i, j, Spring { stiffness: 10.0, rest_length, damping: 0.0 });
        }
        for (p, axes) in &self.held {
            builder.constrain(Constraint { axes: Axes::of(axes), ..Constraint::hold([*p]) });
        }
        builder.build()
    }
}

/// All pairs, each with a probability.
fn some_pairs(rng: &mut ChaCha8Rng, count: usize, share: f64) -> Vec<[usize; 2]> {
    (0..count).flat_map(|i| (0..i).map(move |j| [j, i])).filter(|_| rng.random_bool(share)).collect()
}

fn points(rng: &mut ChaCha8Rng, dimension: usize, count: usize) -> Vec<Vector3<f64>> {
    let mut point = || Vector3::from_fn(|axis, _| if axis < dimension { rng.random_range(-1.0..1.0) } else { 0.0 });
    (0..count).map(|_| point()).collect()
}

/// The grid of a seed that is too large for the dense decomposition of the library, with a share of its diagonals.
fn large(rng: &mut ChaCha8Rng) -> Framework {
    let side = 25;
    let places: Vec<Vector3<f64>> = (0..side * side)
        .map(|p| {
            Vector3::new(
                (p % side) as f64 + rng.random_range(-0.2..0.2),
                (p / side) as f64 + rng.random_range(-0.2..0.2),
                0.0,
            )
        })
        .collect();
    let mut pairs = Vec::new();
    let share = rng.random_range(0.92..1.0);
    for j in 0..side {
        for i in 0..side {
            for (a, b) in [(1, 0), (0, 1), (1, 1)] {
                if i + a < side && j + b < side && (a + b == 1 || rng.random_bool(share)) {
                    pairs.push([j * side + i, (j + b) * side + i + a]);
                }
            }
        }
    }
    Framework::free(2, places, pairs)
}

/// The framework of a seed.
pub fn framework(seed: u64) -> Framework {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed ^ 0x5261_6e6b_7300);
    if seed % LARGE_EVERY == LARGE_EVERY - 1 {
        return large(rng);
    }
    let kind = (seed % KINDS.len() as u64) as usize;
    let count = rng.random_range(3..=30);
    let dimension = rng.random_range(2..=3);
    let mut framework = match kind {
        0 | 1 => {
            let share = rng.random_range(0.1..0.9);
            Framework::free(2 + kind, points(rng, 2 + kind, count), some_pairs(rng, count, share))
        }
        // Henneberg's construction: every node by two bars to those before it.
        2 => {
            let mut pairs = vec![[0, 1]];
            for i in 2..count {
                let a = rng.random_range(0..i);
                let b = (a + rng.random_range(1..i)) % i;
                pairs.extend([[a, i], [b, i]]);
            }
            Framework::free(2, points(rng, 2, count), pairs)
        }
        3 => {
            let count = count.min(16);
            Framework::free(dimension, points(rng, dimension, count), some_pairs(rng, count, 0.95))
        }
        4 => {
            let layout = net(rng, dimension, count);
            let pairs = layout.pairs.into_iter().filter(|_| rng.random_bool(0.5)).collect();
            Framework::free(dimension, layout.places, pairs)
        }
        5 => {
            let direction = Vector3::new(1.0, 0.5, if dimension == 3 { 0.25 } else { 0.0 });
            let places = (0..count).map(|p| direction * (p as f64 + rng.random_range(0.0..0.5))).collect();
            let share = rng.random_range(0.1..0.9);
            Framework::free(dimension, places, some_pairs(rng, count, share))
        }
        6 => {
            let turn = nalgebra::Rotation3::from_euler_angles(0.3, 0.7, 1.1);
            let places = points(rng, 2, count).into_iter().map(|x| turn * x).collect();
            let share = rng.random_range(0.2..0.9);
            Framework::free(3, places, some_pairs(rng, count, share))
        }
        7 => {
            let places = (0..count).map(|p| Vector3::new((p % 4) as f64, (p / 4) as f64, 0.0)).collect();
            let share = rng.random_range(0.2..0.8);
            Framework::free(dimension, places, some_pairs(rng, count, share))
        }
        // A polygon with bars that all of its rotations repeat, in space with a second one above.
        8 => {
            let corners = count.max(5);
            let storeys = dimension - 1;
            let places = (0..storeys * corners)
                .map(|p| {
                    let angle = TAU * (p % corners) as f64 / corners as f64;
                    Vector3::new(angle.cos(), angle.sin(), (p / corners) as f64)
                })
                .collect();
            let mut pairs = Vec::new();
            for step in 1..=corners / 2 {
                for storey in 0..storeys {
                    for p in (0..corners).filter(|_| step == 1 || (step + seed as usize / 10).is_multiple_of(3)) {
                        let [i, j] = [p, (p + step) % corners].map(|p| storey * corners + p);
                        if 2 * step != corners || p < corners / 2 {
                            pairs.push([i, j]);
                        }
                    }
                }
            }
            for p in (0..corners).filter(|_| storeys == 2) {
                pairs.extend([[p, corners + p], [p, corners + (p + 1) % corners]]);
            }
            Framework::free(dimension, places, pairs)
        }
        // A framework of the textbooks that has a self-stress, out of place by some power of ten.
        _ => {
            let off = 10f64.powf(rng.random_range(-17.0..-5.0));
            let mut all: Vec<Known> = known().into_iter().filter(|known| known.expected[2] == 1).collect();
            let mut framework = all.swap_remove(rng.random_range(0..all.len())).framework;
            let dimension = framework.dimension;
            for x in &mut framework.places {
                *x +=
                    Vector3::from_fn(|axis, _| if axis < dimension { off * rng.random_range(-1.0..1.0) } else { 0.0 });
            }
            framework
        }
    };
    let supported = rng.random_range(0..6);
    if supported < 2 {
        let all: Vec<usize> = (0..framework.dimension).collect();
        framework.held.push((0, all.clone()));
        if supported == 1 {
            framework.held.push((1, all));
            framework.held.push((2, vec![0]));
        }
    }
    framework
}

/// Singular values, descending, with zeros for the rows or columns that are more.
fn singular_values(matrix: &DMatrix<f64>) -> Vec<f64> {
    if matrix.is_empty() {
        return Vec::new();
    }
    let mut values: Vec<f64> = matrix.singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

fn rank_of(matrix: &DMatrix<f64>, tolerance: f64) -> usize {
    let values = singular_values(matrix);
    values.iter().filter(|value| **value > tolerance * values[0]).count()
}

/// The rank, where the singular values leave no doubt; otherwise whether they are clearly between.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rank {
    Clear(usize),
    /// One is far above rounding and far below 1e-9 of the largest.
    Between,
    /// One is at an edge, where either answer is right.
    Edge,
}

fn rank(values: &[f64], size: usize) -> Rank {
    let largest = values.first().copied().unwrap_or(0.0);
    let rounding = f64::EPSILON * size as f64;
    let within = |low: f64, high: f64| values.iter().any(|value| *value > low * largest && *value < high * largest);
    if !within(5.0 * rounding, 1.1e-9) {
        return Rank::Clear(values.iter().filter(|value| **value >= 1.1e-9 * largest && largest > 0.0).count());
    }
    if within(20.0 * rounding, 0.9e-9) { Rank::Between } else { Rank::Edge }
}

/// The number of rigid motions, by the rank of what they do to the free coordinates among those that leave the held ones, body by body.
fn rigid_motions(model: &Model, x: &[Vector3<f64>]) -> usize {
    let mut count = 0;
    for (members, _) in model.bodies() {
        // Held particles at the other ends of springs belong to the body here.
        let mut all = members.clone();
        for (_, bar) in &model.bars {
            let [i, j] = bar.ends;
            for (p, q) in [(i, j), (j, i)] {
                if members.contains(&p) && !members.contains(&q) {
                    all.push(q);
                }
            }
        }
        let centre = all.iter().map(|&p| x[p]).sum::<Vector3<f64>>() / all.len() as f64;
        let radius = all.iter().map(|&p| (x[p] - centre).norm()).fold(1e-3, f64::max);
        let motion = |column: usize, p: usize| match column {
            0..3 => Vector3::ith(column, 1.0),
            _ => Vector3::ith(column - 3, 1.0).cross(&(x[p] - centre)) / radius,
        };
        let columns: Vec<usize> = if model.dimension == 3 { (0..6).collect() } else { vec![0, 1, 5] };
        let mut held = Vec::new();
        let mut free = Vec::new();
        for &p in &all {
            for axis in 0..model.dimension {
                let row: Vec<f64> = columns.iter().map(|&column| motion(column, p)[axis]).collect();
                if model.rows[p][axis].is_some() { free.push(row) } else { held.push(row) }
            }
        }
        // Those that move free coordinates: all independent ones less those that held coordinates stop.
        let matrix = |rows: &[Vec<f64>]| DMatrix::from_fn(rows.len(), columns.len(), |i, j| rows[i][j]);
        let both = [held.clone(), free].concat();
        count += rank_of(&matrix(&both), 1e-7) - if held.is_empty() { 0 } else { rank_of(&matrix(&held), 1e-7) };
    }
    count
}

/// How a framework was judged.
pub struct Judged {
    pub decided: bool,
    /// The gap is proven, and the rank exactly.
    pub proven: [bool; 2],
    pub self_stresses: usize,
    /// Mechanisms that are no rigid motions.
    pub beside_rigid: usize,
    pub wrong: Vec<String>,
}

fn columns(order: usize, vectors: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(order, vectors.len(), |i, j| vectors[j][i])
}

/// Everything about a framework held to its compatibility matrix.
pub fn judged(framework: &Framework) -> sprung::Result<(Judged, Mechanisms)> {
    let (system, state) = framework.build()?;
    let found = mechanisms(&system, &state)?;
    let model = Model::new(&system);
    let x = &state.positions;
    let b = model.compatibility(x, system.springs().len());
    let [s, d] = [b.nrows(), b.ncols()];
    let values = singular_values(&b);
    let true_rank = rank(&values, s.max(d));
    let mut wrong = Vec::new();
    match (true_rank, found.decided) {
        (Rank::Clear(rank), true) if rank != found.rank => wrong.push(format!("rank {}, not {rank}", found.rank)),
        (Rank::Clear(rank), false) => wrong.push(format!("undecided, though the rank is {rank}")),
        (Rank::Between, true) => wrong.push("decided, though a singular value lies between".into()),
        _ => {}
    }
    if found.degrees_of_freedom != d
        || found.springs != s
        || found.mechanisms + found.rank != d
        || found.self_stresses + found.rank != s
    {
        wrong.push(format!("counts that do not add up: d {d}, s {s}"));
    }
    // Bounds that are proven hold for the computed singular values, to their rounding.
    let rounding = 1e-15 * (s.max(d) as f64) * values.first().copied().unwrap_or(0.0);
    let [above, below] = found.proven_gap;
    let value = |k: usize| values.get(k).copied().unwrap_or(0.0);
    if found.proven && found.rank > 0 && above > value(found.rank - 1) + rounding
        || found.proven && found.rank < d && below + rounding < value(found.rank)
        || found.rank_is_exact && matches!(true_rank, Rank::Clear(rank) if rank != found.rank)
    {
        wrong.push(format!("singular values are not {above:e} above and {below:e} below, as proven"));
    }
    let is_large = s.max(d) > 1200;
    if let (Rank::Clear(_), true, true) = (true_rank, found.decided, wrong.is_empty()) {
        let rigid = rigid_motions(&model, x);
        if rigid != found.rigid_motions {
            wrong.push(format!("{} rigid motions, not {rigid}", found.rigid_motions));
        }
        let beside = found.mechanisms - found.rigid_motions;
        if found.motions.len() != beside {
            wrong.push(format!("{} motions of {beside}", found.motions.len()));
        }
        let motions = columns(d, &found.motions);
        let stretch = (&b * &motions).amax();
        // Relative to a largest displacement of 1, of vectors that rank decisions leave unclear by 1e-9.
        if found.motions.iter().any(|u| u.iter().fold(0.0f64, |a, u| a.max(u.abs())) < 0.5)
            || (!motions.is_empty() && stretch > 1e-8)
        {
            wrong.push(format!("motions that stretch springs by {stretch:.1e}"));
        }
        if !is_large && !motions.is_empty() && rank_of(&motions, 1e-9) != beside {
            wrong.push("motions that are not independent".into());
        }
        if !is_large {
            let stresses = columns(s, &found.self_stress);
            let left = (b.transpose() * &stresses).amax();
            if stresses.ncols() != found.self_stresses
                || (!stresses.is_empty() && (left > 1e-10 || rank_of(&stresses, 1e-9) != stresses.ncols()))
            {
                wrong.push(format!("states of self-stress that leave forces of {left:.1e}, or are not independent"));
            }
            wrong.extend(added_springs_are_wrong(framework, &found)?);
        }
        if !is_large && beside > 0 && found.self_stresses == 1 && !found.motions.is_empty() {
            let form = stress_form(&model, x, &found);
            let eigenvalues = form.symmetric_eigenvalues();
            let (low, high) = (eigenvalues.min(), eigenvalues.max());
            let size = low.abs().max(high.abs());
            let is_definite = low > 1e-6 * size || high < -1e-6 * size;
            let is_open = low.abs().min(high.abs()) < 1e-6 * size || size < 1e-9;
            if !is_open && found.prestress_stable != Some(is_definite) {
                wrong.push(format!("prestress stable: {:?}, not {is_definite}", found.prestress_stable));
            }
        }
    }
    let judged = Judged {
        decided: found.decided,
        proven: [found.proven, found.rank_is_exact],
        self_stresses: found.self_stresses,
        beside_rigid: found.mechanisms.saturating_sub(found.rigid_motions),
        wrong,
    };
    Ok((judged, found))
}

/// Every spring that is added must raise the rank by one.
fn added_springs_are_wrong(framework: &Framework, found: &Mechanisms) -> sprung::Result<Option<String>> {
    if found.added_springs.is_empty() {
        return Ok(None);
    }
    let pairs = [framework.pairs.clone(), found.added_springs.clone()].concat();
    let Framework { dimension, places, held, .. } = framework;
    let (system, state) =
        Framework { dimension: *dimension, places: places.clone(), pairs, held: held.clone() }.build()?;
    let b = Model::new(&system).compatibility(&state.positions, system.springs().len());
    let expected = found.rank + found.added_springs.len();
    let rank = rank_of(&b, 1e-9);
    Ok((rank != expected).then(|| format!("{} added springs make a rank of {rank}", found.added_springs.len())))
}

/// `uᵀ Σ (T/l)(I − nnᵀ) u` between the motions, for the only state of self-stress.
fn stress_form(model: &Model, x: &[Vector3<f64>], found: &Mechanisms) -> DMatrix<f64> {
    let count = found.motions.len();
    let shapes: Vec<Vec<Vector3<f64>>> = found.motions.iter().map(|motion| found.shape(motion)).collect();
    let mut form = DMatrix::zeros(count, count);
    for (number, bar) in &model.bars {
        let [i, j] = bar.ends;
        let d = x[j] - x[i];
        let n = d.normalize();
        let across: Vec<Vector3<f64>> = shapes
            .iter()
            .map(|u| {
                let between = u[j] - u[i];
                between - n * n.dot(&between)
            })
            .collect();
        for k in 0..count {
            for l in 0..count {
                form[(k, l)] += found.self_stress[0][*number] / d.norm() * across[k].dot(&across[l]);
            }
        }
    }
    form
}

/// All frameworks of some seeds; large ones where they are wanted.
pub fn all(seeds: Range<u64>, with_large: bool) -> Vec<(u64, Result<Judged, String>)> {
    seeds
        .collect::<Vec<u64>>()
        .into_par_iter()
        .with_max_len(1)
        .filter(|seed| with_large || seed % LARGE_EVERY != LARGE_EVERY - 1)
        .map(|seed| (seed, caught(|| judged(&framework(seed)).map(|(judged, _)| judged))))
        .collect()
}

/// A framework of the textbooks with what is known of it: rank, mechanisms, states of self-stress, and stiffness by prestress where that is known.
pub struct Known {
    pub name: &'static str,
    pub framework: Framework,
    pub expected: [usize; 3],
    pub prestress_stable: Option<bool>,
}

fn plane(places: &[[f64; 2]]) -> Vec<Vector3<f64>> {
    places.iter().map(|[x, y]| Vector3::new(*x, *y, 0.0)).collect()
}

/// Two triangles, the corners of the second on rays through the corners of the first at the given distances; joined corner by corner.
fn desargues(second: [f64; 3], aside: f64) -> Framework {
    let rays = [[1.0, 0.1], [-0.4, 0.9], [-0.7, -0.8]];
    let first = rays.map(|[x, y]| [0.8 * x, 0.8 * y]);
    let mut corners: Vec<[f64; 2]> = first.into_iter().chain((0..3).map(|k| rays[k].map(|x| x * second[k]))).collect();
    corners[3][1] += aside;
    let pairs = vec![[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]];
    Framework::free(2, plane(&corners), pairs)
}

pub fn known() -> Vec<Known> {
    let mut all = Vec::new();
    let mut add = |name, framework, expected, prestress_stable| {
        all.push(Known { name, framework, expected, prestress_stable });
    };
    let square = || plane(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let sides = vec![[0, 1], [1, 2], [2, 3], [3, 0]];
    add("square", Framework::free(2, square(), sides.clone()), [4, 4, 0], Some(false));
    add("square, one diagonal", Framework::free(2, square(), [sides.clone(), vec![[0, 2]]].concat()), [5, 3, 0], None);
    add(
        "square, both diagonals",
        Framework::free(2, square(), [sides, vec![[0, 2], [1, 3]]].concat()),
        [5, 3, 1],
        None,
    );
    // A triangle with a point on each of two sides would do as well: three collinear points, both halves and the whole.
    let line = plane(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
    add(
        "three points on a line, all joined",
        Framework::free(2, line, vec![[0, 1], [1, 2], [0, 2]]),
        [2, 4, 1],
        Some(true),
    );
    add("Desargues, triangles in perspective", desargues([1.5, 2.0, 1.7], 0.0), [8, 4, 1], None);
    add("Desargues, one corner aside", desargues([1.5, 2.0, 1.7], 0.05), [9, 3, 0], None);
    let bars: Vec<[usize; 2]> = (0..9).map(|k| [k / 3, 3 + k % 3]).collect();
    let angles = [0.1, 1.3, 2.2, 3.0, 4.4, 5.5];
    let ellipse: Vec<[f64; 2]> = angles.iter().map(|t: &f64| [2.0 * t.cos(), t.sin()]).collect();
    let hyperbola: Vec<[f64; 2]> = [0.3, 0.7, 1.9, -0.4, -1.2, 2.6].iter().map(|t: &f64| [*t, 1.0 / t]).collect();
    let mut off = ellipse.clone();
    off[2][1] += 0.2;
    add("K₃,₃ on an ellipse", Framework::free(2, plane(&ellipse), bars.clone()), [8, 4, 1], None);
    add("K₃,₃ on a hyperbola", Framework::free(2, plane(&hyperbola), bars.clone()), [8, 4, 1], None);
    add("K₃,₃ off the conic", Framework::free(2, plane(&off), bars), [9, 3, 0], None);
    let axes = (0..6).map(|p| Vector3::ith(p / 2, if p % 2 == 0 { 1.0 } else { -1.0 })).collect();
    let edges = (0..6).flat_map(|i| (0..i).map(move |j| [i, j])).filter(|[i, j]| i / 2 != j / 2).collect();
    add("octahedron", Framework::free(3, axes, edges), [12, 6, 0], None);
    let cube: Vec<Vector3<f64>> =
        (0..8).map(|p| Vector3::new((p & 1) as f64, (p >> 1 & 1) as f64, (p >> 2) as f64)).collect();
    let edges: Vec<[usize; 2]> =
        (0..8usize).flat_map(|i| (0..i).map(move |j| [i, j])).filter(|[i, j]| (i ^ j).count_ones() == 1).collect();
    add("cube", Framework::free(3, cube, edges), [12, 12, 0], Some(false));
    for (name, degrees, expected, stable) in [
        ("prism of three struts, 30°", 30.0f64, [11, 7, 1], Some(true)),
        ("prism of three struts, 31°", 31.0, [12, 6, 0], None),
    ] {
        let layout = prism(3, degrees.to_radians(), 1.0);
        add(name, Framework::free(3, layout.places, layout.pairs), expected, stable);
    }
    all
}

/// What is found of a framework of the textbooks, and whether that is right.
pub fn is_right(known: &Known) -> Result<(Mechanisms, bool), String> {
    let (judged, found) = caught(|| judged(&known.framework))?;
    let is_right = judged.wrong.is_empty()
        && found.decided
        && known.expected == [found.rank, found.mechanisms, found.self_stresses]
        && (known.prestress_stable.is_none() || known.prestress_stable == found.prestress_stable);
    Ok((found, is_right))
}

pub fn section(seeds: Range<u64>) -> Section {
    let all = all(seeds.clone(), true);
    let mut failures = Vec::new();
    let mut text = format!(
        "## Frameworks\n\nSeeds {} to {}: ten kinds of frameworks of 3 to 30 particles, free or on supports, and every {LARGE_EVERY}th seed a grid of 625 that is too large for the \
         dense decomposition of the library. The rank is held to singular values (nalgebra) of a matrix written a second time. Where one lies between rounding and 1e-9 of the \
         largest, the rank must be undecided, elsewhere decided. Beside the rank: rigid motions, that the motions stretch nothing, that the self-stresses are balanced, bounds of the gap that are proven, that \
         each is a basis, that every spring added raises the rank by one, and the definiteness of the only self-stress on the motions.\n\n\
         | kind | frameworks | of which have motions beside rigid ones or self-stress | undecided | gap proven | rank exact | wrong |\n|---|---|---|---|---|---|---|\n",
        seeds.start,
        seeds.end - 1
    );
    let kind_of = |seed: u64| match seed % LARGE_EVERY == LARGE_EVERY - 1 {
        true => "large grid",
        false => KINDS[(seed % KINDS.len() as u64) as usize],
    };
    for kind in KINDS.iter().copied().chain(["large grid", "all"]) {
        let of: Vec<_> = all.iter().filter(|(seed, _)| kind == "all" || kind_of(*seed) == kind).collect();
        let count =
            |is: &dyn Fn(&Judged) -> bool| of.iter().filter(|(_, judged)| judged.as_ref().is_ok_and(is)).count();
        let wrong =
            of.iter().filter(|(_, judged)| judged.as_ref().map_or(true, |judged| !judged.wrong.is_empty())).count();
        let _ = writeln!(
            text,
            "| {kind} | {} | {} | {} | {} | {} | {wrong} |",
            of.len(),
            count(&|judged| judged.self_stresses > 0 || judged.beside_rigid > 0),
            count(&|judged| !judged.decided),
            count(&|judged| judged.proven[0]),
            count(&|judged| judged.proven[1])
        );
    }
    for (seed, judged) in &all {
        let why = match judged {
            Ok(judged) => judged.wrong.join("; "),
            Err(error) => error.clone(),
        };
        if !why.is_empty() {
            failures.push(format!("seed {seed}, {}: {why}", kind_of(*seed)));
        }
    }
    text.push_str("\nFrameworks of the textbooks:\n\n| framework | springs | rank | mechanisms | of these rigid | self-stresses | stiff by prestress | as known |\n|---|---|---|---|---|---|---|---|\n");
    for known in known() {
        match is_right(&known) {
            Ok((found, is_right)) => {
                let prestress = match found.prestress_stable {
                    Some(true) => "yes",
                    Some(false) => "no",
                    None => "–",
                };
                let _ = writeln!(
                    text,
                    "| {} | {} | {} | {} | {} | {} | {prestress} | {} |",
                    known.name,
                    found.springs,
                    found.rank,
                    found.mechanisms,
                    found.rigid_motions,
                    found.self_stresses,
                    if is_right { "yes" } else { "no" }
                );
                if !is_right {
                    failures.push(format!("{}: not as known, {:?}", known.name, known.expected));
                }
            }
            Err(error) => failures.push(format!("{}: {error}", known.name)),
        }
    }
    text.push('\n');
    text.push_str(&list(&failures));
    Section { text, failures: failures.len() }
}
