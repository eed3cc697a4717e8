//! What changes while a system moves.

use super::System;
use crate::error::Invalid;
use nalgebra::Vector3;

/// Positions and velocities of all particles at one time.
///
/// # Examples
/// ```
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// state.velocities[1].y = 0.5;
/// let mut saved = state.clone();
/// state.positions[1].x = 1.25;
/// saved.copy_from(&state); // allocates nothing
/// assert_eq!(saved, state);
/// assert!(state.is_finite());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// t, in s.
    pub time: f64,
    /// x, one row per particle, in m.
    pub positions: Vec<Vector3<f64>>,
    /// v, one row per particle, in m/s.
    pub velocities: Vec<Vector3<f64>>,
}

/// Where and how fast all particles are at a time, by reference: what forces depend on.
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
    /// The state by reference.
    pub fn moment(&self) -> StateView<'_> {
        StateView { time: self.time, positions: &self.positions, velocities: &self.velocities }
    }

    /// The largest coordinate, in m, and velocity, in m/s, that states may have: beyond it their squares, and with them energies,
    /// are no numbers any more.
    pub const LARGEST: f64 = 1e150;

    /// Refuses a state of a system of another size.
    ///
    /// # Errors
    /// [`Invalid`] with the list that has another length than the system has particles.
    pub fn check(&self, system: &System) -> Result<(), Invalid> {
        let expected = system.particles();
        for (key, list) in [("positions", &self.positions), ("velocities", &self.velocities)] {
            if list.len() != expected {
                return Err(Invalid::new(
                    key,
                    format!("{} rows", list.len()),
                    format!("must have {expected}, one for each particle"),
                ));
            }
        }
        Ok(())
    }

    /// Whether the time is finite, and no coordinate or velocity is beyond [`LARGEST`](Self::LARGEST), infinite or undefined.
    pub fn is_finite(&self) -> bool {
        // Every number is looked at: a loop that ends early takes them one by one.
        let are_finite = |vectors: &[Vector3<f64>]| {
            vectors.iter().fold(true, |all, v| v.iter().fold(all, |all, c| all & (c.abs() <= Self::LARGEST)))
        };
        self.time.is_finite() && are_finite(&self.positions) && are_finite(&self.velocities)
    }

    /// Whether no component is beyond [`LARGEST`](Self::LARGEST), infinite or undefined.
    pub(crate) fn is_finite_vector(v: &Vector3<f64>) -> bool {
        v.iter().all(|c| c.abs() <= Self::LARGEST)
    }

    /// Puts every prescribed coordinate where its motion has it at `self.time`, with that motion's velocity.
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
