//! The random scenes: one for each seed, the same on every machine.
//!
//! A scene is drawn without units first: distances in those of neighbours, times in that of the whole run T, stiffness as
//! `Ω = ω T`, ω a bound of the highest frequency (Gershgorin's: `ω² ≤ max 2 Σ k/(l0 m)` over the particles). So soft and stiff
//! mean what they mean to a method: how many vibrations the run has, and how many one step would have to resolve. Lengths,
//! masses and T then only scale.

use super::shape::{Layout, Shape, layout};
use rand::rngs::ChaCha8Rng;
use rand::{Rng, RngExt, SeedableRng};
use sprung::Scene;
use sprung::scene::{AxisName, ConstraintEntry, Particles, Path, Row, Springs, TimeSettings, Values};
use std::f64::consts::TAU;

/// A scene of the study.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The scene, with a duration and without a step.
    pub scene: Scene,
    /// Its kind.
    pub shape: Shape,
    /// Further properties, for tables.
    pub traits: Traits,
}

/// Properties that tables sort scenes by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traits {
    /// `Ω = ω T`, see above.
    pub pace: f64,
    /// Whether any spring is damped.
    pub damped: bool,
    /// Whether a prescribed particle moves.
    pub moved: bool,
    /// Whether it has gravity.
    pub gravity: bool,
    /// Largest initial strain, in absolute value.
    pub strain: f64,
}

/// One of so many scenes is large.
const LARGE: u64 = 25;

fn shape(seed: u64) -> Shape {
    Shape::ALL[(seed % Shape::ALL.len() as u64) as usize]
}

/// The name of the scene of a seed.
pub fn name(seed: u64) -> String {
    format!("{}-{seed}", shape(seed).name())
}

/// The scene of a seed.
pub fn scene(seed: u64) -> Drawn {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let random = &mut random;
    let shape = shape(seed);
    let large = shape != Shape::Rod && (seed / Shape::ALL.len() as u64) % LARGE == LARGE - 1;
    let layout = layout(shape, large, random);
    let duration = log_uniform(0.1, 3.0, random);
    let spacing = log_uniform(0.02, 1.0, random);
    let pace = pace(shape, large, layout.points.len(), random);

    let masses = masses(layout.points.len(), random);
    let strains = strains(shape, pace, layout.pairs.len(), random);
    let lengths: Vec<f64> = layout.pairs.iter().map(|&pair| spacing * length(&layout, pair)).collect();
    let rest_lengths: Vec<f64> = lengths.iter().zip(&strains).map(|(l, strain)| l / (1.0 + strain)).collect();
    let spread = if random.random_bool(0.5) { 1.0 } else { log_uniform(1.2, 10.0, random) };
    let relative = (0..layout.pairs.len()).map(|_| log_uniform(1.0 / spread, spread * 1.000_001, random));
    let relative: Vec<f64> = relative.collect();
    let omega = pace / duration;
    let scale = omega * omega / highest(&layout.pairs, &relative, &rest_lengths, &masses);
    let stiffness: Vec<f64> = relative.iter().map(|k| scale * k).collect();
    let damping = damping(&stiffness, &rest_lengths, [omega, pace], random);
    let gravity = gravity(&layout, &masses, &stiffness, [spacing, duration], random);
    let velocities = velocities(&layout, [spacing, duration], random);
    let constraints = constraints(shape, &layout, [spacing, duration], random);

    let row = |v: [f64; 3]| Row::of(&v.into(), layout.dimension);
    let traits = Traits {
        pace,
        damped: damping.is_some(),
        moved: constraints.iter().any(|c| c.velocity.is_some() || c.path.is_some()),
        gravity: gravity.is_some(),
        strain: strains.iter().fold(0.0, |most, strain| strain.abs().max(most)),
    };
    let scene = Scene {
        name: name(seed),
        gravity: gravity.map(|gravity| row(gravity).into()),
        particles: Particles {
            positions: layout.points.iter().map(|x| row(x.map(|c| spacing * c))).collect(),
            velocities: velocities.map(|all| all.into_iter().map(row).collect()),
            masses: Some(Values::collect(masses)),
        },
        springs: Springs {
            pairs: layout.pairs.clone(),
            stiffness: Some(Values::collect(stiffness)),
            rest_lengths: Some(Values::collect(rest_lengths)),
            damping: damping.map(Values::collect),
            ..Springs::default()
        },
        constraints,
        time: TimeSettings { dt: None, duration: Some(duration) },
        ..Scene::default()
    };
    Drawn { scene, shape, traits }
}

/// Ω. Stiff scenes with many particles would cost their reference minutes.
fn pace(shape: Shape, large: bool, particles: usize, random: &mut impl Rng) -> f64 {
    let most = match particles {
        _ if shape == Shape::Rod => 3e4,
        0..=8 => 1e4,
        9..=64 => 3e3,
        _ => 500.0,
    };
    log_uniform(if large { 30.0 } else { 4.0 }, most, random)
}

fn masses(count: usize, random: &mut impl Rng) -> Vec<f64> {
    let typical = log_uniform(1e-3, 3.0, random);
    let spread = match random.random_range(0..4) {
        0 | 1 => 1.000_001,
        2 => 2.0,
        _ => 10.0,
    };
    (0..count).map(|_| typical * log_uniform(1.0 / spread, spread, random)).collect()
}

/// l/l0 − 1 of every spring. A vibration of strain s moves its particles by about s; where there are very many of them in
/// the run (large Ω), large ones make a gas of vibrations whose motion nobody could predict: most scenes have small ones there.
fn strains(shape: Shape, pace: f64, count: usize, random: &mut impl Rng) -> Vec<f64> {
    let wild = random.random_bool(0.1);
    let most = if wild { 0.4f64 } else { (20.0 / pace).min(0.4) };
    let strain = log_uniform(1e-3 * most, most, random);
    match random.random_range(0..5) {
        _ if shape == Shape::Column && random.random_bool(0.7) => vec![-strain; count],
        0 => vec![0.0; count],
        1 => vec![-strain; count],
        2 => vec![strain; count],
        _ => (0..count).map(|_| random.random_range(-strain..strain)).collect(),
    }
}

fn length(layout: &Layout, [i, j]: [u32; 2]) -> f64 {
    let (a, b) = (layout.points[i as usize], layout.points[j as usize]);
    a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The bound of ω².
fn highest(pairs: &[[u32; 2]], stiffness: &[f64], rest_lengths: &[f64], masses: &[f64]) -> f64 {
    let mut sums = vec![0.0; masses.len()];
    for ((pair, k), l0) in pairs.iter().zip(stiffness).zip(rest_lengths) {
        for &end in pair {
            sums[end as usize] += 2.0 * k / (l0 * masses[end as usize]);
        }
    }
    sums.into_iter().fold(f64::MIN_POSITIVE, f64::max)
}

/// In proportion to stiffness: ζ is the damping ratio at ω. Strongly damped scenes have a rate of 2ζω.
fn damping(
    stiffness: &[f64],
    rest_lengths: &[f64],
    [omega, pace]: [f64; 2],
    random: &mut impl Rng,
) -> Option<Vec<f64>> {
    if random.random_bool(0.4) {
        return None;
    }
    let most = if random.random_bool(0.15) { (2e4 / pace).clamp(1.0, 20.0) } else { 0.3 };
    let ratio = log_uniform(1e-4, most, random);
    let part = |random: &mut _| if RngExt::random_bool(random, 0.8) { 1.0 } else { 0.0 };
    let uneven = random.random_bool(0.2);
    let each = stiffness.iter().zip(rest_lengths);
    Some(each.map(|(k, l0)| 2.0 * ratio * k / (l0 * omega) * if uneven { part(random) } else { 1.0 }).collect())
}

/// Downwards along the last of the first two axes, 9.81 m/s², or as much less as keeps the links from stretching to three times
/// their length under the weight of all others and from falling by more than ten distances.
fn gravity(
    layout: &Layout,
    masses: &[f64],
    stiffness: &[f64],
    [spacing, duration]: [f64; 2],
    random: &mut impl Rng,
) -> Option<[f64; 3]> {
    if random.random_bool(0.4) {
        return None;
    }
    let mean = stiffness.iter().sum::<f64>() / stiffness.len() as f64;
    let in_a_row = (masses.len() as f64).powf(1.0 / layout.dimension as f64).max(2.0);
    let heaviest = masses.iter().sum::<f64>() / masses.len() as f64 * in_a_row;
    let most = (2.0 * mean / heaviest).max(20.0 * spacing / (duration * duration)).min(9.81);
    let mut gravity = [0.0; 3];
    gravity[layout.dimension.min(2) - 1] = -most;
    Some(gravity)
}

fn velocities(layout: &Layout, [spacing, duration]: [f64; 2], random: &mut impl Rng) -> Option<Vec<[f64; 3]>> {
    let speed = log_uniform(0.02, 2.0, random) * spacing / duration;
    let axes = layout.dimension;
    let arbitrary = |random: &mut _| {
        let mut v = [0.0; 3];
        v[..axes].fill_with(|| speed * RngExt::random_range(random, -1.0..1.0));
        v
    };
    match random.random_range(0..10) {
        0..4 => None,
        4..8 => Some(layout.points.iter().map(|_| arbitrary(random)).collect()),
        8 if axes > 1 => {
            // A turn about the centre, of up to a whole round.
            let rate = random.random_range(0.1..TAU) / duration;
            let count = layout.points.len() as f64;
            let centre = [0, 1].map(|axis| layout.points.iter().map(|x| x[axis]).sum::<f64>() / count);
            let turn = |x: &[f64; 3]| [-(x[1] - centre[1]), x[0] - centre[0], 0.0].map(|v| rate * spacing * v);
            Some(layout.points.iter().map(turn).collect())
        }
        _ => {
            let mut all = vec![[0.0; 3]; layout.points.len()];
            let struck = random.random_range(0..all.len());
            all[struck] = arbitrary(random).map(|v| 3.0 * v);
            Some(all)
        }
    }
}

fn constraints(
    shape: Shape,
    layout: &Layout,
    [spacing, duration]: [f64; 2],
    random: &mut impl Rng,
) -> Vec<ConstraintEntry> {
    let free = if shape == Shape::Rod { 0.1 } else { 0.25 };
    if random.random_bool(free) {
        return Vec::new();
    }
    let choice = if random.random_bool(0.6) { 0 } else { random.random_range(0..layout.supports.len()) };
    // At least one particle is to be free.
    let mut particles = layout.supports[choice].clone();
    particles.truncate(layout.points.len() - 1);
    let mut entries = vec![ConstraintEntry { particles: particles.clone(), ..ConstraintEntry::default() }];
    if layout.dimension > 1 && random.random_bool(0.1) {
        let axes = [AxisName::X, AxisName::Y, AxisName::Z];
        let one = axes[random.random_range(0..layout.dimension)];
        entries[0].axes = Some(vec![one]);
    }
    let size = spacing * log_uniform(0.05, 1.5, random);
    let row = |v: [f64; 3]| Row::of(&v.into(), layout.dimension);
    let way = |random: &mut _| {
        let mut v = [0.0; 3];
        v[..layout.dimension].fill_with(|| size * RngExt::random_range(random, -1.0..1.0));
        v
    };
    // The motion belongs to the last support alone where there are several, so that it deforms what it moves.
    let moving = if particles.len() > 1 && random.random_bool(0.5) {
        particles.split_off(particles.len() - 1)
    } else {
        particles
    };
    let mut entry = ConstraintEntry { particles: moving, axes: entries[0].axes.clone(), ..ConstraintEntry::default() };
    match random.random_range(0..10) {
        0..6 => return entries,
        6..8 => entry.velocity = Some(row(way(random).map(|v| v / duration))),
        _ => {
            let corners = random.random_range(2..=5);
            let mut times: Vec<f64> = (0..corners).map(|_| duration * random.random_range(0.0..0.95)).collect();
            times.sort_by(f64::total_cmp);
            // Corners nearer than a hundredth of the run would be blows.
            times.dedup_by(|later, earlier| *later - *earlier < 0.02 * duration);
            let mut offsets: Vec<Row> = times.iter().map(|_| row(way(random))).collect();
            offsets[0] = row([0.0; 3]);
            entry.path = Some(Path { times, offsets });
        }
    }
    entries.push(entry);
    entries
}

fn log_uniform(low: f64, high: f64, random: &mut impl Rng) -> f64 {
    if low >= high { low } else { random.random_range(low.ln()..high.ln()).exp() }
}

/// A unit vector in a space of n coordinates, or its first ones: for perturbations.
pub fn direction(n: usize, seed: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Box and Muller's normal numbers point in every direction equally often.
    let mut normal = || {
        let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random_range(0.0..TAU));
        (-2.0 * u.ln()).sqrt() * v.cos()
    };
    let mut all: Vec<f64> = (0..n).map(|_| normal()).collect();
    let norm = all.iter().map(|c| c * c).sum::<f64>().sqrt();
    all.iter_mut().for_each(|c| *c /= norm.max(f64::MIN_POSITIVE));
    all
}
