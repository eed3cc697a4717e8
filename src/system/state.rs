//! The state of a system.

use super::System;
use crate::error::Invalid;
use nalgebra::Vector3;

/// Positions and velocities of all particles at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// t, in s.
    pub time: f64,
    /// x, one row per particle, in m.
    pub positions: Vec<Vector3<f64>>,
    /// v, one row per particle, in m/s.
    pub velocities: Vec<Vector3<f64>>,
}

/// A borrowed state, which forces depend on.
#[derive(Debug, Clone, Copy)]
pub struct StateView<'a> {
    /// t, in s.
    pub time: f64,
    /// x, one row per particle, in m.
    pub positions: &'a [Vector3<f64>],
    /// v, one row per particle, in m/s.
    pub velocities: &'a [Vector3<f64>],
}

impl State {
    /// A view of the state.
    pub fn moment(&self) -> StateView<'_> {
        StateView { time: self.time, positions: &self.positions, velocities: &self.velocities }
    }

    /// The largest coordinate, in m, and velocity, in m/s, of a valid state: larger values overflow when squared.
    pub const LARGEST: f64 = 1e150;

    /// An error unless the state has as many particles as the system.
    ///
    /// # Errors
    /// [`Invalid`] with the list of wrong length.
    pub fn check(&self, system: &System) -> Result<(), Invalid> {
        let expected = system.particles();
        for (key, list) in [("positions", &self.positions), ("velocities", &self.velocities)] {
            if list.len() != expected {
                let rule = format!("must have {expected}, one for each particle");
                return Err(Invalid::new(key, format!("{} rows", list.len()), rule));
            }
        }
        Ok(())
    }

    /// True if the time is finite and no coordinate or velocity is NaN or exceeds [`LARGEST`](Self::LARGEST).
    pub fn is_finite(&self) -> bool {
        // No early exit, so that the loop vectorizes.
        let are_finite = |vectors: &[Vector3<f64>]| {
            vectors.iter().fold(true, |all, v| v.iter().fold(all, |all, c| all & (c.abs() <= Self::LARGEST)))
        };
        self.time.is_finite() && are_finite(&self.positions) && are_finite(&self.velocities)
    }

    pub(crate) fn is_finite_vector(v: &Vector3<f64>) -> bool {
        v.iter().all(|c| c.abs() <= Self::LARGEST)
    }

    /// Sets prescribed coordinates to the position and velocity of their motion at `self.time`.
    pub fn prescribe(&mut self, system: &System) {
        let prescribed = system.prescribed();
        prescribed.set_positions(self.time, &mut self.positions);
        prescribed.set_velocities(self.time, &mut self.velocities);
    }

    /// Copies another state, without allocating where it has as many particles.
    pub fn copy_from(&mut self, other: &Self) {
        self.time = other.time;
        self.positions.clone_from(&other.positions);
        self.velocities.clone_from(&other.velocities);
    }
}

/// The distance of positions from their centroid, `‖x − c‖` over all particles of all parts of a system, or from where they
/// started if they are all at one place; never zero.
pub(crate) fn extent(system: Option<&System>, positions: &[Vector3<f64>], start: &[Vector3<f64>]) -> f64 {
    let total = |sums: [f64; 4]| system.map_or(sums, |system| system.total(sums));
    let own = &positions[..system.map_or(positions.len(), System::own_particles).min(positions.len())];
    let sum = own.iter().sum::<Vector3<f64>>();
    let [count, x, y, z] = total([own.len() as f64, sum.x, sum.y, sum.z]);
    let centroid = Vector3::new(x, y, z) / count.max(1.0);
    let spread = own.iter().map(|x| (x - centroid).norm_squared()).sum();
    let moved = own.iter().zip(start).map(|(x, start)| (x - start).norm_squared()).sum();
    let [spread, moved, ..] = total([spread, moved, 0.0, 0.0]).map(f64::sqrt);
    let largest = own.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let [largest] = system.map_or([largest], |system| system.largest([largest]));
    // A spread by rounding is none.
    [spread, moved].into_iter().find(|&length| length > 1e-12 * largest).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::State;
    use nalgebra::Vector3;

    #[test]
    fn states_are_finite_up_to_the_largest_coordinate() {
        let state = |time, x, v| State {
            time,
            positions: vec![Vector3::new(0.0, x, 0.0)],
            velocities: vec![Vector3::new(0.0, 0.0, v)],
        };
        for (state, is_finite) in [
            (state(1.0, State::LARGEST, -State::LARGEST), true),
            (state(f64::INFINITY, 0.0, 0.0), false),
            (state(0.0, -State::LARGEST.next_up(), 0.0), false),
            (state(0.0, 0.0, State::LARGEST.next_up()), false),
            (state(0.0, f64::NAN, 0.0), false),
        ] {
            assert_eq!(state.is_finite(), is_finite, "{state:?}");
        }
    }

    #[test]
    fn a_copy_has_everything() {
        let mut copy = State { time: 0.0, positions: vec![Vector3::zeros()], velocities: vec![Vector3::zeros()] };
        let state = State { time: 3.0, positions: vec![Vector3::x()], velocities: vec![Vector3::y()] };
        copy.copy_from(&state);
        assert_eq!(copy, state);
    }
}
