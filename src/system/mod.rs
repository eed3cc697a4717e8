//! The data of a scene: particles, springs and constraints, and the free degrees of freedom that follow from them.

mod axes;
mod behaviour;
mod builder;
mod change;
mod constraint;
mod curve;
mod dofs;
mod external;
#[cfg(test)]
pub(crate) mod fixtures;
mod loads;
mod part;
mod state;
mod thread_partition;

pub use axes::Axes;
pub use behaviour::{Actuation, Behaviour};
pub use builder::SystemBuilder;
pub use constraint::{Constraint, Motion, Prescribed};
pub use curve::Curve;
pub(crate) use curve::{SAME_TIME, check_length};
pub use dofs::{Dof, DofMap};
pub use external::{Derivatives, ExternalForce};
pub use loads::Loads;
pub use part::Communicator;
#[cfg(test)]
pub(crate) use part::tests as parts;
pub use state::{State, StateView};
pub(crate) use thread_partition::ThreadPartition;

use crate::error::Result;
use crate::spring::{Extension, LawValues, Spring, SpringLaw};
use nalgebra::Vector3;
use std::sync::Arc;
use thread_partition::ThreadPartitions;

/// A mass–spring system: everything that does not change while it moves.
///
/// Made by a [`SystemBuilder`], which checks every value; a `System` is valid by construction. Vectors always have
/// three components; in a planar or one-dimensional scene the absent ones are zero and have no degree of freedom.
///
/// # Examples
/// ```
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// assert_eq!(system.active_springs(), [0]);
/// // Three rows: of the particle that is not held.
/// assert_eq!(system.dofs().rows(1), 0..3);
/// // A held coordinate more.
/// let line = system.with_held(&[sprung::system::Dof { particle: 1, axis: 2 }], &state.positions);
/// assert_eq!(line.dofs().len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct System {
    dimension: usize,
    gravity: Vector3<f64>,
    masses: Vec<f64>,
    pairs: Vec<[u32; 2]>,
    springs: Vec<Spring>,
    prescribed: Prescribed,
    dofs: DofMap,
    active: Vec<u32>,
    law: Option<Arc<dyn SpringLaw>>,
    behaviour: Arc<Behaviour>,
    /// Which actuation counts for every spring; empty where there is none.
    actuated: Arc<Vec<u32>>,
    /// Whether some spring is not one of the built-in law with a rest length, at all times.
    has_special_springs: bool,
    loads: Arc<Loads>,
    external: Vec<Arc<dyn ExternalForce>>,
    shares: ThreadPartitions,
    part: Option<part::Part>,
}

impl System {
    /// The same system with another law for all its springs, whose parameters the law sees and whose damping stays. What `verify` and
    /// scenes say of springs is said of the built-in law.
    pub fn with_spring_law(self, law: impl SpringLaw + 'static) -> Self {
        Self { law: Some(Arc::new(law)), ..self }
    }

    /// The same system with one more force from outside.
    pub fn with_external_force(mut self, force: impl ExternalForce + 'static) -> Self {
        self.external.push(Arc::new(force));
        self
    }

    /// The same system with constant loads, drag and gravity that changes in time, in place of those that it has.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    pub fn with_loads(mut self, loads: Loads) -> Result<Self> {
        loads.check(self.particles(), self.dimension)?;
        if let Some(gravity) = &loads.gravity {
            self.gravity = gravity.at(0.0);
            self.prescribed.add_kinks(&gravity.times);
        }
        self.loads = Arc::new(loads);
        Ok(self)
    }

    /// The same system with springs that do not push or change their rest length, in place of those that it has.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    pub fn with_behaviour(mut self, behaviour: Behaviour) -> Result<Self> {
        behaviour.check(&self.springs)?;
        behaviour.actuation.iter().for_each(|entry| self.prescribed.add_kinks(&entry.factors.times));
        self.actuated = Arc::new(behaviour.of_springs(self.springs.len()));
        self.has_special_springs = behaviour.has_special(&self.springs);
        self.behaviour = Arc::new(behaviour);
        Ok(self)
    }

    /// Constant loads, drag and gravity in time.
    pub fn loads(&self) -> &Loads {
        &self.loads
    }

    /// Springs that do not push or change their rest length.
    pub fn behaviour(&self) -> &Behaviour {
        &self.behaviour
    }

    /// The forces from outside that are the caller's own.
    pub fn external_forces(&self) -> impl Iterator<Item = &dyn ExternalForce> + '_ {
        self.external.iter().map(|force| &**force)
    }

    /// Whether there are forces from outside, [loads](Self::loads) among them.
    pub fn has_external_forces(&self) -> bool {
        !self.external.is_empty() || !self.loads.is_empty()
    }

    /// Whether forces from outside enter the matrices.
    pub fn has_external_derivatives(&self) -> bool {
        self.loads.has_drag() || self.external.iter().any(|force| force.has_derivatives())
    }

    /// Whether all derivatives of forces from outside are known.
    pub fn knows_external_derivatives(&self) -> bool {
        self.external.iter().all(|force| force.has_derivatives())
    }

    /// Whether springs have to be asked for at their lengths: of a law of the caller's own, without a rest length, that do not push or that change
    /// their rest lengths.
    pub fn has_spring_law(&self) -> bool {
        self.law.is_some() || self.has_special_springs
    }

    /// How a spring's rest length has changed by a time: the factor, and its rate in 1/s.
    pub(crate) fn actuation(&self, number: usize, time: f64) -> Option<[f64; 2]> {
        let entry = self.behaviour.actuation.get(*self.actuated.get(number)? as usize)?;
        Some([entry.factors.at(time), entry.factors.rate(time)])
    }

    /// A spring with its rest length at a time.
    #[inline]
    fn spring_then(&self, number: usize, time: f64) -> Spring {
        let spring = self.springs[number];
        match self.actuation(number, time) {
            None => spring,
            Some([factor, _]) => Spring { rest_length: spring.rest_length * factor, ..spring },
        }
    }

    /// A spring as it is at a length, in m, and a time: its own parameters, or those of the [tangent](SpringLaw) of the law. One that does not
    /// push has neither stiffness nor damping while it is shorter than at rest.
    #[inline]
    pub fn spring_at(&self, number: usize, length: f64, time: f64) -> Spring {
        self.spring_with(LawValues::NONE, number, length, time)
    }

    /// As [`spring_at`](Self::spring_at), with what the law says of all springs at this configuration.
    #[inline]
    pub(crate) fn spring_with(&self, values: &LawValues, number: usize, length: f64, time: f64) -> Spring {
        let spring = self.spring_then(number, time);
        match &self.law {
            Some(law) => {
                let known = values.get(number).map(|value| value.tension);
                spring.tangent(known.unwrap_or_else(|| law.tension(number, &spring, length)), length)
            }
            None if self.behaviour.is_tension_only(number) && length < spring.rest_length => {
                Spring { stiffness: 0.0, rest_length: length, damping: 0.0 }
            }
            None => spring,
        }
    }

    /// All springs as they are at a moment, see [`spring_at`](Self::spring_at); those between prescribed particles too.
    pub fn springs_at(&self, at: &StateView<'_>) -> Vec<Spring> {
        let law = self.law_values(at.positions, at.time);
        let length = |[i, j]: [usize; 2]| (at.positions[i] - at.positions[j]).norm();
        let numbers = 0..self.springs.len();
        numbers.map(|number| self.spring_with(&law, number, length(self.pair(number)), at.time)).collect()
    }

    /// What the law says of all springs at these positions and this time, where it is one that is asked so.
    pub(crate) fn law_values(&self, positions: &[Vector3<f64>], time: f64) -> LawValues {
        let Some(law) = &self.law else { return LawValues::default() };
        if !law.is_asked_at_once() {
            return LawValues::default();
        }
        let springs: Vec<Spring> = (0..self.springs.len()).map(|number| self.spring_then(number, time)).collect();
        let length = |&[i, j]: &[u32; 2]| Extension::between(&positions[i as usize], &positions[j as usize]);
        let lengths: Vec<f64> = self.pairs.iter().map(|pair| length(pair).map_or(0.0, |at| at.length)).collect();
        LawValues::of(&**law, &springs, &lengths)
    }

    /// Where the ends of a spring are relative to each other; `None` where they coincide and the spring would need a direction.
    #[inline]
    pub fn extension(&self, number: usize, xi: &Vector3<f64>, xj: &Vector3<f64>) -> Option<Extension> {
        let may_collapse = || self.springs[number].rest_length == 0.0 || self.behaviour.is_tension_only(number);
        let collapsed = || (self.law.is_none() && may_collapse()).then_some(Extension::COLLAPSED);
        Extension::between(xi, xj).or_else(collapsed)
    }

    /// What a spring stores at a time, in J.
    pub fn elastic_energy(&self, number: usize, at: &Extension, time: f64) -> f64 {
        self.elastic_energy_with(LawValues::NONE, number, at, time)
    }

    /// As [`elastic_energy`](Self::elastic_energy), with what the law says of all springs at this configuration.
    pub(crate) fn elastic_energy_with(&self, values: &LawValues, number: usize, at: &Extension, time: f64) -> f64 {
        let spring = self.spring_then(number, time);
        match &self.law {
            Some(law) => {
                values.get(number).map_or_else(|| law.energy(number, &spring, at.length), |value| value.energy)
            }
            None if self.behaviour.is_tension_only(number) && at.length < spring.rest_length => 0.0,
            None => spring.elastic_energy(at),
        }
    }

    /// The same system with more coordinates held, where `positions` have them.
    ///
    /// Coordinates that are prescribed already keep their motion, and those that do not exist are passed over; particles and
    /// springs keep their numbers.
    pub fn with_held(&self, held: &[Dof], positions: &[Vector3<f64>]) -> Self {
        let is_free = |dof: &&Dof| {
            dof.particle < self.particles().min(positions.len()) && self.dofs.free_axes(dof.particle).contains(dof.axis)
        };
        let held: Vec<Dof> = held.iter().filter(is_free).copied().collect();
        let prescribed = self.prescribed.with_held(&held, positions);
        let mut free: Vec<Axes> = (0..self.particles()).map(|p| self.dofs.free_axes(p)).collect();
        for dof in &held {
            free[dof.particle] = free[dof.particle].without(Axes::of(&[dof.axis]));
        }
        let dofs = DofMap::new(free);
        let active = active_springs(&self.pairs, &dofs);
        Self { prescribed, dofs, active, ..self.clone() }
    }

    /// Number of modelled axes: 1, 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Gravitational acceleration, in m/s²: at time zero, where it [changes](Loads).
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }

    /// Mass of every particle, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// The lightest and the heaviest mass of particles that move freely along some axis, in kg, of all parts together; ∞ and 0 where none does.
    pub(crate) fn free_masses(&self) -> [f64; 2] {
        let free = self.masses.iter().enumerate().filter(|(p, _)| self.dofs.free_axes(*p) != Axes::NONE);
        let here = free.fold([f64::NEG_INFINITY, 0.0], |[light, heavy], (_, mass)| [light.max(-mass), mass.max(heavy)]);
        let [light, heavy] = self.largest(here);
        [-light, heavy]
    }

    /// Number of particles.
    pub fn particles(&self) -> usize {
        self.masses.len()
    }

    /// The end points (i, j) of every spring.
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// The end points (i, j) of one spring.
    pub fn pair(&self, spring: usize) -> [usize; 2] {
        self.pairs[spring].map(|p| p as usize)
    }

    /// Every spring, in the scene's order.
    pub fn springs(&self) -> &[Spring] {
        &self.springs
    }

    /// Indices of the springs that have a free end, ascending. Only these enter forces and matrices: a spring
    /// between two wholly prescribed particles moves nothing.
    pub fn active_springs(&self) -> &[u32] {
        &self.active
    }

    /// The active springs with their ends, in order: (spring, [i, j], parameters).
    #[inline]
    pub fn active(&self) -> impl ExactSizeIterator<Item = (usize, [usize; 2], &Spring)> + '_ {
        self.active.iter().map(|&s| (s as usize, self.pair(s as usize), &self.springs[s as usize]))
    }

    /// As [`active`](Self::active), from a position on.
    #[inline]
    pub(crate) fn active_from(&self, first: usize) -> impl Iterator<Item = (usize, [usize; 2], &Spring)> + '_ {
        let springs = self.active.get(first..).unwrap_or_default();
        springs.iter().map(|&s| (s as usize, self.pair(s as usize), &self.springs[s as usize]))
    }

    /// The map between (particle, axis) and the rows of reduced vectors and matrices.
    pub fn dofs(&self) -> &DofMap {
        &self.dofs
    }

    /// The prescribed coordinates and their motion.
    pub fn prescribed(&self) -> &Prescribed {
        &self.prescribed
    }

    /// Whether any spring that enters the matrices has damping, or any force from outside may have. Without one there is no G.
    pub fn is_damped(&self) -> bool {
        let here = || self.has_external_derivatives() || self.active().any(|(_, _, spring)| spring.damping > 0.0);
        self.damping_of_parts().unwrap_or_else(here)
    }
}

/// Indices of the springs with a free end.
fn active_springs(pairs: &[[u32; 2]], dofs: &DofMap) -> Vec<u32> {
    let is_free = |&p: &u32| dofs.free_axes(p as usize) != Axes::NONE;
    (0u32..).zip(pairs).filter(|(_, pair)| pair.iter().any(is_free)).map(|(s, _)| s).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three particles in a plane, the first held, the last on a rail along y that moves.
    #[test]
    fn held_coordinates_stay_and_others_keep_their_motion() {
        let mut builder = SystemBuilder::new();
        builder.dimension = 2;
        for x in [0.0, 1.0, 3.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        for i in 0..2 {
            builder.spring(i, i + 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.hold(0);
        let motion = Motion::Velocity(Vector3::new(0.5, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
        let (system, _) = builder.build().unwrap();
        assert_eq!((system.dofs().len(), system.active_springs().len()), (3, 2));
        assert!(!system.has_spring_law() && !system.has_external_forces());

        let places = [[9.0, 9.0, 0.0], [1.0, 7.0, 0.0], [9.0, 8.0, 0.0]].map(Vector3::from);
        // What is prescribed, not modelled or not there is passed over.
        let asked = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 2), (3, 0), (99, 1)];
        let asked = asked.map(|(particle, axis)| Dof { particle, axis });
        let held = system.with_held(&asked, &places);
        let free: Vec<Dof> = held.dofs().iter().collect();
        assert_eq!(free, [Dof { particle: 2, axis: 1 }]);
        assert_eq!((held.prescribed().len(), held.active_springs()), (5, &[1][..]));
        let mut positions = places.to_vec();
        held.prescribed().set_positions(2.0, &mut positions);
        let expected = [[0.0, 0.0, 0.0], [1.0, 7.0, 0.0], [4.0, 8.0, 0.0]].map(Vector3::from);
        assert_eq!(positions, expected);
    }

    /// Pulls with 3 N whatever the length.
    #[derive(Debug)]
    struct Pull;

    impl SpringLaw for Pull {
        fn tension(&self, number: usize, _: &Spring, length: f64) -> crate::spring::Tension {
            crate::spring::Tension { force: 3.0, slope: 4.0 * length + number as f64 }
        }

        fn energy(&self, _: usize, _: &Spring, length: f64) -> f64 {
            3.0 * length
        }
    }

    #[derive(Debug)]
    struct Wind;

    impl ExternalForce for Wind {
        fn add(&self, _: &StateView<'_>, force: &mut [Vector3<f64>]) {
            force.iter_mut().for_each(|force| force.x += 1.0);
        }
    }

    #[test]
    fn laws_and_forces_are_part_of_a_system() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([2.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.5 });
        let (system, _) = builder.build().unwrap();
        let at = Extension { direction: Vector3::x(), length: 2.0 };
        assert_eq!((system.elastic_energy(0, &at, 0.0), system.spring_at(0, 2.0, 0.0)), (4.0, system.springs()[0]));
        assert!(system.is_damped());

        let of_law = system.clone().with_spring_law(Pull);
        assert!(of_law.has_spring_law() && !of_law.has_external_forces());
        assert_eq!(of_law.elastic_energy(0, &at, 0.0), 6.0);
        // The tangent: k = T' l − T = 13 and l0 = 13/8.
        let tangent = of_law.spring_at(0, 2.0, 0.0);
        assert_eq!(tangent, Spring { stiffness: 13.0, rest_length: 1.625, damping: 0.5 });

        let forced = system.with_external_force(Wind).with_external_force(Wind);
        assert!(forced.has_external_forces() && !forced.has_spring_law());
        assert_eq!(forced.external_forces().count(), 2);
    }
}
