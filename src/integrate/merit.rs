//! When a step of Newton's line search is good enough, and when its residual is.

use crate::force::Extensions;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;

/// The least decrease that a step must bring, as a part of what its slope promises (c in Armijo's condition).
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// A point of the line search.
#[derive(Clone, Copy)]
pub(super) struct Point {
    /// ‖r‖.
    pub residual: f64,
    /// Φ, and how far rounding of its terms and of the positions leaves it uncertain.
    pub potential: f64,
    pub noise: f64,
    /// rᵀΔ.
    pub slope: f64,
    /// −f_dᵀΔ, the part of the slope that is in no potential.
    pub damping_slope: f64,
}

impl Point {
    /// Whether φ is low enough after a step.
    pub fn is_lower(&self, from: &Self, step: f64) -> bool {
        let work = 0.5 * step * (from.damping_slope + self.damping_slope);
        let change = self.potential - from.potential + work;
        let noise = self.noise + from.noise;
        change <= SUFFICIENT_DECREASE * step * from.slope
            || change <= noise && self.slope <= (1.0 - 2.0 * SUFFICIENT_DECREASE) * from.slope.abs()
    }

    /// The part of a step to try next: to the zero of a linear slope, within reason.
    pub fn shortening(&self, from: &Self) -> f64 {
        let zero = from.slope / (from.slope - self.slope);
        if self.slope > 0.0 { zero.clamp(0.1, 0.5) } else { 0.5 }
    }
}

/// What r is small against, in N.
#[derive(Clone, Copy)]
pub(super) struct Balance {
    /// Norm of the forces that balance in r, their magnitudes added up particle by particle.
    pub forces: f64,
    /// Norm of the change of r by rounding: nothing below it can be asked for.
    pub rounding: f64,
}

impl Balance {
    /// Of a step of dt seconds from a state to a trial state, whose extensions are given. Uses `sums` as scratch: x holds magnitudes of
    /// forces, y those of roundings.
    pub fn of(
        system: &System,
        extensions: &Extensions,
        [state, trial]: [&State; 2],
        dt: f64,
        sums: &mut [Vector3<f64>],
    ) -> Self {
        let gravity = system.gravity().norm();
        for (p, mass) in system.masses().iter().enumerate() {
            let momentum = state.velocities[p].norm() + trial.velocities[p].norm();
            let force = mass * (momentum / dt + gravity);
            sums[p] = Vector3::new(force, f64::EPSILON * force, 0.0);
        }
        for ((_, [i, j], spring), at) in system.active().zip(extensions.iter()) {
            let damping = spring.damping * at.direction.dot(&(trial.velocities[i] - trial.velocities[j]));
            let force = (spring.stiffness * spring.strain(at)).abs() + damping.abs();
            // Of the positions, and of the length that is computed from them.
            let reach = trial.positions[i].norm() + trial.positions[j].norm() + 2.0 * at.length;
            let rounding = f64::EPSILON * (spring.stiffness / spring.rest_length * reach + force);
            sums[i] += Vector3::new(force, rounding, 0.0);
            sums[j] += Vector3::new(force, rounding, 0.0);
        }
        let norm = |component: usize| {
            let free = sums.iter().enumerate().filter(|&(p, _)| system.dofs().free_axes(p) != Axes::NONE);
            free.map(|(_, s)| s[component] * s[component]).sum::<f64>().sqrt()
        };
        Self { forces: norm(0), rounding: norm(1) }
    }
}
