//! Energy from nowhere: when a run has become unstable, and the last state from before.
//!
//! A scene without an engine only exchanges the energy it has: what it started with, what its springs and weights release on
//! the way, and what moving constraints put in. With the free part of the scene alone (kinetic K, potential P, work W of
//! constraints on springs, and D the least that damping can have taken; a scene that nothing holds is seen from its centre of mass,
//! whose flight exchanges nothing)
//!
//! ```text
//! I = K + P − W + D − (K₀ + P₀) ≤ 0        for every passive motion,
//! S = K₀ + max(P₀ − P) + (max W − min W)     what the motion has exchanged so far, from its true minimum.
//! ```
//!
//! A method that dissipates takes I below zero, and what it gains later starts from there: growth is measured from the lowest I
//! so far. It is never exactly zero: methods that keep energy do so on average, and explicit ones within their limits swing
//! about it: symplectic Euler between `1/(1 + hω/2)` and `1/(1 − hω/2)` of it, 1.3 times the energy at hω = 1 and 3.4 times
//! at 1.5. So a run is called unstable when growth stays above four times S for three steps: in an instability it grows on
//! without bound, and it is soon found. Three, because S begins at zero where a scene starts at rest: forward Euler's n-th step
//! of a fall has gained 1/(n − 1) of what it has released.
//!
//! Nothing is waited for where more has appeared at once than all that was there: the kinetic and the elastic energy that the scene started with,
//! what it has exchanged, and what a step of free fall gives.
//!
//! **A scene at rest** exchanges nothing, and still its energy is not zero. Positions are rounded: with δ a few thousand roundings of
//! the largest coordinate, springs hold `½ Σ (k/l0) δ²` and velocities of steps of h seconds `½ Σ m (δ/h)²`, which is no growth.
//!
//! **A run with error control** may err, by as much as its tolerance says. A local error e of a step, by the method's own estimate, is
//! worth up to `Σ m (‖v‖ + 5 ‖e_v‖) ‖e_v‖` of kinetic energy (beyond their limit explicit methods make of a vibration up to three times what
//! they estimate), as much of elastic energy again, as vibrations have equal parts of both, and `10 Σ κ ‖e_x‖²` of the springs that errors of
//! positions stretch, κ the sum of k/l0 at a particle. That much of growth is in doubt and counts for none: an explicit method whose steps
//! stability bounds lets the fastest vibrations grow until its estimates see them, and so on all the time.

use super::energy_balance::{EnergyBalance, Free};
use crate::force::set_other_forces;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Growth beyond which a run is unstable, in units of the energy exchanged.
const MOST_GROWTH: f64 = 4.0;

/// Growth in one step, in units of all energy there was, that is not waited for: symplectic Euler swings by as much at hω = 1.9, and comes back.
const MOST_AT_ONCE: f64 = 20.0;

/// Growth up to which a state counts as one from before the growth.
const CALM: f64 = 0.3;

/// Steps in a row that must find it so.
const PATIENCE: u32 = 3;

/// What rounding may make of sums, relative to their terms; forces that a solver met to 1e-10 add less.
const ROUNDING: f64 = 1e-10;

/// δ relative to the largest coordinate: rounding, and what steps that do not resolve a vibration make of it.
const NOISE: f64 = 1e-12;

/// Steps after which the state is kept again, fewer at the start. A copy costs about a tenth of a pass over the springs.
const EVERY: u64 = 8;

/// What has grown so far.
#[derive(Debug, Clone)]
pub(super) struct Growth {
    start: Free,
    /// The lowest I so far, the highest release of potential energy, and the bounds of W.
    lowest: f64,
    released: f64,
    work: [f64; 2],
    /// The most that was gained, in J.
    pub gained: f64,
    above: u32,
    noise: Noise,
    /// Kinetic and elastic energy at the start, in J.
    stored: f64,
    /// `Σ f²/(2m)` of weights and external forces at the start, in J/s²: times h² what a step of free fall gives.
    fall: f64,
    /// In J.
    doubt: f64,
    kept: Kept,
}

/// What the energy of rounded positions is made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Noise {
    /// ½ Σ (k/l0) δ², in J.
    elastic: f64,
    /// ½ Σ m δ², in kg·m².
    inertia: f64,
}

impl Noise {
    fn new(system: &System, state: &State) -> Self {
        let own = system.own_particles();
        let [reach] = system.largest([state.positions.iter().take(own).map(|x| x.norm()).fold(0.0, f64::max)]);
        let half = 0.5 * (NOISE * reach) * (NOISE * reach);
        let springs = system.springs().iter().enumerate().filter(|(spring, _)| system.owns_spring(*spring));
        let stiffness: f64 = springs.map(|(_, spring)| spring.axial_stiffness()).sum();
        let [stiffness, mass] = system.total([stiffness, system.masses().iter().take(own).sum::<f64>()]);
        Self { elastic: half * stiffness, inertia: half * mass }
    }

    /// Over steps of dt seconds, in J.
    fn energy(&self, dt: f64) -> f64 {
        self.elastic + self.inertia / (dt * dt)
    }
}

/// `Σ f²/(2m)` of weights and external forces on coordinates that are free, in J/s².
fn fall(system: &System, state: &State) -> f64 {
    let mut force = vec![Vector3::zeros(); system.particles()];
    set_other_forces(system, &state.moment(), &mut force);
    let of = |p: usize| {
        let squared: f64 = system.dofs().free_axes(p).iter().map(|axis| force[p][axis] * force[p][axis]).sum();
        0.5 * squared / system.masses()[p]
    };
    let [fall] = system.total([(0..system.own_particles()).map(of).sum::<f64>()]);
    fall
}

/// What is known of the energy exchanged so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Past {
    start: Free,
    lowest: f64,
    released: f64,
    work: [f64; 2],
    gained: f64,
    above: u32,
    noise: Noise,
    stored: f64,
    fall: f64,
    doubt: f64,
}

/// A state from before the growth.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    pub steps: u64,
    pub state: State,
    pub ledger: EnergyBalance,
}

/// Energy that appeared from nowhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unstable {
    /// How much, in J.
    pub gained: f64,
    /// What the motion had to exchange, in J.
    pub exchanged: f64,
}

impl Growth {
    pub fn new(system: &System, ledger: &EnergyBalance, state: &State) -> Self {
        let (start, noise) = (ledger.free(), Noise::new(system, state));
        let kept = Kept { steps: 0, state: state.clone(), ledger: *ledger };
        Self {
            start,
            lowest: 0.0,
            released: 0.0,
            work: [0.0; 2],
            gained: 0.0,
            above: 0,
            noise,
            stored: start.kinetic + ledger.energy.elastic,
            fall: fall(system, state),
            doubt: 0.0,
            kept,
        }
    }

    /// What a later process needs to go on.
    pub fn past(&self) -> Past {
        let Self { start, lowest, released, work, gained, above, noise, stored, fall, doubt, .. } = *self;
        Past { start, lowest, released, work, gained, above, noise, stored, fall, doubt }
    }

    /// Goes on at a state, which is then the one that is kept.
    pub fn continued(past: &Past, ledger: &EnergyBalance, steps: u64, state: &State) -> Self {
        let Past { start, lowest, released, work, gained, above, noise, stored, fall, doubt } = *past;
        let kept = Kept { steps, state: state.clone(), ledger: *ledger };
        Self { start, lowest, released, work, gained, above, noise, stored, fall, doubt, kept }
    }

    /// S, in J.
    pub fn exchanged(&self) -> f64 {
        self.start.kinetic + self.released + (self.work[1] - self.work[0])
    }

    /// What the method took away from the free part until now, in J.
    pub fn lost(&self, ledger: &EnergyBalance) -> f64 {
        let (start, now) = (self.start, ledger.free());
        let change = (now.kinetic - start.kinetic) + (now.potential - start.potential);
        now.work - change - ledger.balance().dissipated
    }

    /// Says that the next step may err by so much energy, in J.
    pub fn doubt(&mut self, energy: f64) {
        self.doubt += energy;
    }

    /// Enters the state after a number of steps, the last of dt seconds.
    pub fn enter(&mut self, ledger: &EnergyBalance, steps: u64, state: &State, dt: f64) -> Option<Unstable> {
        let (start, now) = (self.start, ledger.free());
        let balance = (now.kinetic - start.kinetic) + (now.potential - start.potential) - now.work + now.certain;
        self.released = self.released.max(start.potential - now.potential);
        self.work = [self.work[0].min(now.work), self.work[1].max(now.work)];
        self.lowest = self.lowest.min(balance);
        let gained = (balance - self.lowest).max(0.0);
        let exchanged = self.exchanged();
        let rounding = ROUNDING * start.magnitude.max(now.magnitude.min(exchanged)) + self.noise.energy(dt);
        // What may be rounding is not said to have appeared.
        if gained > rounding + self.doubt {
            self.gained = self.gained.max(gained);
        }
        // Of sums that are not finite nothing is known.
        let is_above = exchanged.is_finite() && gained > MOST_GROWTH * exchanged + rounding + self.doubt;
        let all = exchanged + self.stored + self.fall * dt * dt;
        let is_sudden = all.is_finite() && gained > MOST_AT_ONCE * all + rounding + self.doubt;
        self.above = if is_sudden {
            PATIENCE
        } else if is_above {
            self.above + 1
        } else {
            0
        };
        if gained <= CALM * exchanged + rounding + self.doubt && steps >= self.kept.steps + EVERY.min(1 + steps / EVERY)
        {
            (self.kept.steps, self.kept.ledger) = (steps, *ledger);
            self.kept.state.copy_from(state);
        }
        (self.above >= PATIENCE).then_some(Unstable { gained, exchanged })
    }

    /// Whether the last state is one that has grown.
    pub fn is_above(&self) -> bool {
        self.above > 0
    }

    pub fn kept(&self) -> &Kept {
        &self.kept
    }
}

#[cfg(test)]
mod tests;
