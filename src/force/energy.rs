//! Energies and momenta of a state.

use crate::spring::Extension;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The energy of a state by kind, in J.
///
/// # Examples
/// ```
/// use sprung::force::Energy;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// state.velocities[1].y = 2.0;
/// let energy = Energy::of(&system, &state);
/// assert_eq!((energy.kinetic, energy.elastic, energy.total()), (2.0, 5.0, 7.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// `Σ ½ m v²`, prescribed particles included.
    pub kinetic: f64,
    /// `Σ ½ k (l − l0)²/l0` over all springs.
    pub elastic: f64,
    /// `−Σ m gravity·x`, zero at the origin; with gravity as it is at time zero.
    pub gravitational: f64,
}

impl Energy {
    /// Of a state. Coincident ends are no obstacle here: the length of such a spring is zero.
    pub fn of(system: &System, state: &State) -> Self {
        let masses = system.masses();
        let kinetic = masses.iter().zip(&state.velocities).map(|(m, v)| 0.5 * m * v.norm_squared()).sum();
        let gravity = system.gravity();
        let gravitational = masses.iter().zip(&state.positions).map(|(m, x)| -m * gravity.dot(x)).sum();
        let law = system.law_values(&state.positions, state.time);
        let elastic = system
            .pairs()
            .iter()
            .enumerate()
            .map(|(spring, &[i, j])| {
                let (xi, xj) = (&state.positions[i as usize], &state.positions[j as usize]);
                let at = Extension::between(xi, xj).unwrap_or(Extension::COLLAPSED);
                system.elastic_energy_with(&law, spring, &at, state.time)
            })
            .sum();
        // An empty sum is −0, which reads as if it were something; with 0 added it is 0, and every other sum itself.
        let [kinetic, elastic, gravitational] = [kinetic, elastic, gravitational].map(|sum: f64| sum + 0.0);
        Self { kinetic, elastic, gravitational }
    }

    /// The sum of all kinds.
    pub fn total(&self) -> f64 {
        self.kinetic + self.elastic + self.gravitational
    }
}

/// `Σ m v`, in kg·m/s.
pub fn linear_momentum(system: &System, state: &State) -> Vector3<f64> {
    system.masses().iter().zip(&state.velocities).map(|(m, v)| v * *m).sum()
}

/// `Σ m x × v` about the origin, in kg·m²/s.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::SystemBuilder;
/// use sprung::force::{angular_momentum, linear_momentum};
///
/// let mut builder = SystemBuilder::new();
/// let p = builder.particle([2.0, 0.0, 0.0], 3.0);
/// builder.velocities[p] = Vector3::new(0.0, 5.0, 0.0);
/// let (system, state) = builder.build()?;
/// assert_eq!(linear_momentum(&system, &state), Vector3::new(0.0, 15.0, 0.0));
/// assert_eq!(angular_momentum(&system, &state), Vector3::new(0.0, 0.0, 30.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn angular_momentum(system: &System, state: &State) -> Vector3<f64> {
    let moving = state.positions.iter().zip(&state.velocities);
    system.masses().iter().zip(moving).map(|(m, (x, v))| x.cross(v) * *m).sum()
}
