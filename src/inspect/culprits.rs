//! The springs that make A lose definiteness.
//!
//! Along a unit vector u the curvature of A is a sum over particles and springs,
//!
//! ```text
//! uᵀAu = Σ m_i‖u_i‖²/dt² + Σ b (nᵀw)²/dt + Σ wᵀK^s w,      w = u_i − u_j,
//! wᵀK^s w = (k/l0) (nᵀw)² + k(1/l0 − 1/l) ‖Pw‖²,          P = I − nnᵀ,
//! ```
//!
//! and only the last term of compressed springs is negative. A spring's *share* of the negative curvature `uᵀ(−K)u` is its part of that sum: the
//! shares of all springs add up to 1, those of the culprits to more where other springs resist. Dropping one spring's transverse term changes the
//! curvature along u from λ to `λ − k(1/l0 − 1/l)‖Pw‖²`, an upper bound for the new lowest eigenvalue.

use crate::eigen::{Eigenpair, product};
use crate::force::SpringGeometry;
use crate::linear::dot;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::System;
use nalgebra::Vector3;

/// A spring with negative curvature along a direction.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Culprit {
    /// The spring.
    pub spring: usize,
    /// Its ends.
    pub particles: [usize; 2],
    /// `l/l0 − 1`.
    pub strain: f64,
    /// Its part of `uᵀ(−K)u`.
    pub share: f64,
    /// `wᵀK^s w`, its curvature along u, in N/m; negative.
    pub curvature: f64,
    /// The curvature `uᵀAu` along u without the transverse term of this spring, in N/m.
    #[serde(rename = "without_transverse")]
    pub relieved: f64,
}

/// A particle that a direction moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mover {
    /// The particle.
    pub particle: usize,
    /// Its part of the unit vector u.
    pub displacement: Vector3<f64>,
}

/// An eigenvector of A, with the springs behind it and the particles that it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// λ = uᵀAu, in N/m.
    pub eigenvalue: f64,
    /// `uᵀ(−K)u`, in N/m.
    pub stiffness_curvature: f64,
    /// The springs with negative curvature, worst first, where `uᵀ(−K)u` is negative.
    pub culprits: Vec<Culprit>,
    /// The particles that move most, the farthest first.
    pub movers: Vec<Mover>,
}

/// The springs behind an eigenpair of A under an option, and the particles that it moves most: a hundred springs at most with a thousandth of the
/// worst share or more, and ten particles.
pub fn direction(system: &System, extensions: &SpringGeometry, option: Stiffness, pair: &Eigenpair) -> Direction {
    let dofs = system.dofs();
    let k = SystemOperator::new(system, extensions, option, Combination::STIFFNESS);
    let stiffness_curvature = -dot(&pair.vector, &product(&k, &pair.vector));
    let mut culprits = Vec::new();
    if stiffness_curvature < 0.0 {
        for ((spring, particles, parameters), at) in extensions.springs(system) {
            let w = dofs.get(&pair.vector, particles[0]) - dofs.get(&pair.vector, particles[1]);
            let block = parameters.stiffness_block(at, option);
            let curvature = w.dot(&block.apply(&w));
            if curvature < 0.0 {
                let along = at.direction.dot(&w);
                let transverse = block.transverse * (w.norm_squared() - along * along).max(0.0);
                let (share, relieved) = (curvature / stiffness_curvature, pair.value - transverse);
                let strain = parameters.strain(at);
                culprits.push(Culprit { spring, particles, strain, share, curvature, relieved });
            }
        }
        culprits.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.spring.cmp(&b.spring)));
        let least = culprits.first().map_or(0.0, |worst| 1e-3 * worst.share);
        culprits.truncate(culprits.partition_point(|culprit| culprit.share >= least).min(100));
    }
    let mover = |particle| Mover { particle, displacement: dofs.get(&pair.vector, particle) };
    let mut movers: Vec<Mover> = (0..system.particles()).map(mover).collect();
    let size = |mover: &Mover| mover.displacement.norm_squared();
    movers.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.particle.cmp(&b.particle)));
    movers.truncate(10);
    movers.retain(|mover| size(mover) > 0.0);
    Direction { eigenvalue: pair.value, stiffness_curvature, culprits, movers }
}

/// Culprits that share particles.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Cluster {
    /// The springs, by their largest share in any direction.
    pub springs: Vec<usize>,
    /// The particles at their ends, ascending.
    pub particles: Vec<usize>,
    /// The lowest eigenvalue of a direction that they have a part in, in N/m.
    pub eigenvalue: f64,
    /// The strain of the most compressed one.
    pub strain: f64,
}

/// Groups the main culprits of several directions, those with a tenth of the worst share or more; the cluster of the lowest direction comes first.
pub fn clusters(directions: &[Direction]) -> Vec<Cluster> {
    let mut found: Vec<(Culprit, f64)> = Vec::new();
    for direction in directions {
        let least = direction.culprits.first().map_or(0.0, |worst| 0.1 * worst.share);
        for culprit in direction.culprits.iter().filter(|culprit| culprit.share >= least) {
            match found.iter_mut().find(|(other, _)| other.spring == culprit.spring) {
                Some((other, lowest)) => {
                    other.share = other.share.max(culprit.share);
                    *lowest = lowest.min(direction.eigenvalue);
                }
                None => found.push((*culprit, direction.eigenvalue)),
            }
        }
    }
    found.sort_by(|(a, _), (b, _)| b.share.total_cmp(&a.share).then(a.spring.cmp(&b.spring)));
    let mut clusters: Vec<Cluster> = Vec::new();
    for (culprit, eigenvalue) in found {
        let touches = |cluster: &Cluster| culprit.particles.iter().any(|p| cluster.particles.contains(p));
        let (touched, apart): (Vec<Cluster>, Vec<Cluster>) = clusters.into_iter().partition(touches);
        let (particles, strain) = (culprit.particles.to_vec(), culprit.strain);
        let mut joined = Cluster { springs: Vec::new(), particles, eigenvalue, strain };
        for cluster in touched {
            joined.springs.extend(cluster.springs);
            joined.particles.extend(cluster.particles);
            joined.eigenvalue = joined.eigenvalue.min(cluster.eigenvalue);
            joined.strain = joined.strain.min(cluster.strain);
        }
        joined.springs.push(culprit.spring);
        joined.particles.sort_unstable();
        joined.particles.dedup();
        clusters = apart;
        clusters.push(joined);
    }
    clusters.sort_by(|a, b| a.eigenvalue.total_cmp(&b.eigenvalue).then(a.springs.cmp(&b.springs)));
    clusters
}
