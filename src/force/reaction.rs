//! The forces with which constraints act.

use super::{DegenerateSpring, set_other_forces};
use crate::spring::Extension;
use crate::system::{State, System};
use nalgebra::Vector3;

/// The forces that hold and lead particles.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reactions {
    /// The particles with a prescribed coordinate, ascending.
    pub particles: Vec<usize>,
    /// What acts on each of them, in N, zero along axes that are free.
    pub forces: Vec<Vector3<f64>>,
}

impl Reactions {
    /// At a state: along every prescribed coordinate what the constraint must add for the particle to move as it is prescribed,
    ///
    /// ```text
    /// r = m a − (f_el + f_d + m g + f_ext).
    /// ```
    ///
    /// Prescribed motions are straight between the kinks of their paths, so that a = 0: at a kink the velocity jumps, and the blow
    /// that makes it is no force. Springs between two held particles, which move nothing, count here. What a constraint feels is −r.
    ///
    /// # Errors
    /// A spring whose ends coincide.
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
    /// // The held end carries its own weight and the pull of the spring, which is as long again as at rest.
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
                // One without a rest length exerts no force there.
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
        let mut reactions = Self::default();
        let mut last = None;
        let mut prescribed: Vec<_> = system.prescribed().iter().map(|(dof, ..)| dof).collect();
        prescribed.sort_by_key(|dof| (dof.particle, dof.axis));
        for dof in prescribed {
            if last != Some(dof.particle) {
                last = Some(dof.particle);
                reactions.particles.push(dof.particle);
                reactions.forces.push(Vector3::zeros());
            }
            if let Some(row) = reactions.forces.last_mut() {
                row[dof.axis] = -force[dof.particle][dof.axis];
            }
        }
        Ok(reactions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::{angular_momentum, linear_momentum};
    use crate::integrate::{ImplicitOptions, Method};
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};

    /// Held, on rollers and led particles, damped springs, one between two held particles, weight.
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

    /// All of them together change the momentum and the angular momentum of everything: measured from a very short step of an explicit method of
    /// eighth order, beside the weight.
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
        // Forces change by some 10² N/s on the way.
        assert!((change(linear_momentum) - force).norm() < 1e-3, "{:?} {force:?}", change(linear_momentum));
        assert!((change(angular_momentum) - held - weight).norm() < 1e-3, "{:?}", change(angular_momentum));
    }

    /// The spring between two held particles pulls at both of them, and at nobody else.
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
