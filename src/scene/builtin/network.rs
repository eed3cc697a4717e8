use super::{Kind, gravity, hold, lasting};
use crate::error::Result;
use crate::scene::{Particles, Scene, Springs, Values};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use std::f64::consts::PI;

/// Springs that end at a particle, on average and away from the boundary.
const NEIGHBOURS: f64 = 10.0;

/// A random geometric graph of `size` particles in the unit cube, hung by its highest tenth: no two values are alike.
///
/// A spring joins each two particles nearer than the radius within which 10 others are expected. Masses are 5 g to
/// 15 g, stiffnesses 20 N to 60 N, dampings up to 0.05 N·s/m, and the springs are up to 10 % shorter or longer than at rest.
/// Parts may be disconnected, and fall. The same seed gives the same scene. For 1 s.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn network(size: usize, seed: u64) -> Result<Scene> {
    Kind::Network.check_size(size)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let positions: Vec<[f64; 3]> = (0..size).map(|_| [(); 3].map(|()| short(random.random_range(0.0..1.0)))).collect();

    let numbered = positions.iter().zip(0u32..).map(|(&x, number)| GeomWithData::new(x, number)).collect();
    let tree = RTree::bulk_load(numbered);
    // The ball of this radius holds NEIGHBOURS of `size` particles spread over a unit volume.
    let radius = (NEIGHBOURS / (size as f64 * 4.0 / 3.0 * PI)).cbrt();
    let mut pairs = Vec::new();
    let mut lengths = Vec::new();
    for (i, &x) in (0u32..).zip(&positions) {
        let from = pairs.len();
        let near = tree.locate_within_distance(x, radius * radius);
        pairs.extend(near.filter(|other| other.data > i && *other.geom() != x).map(|other| [i, other.data]));
        pairs[from..].sort_unstable();
        let ends = pairs[from..].iter().map(|&[_, j]| positions[j as usize]);
        lengths.extend(ends.map(|y| x.iter().zip(y).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()));
    }

    let mut values = |count: usize, low: f64, high: f64| -> Vec<f64> {
        (0..count).map(|_| random.random_range(low..high)).collect()
    };
    let masses = values(size, 0.005, 0.015).into_iter().map(short).collect();
    let stiffness = values(pairs.len(), 20.0, 60.0).into_iter().map(short).collect();
    let damping = values(pairs.len(), 0.0, 0.05).into_iter().map(short).collect();
    let at_rest = values(pairs.len(), 0.9, 1.1);
    let mut highest: Vec<usize> = (0..size).collect();
    highest.sort_by(|&a, &b| positions[b][1].total_cmp(&positions[a][1]));
    highest.truncate(size.div_ceil(10));
    highest.sort_unstable();
    Ok(Scene {
        name: "network".into(),
        gravity: gravity(),
        particles: Particles {
            positions: positions.into_iter().map(Into::into).collect(),
            masses: Some(Values::Each(masses)),
            ..Particles::default()
        },
        springs: Springs {
            stiffness: Some(Values::Each(stiffness)),
            rest_lengths: Some(Values::Each(lengths.iter().zip(at_rest).map(|(l, a)| short(l * a)).collect())),
            damping: Some(Values::Each(damping)),
            pairs,
            ..Springs::default()
        },
        constraints: vec![hold(highest)],
        time: lasting(1.0),
        ..Scene::default()
    })
}

/// Rounded to a millionth, to be short in a file.
fn short(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
