//! Energies, momenta and constraint forces of a state.

use super::{DegenerateSpring, set_other_forces};
use crate::spring::Extension;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The energies of a state, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// `Σ ½ m v²`, prescribed particles included.
    pub kinetic: f64,
    /// `Σ ½ k (l − l0)²/l0` over all springs.
    pub elastic: f64,
    /// `−Σ m gravity·x` with gravity at time zero; zero at the origin.
    pub gravitational: f64,
}

impl Energy {
    /// The energies of a state. Springs with coincident ends have length zero.
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
        // Adding 0 turns the −0 of an empty sum into 0.
        let [kinetic, elastic, gravitational] = [kinetic, elastic, gravitational].map(|sum: f64| sum + 0.0);
        Self { kinetic, elastic, gravitational }
    }

    /// The total energy.
    pub fn total(&self) -> f64 {
        self.kinetic + self.elastic + self.gravitational
    }
}

/// `Σ m v`, in kg·m/s.
pub fn linear_momentum(system: &System, state: &State) -> Vector3<f64> {
    system.masses().iter().zip(&state.velocities).map(|(m, v)| v * *m).sum()
}

/// `Σ m x × v` about the origin, in kg·m²/s.
pub fn angular_momentum(system: &System, state: &State) -> Vector3<f64> {
    let moving = state.positions.iter().zip(&state.velocities);
    system.masses().iter().zip(moving).map(|(m, (x, v))| x.cross(v) * *m).sum()
}

/// The constraint forces on particles with prescribed coordinates.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reactions {
    /// The particles with a prescribed coordinate, ascending.
    pub particles: Vec<usize>,
    /// The force on each of them, in N, zero along free axes.
    pub forces: Vec<Vector3<f64>>,
}

impl Reactions {
    /// The constraint forces at a state, along prescribed coordinates:
    ///
    /// ```text
    /// r = m a − (f_el + f_d + m g + f_ext).
    /// ```
    ///
    /// Prescribed motions are piecewise linear, so a = 0; impulses at kinks are not included. Springs between two held particles are. The force on
    /// the constraint is −r.
    ///
    /// # Errors
    /// A spring with coincident ends.
    ///
    /// # Examples
    /// ```
    /// use sprung::force::Reactions;
    /// # use nalgebra::Vector3;
    /// # use sprung::{Spring, SystemBuilder};
    /// # let mut builder = SystemBuilder::new();
    /// # builder.particle([0.0, 0.0, 0.0], 1.0);
    /// # builder.particle([0.0, -1.0, 0.0], 2.0);
    /// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 0.5, damping: 0.0 });
    /// # builder.hold(0);
    /// # builder.gravity(0.0, -9.81, 0.0);
    /// let (system, state) = builder.build()?;
    /// let reactions = Reactions::at(&system, &state)?;
    /// // The constraint carries the weight of the held particle and the tension of the spring at a strain of 1.
    /// assert_eq!(reactions.particles, [0]);
    /// assert_eq!(reactions.forces, [Vector3::new(0.0, 9.81 + 20.0, 0.0)]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn at(system: &System, state: &State) -> Result<Self, DegenerateSpring> {
        if system.prescribed().is_empty() {
            return Ok(Self::default());
        }
        let moment = state.moment();
        let mut force = vec![Vector3::zeros(); system.particles()];
        set_other_forces(system, &moment, &mut force);
        let law = system.law_values(moment.positions, moment.time);
        for (number, pair) in system.pairs().iter().enumerate() {
            let [i, j] = pair.map(|end| end as usize);
            let Some(at) = Extension::between(&moment.positions[i], &moment.positions[j]) else {
                // A spring without rest length exerts no force at length zero.
                if system.springs()[number].rest_length == 0.0 {
                    continue;
                }
                return Err(DegenerateSpring { spring: number, pair: [i, j] });
            };
            let spring = system.spring_with(&law, number, at.length, moment.time);
            let mut f = spring.elastic_force(&at);
            if spring.damping > 0.0 {
                f += spring.damping_force(&at, &(moment.velocities[i] - moment.velocities[j]));
            }
            force[i] += f;
            force[j] -= f;
        }
        let mut reactions = BTreeMap::<usize, Vector3<f64>>::new();
        for (dof, ..) in system.prescribed().iter() {
            reactions.entry(dof.particle).or_default()[dof.axis] = -force[dof.particle][dof.axis];
        }
        let (particles, forces) = reactions.into_iter().unzip();
        Ok(Self { particles, forces })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{ImplicitOptions, Method};
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};

    /// Particles that are held, moved and on rollers, with damped springs and weight.
    fn scene() -> (System, State) {
        let mut builder = SystemBuilder::new();
        for (position, mass) in
            [([0.0, 0.0, 0.0], 1.0), ([1.0, 0.2, 0.0], 2.0), ([0.1, -1.0, 0.3], 0.5), ([1.2, -1.1, 0.2], 3.0)]
        {
            builder.particle(position, mass);
        }
        for [i, j] in [[0, 1], [0, 2], [1, 3], [2, 3], [1, 2]] {
            builder.spring(i, j, Spring { stiffness: 40.0, rest_length: 0.9, damping: 0.3 });
        }
        builder.gravity(0.5, -9.81, 0.0);
        builder.hold(0);
        let motion = Motion::Velocity(Vector3::new(0.0, 0.0, 0.2));
        builder.constrain(Constraint { particles: vec![1], axes: Axes::ALL, motion });
        builder.constrain(Constraint { axes: Axes::of(&[1]), ..Constraint::hold([3]) });
        let (system, mut state) = builder.build().unwrap();
        state.velocities[2] = Vector3::new(0.3, -0.1, 0.4);
        state.velocities[3] = Vector3::new(-0.2, 0.0, 0.1);
        (system, state)
    }

    /// Constraint forces and weight change momentum and angular momentum, measured in a very short step of an eighth-order method.
    #[test]
    fn momenta_change_by_reactions_and_weight() {
        let (system, state) = scene();
        let reactions = Reactions::at(&system, &state).unwrap();
        assert_eq!(reactions.particles, [0, 1, 3]);
        assert_eq!((reactions.forces[2].x, reactions.forces[2].z), (0.0, 0.0));
        let mut stepper = Method::Dop853.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
        let mut after = state.clone();
        let dt = 1e-6;
        stepper.step(&mut after, dt).unwrap();
        let weights: Vec<_> = system.masses().iter().map(|m| system.gravity() * *m).collect();
        let force = reactions.forces.iter().chain(&weights).sum::<Vector3<f64>>();
        let torque = |p: usize, f: &Vector3<f64>| state.positions[p].cross(f);
        let held: Vector3<f64> = reactions.particles.iter().zip(&reactions.forces).map(|(&p, f)| torque(p, f)).sum();
        let weight: Vector3<f64> = weights.iter().enumerate().map(|(p, f)| torque(p, f)).sum();
        let change = |of: fn(&System, &State) -> Vector3<f64>| (of(&system, &after) - of(&system, &state)) / dt;
        // Forces change by some 10² N/s.
        assert!((change(linear_momentum) - force).norm() < 1e-3, "{:?} {force:?}", change(linear_momentum));
        assert!((change(angular_momentum) - held - weight).norm() < 1e-3, "{:?}", change(angular_momentum));
    }

    #[test]
    fn springs_between_held_particles_count() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([2.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 3.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(0).hold(1);
        let (system, state) = builder.build().unwrap();
        assert!(system.active_springs().is_empty());
        let reactions = Reactions::at(&system, &state).unwrap();
        assert_eq!(reactions.forces, [Vector3::new(-3.0, 0.0, 0.0), Vector3::new(3.0, 0.0, 0.0)]);
        let mut coincident = state;
        coincident.positions[1].x = 0.0;
        assert!(Reactions::at(&system, &coincident).is_err());
    }
}
