//! One pass over the particles after every step: the energy that they have.
//!
//! A scene that nothing holds flies and falls as a whole, which no spring sees. The energy of its centre of mass is known by itself.

use crate::system::{State, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Particles of a block. Sums are made block by block, whatever the number of threads.
const BLOCK: usize = 4096;

/// Sums over particles at a state, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    /// `Σ ½ m v²`.
    pub kinetic: f64,
    /// `Σ m gravity·x`.
    pub weight: f64,
    /// The part of both that the centre of mass of a scene has that nothing holds.
    pub carried: Carried,
    /// `Σ m` and `Σ m v` where nothing is held.
    mass: f64,
    momentum: Vector3<f64>,
}

/// Energy of the centre of mass: kinetic, and `Σ m gravity·x`, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Carried {
    pub kinetic: f64,
    pub weight: f64,
}

impl Sums {
    fn add(mut self, other: &Self) -> Self {
        self.kinetic += other.kinetic;
        self.weight += other.weight;
        self.mass += other.mass;
        self.momentum += other.momentum;
        self
    }

    /// With those of all other parts of a system.
    fn of_all(self, system: &System) -> Self {
        let [kinetic, weight, mass] = system.total([self.kinetic, self.weight, self.mass]);
        let momentum = Vector3::from(system.total(self.momentum.into()));
        Self { kinetic, weight, mass, momentum, ..self }
    }

    fn with_centre_of_mass(self) -> Self {
        if self.mass == 0.0 {
            return self;
        }
        let kinetic = 0.5 * self.momentum.norm_squared() / self.mass;
        Self { carried: Carried { kinetic, weight: self.weight }, ..self }
    }
}

/// All particles of a system.
pub(super) struct Particles<'s> {
    system: &'s System,
    /// Whether nothing is held, so that the centre of mass goes its own way.
    is_loose: bool,
}

impl<'s> Particles<'s> {
    pub fn new(system: &'s System) -> Self {
        let [prescribed] = system.total([system.prescribed().iter().count() as f64]);
        Self { system, is_loose: prescribed == 0.0 && !system.has_external_forces() }
    }

    /// Their energies at a state.
    pub fn pass(&self, state: &State) -> Sums {
        let own = self.system.own_particles();
        let blocks = |number: usize| self.block(state, number * BLOCK..own.min((number + 1) * BLOCK));
        let count = own.div_ceil(BLOCK);
        let sums = if count > 1 {
            (0..count).into_par_iter().map(blocks).collect::<Vec<_>>()
        } else {
            (0..count).map(blocks).collect()
        };
        sums.iter().fold(Sums::default(), Sums::add).of_all(self.system).with_centre_of_mass()
    }

    fn block(&self, state: &State, particles: std::ops::Range<usize>) -> Sums {
        let (gravity, masses) = (self.system.gravity(), self.system.masses());
        let mut sums = Sums::default();
        for p in particles {
            let (x, v, mass) = (state.positions[p], state.velocities[p], masses[p]);
            sums.kinetic += 0.5 * mass * v.norm_squared();
            sums.weight += mass * gravity.dot(&x);
            if self.is_loose {
                sums.mass += mass;
                sums.momentum += v * mass;
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::SystemBuilder;

    /// Masses of 1 kg and 3 kg at 4 m/s and 0: the centre of mass goes at 1 m/s, and has 2 J of the 8 J where nothing is held.
    #[test]
    fn the_centre_of_mass_of_a_free_scene_is_known_by_itself() {
        for is_held in [false, true] {
            let mut builder = SystemBuilder::new();
            builder.gravity(0.0, -10.0, 0.0);
            builder.particle([0.0, 1.0, 0.0], 1.0);
            builder.particle([1.0, 2.0, 0.0], 3.0);
            builder.velocities[0] = Vector3::new(4.0, 0.0, 0.0);
            if is_held {
                builder.hold(1);
            }
            let (system, state) = builder.build().unwrap();
            let sums = Particles::new(&system).pass(&state);
            assert_eq!((sums.kinetic, sums.weight), (8.0, -70.0));
            let expected = if is_held { Carried::default() } else { Carried { kinetic: 2.0, weight: -70.0 } };
            assert_eq!(sums.carried, expected);
        }
    }
}
