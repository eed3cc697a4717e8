//! Where particles are and which are joined, in units of the typical distance between neighbours.

use rand::{Rng, RngExt};
use std::collections::BTreeSet;

/// The kind of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Shape {
    /// Random points, joined to their neighbours.
    Network,
    /// A rectangular sheet, with or without diagonals.
    Cloth,
    /// One particle after the other.
    Chain,
    /// A few stiff rods: pendulums, double pendulums, triangles.
    Rod,
    /// A block or a truss with diagonals.
    Lattice,
    /// A slender mast with bracing, or a straight row under load.
    Column,
}

impl Shape {
    /// Every shape, in the order in which seeds go through them.
    pub const ALL: [Self; 6] = [Self::Network, Self::Cloth, Self::Chain, Self::Rod, Self::Lattice, Self::Column];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Network => "network",
            Self::Cloth => "cloth",
            Self::Chain => "chain",
            Self::Rod => "rod",
            Self::Lattice => "lattice",
            Self::Column => "column",
        }
    }
}

/// Particles and pairs, and which particles it is natural to hold.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Modelled axes.
    pub dimension: usize,
    /// One point per particle; absent axes are zero.
    pub points: Vec<[f64; 3]>,
    /// Ends of springs.
    pub pairs: Vec<[u32; 2]>,
    /// Groups of particles that may be held, the usual choice first.
    pub supports: Vec<Vec<u32>>,
}

/// A random layout of a shape. `large` asks for one of hundreds of particles.
pub fn layout(shape: Shape, large: bool, random: &mut impl Rng) -> Layout {
    match shape {
        Shape::Network => network(large, random),
        Shape::Cloth => cloth(large, random),
        Shape::Chain => chain(large, random),
        Shape::Rod => rod(random),
        Shape::Lattice => lattice(large, random),
        Shape::Column => column(large, random),
    }
}

fn network(large: bool, random: &mut impl Rng) -> Layout {
    let dimension = random.random_range(1..=3);
    let count = if large { random.random_range(80..=200) } else { random.random_range(2..=30) };
    // As many points as unit cells, so that neighbours are about 1 apart; none nearer than a quarter.
    let side = (count as f64).powf(1.0 / dimension as f64);
    let mut points: Vec<[f64; 3]> = Vec::new();
    while points.len() < count {
        let mut point = [0.0; 3];
        point[..dimension].fill_with(|| random.random_range(0.0..side));
        if points.iter().all(|other| distance(&point, other) > 0.25) {
            points.push(point);
        } else if dimension == 1 {
            // A line fills up: the next point goes beyond its end.
            let end = points.iter().map(|p| p[0]).fold(0.0, f64::max);
            points.push([end + random.random_range(0.3..1.0), 0.0, 0.0]);
        }
    }
    let neighbours = if dimension == 1 { random.random_range(1..=2) } else { random.random_range(2..=5) };
    let mut pairs = BTreeSet::new();
    for i in 0..count {
        let mut others: Vec<usize> = (0..count).filter(|&j| j != i).collect();
        others.sort_by(|&a, &b| distance(&points[i], &points[a]).total_cmp(&distance(&points[i], &points[b])));
        // A spanning tree, so that nothing is loose, and the nearest neighbours.
        pairs.extend(others.iter().find(|&&j| j < i).map(|&j| ordered(i, j)));
        pairs.extend(others.iter().take(neighbours).map(|&j| ordered(i, j)));
    }
    let mut by_height: Vec<u32> = (0..count as u32).collect();
    let height = dimension.min(2) - 1;
    by_height.sort_by(|&a, &b| points[b as usize][height].total_cmp(&points[a as usize][height]));
    let supports = [count.div_ceil(10), 1, 2.min(count - 1)].map(|n| by_height[..n].to_vec()).to_vec();
    Layout { dimension, points, pairs: pairs.into_iter().collect(), supports }
}

fn cloth(large: bool, random: &mut impl Rng) -> Layout {
    let [n, m] = if large {
        [(); 2].map(|()| random.random_range(9..=14u32))
    } else {
        [(); 2].map(|()| random.random_range(2..=7u32))
    };
    let shear = random.random_bool(0.6);
    let index = |i: u32, j: u32| i * m + j;
    let points = (0..n).flat_map(|i| (0..m).map(move |j| [f64::from(j), 0.0, f64::from(i)])).collect();
    let mut pairs = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let steps = [(0, 1, true), (1, 0, true), (1, 1, shear)];
            for (di, dj, wanted) in steps {
                if wanted && i + di < n && j + dj < m {
                    pairs.push([index(i, j), index(i + di, j + dj)]);
                }
            }
            if shear && i + 1 < n && j > 0 {
                pairs.push([index(i, j), index(i + 1, j - 1)]);
            }
        }
    }
    let supports = vec![vec![index(0, 0), index(0, m - 1)], (0..m).collect(), vec![index(0, 0)]];
    Layout { dimension: 3, points, pairs, supports }
}

fn chain(large: bool, random: &mut impl Rng) -> Layout {
    let dimension = random.random_range(1..=3);
    let links = if large { random.random_range(60..=150u32) } else { random.random_range(1..=25) };
    let mut points = vec![[0.0; 3]];
    let straight = dimension == 1 || random.random_bool(0.5);
    for _ in 0..links {
        let last = points[points.len() - 1];
        let mut step = [random.random_range(0.7..1.3), 0.0, 0.0];
        if !straight {
            step[1..dimension].fill_with(|| random.random_range(-0.5..0.5));
        }
        points.push([0, 1, 2].map(|axis| last[axis] + step[axis]));
    }
    let pairs = (0..links).map(|i| [i, i + 1]).collect();
    let supports = vec![vec![0], vec![0, links]];
    Layout { dimension, points, pairs, supports }
}

fn rod(random: &mut impl Rng) -> Layout {
    let dimension = random.random_range(2..=3);
    let bobs = random.random_range(1..=4u32);
    let mut points = vec![[0.0; 3]];
    for _ in 0..bobs {
        let last = points[points.len() - 1];
        let angle: f64 = random.random_range(-1.6..1.6);
        let lift: f64 = if dimension == 3 { random.random_range(-0.5..0.5) } else { 0.0 };
        points.push([last[0] + angle.cos(), last[1] + angle.sin(), last[2] + lift]);
    }
    let mut pairs: Vec<_> = (0..bobs).map(|i| [i, i + 1]).collect();
    // A triangle is a rigid body.
    if bobs == 2 && random.random_bool(0.5) {
        pairs.push([0, 2]);
    }
    Layout { dimension, points, pairs, supports: vec![vec![0]] }
}

fn lattice(large: bool, random: &mut impl Rng) -> Layout {
    let dimension = random.random_range(2..=3usize);
    let most = match (large, dimension) {
        (false, 2) => 6,
        (false, _) => 4,
        (true, 2) => 12,
        (true, _) => 6,
    };
    let least = if large { most - 1 } else { 2 };
    let mut sides = [1u32; 3];
    sides[..dimension].fill_with(|| random.random_range(least..=most));
    let [nx, ny, nz] = sides;
    let index = |p: [u32; 3]| (p[0] * ny + p[1]) * nz + p[2];
    let cells = || (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    let points = cells().map(|p| p.map(f64::from)).collect();
    let mut pairs = Vec::new();
    // Edges and the diagonals of faces: every neighbour with at most two changed coordinates, each pair once.
    for p in cells() {
        for d in (0..27).map(|code| [code / 9 - 1, code / 3 % 3 - 1, code % 3 - 1]) {
            let changed = d.iter().filter(|&&step: &&i32| step != 0).count();
            let q = [0, 1, 2].map(|axis| p[axis].wrapping_add_signed(d[axis]));
            let inside = (0..3).all(|axis| q[axis] < sides[axis]);
            if (1..=2).contains(&changed) && inside && index(q) > index(p) {
                pairs.push([index(p), index(q)]);
            }
        }
    }
    let face = cells().filter(|p| p[0] == 0).map(index).collect();
    let supports = vec![face, vec![index([0, 0, 0])], vec![index([0, ny - 1, 0]), index([nx - 1, ny - 1, 0])]];
    Layout { dimension, points, pairs, supports }
}

/// Upright along y: a mast of square (or, in the plane, narrow) bays with diagonals, or a single row.
fn column(large: bool, random: &mut impl Rng) -> Layout {
    let dimension = random.random_range(2..=3usize);
    let bays = if large { random.random_range(25..=50u32) } else { random.random_range(2..=8) };
    if random.random_bool(0.4) {
        let bow = random.random_range(0.0..0.02);
        let points = (0..=bays).map(|i| {
            let s = f64::from(i) / f64::from(bays);
            [bow * (std::f64::consts::PI * s).sin() * f64::from(bays), f64::from(i), 0.0]
        });
        let pairs = (0..bays).map(|i| [i, i + 1]).collect();
        return Layout { dimension, points: points.collect(), pairs, supports: vec![vec![0, bays], vec![0]] };
    }
    let ring: &[[f64; 2]] =
        if dimension == 2 { &[[0.0, 0.0], [1.0, 0.0]] } else { &[[0.0, 0.0], [1.0, 0.0], [0.5, 0.9]] };
    let width = ring.len() as u32;
    let mut points = Vec::new();
    let mut pairs = BTreeSet::new();
    for level in 0..=bays {
        points.extend(ring.iter().map(|[x, z]| [*x, f64::from(level), *z]));
        let base = level * width;
        for a in 0..width {
            for b in 0..width {
                pairs.extend((a < b).then_some([base + a, base + b]));
                // A post, and the diagonals to the other posts.
                pairs.extend((level < bays).then_some([base + a, base + width + b]));
            }
        }
    }
    let pairs = pairs.into_iter().collect();
    Layout { dimension, points, pairs, supports: vec![(0..width).collect(), vec![0]] }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn ordered(i: usize, j: usize) -> [u32; 2] {
    [i.min(j) as u32, i.max(j) as u32]
}
