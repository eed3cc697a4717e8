//! The energy ledger of a run.
//!
//! ```text
//! E(t) − E(0) = work of moving constraints − dissipation of damping + imbalance.
//! ```
//!
//! Energies are those of the states, and hold no error of their own; work and dissipation are integrals over the steps, right to
//! the fourth order where steps resolve the motion (see `springs` and `driven`). So the imbalance is what the method added
//! (positive: energy from nowhere) or took away (negative: its own dissipation), and the quadrature's O(dt⁴).

use super::constraint_work::{DrivenEnergy, Exchange};
use super::particles::{self, Carried};
use super::sums;
use crate::force::Energy;
use serde::{Deserialize, Serialize};

/// Where the energy of a run went since its start, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Work done by moving constraints, and by external forces.
    pub work: f64,
    /// Taken by damping.
    pub dissipated: f64,
    /// Final energy − initial energy − work + dissipated: energy from nowhere where positive, the method's own dissipation
    /// where negative.
    pub imbalance: f64,
}

/// The account of a run so far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct EnergyBalance {
    pub initial: Energy,
    pub energy: Energy,
    /// Energy of the moving coordinates themselves, at the start and now.
    led: [DrivenEnergy; 2],
    /// Energy of the centre of mass of a scene that nothing holds.
    carried: DrivenEnergy,
    /// Work of constraints on springs.
    work: f64,
    dissipated: f64,
    /// The least that damping can have taken.
    certain: f64,
}

/// The part of the scene that exchanges energy: without the moving coordinates themselves, and without the centre of mass of a scene
/// that nothing holds. In J.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Free {
    pub kinetic: f64,
    /// Elastic and gravitational.
    pub potential: f64,
    /// Work that constraints did on springs since the start.
    pub work: f64,
    /// What damping took at least.
    pub certain: f64,
    /// The magnitude of the numbers whose sums these are: rounding is a few 1e-16 of it.
    pub magnitude: f64,
}

impl EnergyBalance {
    /// At a state with the given sums.
    pub fn new(springs: &sums::Sums, particles: &particles::Sums, led: DrivenEnergy) -> Self {
        let energy = energy(springs, particles);
        let carried = carried(&particles.carried);
        Self { initial: energy, energy, led: [led; 2], carried, work: 0.0, dissipated: 0.0, certain: 0.0 }
    }

    /// Enters a step.
    pub fn enter(&mut self, springs: &sums::Sums, particles: &particles::Sums, led: DrivenEnergy, exchange: &Exchange) {
        self.energy = energy(springs, particles);
        self.led[1] = led;
        self.carried = carried(&particles.carried);
        self.work += exchange.work;
        self.dissipated += springs.dissipated + exchange.dissipated;
        self.certain += springs.certain + exchange.certain;
    }

    pub fn balance(&self) -> Balance {
        let [before, now] = &self.led;
        self.balance_of(&self.energy, self.work + (now.total() - before.total()), self.dissipated)
    }

    /// Of a state between two steps, with its own energy and the work and dissipation until then.
    pub fn balance_of(&self, energy: &Energy, work: f64, dissipated: f64) -> Balance {
        let imbalance = energy.total() - self.initial.total() - work + dissipated;
        Balance { work, dissipated, imbalance }
    }

    pub fn free(&self) -> Free {
        let Energy { kinetic, elastic, gravitational } = self.energy;
        let ([_, led], carried) = (&self.led, &self.carried);
        Free {
            kinetic: kinetic - led.kinetic - carried.kinetic,
            potential: elastic + (gravitational - led.gravitational - carried.gravitational),
            work: self.work,
            certain: self.certain,
            magnitude: kinetic + elastic + gravitational.abs() + led.gravitational.abs(),
        }
    }
}

fn energy(springs: &sums::Sums, particles: &particles::Sums) -> Energy {
    Energy { kinetic: particles.kinetic, elastic: springs.elastic, gravitational: 0.0 - particles.weight }
}

fn carried(of: &Carried) -> DrivenEnergy {
    DrivenEnergy { kinetic: of.kinetic, gravitational: 0.0 - of.weight }
}

#[cfg(test)]
mod tests;
