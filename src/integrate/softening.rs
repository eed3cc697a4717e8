//! Which transverse terms to drop so that A is positive definite for certain: few, and without a factorization.
//!
//! A compressed spring's transverse term takes `c‖P(u_i − u_j)‖²` from `uᵀAu`, with `c = k(1/l − 1/l0) > 0` and
//! `P = I − nnᵀ`. As `‖P(u_i − u_j)‖² ≤ 2‖Pu_i‖² + 2‖Pu_j‖²`, and everything else in A but `M/dt²` takes nothing, A is positive
//! definite if at every particle
//!
//! ```text
//! m_i/dt² I − Σ 2 c P  is positive definite        (c instead of 2c where the spring's other end is held),
//! ```
//!
//! the sum over the particle's compressed springs. Springs at particles where this fails lose their transverse terms, the
//! one with the largest c first, until it holds. The terms of all others, stretched or compressed, stay.

use crate::force::Extensions;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{Axes, System};
use nalgebra::{Cholesky, Matrix3};

/// A choice of transverse terms to drop; allocated once for a system.
#[derive(Debug, Clone)]
pub struct Softening {
    /// Of every active spring: `Full`, or `Tension` where its term is dropped.
    options: Vec<Stiffness>,
    /// What every active spring's transverse term takes from each of its ends that can move: 2c, or c from the only one.
    taken: Vec<f64>,
    /// The active springs of every particle: springs[starts[p]..starts[p + 1]].
    starts: Vec<u32>,
    springs: Vec<u32>,
}

impl Softening {
    /// Nothing dropped.
    pub fn new(system: &System) -> Self {
        let active = system.active_springs().len();
        let is_free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
        let mut starts = vec![0u32; system.particles() + 1];
        for (_, ends, _) in system.active() {
            ends.into_iter().filter(|&p| is_free(p)).for_each(|p| starts[p + 1] += 1);
        }
        for p in 0..system.particles() {
            starts[p + 1] += starts[p];
        }
        let mut filled = starts.clone();
        let mut springs = vec![0u32; starts.last().map_or(0, |&end| end as usize)];
        for (position, (_, ends, _)) in (0u32..).zip(system.active()) {
            for p in ends.into_iter().filter(|&p| is_free(p)) {
                springs[filled[p] as usize] = position;
                filled[p] += 1;
            }
        }
        Self { options: vec![Stiffness::Full; active], taken: vec![0.0; active], starts, springs }
    }

    /// Chooses for the matrix `combination` at the given extensions, without allocating; returns the number of terms that
    /// are dropped.
    pub fn choose(&mut self, system: &System, extensions: &Extensions, combination: Combination) -> usize {
        for (position, ((_, ends, spring), at)) in system.active().zip(extensions.iter()).enumerate() {
            let transverse = spring.stiffness_block(at, Stiffness::Full).transverse * -combination.stiffness;
            let both_move = ends.iter().all(|&end| system.dofs().free_axes(end) != Axes::NONE);
            self.taken[position] = (-transverse).max(0.0) * if both_move { 2.0 } else { 1.0 };
            self.options[position] = Stiffness::Full;
        }
        let mut dropped = 0;
        for (particle, mass) in system.masses().iter().enumerate() {
            dropped += self.relieve(particle, combination.mass * mass, extensions);
        }
        dropped
    }

    /// Drops terms at one particle until the rest is small against its mass; returns their number.
    fn relieve(&mut self, particle: usize, mass: f64, extensions: &Extensions) -> usize {
        let springs = &self.springs[self.starts[particle] as usize..self.starts[particle + 1] as usize];
        let extensions = extensions.as_slice();
        for dropped in 0..=springs.len() {
            let mut rest = Matrix3::from_diagonal_element(mass);
            let mut worst = None;
            for position in springs.iter().map(|&s| s as usize) {
                let taken = self.taken[position];
                if taken > 0.0 && self.options[position] == Stiffness::Full {
                    let n = extensions[position].direction;
                    rest -= (Matrix3::identity() - n * n.transpose()) * taken;
                    if worst.is_none_or(|(_, most)| taken > most) {
                        worst = Some((position, taken));
                    }
                }
            }
            match worst {
                Some((position, _)) if Cholesky::new(rest).is_none() => self.options[position] = Stiffness::Tension,
                _ => return dropped,
            }
        }
        springs.len()
    }

    /// The choice: an option for every active spring, in their order.
    pub fn options(&self) -> &[Stiffness] {
        &self.options
    }
}
