//! The parts of a scene that stay the same while it moves.

use crate::system::{Motion, System};
use nalgebra::Vector3;

/// The constraint of a particle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Binding {
    /// No coordinate is prescribed.
    Free,
    /// Some coordinate is held where it is.
    Held,
    /// Some coordinate is moved.
    Moved,
}

impl Binding {
    /// The constraint of every particle of a system.
    pub fn of(system: &System) -> Vec<Self> {
        let mut bindings = vec![Self::Free; system.particles()];
        let motions = system.prescribed().motions();
        for (dof, _, motion) in system.prescribed().iter() {
            let moves = motions.get(motion).is_some_and(|motion| *motion != Motion::Held);
            let binding = if moves { Self::Moved } else { Self::Held };
            if let Some(known) = bindings.get_mut(dof.particle) {
                *known = binding.max(*known);
            }
        }
        bindings
    }
}

/// The parts of a scene that stay the same while it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTopology {
    /// Number of modelled axes: 1, 2 or 3.
    pub dimension: usize,
    /// Gravitational acceleration, in m/s²; upwards is where it comes from.
    pub gravity: Vector3<f64>,
    /// The constraint of every particle.
    pub bindings: Vec<Binding>,
    /// End points of every spring.
    pub pairs: Vec<[u32; 2]>,
    /// l0 of every spring, in m.
    pub rest_lengths: Vec<f64>,
    /// k of every spring, in N.
    pub stiffnesses: Vec<f64>,
    /// Corners of every triangle of a mesh.
    pub triangles: Vec<[u32; 3]>,
}

impl SceneTopology {
    /// The topology of a system, and the triangles of the mesh that it was made from.
    pub fn of(system: &System, triangles: &[[u32; 3]]) -> Self {
        Self {
            dimension: system.dimension(),
            gravity: system.gravity(),
            bindings: Binding::of(system),
            pairs: system.pairs().to_vec(),
            rest_lengths: system.springs().iter().map(|spring| spring.rest_length).collect(),
            stiffnesses: system.springs().iter().map(|spring| spring.stiffness).collect(),
            triangles: triangles.to_vec(),
        }
    }

    /// The strain `l/l0 − 1` of every spring.
    pub(super) fn strains<'a>(&'a self, positions: &'a [Vector3<f64>]) -> impl Iterator<Item = f64> + 'a {
        let at = |p: u32| positions.get(p as usize).copied().unwrap_or_default();
        let ends = self.pairs.iter().zip(&self.rest_lengths);
        ends.map(move |(&[i, j], rest)| ((at(i) - at(j)).norm() - rest) / rest)
    }
}
