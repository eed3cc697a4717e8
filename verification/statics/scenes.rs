//! Random scenes for equilibria, one for each seed, the same on every machine.

use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::system::{Axes, Behaviour, Loads};
use sprung::{Constraint, Spring, State, System, SystemBuilder};
use std::f64::consts::TAU;

/// Kinds of scenes; a seed has the kind of its remainder.
pub const KINDS: [&str; 10] = [
    "plane net",
    "net in space",
    "cloth with holes",
    "truss",
    "chain",
    "lattice",
    "tensegrity prism",
    "pressed column",
    "rest lengths of zero",
    "tension only",
];

/// A scene.
pub struct Drawn {
    pub system: System,
    pub state: State,
    /// Whether the search goes on from saddles.
    pub leaves_saddles: bool,
}

/// Particles, pairs, and those that the kind supports.
pub struct Layout {
    pub dimension: usize,
    pub places: Vec<Vector3<f64>>,
    pub pairs: Vec<[usize; 2]>,
    pub supports: Vec<usize>,
}

/// Points in a box of unit density, each joined to some of its nearest neighbours, and to the nearest of those before it.
pub fn net(rng: &mut ChaCha8Rng, dimension: usize, count: usize) -> Layout {
    let side = (count as f64).powf(1.0 / dimension as f64);
    let places: Vec<Vector3<f64>> = (0..count)
        .map(|_| Vector3::from_fn(|axis, _| if axis < dimension { rng.random_range(0.0..side) } else { 0.0 }))
        .collect();
    let mut pairs = Vec::new();
    let neighbours = rng.random_range(1..=dimension + 3);
    for i in 0..count {
        let mut others: Vec<usize> = (0..count).filter(|&j| j != i).collect();
        others.sort_by(|&a, &b| (places[a] - places[i]).norm().total_cmp(&(places[b] - places[i]).norm()));
        let before = others.iter().copied().find(|&j| j < i);
        pairs.extend(others.iter().take(neighbours).copied().chain(before).map(|j| [i.min(j), i.max(j)]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    let supports = (0..1 + count / 6).map(|_| rng.random_range(0..count)).collect();
    Layout { dimension, places, pairs, supports }
}

/// A grid with diagonals, of which some nodes are missing, held at its corners.
fn cloth(rng: &mut ChaCha8Rng, count: usize) -> Layout {
    let width = ((count as f64).sqrt() as usize).max(2);
    let height = (count / width).max(2);
    let keeps: Vec<bool> = (0..width * height).map(|_| rng.random_bool(0.9)).collect();
    let corners = [0, width - 1, (height - 1) * width, height * width - 1];
    let kept: Vec<usize> = (0..width * height).filter(|&p| keeps[p] || corners.contains(&p)).collect();
    let number = |i: usize, j: usize| kept.iter().position(|&p| p == j * width + i);
    let places = kept.iter().map(|p| Vector3::new((p % width) as f64, 0.0, (p / width) as f64)).collect();
    let diagonals = rng.random_bool(0.8);
    let mut pairs = Vec::new();
    for j in 0..height {
        for i in 0..width {
            let Some(a) = number(i, j) else { continue };
            for (di, dj) in [(1, 0), (0, 1), (1, 1)] {
                let inside = i + di < width && j + dj < height && (diagonals || di + dj == 1);
                if let Some(b) = inside.then(|| number(i + di, j + dj)).flatten() {
                    pairs.push([a, b]);
                }
            }
        }
    }
    let supports = corners.iter().filter_map(|c| kept.iter().position(|p| p == c)).collect();
    Layout { dimension: 3, places, pairs, supports }
}

/// A plane truss of bays with diagonals on two or four supports.
fn truss(rng: &mut ChaCha8Rng, count: usize) -> Layout {
    let bays = (count / 2).max(2);
    let places = (0..2 * bays).map(|p| Vector3::new((p / 2) as f64, (p % 2) as f64, 0.0)).collect();
    let crossed = rng.random_bool(0.4);
    let mut pairs = vec![[0, 1]];
    for bay in 1..bays {
        let (a, b) = (2 * bay - 2, 2 * bay);
        pairs.extend([[a, b], [a + 1, b + 1], [b, b + 1], [a, b + 1]]);
        if crossed {
            pairs.push([a + 1, b]);
        }
    }
    let supports = if rng.random_bool(0.5) { vec![0, 1] } else { vec![0, 1, 2 * bays - 2, 2 * bays - 1] };
    Layout { dimension: 2, places, pairs, supports }
}

fn chain(rng: &mut ChaCha8Rng, count: usize) -> Layout {
    let dimension = rng.random_range(2..=3);
    let places = (0..count).map(|p| Vector3::new(p as f64, 0.0, 0.0)).collect();
    let pairs = (1..count).map(|p| [p - 1, p]).collect();
    let supports = if rng.random_bool(0.7) { vec![0, count - 1] } else { vec![0] };
    Layout { dimension, places, pairs, supports }
}

/// A block with springs along edges and across faces, held at its bottom.
fn lattice(rng: &mut ChaCha8Rng, count: usize) -> Layout {
    let side = ((count as f64).cbrt().round() as usize).max(2);
    let tall = (count / (side * side)).max(2);
    let number = |i: usize, j: usize, k: usize| (k * side + j) * side + i;
    let mut places = Vec::new();
    let mut pairs = Vec::new();
    let braced = rng.random_bool(0.7);
    for k in 0..tall {
        for j in 0..side {
            for i in 0..side {
                places.push(Vector3::new(i as f64, k as f64, j as f64));
                let steps = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]];
                for [a, b, c] in steps.into_iter().take(if braced { 6 } else { 3 }) {
                    if i + a < side && j + b < side && k + c < tall {
                        pairs.push([number(i, j, k), number(i + a, j + b, k + c)]);
                    }
                }
            }
        }
    }
    Layout { dimension: 3, places, pairs, supports: (0..side * side).collect() }
}

/// Bottom and top polygons of cables, cables up, and struts from each bottom node to the next but one, turned so that it bears a self-stress. Springs come
/// as bottom, top, up, strut of each corner.
pub fn prism(struts: usize, turned: f64, height: f64) -> Layout {
    let corner = |k: usize, turned: f64, y: f64| {
        let angle = TAU * k as f64 / struts as f64 + turned;
        Vector3::new(angle.cos(), y, angle.sin())
    };
    let bottom = (0..struts).map(|k| corner(k, 0.0, 0.0));
    let places = bottom.chain((0..struts).map(|k| corner(k, turned, height))).collect();
    let next = |k: usize| (k + 1) % struts;
    let pairs = (0..struts)
        .flat_map(|k| [[k, next(k)], [struts + k, struts + next(k)], [k, struts + k], [k, struts + next(k)]])
        .collect();
    Layout { dimension: 3, places, pairs, supports: (0..struts).collect() }
}

/// Two chords with rungs and diagonals, pressed together at the top.
fn column(rng: &mut ChaCha8Rng, count: usize) -> Layout {
    let storeys = (count / 2).max(2);
    let places = (0..2 * storeys).map(|p| Vector3::new((p % 2) as f64, (p / 2) as f64, 0.0)).collect();
    let mut pairs = vec![[0, 1]];
    for storey in 1..storeys {
        let (a, b) = (2 * storey - 2, 2 * storey);
        pairs.extend([[a, b], [a + 1, b + 1], [b, b + 1], [a, b + 1], [a + 1, b]]);
    }
    Layout { dimension: if rng.random_bool(0.8) { 2 } else { 3 }, places, pairs, supports: vec![0, 1] }
}

/// A number between two, by its logarithm.
fn logarithmic(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

/// The scene of a seed, of about 3 to `most` particles.
pub fn scene(seed: u64, most: usize) -> sprung::Result<Drawn> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed ^ 0x5374_6174_6963_7300);
    let kind = (seed % KINDS.len() as u64) as usize;
    let count = logarithmic(rng, 3.0, most as f64 + 0.99) as usize;
    let layout = match kind {
        0 => net(rng, 2, count),
        1 => net(rng, 3, count),
        2 => cloth(rng, count),
        3 => truss(rng, count),
        4 => chain(rng, count),
        5 => lattice(rng, count),
        6 => {
            let struts = 3 + count % 8;
            let turned = TAU / 4.0 - TAU / 2.0 / struts as f64;
            prism(struts, turned, rng.random_range(0.5..2.0))
        }
        7 => column(rng, count),
        _ => match rng.random_range(0..4) {
            0 => net(rng, 2, count),
            1 => net(rng, 3, count),
            2 => cloth(rng, count),
            _ => chain(rng, count),
        },
    };
    let Layout { dimension, places, pairs, supports } = layout;
    let count = places.len();
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    // Stiffnesses k, unequal by factors; strains of springs at the start, equal or each its own.
    let stiffness = logarithmic(rng, 10.0, 1e4);
    let mut spread = [1.0, 2.0, 10.0][rng.random_range(0..3)];
    let mut stretch = [0.0, 0.05, -0.05, 0.2, -0.2][rng.random_range(0..5)];
    let mut scatter = [0.0, 0.0, 0.1][rng.random_range(0..3)];
    let mut noise = [0.0, 1e-3, 0.1, 0.3][rng.random_range(0..4)];
    // Chains and columns without any imperfection have saddles.
    let is_perfect = [4, 7].contains(&kind) && rng.random_bool(0.4);
    if is_perfect {
        (spread, scatter, noise) = (1.0, 0.0, 0.0);
        stretch = if kind == 4 { -0.1 } else { 0.0 };
    }
    let slack_share = if kind == 9 { rng.random_range(0.2..1.0) } else { 0.0 };
    let zero_share = if kind == 8 { [1.0, 0.5][rng.random_range(0..2)] } else { 0.0 };
    let corners = count / 2;
    let prestress = rng.random_range(0.005..0.1);
    let mut tension_only = Vec::new();
    for (number, &[i, j]) in pairs.iter().enumerate() {
        let length = (places[i] - places[j]).norm();
        let mut k = if spread > 1.0 { stiffness * logarithmic(rng, 1.0 / spread, spread) } else { stiffness };
        let mut rest = length / (1.0 + stretch + rng.random_range(-1.0..1.0) * scatter);
        if kind == 6 {
            // Force densities of the self-stress: 1 in the polygons, 2 sin(π/m) up, and as much, pressed, in the struts.
            let up = 2.0 * (TAU / 2.0 / corners as f64).sin();
            let density = [1.0, 1.0, up, -up][number % 4] * prestress * stiffness;
            // No strut is pressed by more than a quarter.
            k = k.max(4.0 * length * density.abs());
            rest = length * k / (k + density * length);
        } else if kind == 7 {
            rest = length;
        }
        if zero_share > 0.0 && rng.random_bool(zero_share) {
            rest = 0.0;
        }
        tension_only.push(slack_share > 0.0 && rng.random_bool(slack_share));
        builder.spring(i, j, Spring { stiffness: k, rest_length: rest, damping: 0.0 });
    }
    for place in &places {
        let moved =
            Vector3::from_fn(
                |axis, _| {
                    if axis < dimension && noise > 0.0 { noise * rng.random_range(-1.0..1.0) } else { 0.0 }
                },
            );
        builder.particle((place + moved).into(), if is_perfect { 0.5 } else { rng.random_range(0.1..1.0) });
    }
    // No support, one, some along some axes, or those of the kind.
    let supporting = rng.random_range(0.0..1.0);
    if supporting < 0.12 {
    } else if supporting < 0.2 {
        builder.hold(supports[0]);
    } else if supporting < 0.35 {
        for &p in &supports {
            let axes: Vec<usize> = (0..dimension).filter(|_| rng.random_bool(0.6)).collect();
            builder.constrain(Constraint { axes: Axes::of(&axes), ..Constraint::hold([p]) });
        }
    } else {
        builder.constrain(Constraint::hold(supports.iter().copied()));
    }
    let is_unsupported = supporting < 0.12;
    // Weight as a part of the stiffness.
    if !is_perfect && rng.random_bool(if is_unsupported { 0.3 } else { 0.7 }) {
        let total: f64 = builder.masses.iter().sum();
        let g = stiffness * logarithmic(rng, 1e-4, 1.0) / total;
        if rng.random_bool(0.8) && dimension > 1 {
            builder.gravity(0.0, -g, 0.0);
        } else {
            builder.gravity(g, -0.5 * g, 0.0);
        }
    }
    let mut forces = Vec::new();
    let loading = rng.random_range(0.0..1.0);
    if kind == 7 {
        // Down on the top, up to several times what a slender column bears.
        forces = vec![Vector3::zeros(); count];
        let load = stiffness * logarithmic(rng, 1e-3, 0.3);
        for force in forces.iter_mut().skip(count - 2) {
            force.y = -load;
        }
    } else if loading < 0.4 && !is_perfect {
        let size = stiffness * logarithmic(rng, 1e-4, 0.3) / (count as f64).sqrt();
        forces = (0..count)
            .map(|_| {
                Vector3::from_fn(|axis, _| if axis < dimension { size * rng.random_range(-1.0..1.0) } else { 0.0 })
            })
            .collect();
        if is_unsupported && loading < 0.25 {
            let mean = forces.iter().sum::<Vector3<f64>>() / count as f64;
            forces.iter_mut().for_each(|f| *f -= mean);
        }
    }
    let leaves_saddles = rng.random_bool(0.7);
    let (mut system, state) = builder.build()?;
    if !forces.is_empty() {
        system = system.with_loads(Loads { forces, ..Loads::default() })?;
    }
    if tension_only.contains(&true) {
        system = system.with_behaviour(Behaviour { tension_only, ..Behaviour::default() })?;
    }
    Ok(Drawn { system, state, leaves_saddles })
}
