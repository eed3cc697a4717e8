//! The parameters of a scene by which runs and equilibria are differentiated, and the derivatives of forces by them.

use crate::force::SpringGeometry;
use crate::spring::{Extension, Spring, Stiffness};
use crate::system::System;
use nalgebra::Vector3;

/// Derivatives of a number by the parameters of a scene, or a change of these parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// k of every spring.
    pub stiffness: Vec<f64>,
    /// l0 of every spring; the derivative is zero where l0 is, since the law is another there.
    pub rest_lengths: Vec<f64>,
    /// b of every spring.
    pub damping: Vec<f64>,
    /// m of every particle.
    pub masses: Vec<f64>,
    /// g.
    pub gravity: Vector3<f64>,
    /// A constant force on every particle.
    pub loads: Vec<Vector3<f64>>,
    /// Positions at the start; of held and moved coordinates, their whole paths shifted.
    pub positions: Vec<Vector3<f64>>,
    /// Velocities at the start, of free coordinates.
    pub velocities: Vec<Vector3<f64>>,
}

impl Parameters {
    /// Zeros for a system.
    pub fn zeros(system: &System) -> Self {
        let [springs, particles] = [system.springs().len(), system.particles()];
        Self {
            stiffness: vec![0.0; springs],
            rest_lengths: vec![0.0; springs],
            damping: vec![0.0; springs],
            masses: vec![0.0; particles],
            gravity: Vector3::zeros(),
            loads: vec![Vector3::zeros(); particles],
            positions: vec![Vector3::zeros(); particles],
            velocities: vec![Vector3::zeros(); particles],
        }
    }

    /// The sum of products with another set: how fast a number changes along a change.
    pub fn dot(&self, other: &Self) -> f64 {
        self.sum_with(other, |a, b| a * b)
    }

    /// The sum of a function of each number and that of another set.
    pub(crate) fn sum_with(&self, other: &Self, of: impl Fn(f64, f64) -> f64) -> f64 {
        let vector = |a: &Vector3<f64>, b: &Vector3<f64>| a.iter().zip(b).map(|(a, b)| of(*a, *b)).sum::<f64>();
        let scalars = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| of(*a, *b)).sum::<f64>();
        let vectors = |a: &[Vector3<f64>], b: &[Vector3<f64>]| a.iter().zip(b).map(|(a, b)| vector(a, b)).sum::<f64>();
        scalars(&self.stiffness, &other.stiffness)
            + scalars(&self.rest_lengths, &other.rest_lengths)
            + scalars(&self.damping, &other.damping)
            + scalars(&self.masses, &other.masses)
            + vector(&self.gravity, &other.gravity)
            + vectors(&self.loads, &other.loads)
            + vectors(&self.positions, &other.positions)
            + vectors(&self.velocities, &other.velocities)
    }

    /// Adds `(∂F/∂p)ᵀ λ` at a configuration, with relative velocities of w; gives `(K + D)ᵀ λ` and `Gᵀ λ`.
    pub(crate) fn add_force_adjoint(
        &mut self,
        system: &System,
        at: &Point<'_>,
        adjoint: &[Vector3<f64>],
    ) -> [Vec<Vector3<f64>>; 2] {
        let [mut moved, mut damped] = [0; 2].map(|_| vec![Vector3::zeros(); adjoint.len()]);
        for ((number, [i, j], spring), extension) in at.geometry.springs(system) {
            let (u, v) = (adjoint[i] - adjoint[j], at.velocities[i] - at.velocities[j]);
            let [along, rate] = [u, v].map(|w| extension.direction.dot(&w));
            self.stiffness[number] -= spring.strain(extension) * along;
            self.damping[number] -= rate * along;
            if spring.rest_length > 0.0 {
                self.rest_lengths[number] += spring.stiffness * extension.length / spring.rest_length.powi(2) * along;
            }
            let mut change = -spring.stiffness_block(extension, Stiffness::Full).apply(&u);
            if spring.damping > 0.0 {
                change += turning_adjoint(spring, extension, &v, &u);
                let force = spring.damping_force(extension, &u);
                damped[i] += force;
                damped[j] -= force;
            }
            moved[i] += change;
            moved[j] -= change;
        }
        for (p, derivatives) in at.geometry.external().iter().enumerate() {
            moved[p] += derivatives.stiffness * adjoint[p];
            damped[p] += derivatives.damping * adjoint[p];
        }
        let gravity = gravity(system, at.time);
        for (p, u) in adjoint.iter().enumerate() {
            self.masses[p] += gravity.dot(u);
            self.gravity += u * system.masses()[p];
            self.loads[p] += u;
        }
        [moved, damped]
    }

    /// Adds `∂F/∂p δp` at a configuration, for a change δp of the parameters.
    pub(super) fn add_force_change(&self, system: &System, at: &Point<'_>, force: &mut [Vector3<f64>]) {
        for ((number, [i, j], spring), extension) in at.geometry.springs(system) {
            let rate = extension.direction.dot(&(at.velocities[i] - at.velocities[j]));
            let mut along = -spring.strain(extension) * self.stiffness[number] - rate * self.damping[number];
            if spring.rest_length > 0.0 {
                let slope = spring.stiffness * extension.length / spring.rest_length.powi(2);
                along += slope * self.rest_lengths[number];
            }
            force[i] += extension.direction * along;
            force[j] -= extension.direction * along;
        }
        let gravity = gravity(system, at.time);
        for (p, f) in force.iter_mut().enumerate() {
            *f += gravity * self.masses[p] + self.gravity * system.masses()[p] + self.loads[p];
        }
    }
}

/// `Dᵀ u` of one spring, on its end i: `−b ((nᵀv) P u + P v (nᵀu))` with `P = (I − nnᵀ)/l`.
pub(super) fn turning_adjoint(spring: &Spring, at: &Extension, v: &Vector3<f64>, u: &Vector3<f64>) -> Vector3<f64> {
    if at.length == 0.0 {
        return Vector3::zeros();
    }
    let n = &at.direction;
    let across = |w: &Vector3<f64>| (w - n * n.dot(w)) / at.length;
    (across(u) * n.dot(v) + across(v) * n.dot(u)) * -spring.damping
}

fn gravity(system: &System, time: f64) -> Vector3<f64> {
    system.loads().gravity.as_ref().map_or(system.gravity(), |gravity| gravity.at(time))
}

/// Where forces are linearised.
pub(crate) struct Point<'a> {
    pub geometry: &'a SpringGeometry,
    pub velocities: &'a [Vector3<f64>],
    pub time: f64,
}
