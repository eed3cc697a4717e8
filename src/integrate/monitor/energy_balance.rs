//! The energy balance of a run.
//!
//! ```text
//! E(t) − E(0) = work of constraints, loads and rest lengths − dissipation of damping and drag + imbalance.
//! ```
//!
//! Energies are those of the states; work and dissipation are integrals over the steps, right to fourth order where steps resolve the motion (see
//! `force::spring_energies` and `work`). So the imbalance is the energy that the method adds (positive) or takes away (negative), and the O(dt⁴) of
//! the quadrature. A scene that nothing holds flies and falls as a whole, which no spring sees: the energy of its centre of mass is known apart.

use super::work::BodyEnergy;
use crate::force::{BLOCK, Energy, SpringSums};
use crate::system::{State, System};
use nalgebra::{Vector3, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The balance of a run's energy since its start, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Work done by moving constraints, by loads and other external forces except drag, and by rest lengths that change. Gravity that changes in time
    /// is a load beyond its value at time zero.
    pub work: f64,
    /// Dissipated by damping and drag.
    pub dissipated: f64,
    /// Final energy − initial energy − work + dissipated: energy from nowhere where positive, the method's own dissipation where negative.
    pub imbalance: f64,
}

/// The energies of a run so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct EnergyBalance {
    pub initial: Energy,
    pub energy: Energy,
    /// Energy of the moving prescribed coordinates themselves, at the start and now.
    prescribed: [BodyEnergy; 2],
    /// Energy of the centre of mass of a scene that nothing holds.
    centre_of_mass: BodyEnergy,
    /// Work of constraints on springs, of loads, and of rest lengths.
    work: f64,
    dissipated: f64,
    /// The least that damping can have taken.
    certain: f64,
}

/// The part of the scene that exchanges energy, in J: without the moving coordinates themselves, and the centre of mass of a loose scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Free {
    pub kinetic: f64,
    /// Elastic and gravitational.
    pub potential: f64,
    pub work: f64,
    pub certain: f64,
    /// The sum of the magnitudes of the energies, to which rounding is relative.
    pub magnitude: f64,
}

impl EnergyBalance {
    pub fn new(springs: &SpringSums, particles: &ParticleSums, prescribed: BodyEnergy) -> Self {
        let mut balance = Self::default();
        balance.enter(springs, particles, prescribed);
        Self { initial: balance.energy, prescribed: [prescribed; 2], ..balance }
    }

    /// Enters a step; `sums` holds the energies of the springs, and the work and dissipation of the step.
    pub fn enter(&mut self, sums: &SpringSums, particles: &ParticleSums, prescribed: BodyEnergy) {
        let BodyEnergy { kinetic, gravitational } = particles.energy;
        self.energy = Energy { kinetic, elastic: sums.elastic, gravitational };
        self.prescribed[1] = prescribed;
        self.centre_of_mass = particles.centre_of_mass;
        self.work += sums.work;
        self.dissipated += sums.dissipated;
        self.certain += sums.certain;
    }

    pub fn balance(&self) -> Balance {
        let [before, now] = &self.prescribed;
        self.balance_of(&self.energy, self.work + (now.total() - before.total()), self.dissipated)
    }

    /// At a state with its own energy, and the work and dissipation until then.
    pub fn balance_of(&self, energy: &Energy, work: f64, dissipated: f64) -> Balance {
        let imbalance = energy.total() - self.initial.total() - work + dissipated;
        Balance { work, dissipated, imbalance }
    }

    pub fn free(&self) -> Free {
        let Energy { kinetic, elastic, gravitational } = self.energy;
        let ([_, prescribed], centre_of_mass) = (&self.prescribed, &self.centre_of_mass);
        Free {
            kinetic: kinetic - prescribed.kinetic - centre_of_mass.kinetic,
            potential: elastic + (gravitational - prescribed.gravitational - centre_of_mass.gravitational),
            work: self.work,
            certain: self.certain,
            magnitude: kinetic + elastic + gravitational.abs() + prescribed.gravitational.abs(),
        }
    }
}

/// Energies of the particles at a state.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ParticleSums {
    /// `Σ ½ m v²` and `−Σ m gravity·x`, in J.
    pub energy: BodyEnergy,
    /// That of the centre of mass of a scene that nothing holds, else zero.
    pub centre_of_mass: BodyEnergy,
}

impl ParticleSums {
    /// At a state; `is_loose` where nothing holds the scene. Sums are made block by block, whatever the number of threads.
    pub fn at(system: &System, state: &State, is_loose: bool) -> Self {
        let (gravity, masses, own) = (system.gravity(), system.masses(), system.own_particles());
        // Kinetic energy, weight, and of a loose scene mass and momentum.
        let of = |p: usize| {
            let (x, v, mass) = (state.positions[p], state.velocities[p], masses[p]);
            let momentum = if is_loose { v * mass } else { Vector3::zeros() };
            let sums = [0.5 * mass * v.norm_squared(), mass * gravity.dot(&x), if is_loose { mass } else { 0.0 }];
            Vector6::new(sums[0], sums[1], sums[2], momentum.x, momentum.y, momentum.z)
        };
        let block = |number: usize| (number * BLOCK..own.min((number + 1) * BLOCK)).map(of).sum();
        let blocks = own.div_ceil(BLOCK);
        let blocks: Vec<Vector6<f64>> = if blocks > 1 {
            (0..blocks).into_par_iter().map(block).collect()
        } else {
            (0..blocks).map(block).collect()
        };
        let sums: Vector6<f64> = blocks.iter().sum();
        let [kinetic, weight, mass, x, y, z] = system.total(sums.into());
        let energy = BodyEnergy { kinetic, gravitational: 0.0 - weight };
        if mass == 0.0 {
            return Self { energy, ..Self::default() };
        }
        let kinetic = 0.5 * Vector3::new(x, y, z).norm_squared() / mass;
        Self { energy, centre_of_mass: BodyEnergy { kinetic, ..energy } }
    }
}
