//! The energy balance of a run.
//!
//! ```text
//! E(t) − E(0) = work of constraints and external forces − dissipation of damping + imbalance.
//! ```
//!
//! Energies are those of the states and hold no error of their own; work and dissipation are integrals over the steps, right to
//! fourth order where steps resolve the motion (see `springs` and `work`). So the imbalance is the energy that the method adds
//! (positive) or takes away (negative, its own dissipation), and the O(dt⁴) of the quadrature.
//!
//! A scene that nothing holds flies and falls as a whole, which no spring sees: the energy of its centre of mass is known apart.

use super::springs::Sums;
use super::work::BodyEnergy;
use crate::force::Energy;
use crate::system::{State, System};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The balance of a run's energy since its start, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Work done by moving constraints, and by external forces.
    pub work: f64,
    /// Dissipated by damping.
    pub dissipated: f64,
    /// Final energy − initial energy − work + dissipated: energy from nowhere where positive, the method's own dissipation
    /// where negative.
    pub imbalance: f64,
}

/// The energies of a run so far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct EnergyBalance {
    pub initial: Energy,
    pub energy: Energy,
    /// Energy of the moving prescribed coordinates themselves, at the start and now.
    prescribed: [BodyEnergy; 2],
    /// Energy of the centre of mass of a scene that nothing holds.
    centre_of_mass: BodyEnergy,
    /// Work of constraints on springs, and of external forces.
    work: f64,
    dissipated: f64,
    /// The least that damping can have taken.
    certain: f64,
}

/// The part of the scene that exchanges energy: without the moving coordinates themselves, and without the centre of mass of a
/// scene that nothing holds. In J.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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
    /// At the start of a run.
    pub fn new(springs: &Sums, particles: &ParticleSums, prescribed: BodyEnergy) -> Self {
        let energy = energy(springs, particles);
        let centre_of_mass = particles.centre_of_mass();
        Self {
            initial: energy,
            energy,
            prescribed: [prescribed; 2],
            centre_of_mass,
            work: 0.0,
            dissipated: 0.0,
            certain: 0.0,
        }
    }

    /// Enters a step; `sums` holds the energies of the springs, and the work and dissipation of the step.
    pub fn enter(&mut self, sums: &Sums, particles: &ParticleSums, prescribed: BodyEnergy) {
        self.energy = energy(sums, particles);
        self.prescribed[1] = prescribed;
        self.centre_of_mass = particles.centre_of_mass();
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

fn energy(springs: &Sums, particles: &ParticleSums) -> Energy {
    Energy { kinetic: particles.kinetic, elastic: springs.elastic, gravitational: 0.0 - particles.weight }
}

/// Sums over particles at a state.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ParticleSums {
    /// `Σ ½ m v²`, in J.
    pub kinetic: f64,
    /// `Σ m gravity·x`, in J.
    pub weight: f64,
    /// `Σ m` and `Σ m v` of a scene that nothing holds, else zero.
    pub mass: f64,
    pub momentum: Vector3<f64>,
}

impl ParticleSums {
    /// At a state; `is_loose` where nothing holds the scene. Sums are made block by block, whatever the number of threads.
    pub fn at(system: &System, state: &State, is_loose: bool) -> Self {
        const BLOCK: usize = 4096;
        let own = system.own_particles();
        let block = |number: usize| {
            let (gravity, masses) = (system.gravity(), system.masses());
            let mut sums = Self::default();
            let range = number * BLOCK..own.min((number + 1) * BLOCK);
            let particles = state.positions[range.clone()].iter().zip(&state.velocities[range.clone()]);
            for ((x, v), &mass) in particles.zip(&masses[range]) {
                sums.kinetic += 0.5 * mass * v.norm_squared();
                sums.weight += mass * gravity.dot(x);
                if is_loose {
                    sums.mass += mass;
                    sums.momentum += v * mass;
                }
            }
            sums
        };
        let count = own.div_ceil(BLOCK);
        let blocks: Vec<Self> =
            if count > 1 { (0..count).into_par_iter().map(block).collect() } else { (0..count).map(block).collect() };
        let sums = blocks.iter().fold(Self::default(), |sum, block| Self {
            kinetic: sum.kinetic + block.kinetic,
            weight: sum.weight + block.weight,
            mass: sum.mass + block.mass,
            momentum: sum.momentum + block.momentum,
        });
        let [kinetic, weight, mass] = system.total([sums.kinetic, sums.weight, sums.mass]);
        Self { kinetic, weight, mass, momentum: Vector3::from(system.total(sums.momentum.into())) }
    }

    /// The energy of the centre of mass of a scene that nothing holds.
    fn centre_of_mass(&self) -> BodyEnergy {
        if self.mass == 0.0 {
            return BodyEnergy::default();
        }
        let kinetic = 0.5 * self.momentum.norm_squared() / self.mass;
        BodyEnergy { kinetic, gravitational: 0.0 - self.weight }
    }
}
