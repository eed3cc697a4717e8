//! The formulas of springs, forces and matrices, written a second time as plainly as possible, for checks to compare with.
//!
//! Nothing here is shared with the code under test. Vectors are full-length, one 3-vector a particle, prescribed or not;
//! K^s and the damping block are 3×3 matrices; sums go in the order of the springs.

use super::TestCase;
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, State, System};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// One spring at a configuration: its number, its ends, `d = x_i − x_j`, `n = d/l`, `l`, and the numbers k, l0, b.
///
/// Its force is `f = −a d + c n`, of which only the second part is curved: `a = k/l0` and `c = k`, or `a = k` and `c = 0` without a rest length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    pub index: usize,
    pub ends: [usize; 2],
    pub separation: Vector3<f64>,
    pub direction: Vector3<f64>,
    pub length: f64,
    /// a, in N/m.
    pub axial: f64,
    /// c, in N.
    pub curved: f64,
    pub rest_length: f64,
    pub damping: f64,
}

impl Link {
    pub fn new(index: usize, ends: [usize; 2], spring: Spring, separation: Vector3<f64>, length: f64) -> Self {
        let Spring { stiffness, rest_length, damping } = spring;
        let (axial, curved) = if rest_length > 0.0 { (stiffness / rest_length, stiffness) } else { (stiffness, 0.0) };
        Self { index, ends, separation, direction: separation / length, length, axial, curved, rest_length, damping }
    }

    pub fn elongation(&self) -> f64 {
        self.length - self.rest_length
    }

    /// The vector of the first end less that of the second.
    pub fn difference(&self, vectors: &[Vector3<f64>]) -> Vector3<f64> {
        vectors[self.ends[0]] - vectors[self.ends[1]]
    }

    /// `−a (l − l0) n`, on the first end.
    pub fn elastic_force(&self) -> Vector3<f64> {
        self.direction * (-self.axial * self.elongation())
    }

    /// `a (1 − l0/l)`, zero where the option drops it: never without a rest length.
    pub fn transverse(&self, option: Stiffness) -> f64 {
        let exact = self.axial * self.elongation() / self.length;
        match option {
            Stiffness::Full => exact,
            Stiffness::Tension => exact.max(0.0),
            Stiffness::Axial if self.rest_length == 0.0 => exact,
            Stiffness::Axial => 0.0,
            Stiffness::Absolute => exact.abs(),
        }
    }

    /// `K^s = a (1 − l0/l)(I − nnᵀ) + a nnᵀ`.
    pub fn stiffness_block(&self, option: Stiffness) -> Matrix3<f64> {
        let along = self.direction * self.direction.transpose();
        (Matrix3::identity() - along) * self.transverse(option) + along * self.axial
    }

    pub fn damping_block(&self) -> Matrix3<f64> {
        self.direction * self.direction.transpose() * self.damping
    }

    /// The largest possible entry of K^s, or of a part of it before terms cancel.
    pub fn magnitude(&self) -> f64 {
        self.axial + self.curved / self.length
    }

    /// Whether the spring is so short that the rounding of its direction goes in large jumps.
    pub fn is_collapsed(&self) -> bool {
        self.length < 0.01 * self.rest_length
    }
}

/// All springs of a system at some positions, those between prescribed particles included.
pub(super) fn links(system: &System, positions: &[Vector3<f64>]) -> Vec<Link> {
    let link = |(index, (pair, &spring)): (usize, (&[u32; 2], &Spring))| {
        let ends = pair.map(|p| p as usize);
        let separation = positions[ends[0]] - positions[ends[1]];
        let length = (separation.x * separation.x + separation.y * separation.y + separation.z * separation.z).sqrt();
        Link::new(index, ends, spring, separation, length)
    };
    system.pairs().iter().zip(system.springs()).enumerate().map(link).collect()
}

/// The springs with a free end.
pub(super) fn active_links(system: &System, positions: &[Vector3<f64>]) -> Vec<Link> {
    let all = links(system, positions);
    system.active_springs().iter().map(|&spring| all[spring as usize]).collect()
}

/// `Σ f` over the springs: f on the first end, −f on the second.
pub(super) fn sum(links: &[Link], particles: usize, force: impl Fn(&Link) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut total = vec![Vector3::zeros(); particles];
    for link in links {
        let f = force(link);
        total[link.ends[0]] += f;
        total[link.ends[1]] -= f;
    }
    total
}

/// `K w` at the links' configuration.
pub(super) fn stiffness_product(links: &[Link], option: Stiffness, w: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    sum(links, w.len(), |link| -link.stiffness_block(option) * link.difference(w))
}

/// `G w` at the links' configuration; with velocities for w this is f_d.
pub(super) fn damping_product(links: &[Link], w: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    sum(links, w.len(), |link| -link.damping_block() * link.difference(w))
}

/// Sums over the springs of every particle.
pub(super) fn sizes(links: &[Link], particles: usize, size: impl Fn(&Link) -> f64) -> Vec<f64> {
    let mut total = vec![0.0; particles];
    for link in links {
        let size = size(link);
        link.ends.iter().for_each(|&p| total[p] += size);
    }
    total
}

/// `|K| |w|` particle by particle: the sum of the magnitudes of all terms of `K w`.
pub(super) fn magnitude(links: &[Link], block: impl Fn(&Link) -> f64, w: &[Vector3<f64>]) -> Vec<f64> {
    sizes(links, w.len(), |link| block(link) * (w[link.ends[0]].norm() + w[link.ends[1]].norm()))
}

/// `Σ a (l + l0)` particle by particle: the magnitudes in f_el before they cancel, in N.
pub(super) fn pull(links: &[Link], particles: usize) -> Vec<f64> {
    sizes(links, particles, |link| link.axial * (link.length + link.rest_length))
}

/// `A = M/dt² − G/dt − K` over the free degrees of freedom as a dense matrix.
pub(super) fn dense_step_matrix(case: &TestCase, option: Stiffness, dt: f64) -> DMatrix<f64> {
    let TestCase { system, state, .. } = case;
    let n = 3 * system.particles();
    let mut whole = DMatrix::zeros(n, n);
    for (p, mass) in system.masses().iter().enumerate() {
        for axis in 0..3 {
            whole[(3 * p + axis, 3 * p + axis)] += mass / (dt * dt);
        }
    }
    for link in links(system, &state.positions) {
        let block = link.stiffness_block(option) + link.damping_block() / dt;
        let [i, j] = link.ends;
        for (p, q, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            let mut part = whole.fixed_view_mut::<3, 3>(3 * p, 3 * q);
            part += block * sign;
        }
    }
    let free: Vec<usize> = system.dofs().iter().map(|dof| 3 * dof.particle + dof.axis).collect();
    DMatrix::from_fn(free.len(), free.len(), |row, column| whole[(free[row], free[column])])
}

/// The largest sum of magnitudes in a row of A, at least `‖A‖∞`, over the particles that move: a held one is in no matrix.
pub(super) fn step_matrix_norm(case: &TestCase, state: &State, dt: f64) -> f64 {
    let system = &case.system;
    // A row of a 3×3 block of norm β sums up to at most √3 β, once on the diagonal and once beside it.
    let size = |link: &Link| 2.0 * 3f64.sqrt() * (link.magnitude() + link.damping / dt);
    let rows = sizes(&links(system, &state.positions), system.particles(), size);
    movers(system).map(|p| system.masses()[p] / (dt * dt) + rows[p]).fold(0.0, f64::max)
}

/// Particles with a free coordinate.
pub(super) fn movers(system: &System) -> impl Iterator<Item = usize> + '_ {
    (0..system.particles()).filter(|&p| system.dofs().free_axes(p) != Axes::NONE)
}

/// The smallest mass of a particle that moves, in kg.
pub(super) fn lightest(system: &System) -> f64 {
    movers(system).map(|p| system.masses()[p]).fold(f64::INFINITY, f64::min)
}

/// A field of vectors without symmetry: no component along a modelled axis is zero, no two are alike, all are at most 1.
pub(super) fn field(system: &System) -> Vec<Vector3<f64>> {
    // Multiples of the golden ratio, modulo 1, are spread evenly and never repeat.
    let spread = |n: usize| 2.0 * ((n as f64 * 0.618_033_988_749_895) % 1.0) - 1.0;
    let vector = |p| Vector3::from_fn(|axis, _| spread(3 * p + axis + 1));
    (0..system.particles()).map(|p| Axes::first(system.dimension()).project(&vector(p))).collect()
}
