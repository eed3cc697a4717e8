//! Ready scenes of any size, made by formula.
//!
//! All use SI units, start at rest unless they say otherwise, and have no time step. The vertical axis is y. A size outside
//! [`Kind::sizes`] is an [`Error::Scene`].

use super::{ConstraintEntry, Particles, Row, Scene, Springs, TimeSettings, Values};
use crate::error::{Error, Result};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rstar::RTree;
use rstar::primitives::GeomWithData;
use std::f64::consts::PI;
use std::ops::RangeInclusive;

/// The standard acceleration of free fall downwards, rounded, in m/s².
const GRAVITY: [f64; 3] = [0.0, -9.81, 0.0];

/// The kinds of ready scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[non_exhaustive]
pub enum Kind {
    /// A chain of SIZE links, held at one end and let go from the horizontal.
    Chain,
    /// A square cloth of SIZE × SIZE particles that swings down from two corners.
    Cloth,
    /// A cantilever block of SIZE × SIZE × SIZE particles that bends under its weight.
    Lattice,
    /// A straight column of SIZE joints, compressed between two held ends, that buckles.
    Column,
    /// A stiff pendulum of SIZE bobs in the plane, let go from the horizontal.
    Pendulum,
    /// A taut string of SIZE particles in the plane, struck in its lowest mode.
    String,
    /// A random network of SIZE particles with all values unequal, hung by its highest particles.
    Network,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 7] =
        [Self::Chain, Self::Cloth, Self::Lattice, Self::Column, Self::Pendulum, Self::String, Self::Network];

    /// The kind's name, also that of its scenes.
    pub fn name(self) -> &'static str {
        self.figures().0
    }

    /// A size that shows the kind's behaviour and runs in a moment.
    pub fn default_size(self) -> usize {
        self.figures().1
    }

    /// The valid sizes: up to about 10⁶ particles.
    pub fn sizes(self) -> RangeInclusive<usize> {
        1..=self.figures().2
    }

    /// Name, default size and largest size.
    fn figures(self) -> (&'static str, usize, usize) {
        match self {
            Self::Chain => ("chain", 20, 1_000_000),
            Self::Cloth => ("cloth", 20, 1000),
            Self::Lattice => ("lattice", 8, 100),
            Self::Column => ("column", 9, 1_000_000),
            Self::Pendulum => ("pendulum", 1, 1000),
            Self::String => ("string", 31, 1_000_000),
            Self::Network => ("network", 60, 1_000_000),
        }
    }

    fn check_size(self, size: usize) -> Result<()> {
        let (name, _, most) = self.figures();
        if (1..=most).contains(&size) {
            return Ok(());
        }
        Err(Error::Scene(format!("size {size}: a {name} can have a size from 1 to {most}")))
    }

    /// A scene under gravity with equal masses, in kg, stiffnesses, in N, and dampings, in N·s/m; rest lengths are the distances.
    fn scene(
        self,
        positions: impl Iterator<Item = Row>,
        pairs: Vec<[u32; 2]>,
        [mass, stiffness, damping]: [f64; 3],
        held: impl IntoIterator<Item = usize>,
        duration: f64,
    ) -> Scene {
        Scene {
            name: self.name().into(),
            gravity: Some(GRAVITY.into()),
            particles: Particles { positions: positions.collect(), masses: Some(mass.into()), ..Particles::default() },
            springs: Springs {
                pairs,
                stiffness: Some(stiffness.into()),
                damping: (damping > 0.0).then(|| damping.into()),
                ..Springs::default()
            },
            constraints: vec![ConstraintEntry {
                particles: held.into_iter().map(|p| p as u32).collect(),
                ..ConstraintEntry::default()
            }],
            time: TimeSettings { dt: None, duration: Some(duration) },
            ..Scene::default()
        }
    }
}

/// The scene of a kind and size; a random one is made with seed 0.
///
/// # Errors
/// [`Error::Scene`] for a size outside [`Kind::sizes`].
pub fn builtin(kind: Kind, size: usize) -> Result<Scene> {
    match kind {
        Kind::Chain => chain(size),
        Kind::Cloth => cloth(size),
        Kind::Lattice => lattice(size),
        Kind::Column => column(size),
        Kind::Pendulum => pendulum(size),
        Kind::String => string(size),
        Kind::Network => network(size, 0),
    }
}

/// Neighbours in a row of particles: (0, 1), (1, 2), …
fn links(count: usize) -> Vec<[u32; 2]> {
    (0..count as u32).map(|i| [i, i + 1]).collect()
}

/// A chain of `size` links of 5 cm and 10 g, held at one end and let go from the horizontal, for 2 s. k = 100 N, so that a link stretches by 0.1 % for
/// each link below it; b = 0.02 N·s/m.
pub fn chain(size: usize) -> Result<Scene> {
    Kind::Chain.check_size(size)?;
    let positions = (0..=size).map(|i| [i as f64 / 20.0, 0.0, 0.0].into());
    Ok(Kind::Chain.scene(positions, links(size), [0.01, 100.0, 0.02], [0], 2.0))
}

/// A square cloth of `size` × `size` particles, 5 cm apart, that swings down from two corners, for 2 s. Particle (row, column) has number
/// row·size + column.
///
/// Structural springs join neighbours, shear springs the diagonals, bend springs every second particle, all with k = 1250 N and b = 0.05 N·s/m. A
/// particle has 0.5 g, of 0.2 kg/m²; (k/l0)·dt²/m is 5000 for the structural springs and steps of 10 ms.
pub fn cloth(size: usize) -> Result<Scene> {
    Kind::Cloth.check_size(size)?;
    let particle = |[row, column]: [usize; 2]| (row < size && column < size).then_some((row * size + column) as u32);
    let grid = || (0..size).flat_map(|row| (0..size).map(move |column| (row, column)));
    let mut pairs = Vec::with_capacity(6 * size * size);
    for (row, column) in grid() {
        let ends = [
            ([row, column], [row, column + 1]),
            ([row, column], [row + 1, column]),
            ([row, column], [row, column + 2]),
            ([row, column], [row + 2, column]),
            ([row, column], [row + 1, column + 1]),
            ([row, column + 1], [row + 1, column]),
        ];
        pairs.extend(ends.iter().filter_map(|&(i, j)| Some([particle(i)?, particle(j)?])));
    }
    let positions = grid().map(|(row, column)| [column as f64 / 20.0, 0.0, row as f64 / 20.0].into());
    let held = if size > 1 { vec![0, size - 1] } else { vec![0] };
    Ok(Kind::Cloth.scene(positions, pairs, [0.0005, 1250.0, 0.05], held, 2.0))
}

/// A block of `size` × `size` × `size` particles, 1 cm apart, held at its face x = 0: a cantilever of firm jelly that bends under its weight.
///
/// Structural springs join neighbours, others the diagonals of the faces of every cell, all with k = 4 N and b = 0.002 N·s/m; 1000 kg/m³ make 1 g a
/// particle. For 1 s. Particle (i, j, l) has number (i·size + j)·size + l.
pub fn lattice(size: usize) -> Result<Scene> {
    /// Half of the neighbours: the others follow by symmetry.
    const OFFSETS: [[isize; 3]; 9] =
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [0, 1, -1], [1, 0, 1], [1, 0, -1], [1, 1, 0], [1, -1, 0]];
    Kind::Lattice.check_size(size)?;
    let shifted = |coordinate: usize, by: isize| coordinate.checked_add_signed(by).filter(|&end| end < size);
    let number = |[i, j, l]: [usize; 3]| ((i * size + j) * size + l) as u32;
    let grid = || (0..size * size * size).map(|p| [p / (size * size), p / size % size, p % size]);
    let mut pairs = Vec::with_capacity(9 * size * size * size);
    for at @ [i, j, l] in grid() {
        for [di, dj, dl] in OFFSETS {
            if let (Some(i), Some(j), Some(l)) = (shifted(i, di), shifted(j, dj), shifted(l, dl)) {
                pairs.push([number(at), number([i, j, l])]);
            }
        }
    }
    let positions = grid().map(|at| at.map(|coordinate| coordinate as f64 / 100.0).into());
    Ok(Kind::Lattice.scene(positions, pairs, [0.001, 4.0, 0.002], 0..size * size, 1.0))
}

/// A column of `size` joints between two held ends, its links compressed by 5 %: it buckles into a zigzag.
///
/// The links are 9.5 cm long and 10 cm at rest, with k = 1000 N and b = 1 N·s/m; a joint has 0.1 kg, and is 0.1 mm off the axis, alternately in x and
/// in −x, so that buckling does not wait for rounding. With c = k (1/l − 1/l0) = 526 N/m the matrix with the whole stiffness is definite up to about
/// dt = sqrt(m/(c (2 + 2 cos(π/(size + 1))))) ≥ 6.9 ms and indefinite beyond. For 0.5 s.
pub fn column(size: usize) -> Result<Scene> {
    Kind::Column.check_size(size)?;
    let last = size + 1;
    let sideways = |i| match i {
        _ if i == 0 || i == last => 0.0,
        i if i % 2 == 0 => -0.0001,
        _ => 0.0001,
    };
    let positions = (0..=last).map(|i| [sideways(i), 19.0 * i as f64 / 200.0, 0.0].into());
    let mut scene = Kind::Column.scene(positions, links(last), [0.1, 1000.0, 1.0], [0, last], 0.5);
    scene.springs.rest_lengths = Some(0.1.into());
    Ok(scene)
}

/// A pendulum of `size` bobs in the plane, let go from the horizontal: one bob is the simple pendulum, two the double one.
///
/// The rods are 1 m long with k = 10⁴ N and undamped, a bob has 1 kg: the axial mode of one bob, ω = sqrt(k/(l0 m)) =
/// 100 rad/s, is 32 times as fast as the swing, sqrt(g/l) = 3.1 rad/s. For 4 s.
pub fn pendulum(size: usize) -> Result<Scene> {
    Kind::Pendulum.check_size(size)?;
    let positions = (0..=size).map(|i| [i as f64, 0.0].into());
    let scene = Kind::Pendulum.scene(positions, links(size), [1.0, 10_000.0, 0.0], [0], 4.0);
    let [x, y, _] = GRAVITY;
    Ok(Scene { gravity: Some([x, y].into()), ..scene })
}

/// A string of `size` particles in the plane, stretched by 10 % between two held ends and struck in its lowest mode.
///
/// It is 1 m long with 10 g/m and k = 10 N, which makes a tension of 1 N and waves of 10 m/s: a period of 0.2 s. There is no gravity and no damping.
/// The initial velocity is 0.5 m/s·sin(πs) across the string, which deflects it by 16 mm. For two periods.
pub fn string(size: usize) -> Result<Scene> {
    Kind::String.check_size(size)?;
    let last = size + 1;
    let links_per_metre = last as f64;
    // At rest to the last bit at the ends.
    let speed = |i| if i == 0 || i == last { 0.0 } else { 0.5 * (PI * i as f64 / links_per_metre).sin() };
    let positions = (0..=last).map(|i| [i as f64 / links_per_metre, 0.0].into());
    let parameters = [0.01 / links_per_metre, 10.0, 0.0];
    let mut scene = Kind::String.scene(positions, links(last), parameters, [0, last], 0.4);
    scene.particles.velocities = Some((0..=last).map(|i| [0.0, speed(i)].into()).collect());
    scene.springs.rest_lengths = Some((1.0 / (1.1 * links_per_metre)).into());
    Ok(Scene { gravity: None, ..scene })
}

/// A random geometric graph of `size` particles in the unit cube, hung by its highest tenth: no two values are alike.
///
/// A spring joins each two particles nearer than the radius within which 10 others are expected. Masses are 5 g to 15 g, stiffnesses 20 N to 60 N,
/// dampings up to 0.05 N·s/m, and the springs are up to 10 % shorter or longer than at rest. Parts may be disconnected, and fall. For 1 s.
pub fn network(size: usize, seed: u64) -> Result<Scene> {
    Kind::Network.check_size(size)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Rounded to a millionth, to be short in a file.
    let short = |value: f64| (value * 1e6).round() / 1e6;
    let positions: Vec<[f64; 3]> = (0..size).map(|_| [(); 3].map(|()| short(random.random_range(0.0..1.0)))).collect();
    let numbered = positions.iter().zip(0u32..).map(|(&x, number)| GeomWithData::new(x, number)).collect();
    let tree = RTree::bulk_load(numbered);
    // The ball of this radius holds 10 of `size` particles spread over a unit volume.
    let radius = (10.0 / (size as f64 * 4.0 / 3.0 * PI)).cbrt();
    let (mut pairs, mut lengths) = (Vec::new(), Vec::new());
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
    let mut short_values = |count, low, high| Values::Each(values(count, low, high).into_iter().map(short).collect());
    let masses = short_values(size, 0.005, 0.015);
    let stiffness = short_values(pairs.len(), 20.0, 60.0);
    let damping = short_values(pairs.len(), 0.0, 0.05);
    let ratios = values(pairs.len(), 0.9, 1.1);
    let mut highest: Vec<usize> = (0..size).collect();
    highest.sort_by(|&a, &b| positions[b][1].total_cmp(&positions[a][1]));
    highest.truncate(size.div_ceil(10));
    highest.sort_unstable();
    let mut scene = Kind::Network.scene(positions.into_iter().map(Row::from), pairs, [0.0; 3], highest, 1.0);
    scene.particles.masses = Some(masses);
    scene.springs.stiffness = Some(stiffness);
    scene.springs.rest_lengths = Some(Values::Each(lengths.iter().zip(ratios).map(|(l, a)| short(l * a)).collect()));
    scene.springs.damping = Some(damping);
    Ok(scene)
}

/// The scene of a kind and its [default size](Kind::default_size), in a mesh of `size`: of the same extent, mass and elasticity.
///
/// With s the ratio of the mesh widths, and in d dimensions (1 for chains, columns and strings, 2 for cloths, 3 for lattices), lengths are as s, masses
/// as s^d, and of springs, which stand for the material around them, the stiffness k as s^(d − 1) and the damping b as s^(d − 2). The particles at the
/// edges have full masses, by which a mesh is a little heavier than a continuum.
///
/// # Errors
/// [`Error::Scene`] for a size outside [`Kind::sizes`], for a single particle, and for pendulums and networks, which are no meshes.
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin, refined};
///
/// let width = |scene: &sprung::Scene| scene.particles.positions.last().map(|last| last.as_slice()[0]);
/// let (coarse, fine) = (builtin(Kind::Cloth, 20)?, refined(Kind::Cloth, 39)?);
/// assert_eq!(fine.particles.positions.len(), 39 * 39);
/// assert_eq!(width(&coarse), width(&fine)); // 0.95 m
/// # Ok::<(), sprung::Error>(())
/// ```
pub fn refined(kind: Kind, size: usize) -> Result<Scene> {
    let mut scene = builtin(kind, size)?;
    // A side of N particles has N − 1 mesh widths, one of N links has N, and N joints are between N + 1.
    let (dimensions, widths): (i32, fn(usize) -> usize) = match kind {
        // It is 1 m long, whatever its size.
        Kind::String => return Ok(scene),
        Kind::Chain => (1, |links| links),
        Kind::Column => (1, |joints| joints + 1),
        Kind::Cloth => (2, |particles| particles - 1),
        Kind::Lattice => (3, |particles| particles - 1),
        Kind::Pendulum | Kind::Network => {
            return Err(Error::Scene(format!("a {} is no mesh that could be refined", kind.name())));
        }
    };
    if widths(size) == 0 {
        return Err(Error::Scene(format!("size {size}: a single particle has no extent")));
    }
    let ratio = widths(kind.default_size()) as f64 / widths(size) as f64;
    for row in &mut scene.particles.positions {
        *row = Row::of(&(row.vector() * ratio), row.dimension());
    }
    for (values, power) in [
        (&mut scene.particles.masses, dimensions),
        (&mut scene.springs.rest_lengths, 1),
        (&mut scene.springs.stiffness, dimensions - 1),
        (&mut scene.springs.damping, dimensions - 2),
    ] {
        // Scenes of a mesh have one number for all.
        if let Some(Values::Uniform(value)) = values {
            *value *= ratio.powi(power);
        }
    }
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The held ends are at rest to the last bit, and the middle is the fastest.
    #[test]
    fn the_ends_of_a_string_are_at_rest() {
        let velocities = string(5).unwrap().particles.velocities.unwrap();
        let speeds: Vec<f64> = velocities.iter().map(|row| row.as_slice()[1]).collect();
        assert_eq!([speeds[0], speeds[3], speeds[6]], [0.0, 0.5, 0.0]);
    }

    /// Extents do; mass, stiffness and damping of a side change by its dimension.
    #[test]
    fn materials_stay() {
        for (kind, size, dimensions) in
            [(Kind::Chain, 40, 1), (Kind::Column, 19, 1), (Kind::Cloth, 39, 2), (Kind::Lattice, 15, 3)]
        {
            let [coarse, fine] = [builtin(kind, kind.default_size()), refined(kind, size)].map(Result::unwrap);
            let number = |values: &Option<Values>| values.as_ref().unwrap().get(0);
            let ratio = |get: fn(&Scene) -> &Option<Values>| number(get(&fine)) / number(get(&coarse));
            let close =
                |found: f64, power: i32| assert!((found / 0.5f64.powi(power) - 1.0).abs() < 1e-12, "{kind:?} {found}");
            close(ratio(|scene| &scene.particles.masses), dimensions);
            close(ratio(|scene| &scene.springs.stiffness), dimensions - 1);
            close(ratio(|scene| &scene.springs.damping), dimensions - 2);
            let [from, to] = [&coarse, &fine].map(|scene| scene.particles.positions.last().unwrap().vector());
            assert!((from - to).norm() < 1e-12, "{kind:?} has another extent");
        }
        assert!(refined(Kind::Pendulum, 3).is_err() && refined(Kind::Network, 50).is_err());
        assert!(refined(Kind::Cloth, 1).is_err() && refined(Kind::Cloth, 0).is_err());
        assert_eq!(refined(Kind::String, 9).unwrap(), builtin(Kind::String, 9).unwrap());
    }
}
