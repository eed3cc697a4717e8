//! Modified copies of a system, which continue from any state of the original.

use super::loads::check_length;
use super::{Axes, Dof, DofMap, Prescribed, State, System, active_springs, builder};
use crate::error::Result;
use crate::spring::{Spring, SpringLaw, Tension};
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::sync::Arc;

impl System {
    /// The system with other parameters for its springs, one entry for each, in order.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for the first value that breaks a rule of the scene format, with its key and index.
    pub fn with_springs(&self, springs: Vec<Spring>) -> Result<Self> {
        check_length("springs.stiffness", springs.len(), self.springs.len(), "springs")?;
        springs.iter().enumerate().try_for_each(|(s, spring)| builder::check_spring(s, spring))?;
        self.behaviour.check(&springs)?;
        let has_special_springs = self.behaviour.has_special(&springs);
        Ok(Self { springs, has_special_springs, ..self.clone() })
    }

    /// The system without some of its springs. The others keep their order and are renumbered; behaviour and actuation stay with their springs, and a
    /// spring law still receives the original numbers. Numbers that do not exist are ignored.
    pub fn without_springs(&self, removed: &[usize]) -> Self {
        let removed: BTreeSet<usize> = removed.iter().copied().collect();
        let numbers: Vec<usize> = (0..self.springs.len()).filter(|spring| !removed.contains(spring)).collect();
        let springs: Vec<Spring> = numbers.iter().map(|&s| self.springs[s]).collect();
        let pairs: Vec<[u32; 2]> = numbers.iter().map(|&s| self.pairs[s]).collect();
        let behaviour = self.behaviour.renumbered(&numbers);
        let law = self.law.clone().map(|law| -> Arc<dyn SpringLaw> { Arc::new(Renumbered { law, numbers }) });
        Self {
            active: active_springs(&pairs, &self.dofs),
            actuated: Arc::new(behaviour.actuation_indices(springs.len())),
            has_special_springs: behaviour.has_special(&springs),
            behaviour: Arc::new(behaviour),
            pairs,
            springs,
            law,
            ..self.clone()
        }
    }

    /// The system with some prescribed coordinates released. Coordinates that are free or do not exist are ignored. A released particle keeps its velocity
    /// in the state, which is that of its motion.
    pub fn with_released(&self, released: &[Dof]) -> Self {
        let released: BTreeSet<(usize, usize)> = released.iter().map(|dof| (dof.particle, dof.axis)).collect();
        let is_released = |dof: &Dof| released.contains(&(dof.particle, dof.axis));
        let mut free = self.free_axes();
        for (dof, ..) in self.prescribed.iter().filter(|(dof, ..)| is_released(dof)) {
            free[dof.particle] = free[dof.particle].with(dof.axis);
        }
        self.with_prescribed(self.prescribed.clone().without(is_released), free)
    }

    /// The system with more coordinates held, at `positions`. Prescribed coordinates keep their motion, and those that do not exist are ignored;
    /// particles and springs keep their numbers.
    pub fn with_held(&self, held: &[Dof], positions: &[Vector3<f64>]) -> Self {
        let is_free = |dof: &&Dof| {
            dof.particle < self.particles().min(positions.len()) && self.dofs.free_axes(dof.particle).contains(dof.axis)
        };
        let held: Vec<Dof> = held.iter().filter(is_free).copied().collect();
        let mut free = self.free_axes();
        for dof in &held {
            free[dof.particle] = free[dof.particle].without(Axes::of(&[dof.axis]));
        }
        self.with_prescribed(self.prescribed.with_held(&held, positions), free)
    }

    /// The system continued from a state whose prescribed coordinates may differ from their motions, as after a moving particle was held: the
    /// motions are shifted, `x(t) = x_s + offset(t) − offset(t_s)`, so that nothing jumps. Coordinates that agree to rounding do not change.
    pub fn continued_from(&self, state: &State) -> Self {
        Self { prescribed: self.prescribed.clone().shifted_to(state), ..self.clone() }
    }

    fn free_axes(&self) -> Vec<Axes> {
        (0..self.particles()).map(|p| self.dofs.free_axes(p)).collect()
    }

    fn with_prescribed(&self, prescribed: Prescribed, free: Vec<Axes>) -> Self {
        let dofs = DofMap::new(free);
        let active = active_springs(&self.pairs, &dofs);
        Self { prescribed, dofs, active, ..self.clone() }
    }
}

/// A law that receives the original numbers of springs.
#[derive(Debug)]
struct Renumbered {
    law: Arc<dyn SpringLaw>,
    numbers: Vec<usize>,
}

impl Renumbered {
    fn original(&self, number: usize) -> usize {
        self.numbers.get(number).copied().unwrap_or(number)
    }
}

impl SpringLaw for Renumbered {
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension {
        self.law.tension(self.original(number), spring, length)
    }

    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64 {
        self.law.energy(self.original(number), spring, length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Actuation, Behaviour, Constraint, Curve, Loads, Motion, SystemBuilder};

    const SPRING: Spring = Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.5 };

    /// Four particles in a row; the first moves along x at 2 m/s. The first spring is tension-only, and the first and the last become longer.
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

    /// Loads and behaviour that are replaced leave no kinks behind.
    #[test]
    fn kinks_are_those_of_the_present_loads_and_behaviour() {
        let gravity = Curve { times: vec![2.0, 0.5 + 2.0], values: vec![Vector3::zeros(), Vector3::x()] };
        let (system, _) = chain();
        let pulled = system.with_loads(Loads { gravity: Some(gravity), ..Loads::default() }).unwrap();
        assert_eq!(pulled.prescribed().kinks(), [0.0, 1.0, 2.0, 2.5]);
        let passive = pulled.clone().with_behaviour(Behaviour::default()).unwrap();
        assert_eq!(passive.prescribed().kinks(), [2.0, 2.5]);
        assert_eq!(pulled.with_loads(Loads::default()).unwrap().prescribed().kinks(), [0.0, 1.0]);
        assert!(passive.with_loads(Loads::default()).unwrap().prescribed().kinks().is_empty());
    }

    #[test]
    fn what_belongs_to_a_spring_stays_with_it() {
        let (system, _) = chain();
        let torn = system.without_springs(&[1, 1, 9]);
        assert_eq!((torn.pairs(), torn.active_springs()), (&[[0, 1], [2, 3]][..], &[0, 1][..]));
        assert_eq!([0, 1].map(|s| torn.behaviour().is_tension_only(s)), [true, false]);
        // At half a second rest lengths have doubled, and the tension-only spring is slack.
        let [first, last] = [0, 1].map(|s| torn.spring_at(s, 1.5, 0.5));
        assert_eq!((first.stiffness, last), (0.0, Spring { stiffness: 3.0, rest_length: 2.0, damping: 0.5 }));
        assert_eq!((torn.loads(), torn.dofs()), (system.loads(), system.dofs()));
        assert!(torn.has_spring_law() && !system.without_springs(&[0, 1, 2]).behaviour().is_tension_only(0));

        let doubled = system.with_springs(vec![Spring { stiffness: 16.0, ..SPRING }; 3]).unwrap();
        assert_eq!((doubled.spring_at(1, 1.0, 0.5).stiffness, doubled.behaviour()), (16.0, system.behaviour()));
    }

    /// A tension of as many newtons as the number of the spring.
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

    #[test]
    fn laws_receive_original_numbers() {
        let system = chain().0.with_spring_law(ByNumber).without_springs(&[0]).without_springs(&[0]);
        let at = system.extension(0, &Vector3::zeros(), &Vector3::x()).unwrap();
        assert_eq!((system.pairs(), system.elastic_energy(0, &at, 0.0)), (&[[2, 3]][..], 2.0));
        let spring = system.spring_at(0, 1.5, 0.0);
        assert_eq!(spring.stiffness * (1.5 / spring.rest_length - 1.0), 2.0);
        // The tangent: k = T' l − T and l0 = k/T'.
        assert_eq!((spring.stiffness, spring.rest_length), (-0.5, -0.5));
    }

    #[test]
    fn parameters_that_break_a_rule_are_refused() {
        let (system, _) = chain();
        for (springs, rule) in [
            (vec![SPRING; 2], "springs.stiffness = a list of 2: must have one entry"),
            (vec![SPRING, Spring { stiffness: -1.0, ..SPRING }, SPRING], "springs.stiffness[1] = -1: must be"),
            (vec![SPRING, SPRING, Spring { damping: -1.0, ..SPRING }], "springs.damping[2] = -1: must be"),
            (vec![SPRING, SPRING, Spring { rest_length: 0.0, ..SPRING }], "has no rest length to change"),
        ] {
            let message = system.with_springs(springs).unwrap_err().to_string();
            assert!(message.contains(rule), "{message}");
        }
    }

    #[test]
    fn released_coordinates_are_free_and_others_stay() {
        let (system, state) = chain();
        let requested = [(0, 1), (1, 0), (0, 2), (7, 0)].map(|(particle, axis)| Dof { particle, axis });
        let released = system.with_released(&requested);
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

    /// The prescribed particle is ahead of its motion and above it, and continues from there.
    #[test]
    fn motions_continue_from_a_state() {
        let (system, mut state) = chain();
        state.time = 3.0;
        state.positions[0] = Vector3::new(6.5, 0.25, 0.0);
        let shifted = system.continued_from(&state);
        let mut positions = state.positions.clone();
        shifted.prescribed().set_positions(3.0, &mut positions);
        assert_eq!(positions, state.positions);
        shifted.prescribed().set_positions(4.0, &mut positions);
        assert_eq!(positions[0], Vector3::new(8.5, 0.25, 0.0));
        // A difference within rounding is ignored.
        state.positions[0] = Vector3::new(6.0_f64.next_up(), 0.0, 0.0);
        let starts = |system: &System| system.prescribed().iter().map(|(_, start, _)| start).collect::<Vec<_>>();
        assert_eq!(starts(&system.continued_from(&state)), starts(&system));
    }

    /// Three particles in a plane, the first held, the last free along y alone.
    #[test]
    fn held_coordinates_stay_and_others_keep_their_motion() {
        let mut builder = SystemBuilder::new();
        builder.dimension = 2;
        for x in [0.0, 1.0, 3.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        for i in 0..2 {
            builder.spring(i, i + 1, SPRING);
        }
        builder.hold(0);
        let motion = Motion::Velocity(Vector3::new(0.5, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
        let (system, _) = builder.build().unwrap();
        assert_eq!((system.dofs().len(), system.active_springs().len()), (3, 2));
        assert!(!system.has_spring_law() && !system.has_external_forces());

        let places = [[9.0, 9.0, 0.0], [1.0, 7.0, 0.0], [9.0, 8.0, 0.0]].map(Vector3::from);
        // Coordinates that are prescribed, not modelled or do not exist are ignored.
        let requested = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 2), (3, 0), (99, 1)];
        let requested = requested.map(|(particle, axis)| Dof { particle, axis });
        let held = system.with_held(&requested, &places);
        let free: Vec<Dof> = held.dofs().iter().collect();
        assert_eq!(free, [Dof { particle: 2, axis: 1 }]);
        assert_eq!((held.prescribed().len(), held.active_springs()), (5, &[1][..]));
        let mut positions = places.to_vec();
        held.prescribed().set_positions(2.0, &mut positions);
        let expected = [[0.0, 0.0, 0.0], [1.0, 7.0, 0.0], [4.0, 8.0, 0.0]].map(Vector3::from);
        assert_eq!(positions, expected);
    }
}
