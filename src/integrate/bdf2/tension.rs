//! Which transverse stiffness the matrix of a step has by default: that of the tension that lasts.
//!
//! A spring under the tension T resists turning by the transverse term T/l. The iteration converges without this term like
//! `τ² T/(l m)`: well where springs are slack or steps short, and not at all on a taut string with long steps. With the
//! tension at the prediction y in its place it converges badly where springs turn: one that turns by u across itself is
//! stretched by u²/(2 l) at y, which the step takes away again, and the tension of this stretch would brake the turning.
//! So the matrix has the tension that is there for another reason,
//!
//! ```text
//! T = min(T_y, T_last) − C (k/l0) u²/(2 l),      the transverse term T/l where T > 0, none elsewhere,
//! ```
//!
//! T_y that at y, and T_last what the last solve left in the spring by its own, linear account, `k (l/l0 − 1 + nᵀ(d_i − d_j)/l0)`:
//! positions after a single iteration still hold stretches of second order, that account does not. (Where there is no last
//! step it is the tension at the step's start.) Of a cloth that swings down nearly all terms fall out, of a taut string none;
//! with T ≥ 0 the matrix is positive definite.

use crate::force::SpringGeometry;
use crate::spring::{Extension, Spring};
use crate::system::{State, System};
use nalgebra::Vector3;

/// How much more than the stretch by turning there must be (C). Of cloths that swing down with steps of 5 to 17 ms the error is
/// the same for C from 4 to 50, and up to ten times larger for 0; on taut strings nothing turns.
const TURNING: f64 = 8.0;

/// What lasts of every active spring's tension.
pub(super) struct Tensions {
    /// T_last, in N.
    last: Vec<f64>,
}

impl Tensions {
    /// Of a system.
    pub fn new(system: &System) -> Self {
        Self { last: vec![0.0; system.active_springs().len()] }
    }

    /// Takes the tensions at a state for the last ones.
    pub fn set(&mut self, system: &System, state: &State) {
        let law = system.law_values(&state.positions, state.time);
        for (last, (number, [i, j], _)) in self.last.iter_mut().zip(system.active()) {
            // Coincident ends have no tension that lasts, and a step from there fails for its own reasons.
            let extension = Extension::between(&state.positions[i], &state.positions[j]);
            let spring = |length| system.spring_with(&law, number, length, state.time);
            *last = extension.map_or(0.0, |at| tension(&spring(at.length), &at));
        }
    }

    /// Takes over what a solve leaves: `displacement` is the correction of the positions that have these extensions.
    pub fn learn(&mut self, system: &System, extensions: &SpringGeometry, displacement: &[Vector3<f64>]) {
        for (last, ((_, [i, j], spring), at)) in self.last.iter_mut().zip(extensions.springs(system)) {
            let stretch = at.direction.dot(&(displacement[i] - displacement[j]));
            *last = tension(spring, at) + spring.axial_stiffness() * stretch;
        }
    }

    /// The transverse coefficient of the spring at a position among the active ones, in N/m, when its ends have moved relative to
    /// each other by `moved` to where they are.
    pub fn transverse(&self, position: usize, spring: &Spring, at: &Extension, moved: &Vector3<f64>) -> f64 {
        // Without a rest length all directions are alike.
        if spring.rest_length == 0.0 {
            return spring.axial_stiffness();
        }
        let across = moved.norm_squared() - at.direction.dot(moved).powi(2);
        let turning = TURNING * spring.axial_stiffness() * across / (2.0 * at.length);
        let lasting = tension(spring, at).min(self.last[position]) - turning;
        lasting.max(0.0) / at.length
    }
}

/// `k (l/l0 − 1)`, in N.
fn tension(spring: &Spring, at: &Extension) -> f64 {
    spring.stiffness * spring.strain(at)
}

#[cfg(test)]
mod tests {
    use super::{TURNING, Tensions};
    use crate::force::SpringGeometry;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use nalgebra::Vector3;

    /// A spring of 2 m at rest with k = 30 N, 3 m long: T = 15 N, T/l = 5 N/m.
    #[test]
    fn the_least_tension_counts_less_the_stretch_by_turning() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([3.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 30.0, rest_length: 2.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let (spring, at) = (system.springs()[0], extensions.as_slice()[0]);
        let mut tensions = Tensions::new(&system);
        let still = Vector3::zeros();
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 0.0);
        tensions.set(&system, &state);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 5.0);
        // Moving along the spring is no turning; 0.2 m across stretch by 0.04/6 m, of 15 N/m.
        assert_eq!(tensions.transverse(0, &spring, &at, &Vector3::new(0.5, 0.0, 0.0)), 5.0);
        let turned = tensions.transverse(0, &spring, &at, &Vector3::new(0.5, 0.2, 0.0));
        assert!((turned - (15.0 - TURNING * 0.1) / 3.0).abs() < 1e-12, "{turned}");
        assert_eq!(tensions.transverse(0, &spring, &at, &Vector3::new(0.0, 2.0, 0.0)), 0.0);
        // A solve that takes 0.6 m of the metre away leaves 6 N, one that adds to it no more than there is.
        tensions.learn(&system, &extensions, &[Vector3::new(0.25, 9.0, 0.0), Vector3::new(-0.35, 0.0, 0.0)]);
        let left = tensions.transverse(0, &spring, &at, &still);
        assert!((left - 2.0).abs() < 1e-12, "{left}");
        tensions.learn(&system, &extensions, &[Vector3::new(-0.25, 0.0, 0.0), Vector3::zeros()]);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 5.0);
        tensions.learn(&system, &extensions, &[Vector3::new(1.1, 0.0, 0.0), Vector3::zeros()]);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 0.0);
    }
}
