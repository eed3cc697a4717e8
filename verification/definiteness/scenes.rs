//! Random scenes with indefinite matrices, one for each seed, the same on every machine.

use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::scene::{Kind, builtin};
use sprung::{Constraint, Spring, State, System, SystemBuilder};

/// Kinds of scenes; a seed has the kind of its remainder.
pub const KINDS: [&str; 5] = ["thrown about", "pressed by half", "hung", "stretched", "ready scene"];

/// A scene: its name, its system and start, and the time in which a wave passes a spring, √(m l0/k), in s.
pub struct Drawn {
    pub name: String,
    pub system: System,
    pub state: State,
    pub spring_time: f64,
}

/// Places one rest length apart, and pairs.
struct Layout {
    name: &'static str,
    places: Vec<Vector3<f64>>,
    pairs: Vec<[usize; 2]>,
}

/// A block of i × j × k particles with springs along edges and, where braced, across faces.
fn block(name: &'static str, [ni, nj, nk]: [usize; 3], is_braced: bool) -> Layout {
    let number = |[i, j, k]: [usize; 3]| (k * nj + j) * ni + i;
    let (mut places, mut pairs) = (Vec::new(), Vec::new());
    let offsets = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]];
    for k in 0..nk {
        for j in 0..nj {
            for i in 0..ni {
                places.push(Vector3::new(i as f64, j as f64, k as f64));
                for [a, b, c] in offsets.into_iter().take(if is_braced { 6 } else { 3 }) {
                    if i + a < ni && j + b < nj && k + c < nk {
                        pairs.push([number([i, j, k]), number([i + a, j + b, k + c])]);
                    }
                }
            }
        }
    }
    Layout { name, places, pairs }
}

/// A number between two, by its logarithm.
pub fn logarithmic(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

/// The random numbers of a seed.
pub fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed ^ 0x4465_6669_6e69_7465)
}

/// The scene of a seed, of about 10 to 150 particles.
pub fn scene(seed: u64) -> sprung::Result<Drawn> {
    let rng = &mut random(seed);
    let kind = (seed % KINDS.len() as u64) as usize;
    if kind == 4 {
        return ready(rng);
    }
    let side = |rng: &mut ChaCha8Rng, low: usize, high: usize| rng.random_range(low..=high);
    let is_braced = rng.random_bool(0.7);
    let layout = match rng.random_range(0..3) {
        0 => block("cloth", [side(rng, 4, 12), side(rng, 4, 12), 1], is_braced),
        1 => block("lattice", [side(rng, 2, 5), side(rng, 2, 5), side(rng, 2, 5)], is_braced),
        _ => block("strip", [side(rng, 6, 40), side(rng, 1, 3), 1], is_braced),
    };
    let stiffness = logarithmic(rng, 10.0, 1e4);
    let spread = [1.0, 1.0, 3.0][rng.random_range(0..3)];
    let mass = logarithmic(rng, 0.01, 1.0);
    let mut builder = SystemBuilder::new();
    let last = layout.places.iter().fold(0.0, |last: f64, x| last.max(x.x));
    // (x, y, z) by the kind: whole rest lengths at random, half of x, flat with creases, twice x.
    let [scale, noise] = [[1.0, 1.0], [0.5, 0.02], [1.0, 0.01], [2.0, 0.02]][kind];
    for x in &layout.places {
        let moved = Vector3::from_fn(|_, _| noise * rng.random_range(-1.0..1.0));
        let place = Vector3::new(x.x * scale, x.y, x.z) + moved;
        builder.particle(place.into(), mass * logarithmic(rng, 1.0 / spread, spread + 1e-9));
    }
    for &[i, j] in &layout.pairs {
        let rest_length = (layout.places[i] - layout.places[j]).norm();
        let k = stiffness * logarithmic(rng, 1.0 / spread, spread + 1e-9);
        builder.spring(i, j, Spring { stiffness: k, rest_length, damping: 0.0 });
    }
    let held = |at: &dyn Fn(&Vector3<f64>) -> bool| -> Vec<usize> {
        layout.places.iter().enumerate().filter(|(_, x)| at(x)).map(|(p, _)| p).collect()
    };
    match kind {
        // Free, or on one particle.
        0 if rng.random_bool(0.5) => {}
        0 => drop(builder.hold(0)),
        2 => drop(builder.constrain(Constraint::hold(held(&|x| x.y == 0.0 && (x.x == 0.0 || x.x == last))))),
        _ => drop(builder.constrain(Constraint::hold(held(&|x| x.x == 0.0 || x.x == last)))),
    }
    if kind == 2 || rng.random_bool(0.3) {
        let g = stiffness / mass * logarithmic(rng, 1e-3, 0.1);
        builder.gravity(0.0, 0.0, -g);
    }
    let (system, state) = builder.build()?;
    Ok(Drawn {
        name: format!("{}, {}", layout.name, KINDS[kind]),
        system,
        state,
        spring_time: (mass / stiffness).sqrt(),
    })
}

/// A small ready scene, its particles moved by up to a tenth of a spring.
fn ready(rng: &mut ChaCha8Rng) -> sprung::Result<Drawn> {
    let kind = Kind::ALL[rng.random_range(0..Kind::ALL.len())];
    let size = rng.random_range(3..=6).clamp(*kind.sizes().start(), *kind.sizes().end());
    let (system, mut state) = builtin(kind, size)?.build()?;
    let springs = system.springs();
    let mean = |of: &dyn Fn(&Spring) -> f64| springs.iter().map(of).sum::<f64>() / springs.len().max(1) as f64;
    let length = mean(&|spring| spring.gauge_length());
    for (p, x) in state.positions.iter_mut().enumerate() {
        for axis in system.dofs().free_axes(p).iter() {
            x[axis] += 0.1 * length * rng.random_range(-1.0..1.0);
        }
    }
    let mass = system.masses().iter().sum::<f64>() / system.particles() as f64;
    let spring_time = (mass / mean(&|spring| spring.axial_stiffness())).sqrt();
    Ok(Drawn { name: kind.name().into(), system, state, spring_time })
}
