//! What a step takes from motion across springs.

use crate::force::SpringGeometry;
use crate::system::{Axes, System};
use nalgebra::Vector3;

/// The part of U²/K_s that a step takes from the kinetic energy K_s across a spring that turns, U being what the step of straight motion would put into
/// it. Measured on a rod that turns with U well below K_s, and about so on random scenes.
pub(in crate::integrate) const BRAKE: f64 = 0.4;

/// The share of the kinetic energy that a step of h seconds from a state with these extensions and velocities takes: `BRAKE Σ U²/K_s / K` with
/// `U = ½ κ L²`, `L = (h v⊥)²/(2 l)`, `K_s = ½ μ v⊥²`.
pub(super) fn braked(system: &System, extensions: &SpringGeometry, velocities: &[Vector3<f64>], h: f64) -> f64 {
    let inverse = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    // A spring without a rest length is not stretched by turning.
    let turning = extensions.springs(system).filter(|((.., spring), _)| spring.rest_length > 0.0);
    let taken = turning.map(|((_, [i, j], spring), at)| {
        let v = velocities[i] - velocities[j];
        let across = v.norm_squared() - at.direction.dot(&v).powi(2);
        let lift = 0.5 * h * h * across / at.length;
        let half = 0.5 * spring.axial_stiffness();
        half * lift * lift * half * (inverse(i) + inverse(j)) * lift * h * h / at.length
    });
    let taken = BRAKE * taken.sum::<f64>();
    let kinetic = system.masses().iter().zip(velocities).map(|(mass, v)| 0.5 * mass * v.norm_squared()).sum::<f64>();
    if taken > 0.0 { taken / kinetic } else { 0.0 }
}
