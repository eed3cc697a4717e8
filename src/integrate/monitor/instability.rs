//! Energy from nowhere: the criterion that a run has become unstable, and the last state from before.
//!
//! A passive system cannot gain energy beyond the work of its constraints. With the kinetic energy K, the potential P, the work
//! W of constraints on springs and the least dissipation D of the part of the scene that exchanges energy,
//!
//! ```text
//! I = K + P − W + D − (K₀ + P₀) ≤ 0        for every passive motion,
//! S = K₀ + max(P₀ − P) + (max W − min W) + L  the energy that the motion has exchanged so far,
//! ```
//!
//! with `L = h² Σ (f − f₀)²/(2m)`, the most that loads which have changed from f₀ to f give particles at rest in one of the steps.
//!
//! A method that dissipates takes I below zero, so growth is measured from the lowest I so far. It is never exactly zero: symplectic Euler lets the
//! energy swing by `hω/(1 − h²ω²/4)` of its mean: 0.3 at hω = 0.3, 1.3 at 1, 3.4 at 1.5 and 20 at 1.9. A run is unstable when growth stays above 4 S
//! for three steps. Three, because S begins at zero where a scene starts at rest: forward Euler's n-th step of a fall has gained 1/(n − 1) of the
//! energy released. It is unstable at once when a single step brings more than twenty times all energy that was there: the kinetic and elastic energy
//! at the start, the energy exchanged, and that of one step of free fall.
//!
//! **A scene at rest** exchanges nothing, and still its energy is not zero. With positions rounded by δ springs hold `½ Σ (k/l0) δ²`, and velocities
//! of steps of h seconds `½ Σ m (δ/h)²`, which is no growth, nor is the rounding of the energies of a scene that falls as a whole.
//!
//! **A run with error control** may err by as much as its tolerance says. A local error e of a step is worth up to `Σ m (‖v‖ + 5 ‖e_v‖) ‖e_v‖` of
//! kinetic energy, as much of elastic energy, and `10 Σ κ ‖e_x‖²` of the springs that errors of positions stretch, κ the sum of k/l0 at a particle.

use super::energy_balance::{EnergyBalance, Free};
use crate::force::set_other_forces;
use crate::integrate::{StepFailure, free_square, sum_of_all};
use crate::system::{State, StateView, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Steps in a row that must show growth; see the module for this and the other bounds.
const PATIENCE: u32 = 3;

/// The energies by which growth is judged, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GrowthRecord {
    start: Free,
    /// The lowest I so far, the highest release of potential energy, and the bounds of W.
    pub lowest: f64,
    pub released: f64,
    pub work: [f64; 2],
    /// The largest growth so far.
    pub gained: f64,
    /// Steps in a row with too much growth.
    pub above: u32,
    pub noise: Noise,
    /// Rounding of a sum over particles and springs relative to its terms, `n ε` (Higham 2002, 4.2).
    #[serde(default)]
    sums: f64,
    /// Kinetic and elastic energy at the start.
    stored: f64,
    /// `Σ f²/(2m)` of weights and external forces on free coordinates at the start, in J/s²: times h² the energy of a step of free fall.
    fall: f64,
    /// L, in J.
    #[serde(default)]
    loaded: f64,
    /// Growth that does not count, by the method's own error estimates.
    doubt: f64,
}

/// The energy of rounded positions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Noise {
    /// ½ Σ (k/l0) δ², in J.
    elastic: f64,
    /// ½ Σ m δ², in kg·m².
    inertia: f64,
}

/// The last state from before the growth.
#[derive(Debug, Clone)]
pub(super) struct SavedState {
    pub steps: u64,
    pub state: State,
    pub balance: EnergyBalance,
}

impl SavedState {
    /// Saves a calm state every eight steps, more often at the start: a copy costs a tenth of a pass over the springs.
    pub fn update(&mut self, steps: u64, state: &State, balance: &EnergyBalance) {
        if steps >= self.steps + (1 + steps / 8).min(8) {
            (self.steps, self.balance) = (steps, *balance);
            self.state.copy_from(state);
        }
    }
}

impl Noise {
    pub fn energy(&self, dt: f64) -> f64 {
        self.elastic + self.inertia / (dt * dt)
    }
}

/// `Σ (f − f₀)²/(2m)` over free coordinates for weights and external forces f and f₀ at two moments, or without f₀ `Σ f²/(2m)`, in J/s².
fn fall(system: &System, at: &StateView<'_>, from: Option<&StateView<'_>>) -> f64 {
    let forces = |at: &StateView<'_>| {
        let mut force = vec![Vector3::zeros(); system.particles()];
        set_other_forces(system, at, &mut force);
        force
    };
    let (mut force, from) = (forces(at), from.map(forces));
    force.iter_mut().zip(from.iter().flatten()).for_each(|(f, from)| *f -= from);
    sum_of_all(system, |p| 0.5 * free_square(system, p, &force[p]) / system.masses()[p])
}

impl GrowthRecord {
    pub fn new(system: &System, balance: &EnergyBalance, state: &State) -> Self {
        let own = 0..system.own_particles();
        let springs = system.springs().iter().enumerate().filter(|(spring, _)| system.owns_spring(*spring));
        let stiffness: f64 = springs.map(|(_, spring)| spring.axial_stiffness()).sum();
        let mass = system.masses()[own.clone()].iter().sum();
        let [stiffness, mass] = system.total([stiffness, mass]);
        let [largest] = system.largest([state.positions[own].iter().map(|x| x.norm()).fold(0.0, f64::max)]);
        // Some thousand roundings of the largest coordinate, from steps that do not resolve a vibration.
        let noise = 1e-12 * largest;
        let half = 0.5 * noise * noise;
        let start = balance.free();
        Self {
            start,
            noise: Noise { elastic: half * stiffness, inertia: half * mass },
            sums: (system.particles() + system.springs().len()) as f64 * f64::EPSILON,
            stored: start.kinetic + balance.energy.elastic,
            fall: fall(system, &state.moment(), None),
            ..Self::default()
        }
    }

    /// Enters the loads at a time, after a step of dt seconds, on the scene as it was at the start.
    pub fn load(&mut self, system: &System, start: &State, time: f64, dt: f64) {
        let (from, at) = (start.moment(), StateView { time, ..start.moment() });
        self.loaded = self.loaded.max(dt * dt * fall(system, &at, Some(&from)));
    }

    /// S, in J.
    pub fn exchanged(&self) -> f64 {
        self.start.kinetic + self.released + (self.work[1] - self.work[0]) + self.loaded
    }

    pub fn doubt(&mut self, energy: f64) {
        self.doubt += energy;
    }

    pub fn is_above(&self) -> bool {
        self.above > 0
    }

    /// Enters the balance after a step of dt seconds, and returns whether the run is still calm.
    ///
    /// # Errors
    /// [`StepFailure::Unstable`] where the run has become unstable.
    pub fn enter(&mut self, balance: &EnergyBalance, dt: f64) -> (bool, Result<(), StepFailure>) {
        let (start, now) = (self.start, balance.free());
        let i = (now.kinetic - start.kinetic) + (now.potential - start.potential) - now.work + now.certain;
        self.released = self.released.max(start.potential - now.potential);
        self.work = [self.work[0].min(now.work), self.work[1].max(now.work)];
        self.lowest = self.lowest.min(i);
        let (gained, exchanged) = ((i - self.lowest).max(0.0), self.exchanged());
        // The residual of linear solvers.
        let resolved = 1e-10 * start.magnitude.max(now.magnitude.min(exchanged));
        let rounding = resolved + self.sums * now.magnitude + self.noise.energy(dt);
        if gained > rounding + self.doubt {
            self.gained = self.gained.max(gained);
        }
        let is_above = |most: f64| most.is_finite() && gained > most + rounding + self.doubt;
        self.above = if is_above(20.0 * (exchanged + self.stored + self.fall * dt * dt)) {
            PATIENCE
        } else if is_above(4.0 * exchanged) {
            self.above + 1
        } else {
            0
        };
        // The swing of symplectic Euler at hω = 0.3, which resolves a vibration.
        let is_calm = gained <= 0.3 * exchanged + rounding + self.doubt;
        (is_calm, if self.above >= PATIENCE { Err(StepFailure::Unstable { gained, exchanged }) } else { Ok(()) })
    }
}
