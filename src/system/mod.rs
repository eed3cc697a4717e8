//! Mass–spring systems: particles, springs, constraints and their free degrees of freedom.

mod builder;
mod change;
mod constraint;
mod dofs;
mod loads;
mod partition;
mod state;

pub use builder::SystemBuilder;
pub use constraint::{Constraint, Motion, Prescribed};
pub use dofs::{Axes, Dof, DofMap};
pub(crate) use loads::SAME_TIME;
#[cfg(feature = "scene")]
pub(crate) use loads::check_length;
pub use loads::{Actuation, Behaviour, Curve, Derivatives, ExternalForce, Loads};
pub use partition::Communicator;
pub(crate) use partition::ThreadPartition;
pub(crate) use state::extent;
pub use state::{State, StateView};

use crate::error::Result;
use crate::spring::{Extension, LawValues, Spring, SpringLaw};
use nalgebra::Vector3;
use partition::{PartitionCache, Subdomain};
use std::sync::Arc;

/// An immutable mass–spring system.
///
/// A [`SystemBuilder`] checks every value, so a `System` is valid by construction. Vectors always have three components; in a planar or
/// one-dimensional scene the absent ones are zero and have no degree of freedom.
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
    /// The index of the actuation of every spring; empty without actuation.
    actuated: Arc<Vec<u32>>,
    /// True if any spring is not one of the built-in law with a constant rest length.
    has_special_springs: bool,
    loads: Arc<Loads>,
    external: Vec<Arc<dyn ExternalForce>>,
    partitions: PartitionCache,
    subdomain: Option<Subdomain>,
}

impl System {
    /// The system with another law for all its springs; damping does not change. `verify` and scene files support the built-in law only.
    pub fn with_spring_law(self, law: impl SpringLaw + 'static) -> Self {
        Self { law: Some(Arc::new(law)), ..self }
    }

    /// The system with one more external force.
    pub fn with_external_force(mut self, force: impl ExternalForce + 'static) -> Self {
        self.external.push(Arc::new(force));
        self
    }

    /// The system with these loads in place of its own.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    pub fn with_loads(mut self, loads: Loads) -> Result<Self> {
        loads.check(self.particles(), self.dimension)?;
        if let Some(gravity) = &loads.gravity {
            self.gravity = gravity.at(0.0);
        }
        self.loads = Arc::new(loads);
        Ok(self.with_load_kinks())
    }

    /// The system with this behaviour of its springs in place of its own.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    pub fn with_behaviour(mut self, behaviour: Behaviour) -> Result<Self> {
        behaviour.check(&self.springs)?;
        self.actuated = Arc::new(behaviour.actuation_indices(self.springs.len()));
        self.has_special_springs = behaviour.has_special(&self.springs);
        self.behaviour = Arc::new(behaviour);
        Ok(self.with_load_kinks())
    }

    fn with_load_kinks(mut self) -> Self {
        let gravity = self.loads.gravity.iter().flat_map(|curve| &curve.times);
        let lengths = self.behaviour.actuation.iter().flat_map(|entry| &entry.factors.times);
        let times = gravity.chain(lengths).copied().collect();
        self.prescribed.set_load_kinks(times);
        self
    }

    /// Constant loads, drag and gravity in time.
    pub fn loads(&self) -> &Loads {
        &self.loads
    }

    /// Tension-only springs and rest lengths that change in time.
    pub fn behaviour(&self) -> &Behaviour {
        &self.behaviour
    }

    /// The external forces that are not [loads](Self::loads).
    pub fn external_forces(&self) -> impl Iterator<Item = &dyn ExternalForce> + '_ {
        self.external.iter().map(|force| &**force)
    }

    /// True if there are loads or other external forces.
    pub fn has_external_forces(&self) -> bool {
        !self.external.is_empty() || !self.loads.is_empty()
    }

    /// True if forces other than those of springs may depend on time.
    pub(crate) fn has_forces_in_time(&self) -> bool {
        self.loads.gravity.is_some() || !self.external.is_empty()
    }

    /// True if external forces enter the matrices.
    pub fn has_external_derivatives(&self) -> bool {
        self.loads.has_drag() || self.external.iter().any(|force| force.has_derivatives())
    }

    /// True if all external forces provide their derivatives.
    pub fn knows_external_derivatives(&self) -> bool {
        self.external.iter().all(|force| force.has_derivatives())
    }

    /// True if the parameters of springs depend on their lengths or on time: with a custom law, without a rest length, tension-only or with actuation.
    pub fn has_spring_law(&self) -> bool {
        self.law.is_some() || self.has_special_springs
    }

    /// True if any spring follows a law of the caller's own, is tension-only, or is actuated.
    pub(crate) fn has_other_laws(&self) -> bool {
        self.law.is_some() || !self.behaviour.is_empty()
    }

    /// The factor of the rest length of a spring at a time, and its rate in 1/s.
    pub(crate) fn actuation(&self, number: usize, time: f64) -> Option<[f64; 2]> {
        let entry = self.behaviour.actuation.get(*self.actuated.get(number)? as usize)?;
        Some([entry.factors.at(time), entry.factors.rate(time)])
    }

    /// A spring with its rest length at a time.
    #[inline]
    pub(crate) fn spring_then(&self, number: usize, time: f64) -> Spring {
        let spring = self.springs[number];
        match self.actuation(number, time) {
            None => spring,
            Some([factor, _]) => Spring { rest_length: spring.rest_length * factor, ..spring },
        }
    }

    /// The parameters of a spring at a length, in m, and a time: its own, or those of the [tangent](SpringLaw) of the law. A tension-only
    /// spring has neither stiffness nor damping while it is slack.
    #[inline]
    pub fn spring_at(&self, number: usize, length: f64, time: f64) -> Spring {
        self.spring_with(LawValues::NONE, number, length, time)
    }

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

    /// The length below which a tension-only spring is slack, in m; `None` for other springs.
    pub(crate) fn slack_length(&self, number: usize, time: f64) -> Option<f64> {
        self.behaviour.is_tension_only(number).then(|| self.spring_then(number, time).rest_length)
    }

    /// The parameters of all springs, those between prescribed particles included; see [`spring_at`](Self::spring_at).
    pub fn springs_at(&self, at: &StateView<'_>) -> Vec<Spring> {
        let law = self.law_values(at.positions, at.time);
        let spring = |number: usize| {
            let [i, j] = self.pair(number);
            self.spring_with(&law, number, (at.positions[i] - at.positions[j]).norm(), at.time)
        };
        (0..self.springs.len()).map(spring).collect()
    }

    /// The values of a law that is evaluated for all springs at once; otherwise empty.
    pub(crate) fn law_values(&self, positions: &[Vector3<f64>], time: f64) -> LawValues {
        let length = |number: usize| {
            let [i, j] = self.pair(number);
            Extension::between(&positions[i], &positions[j]).map_or(0.0, |at| at.length)
        };
        self.law_values_of(length, time)
    }

    pub(crate) fn law_values_of(&self, length: impl Fn(usize) -> f64, time: f64) -> LawValues {
        let Some(law) = self.law.as_ref().filter(|law| law.is_asked_at_once()) else { return LawValues::default() };
        let numbers = 0..self.springs.len();
        let springs: Vec<Spring> = numbers.clone().map(|number| self.spring_then(number, time)).collect();
        let lengths: Vec<f64> = numbers.map(length).collect();
        LawValues::of(&**law, &springs, &lengths)
    }

    /// Direction and length of a spring; `None` where its ends coincide and it needs a direction.
    #[inline]
    pub fn extension(&self, number: usize, xi: &Vector3<f64>, xj: &Vector3<f64>) -> Option<Extension> {
        let may_collapse = || self.springs[number].rest_length == 0.0 || self.behaviour.is_tension_only(number);
        let collapsed = || (self.law.is_none() && may_collapse()).then_some(Extension::COLLAPSED);
        Extension::between(xi, xj).or_else(collapsed)
    }

    /// The elastic energy of a spring, in J.
    pub fn elastic_energy(&self, number: usize, at: &Extension, time: f64) -> f64 {
        self.elastic_energy_with(LawValues::NONE, number, at, time)
    }

    pub(crate) fn elastic_energy_with(&self, values: &LawValues, number: usize, at: &Extension, time: f64) -> f64 {
        self.elastic_energy_of(values, number, &self.spring_then(number, time), at)
    }

    pub(crate) fn elastic_energy_of(&self, values: &LawValues, number: usize, spring: &Spring, at: &Extension) -> f64 {
        match &self.law {
            Some(law) => values.get(number).map_or_else(|| law.energy(number, spring, at.length), |value| value.energy),
            None if self.behaviour.is_tension_only(number) && at.length < spring.rest_length => 0.0,
            None => spring.elastic_energy(at),
        }
    }

    /// The number of modelled axes: 1, 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The gravitational acceleration at time zero, in m/s².
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }

    /// The mass of every particle, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// The smallest and the largest mass of particles with a free axis, in kg, over all subdomains; ∞ and 0 if there are none.
    pub(crate) fn free_masses(&self) -> [f64; 2] {
        let free = self.masses.iter().enumerate().filter(|(p, _)| self.dofs.free_axes(*p) != Axes::NONE);
        let here = free.fold([f64::NEG_INFINITY, 0.0], |[light, heavy], (_, mass)| [light.max(-mass), mass.max(heavy)]);
        let [light, heavy] = self.largest(here);
        [-light, heavy]
    }

    /// The number of particles.
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

    /// The parameters of every spring, in order.
    pub fn springs(&self) -> &[Spring] {
        &self.springs
    }

    /// Indices of the springs with a free end, ascending. Only these enter forces and matrices.
    pub fn active_springs(&self) -> &[u32] {
        &self.active
    }

    /// The active springs with their ends, in order: (spring, [i, j], parameters).
    #[inline]
    pub fn active(&self) -> impl ExactSizeIterator<Item = (usize, [usize; 2], &Spring)> + '_ {
        self.active_from(0)
    }

    #[inline]
    pub(crate) fn active_from(&self, first: usize) -> impl ExactSizeIterator<Item = (usize, [usize; 2], &Spring)> + '_ {
        let springs = self.active.get(first..).unwrap_or_default();
        springs.iter().map(|&s| (s as usize, self.pair(s as usize), &self.springs[s as usize]))
    }

    /// The map between (particle, axis) and the rows of reduced vectors and matrices.
    pub fn dofs(&self) -> &DofMap {
        &self.dofs
    }

    /// The prescribed coordinates and their motions.
    pub fn prescribed(&self) -> &Prescribed {
        &self.prescribed
    }
}

fn active_springs(pairs: &[[u32; 2]], dofs: &DofMap) -> Vec<u32> {
    let is_free = |&p: &u32| dofs.free_axes(p as usize) != Axes::NONE;
    (0u32..).zip(pairs).filter(|(_, pair)| pair.iter().any(is_free)).map(|(s, _)| s).collect()
}

#[cfg(test)]
pub(crate) mod fixtures;
