//! When a step of Newton's line search is good enough, and when its residual is.

use crate::force::SpringGeometry;
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
        extensions: &SpringGeometry,
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
        for ((_, [i, j], spring), at) in extensions.springs(system) {
            let damping = spring.damping * at.direction.dot(&(trial.velocities[i] - trial.velocities[j]));
            let force = (spring.stiffness * spring.strain(at)).abs() + damping.abs();
            // Of the positions, and of the length that is computed from them.
            let reach = trial.positions[i].norm() + trial.positions[j].norm() + 2.0 * at.length;
            let rounding = f64::EPSILON * (spring.axial_stiffness() * reach + force);
            sums[i] += Vector3::new(force, rounding, 0.0);
            sums[j] += Vector3::new(force, rounding, 0.0);
        }
        let square = |component: usize| {
            let own = sums.iter().enumerate().take(system.own_particles());
            let free = own.filter(|&(p, _)| system.dofs().free_axes(p) != Axes::NONE);
            free.map(|(_, s)| s[component] * s[component]).sum::<f64>()
        };
        let [forces, rounding] = system.total([square(0), square(1)]).map(f64::sqrt);
        Self { forces, rounding }
    }
}

#[cfg(test)]
mod tests {
    use super::{Balance, Point};
    use crate::force::SpringGeometry;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use nalgebra::Vector3;

    const START: Point = Point { residual: 1.0, potential: 10.0, noise: 0.0, slope: -4.0, damping_slope: 0.5 };

    /// Over a quarter of the direction the damping forces do 0.5·0.25·(0.5 + 0.3) = 0.1, and 1e-4 is to be gained.
    #[test]
    fn the_potential_with_the_work_of_damping_must_fall() {
        let after = |potential| Point { potential, slope: 9.0, damping_slope: 0.3, ..START };
        assert!(after(9.8999 - 1e-9).is_lower(&START, 0.25));
        assert!(!after(9.8999 + 1e-9).is_lower(&START, 0.25));
    }

    /// Where rounding hides the fall, the slope must have fallen to 1 − 2·1e-4 of its magnitude.
    #[test]
    fn the_slope_decides_within_the_noise() {
        let from = Point { noise: 0.2, damping_slope: 0.0, ..START };
        let after = |change, slope| {
            let potential = from.potential + change;
            Point { residual: 1.0, potential, noise: 0.3, slope, damping_slope: 0.0 }.is_lower(&from, 0.25)
        };
        assert!(after(0.49, 3.9991));
        assert!(!after(0.49, 3.9993));
        assert!(after(0.49, -7.0));
        assert!(!after(0.51, -7.0));
    }

    #[test]
    fn steps_are_shortened_to_the_zero_of_a_linear_slope() {
        let part = |before, after| Point { slope: after, ..START }.shortening(&Point { slope: before, ..START });
        assert_eq!(part(-1.0, 3.0), 0.25);
        assert_eq!(part(-3.0, 1.0), 0.5);
        assert_eq!(part(-1.0, 99.0), 0.1);
        assert_eq!(part(-1.0, -0.5), 0.5);
    }

    /// Two free particles below a held one: every magnitude by hand.
    #[test]
    fn forces_and_roundings_are_added_up_in_magnitude() {
        let mut builder = SystemBuilder::new();
        builder.gravity(0.0, -6.0, -8.0);
        for (position, mass) in [([0.0; 3], 7.0), ([3.0, 0.0, 0.0], 2.0), ([3.0, 4.0, 0.0], 0.5)] {
            builder.particle(position, mass);
        }
        builder.hold(0);
        builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 4.0 });
        builder.spring(1, 2, Spring { stiffness: 30.0, rest_length: 5.0, damping: 3.0 });
        let (system, mut state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let mut trial = state.clone();
        trial.velocities[1] = Vector3::new(3.0, 4.0, 0.0);
        trial.velocities[2] = Vector3::new(0.0, -3.0, 0.0);
        state.velocities[1] = Vector3::new(0.0, 0.0, 2.0);
        state.velocities[2] = Vector3::new(1.0, 0.0, 0.0);
        let Balance { forces, rounding } =
            Balance::of(&system, &extensions, [&state, &trial], 0.5, &mut [Vector3::zeros(); 3]);
        // Inertia and weight, then the springs' stretch and damping: 48 + (50 + 12) + (6 + 21) and 9 + 27.
        assert!((forces - 137f64.hypot(36.0)).abs() < 1e-11, "{forces}");
        // 48 + (50·(3 + 2·3) + 62) + (6·(3 + 5 + 2·4) + 27) and 9 + 123.
        let ulps = rounding / f64::EPSILON;
        assert!((ulps - 683f64.hypot(132.0)).abs() < 1e-10, "{ulps}");
    }
}
