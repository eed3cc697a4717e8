//! A system that is changed in mid-run: another system with the same laws, loads, forces and motions, which goes on from any state of the first.

use super::constraint::Coordinate;
use super::{Behaviour, Dof, DofMap, Prescribed, State, System, active_springs, builder};
use crate::error::Result;
use crate::spring::{Spring, SpringLaw, Tension};
use std::collections::BTreeSet;
use std::sync::Arc;

impl System {
    /// The same system with other parameters for its springs, one for each, in order; which particles they join stays.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    ///
    /// # Examples
    /// ```
    /// # use sprung::{Spring, SystemBuilder};
    /// # let mut builder = SystemBuilder::new();
    /// # builder.particle([0.0, 0.0, 0.0], 1.0);
    /// # builder.particle([1.0, 0.0, 0.0], 1.0);
    /// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
    /// # builder.hold(0);
    /// # let (system, _) = builder.build()?;
    /// let twice = |spring: &Spring| Spring { stiffness: 2.0 * spring.stiffness, ..*spring };
    /// let stiffer = system.with_springs(system.springs().iter().map(twice).collect())?;
    /// assert_eq!(stiffer.springs()[0].stiffness, 40.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn with_springs(&self, springs: Vec<Spring>) -> Result<Self> {
        super::check_length("springs.stiffness", springs.len(), self.springs.len(), "springs")?;
        springs.iter().enumerate().try_for_each(|(s, spring)| builder::check_spring(s, spring))?;
        self.behaviour.check(&springs)?;
        let has_special_springs = self.behaviour.has_special(&springs);
        Ok(Self { springs, has_special_springs, ..self.clone() })
    }

    /// The same system without some of its springs: torn, or cut. Those that stay keep their order, so later ones have smaller numbers; a spring law, tension
    /// without compression and actuation stay with their springs, and a law is asked by the numbers that it knew before. Numbers of springs that do not exist
    /// are passed over.
    ///
    /// # Examples
    /// ```
    /// # use sprung::{Spring, SystemBuilder};
    /// # let mut builder = SystemBuilder::new();
    /// # builder.particle([0.0, 0.0, 0.0], 1.0);
    /// # builder.particle([1.0, 0.0, 0.0], 1.0);
    /// # builder.particle([2.0, 0.0, 0.0], 1.0);
    /// # let spring = Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 };
    /// # builder.spring(0, 1, spring);
    /// # builder.spring(1, 2, spring);
    /// # let (system, _) = builder.build()?;
    /// let torn = system.without_springs(&[0]);
    /// assert_eq!(torn.pairs(), [[1, 2]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn without_springs(&self, removed: &[usize]) -> Self {
        let removed: BTreeSet<usize> = removed.iter().copied().collect();
        let numbers: Vec<usize> = (0..self.springs.len()).filter(|spring| !removed.contains(spring)).collect();
        let springs: Vec<Spring> = numbers.iter().map(|&s| self.springs[s]).collect();
        let pairs: Vec<[u32; 2]> = numbers.iter().map(|&s| self.pairs[s]).collect();
        let behaviour = self.behaviour.renumbered(&numbers);
        let law = self.law.clone().map(|law| -> Arc<dyn SpringLaw> { Arc::new(Renumbered { law, numbers }) });
        Self {
            active: active_springs(&pairs, &self.dofs),
            actuated: Arc::new(behaviour.of_springs(springs.len())),
            has_special_springs: behaviour.has_special(&springs),
            behaviour: Arc::new(behaviour),
            pairs,
            springs,
            law,
            ..self.clone()
        }
    }

    /// The same system with coordinates that were prescribed free again. Those that are free already, or do not exist, are passed over. A
    /// released particle keeps the velocity that its state has, which is that of its motion.
    ///
    /// # Examples
    /// ```
    /// # use sprung::SystemBuilder;
    /// # use sprung::system::Dof;
    /// # let mut builder = SystemBuilder::new();
    /// # builder.particle([0.0, 0.0, 0.0], 1.0);
    /// # builder.hold(0);
    /// # let (system, _) = builder.build()?;
    /// let free = system.with_released(&[0, 1, 2].map(|axis| Dof { particle: 0, axis }));
    /// assert_eq!((system.dofs().len(), free.dofs().len()), (0, 3));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn with_released(&self, released: &[Dof]) -> Self {
        let released: BTreeSet<(usize, usize)> = released.iter().map(|dof| (dof.particle, dof.axis)).collect();
        let mut free: Vec<_> = (0..self.particles()).map(|p| self.dofs.free_axes(p)).collect();
        let is_released = |dof: &Dof| released.contains(&(dof.particle, dof.axis));
        for (dof, ..) in self.prescribed.iter().filter(|(dof, ..)| is_released(dof)) {
            free[dof.particle] = free[dof.particle].with(dof.axis);
        }
        let dofs = DofMap::new(free);
        let active = active_springs(&self.pairs, &dofs);
        Self { prescribed: self.prescribed.without(is_released), dofs, active, ..self.clone() }
    }

    /// The same system going on from a state in which prescribed coordinates may be elsewhere than their motions have them at its time, as after a particle was
    /// held that moved before: their motions then lead on from where they are, `x(t) = x_s + offset(t) − offset(t_s)`, and nothing jumps. What is
    /// within rounding of its motion stays as it is, to the bit.
    pub fn continued_from(&self, state: &State) -> Self {
        Self { prescribed: self.prescribed.through(state), ..self.clone() }
    }
}

/// How near to its motion a coordinate is on it, relative to the numbers that the place is computed from.
const ON_MOTION: f64 = 1e-12;

impl Prescribed {
    /// These without some coordinates.
    fn without(&self, is_left_out: impl Fn(&Dof) -> bool) -> Self {
        let mut rest = self.clone();
        rest.coordinates.retain(|c| !is_left_out(&c.dof()));
        rest
    }

    /// The same motions, shifted to where a state is that is not on them.
    fn through(&self, state: &State) -> Self {
        let mut shifted = self.clone();
        for c in &mut shifted.coordinates {
            let Coordinate { axis, start, .. } = *c;
            let (motion, axis) = (&self.motions[c.motion as usize], usize::from(axis));
            let Some(place) = state.positions.get(c.particle as usize).map(|x| x[axis]) else { continue };
            let offset = motion.offset(state.time, axis);
            let travel = motion.velocity(state.time, axis) * state.time;
            let size = place.abs().max(start.abs()).max(offset.abs()).max(travel.abs());
            if (place - (start + offset)).abs() > ON_MOTION * size {
                c.start = place - offset;
            }
        }
        shifted
    }
}

impl Behaviour {
    /// Whether some spring is not one of the built-in law with a rest length, at all times.
    pub(super) fn has_special(&self, springs: &[Spring]) -> bool {
        !self.is_empty() || springs.iter().any(|spring| spring.rest_length == 0.0)
    }

    /// That of the springs with these numbers, ascending, which are counted anew.
    fn renumbered(&self, numbers: &[usize]) -> Self {
        let flags = numbers.iter().map(|&s| self.is_tension_only(s));
        let tension_only = if self.tension_only.is_empty() { Vec::new() } else { flags.collect() };
        let mut actuation = self.actuation.clone();
        for entry in &mut actuation {
            entry.springs = entry.springs.iter().filter_map(|spring| numbers.binary_search(spring).ok()).collect();
        }
        Self { tension_only, actuation }
    }
}

/// A law for springs that had other numbers before.
#[derive(Debug)]
struct Renumbered {
    law: Arc<dyn SpringLaw>,
    /// The number of every spring that the law knows it by.
    numbers: Vec<usize>,
}

impl Renumbered {
    fn before(&self, number: usize) -> usize {
        self.numbers.get(number).copied().unwrap_or(number)
    }
}

impl SpringLaw for Renumbered {
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension {
        self.law.tension(self.before(number), spring, length)
    }

    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64 {
        self.law.energy(self.before(number), spring, length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Actuation, Axes, Constraint, Curve, Loads, Motion, SystemBuilder};
    use nalgebra::Vector3;

    const SPRING: Spring = Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.5 };

    /// Four particles in a row; the first is led along x at 2 m/s and held along y, springs have different stiffness, the first does not push, the last
    /// becomes longer.
    fn chain() -> (System, State) {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for p in 0..4 {
            builder.particle([f64::from(p), 0.0, 0.0], 1.0);
        }
        for s in 0..3 {
            builder.spring(s, s + 1, Spring { stiffness: 1.0 + s as f64, ..SPRING });
        }
        let motion = Motion::Velocity(Vector3::new(2.0, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, state) = builder.build().unwrap();
        let factors = Curve { times: vec![0.0, 1.0], values: vec![1.0, 3.0] };
        let actuation = vec![Actuation { springs: vec![0, 2], factors }];
        let behaviour = Behaviour { tension_only: vec![true, false, false], actuation };
        let loads = Loads { drag: vec![0.25; 4], ..Loads::default() };
        (system.with_behaviour(behaviour).unwrap().with_loads(loads).unwrap(), state)
    }

    #[test]
    fn what_belongs_to_a_spring_stays_with_it() {
        let (system, _) = chain();
        let torn = system.without_springs(&[1, 1, 9]);
        assert_eq!((torn.pairs(), torn.active_springs()), (&[[0, 1], [2, 3]][..], &[0, 1][..]));
        assert_eq!([0, 1].map(|s| torn.behaviour().is_tension_only(s)), [true, false]);
        // At half a second rest lengths have doubled; the spring that does not push is slack then.
        let [first, last] = [0, 1].map(|s| torn.spring_at(s, 1.5, 0.5));
        assert_eq!((first.stiffness, last), (0.0, Spring { stiffness: 3.0, rest_length: 2.0, damping: 0.5 }));
        assert_eq!((torn.loads(), torn.dofs()), (system.loads(), system.dofs()));
        assert!(torn.has_spring_law() && !system.without_springs(&[0, 1, 2]).behaviour().is_tension_only(0));

        let doubled = system.with_springs(vec![Spring { stiffness: 16.0, ..SPRING }; 3]).unwrap();
        assert_eq!((doubled.spring_at(1, 1.0, 0.5).stiffness, doubled.behaviour()), (16.0, system.behaviour()));
    }

    /// Pulls with as many newtons as the spring's number says.
    #[derive(Debug)]
    struct ByNumber;

    impl SpringLaw for ByNumber {
        fn tension(&self, number: usize, _: &Spring, _: f64) -> Tension {
            Tension { force: number as f64, slope: 1.0 }
        }

        fn energy(&self, number: usize, _: &Spring, length: f64) -> f64 {
            number as f64 * length
        }
    }

    /// Torn twice, the spring that is left has the force that it had.
    #[test]
    fn laws_know_springs_by_their_first_numbers() {
        let system = chain().0.with_spring_law(ByNumber).without_springs(&[0]).without_springs(&[0]);
        let at = system.extension(0, &Vector3::zeros(), &Vector3::x()).unwrap();
        assert_eq!((system.pairs(), system.elastic_energy(0, &at, 0.0)), (&[[2, 3]][..], 2.0));
        let spring = system.spring_at(0, 1.5, 0.0);
        assert_eq!(spring.stiffness * (1.5 / spring.rest_length - 1.0), 2.0);
    }

    #[test]
    fn parameters_that_break_a_rule_are_refused() {
        let (system, _) = chain();
        let refused = |springs| system.with_springs(springs).unwrap_err().to_string();
        assert!(refused(vec![SPRING; 2]).starts_with("springs.stiffness = a list of 2: must have one entry"));
        let negative = [SPRING, Spring { stiffness: -1.0, ..SPRING }, SPRING];
        assert_eq!(refused(negative.to_vec()), "springs.stiffness[1] = -1: must be finite and positive");
        let negative = [SPRING, SPRING, Spring { damping: -1.0, ..SPRING }];
        assert_eq!(refused(negative.to_vec()), "springs.damping[2] = -1: must be finite and not negative");
        let without = [SPRING, SPRING, Spring { rest_length: 0.0, ..SPRING }];
        assert!(refused(without.to_vec()).contains("has no rest length to change"));
    }

    #[test]
    fn released_coordinates_are_free_and_others_stay() {
        let (system, state) = chain();
        let asked = [(0, 1), (1, 0), (0, 2), (7, 0)].map(|(particle, axis)| Dof { particle, axis });
        let released = system.with_released(&asked);
        assert_eq!((system.dofs().len(), released.dofs().len()), (6, 7));
        assert_eq!(released.dofs().free_axes(0), Axes::of(&[1]));
        let mut positions = state.positions.clone();
        released.prescribed().set_positions(3.0, &mut positions);
        assert_eq!(positions[0], Vector3::new(6.0, 0.0, 0.0));
        let both = [0, 1].map(|axis| Dof { particle: 0, axis });
        assert!(system.with_released(&both).prescribed().is_empty());
        // Between two held particles a spring moves nothing, between others it does.
        let held = system.with_held(&[0, 1].map(|axis| Dof { particle: 1, axis }), &state.positions);
        assert_eq!((held.active_springs(), held.with_released(&both).active_springs()), (&[1, 2][..], &[0, 1, 2][..]));
    }

    /// The led particle stands half a metre ahead of its motion and above it: from there it is led on.
    #[test]
    fn motions_lead_on_from_where_a_state_is() {
        let (system, mut state) = chain();
        state.time = 3.0;
        state.positions[0] = Vector3::new(6.5, 0.25, 0.0);
        let shifted = system.continued_from(&state);
        let mut positions = state.positions.clone();
        shifted.prescribed().set_positions(3.0, &mut positions);
        assert_eq!(positions, state.positions);
        shifted.prescribed().set_positions(4.0, &mut positions);
        assert_eq!(positions[0], Vector3::new(8.5, 0.25, 0.0));
        // Within rounding of the motion it is on it.
        state.positions[0] = Vector3::new(6.0_f64.next_up(), 0.0, 0.0);
        let starts = |system: &System| system.prescribed().iter().map(|(_, start, _)| start).collect::<Vec<_>>();
        assert_eq!(starts(&system.continued_from(&state)), starts(&system));
    }
}
