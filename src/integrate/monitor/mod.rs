//! Monitoring of a run: its energy balance, a check for instability, and its propagated error.
//!
//! A [`Monitor`] is handed to [`run_monitored`](super::run_monitored), which enters every accepted step. Each entry takes one pass over
//! the springs and one over the particles and updates
//!
//! - the [`Balance`]: work done, energy dissipated by damping, and the imbalance that remains;
//! - the instability check (`instability`): energy gained without a source ends the run, unless told otherwise, as
//!   [`StepFailure::Unstable`], and restores the last state before the gain;
//! - the [`PropagatedError`], advanced by the method that took the step.

mod energy_balance;
mod indicators;
mod instability;
mod springs;
mod work;

pub use energy_balance::Balance;
pub use indicators::{ErrorIndicators, INACCURATE, Warning, percent, threshold};

use super::{CompletedStep, PropagatedError, SpringVisitor, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::Energy;
use crate::memory;
use crate::system::{State, System};
use energy_balance::{EnergyBalance, ParticleSums};
use instability::{Growth, GrowthRecord};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use springs::Springs;
use work::Work;

/// Options of a monitor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorOptions {
    /// The relative position error up to which positions count as predictable; `None` where no errors are propagated.
    pub threshold: Option<f64>,
    /// Energy from nowhere ends the run.
    pub stops_unstable: bool,
}

impl MonitorOptions {
    /// The energy balance alone.
    pub const ENERGY: Self = Self { threshold: None, stops_unstable: true };
}

impl Default for MonitorOptions {
    fn default() -> Self {
        Self { threshold: Some(INACCURATE), ..Self::ENERGY }
    }
}

/// The part of a monitor with which a run is continued in another process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorCheckpoint {
    #[serde(rename = "ledger")]
    balance: EnergyBalance,
    #[serde(rename = "past")]
    growth: GrowthRecord,
    steps: u64,
    duration: f64,
    error: Option<PropagatedError>,
    predictable_until: Option<f64>,
}

/// The monitor of a run; see the module.
///
/// # Examples
/// ```
/// use sprung::Method;
/// use sprung::integrate::{ImplicitOptions, Monitor, MonitorOptions, Schedule, run_monitored};
/// use std::ops::ControlFlow;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut monitor = Monitor::new(&system, &state, MonitorOptions::default())?;
/// let mut stepper = Method::ForwardEuler.stepper(&system, &state, &ImplicitOptions::default())?;
/// // Forward Euler makes energy from nowhere, and with this step much of it.
/// let schedule = Schedule::duration(0.2, 60.0);
/// let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
/// assert_eq!(outcome.status().name(), "unstable");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Monitor<'s> {
    system: &'s System,
    options: MonitorOptions,
    springs: Springs<'s>,
    work: Work<'s>,
    /// Nothing holds the scene.
    is_loose: bool,
    balance: EnergyBalance,
    /// The balance at the state before, and the times of both.
    before: EnergyBalance,
    times: [f64; 2],
    growth: Growth,
    steps: u64,
    duration: f64,
    /// `None` where errors are not propagated, or the method does not know how.
    error: Option<PropagatedError>,
    predictable_until: Option<f64>,
    /// The start of the step at hand, where errors are propagated.
    started: State,
    /// Positions at the start of the run.
    start: Vec<Vector3<f64>>,
}

impl<'s> Monitor<'s> {
    /// At the start of a run.
    ///
    /// # Errors
    /// Coincident ends of a spring; too little memory.
    pub fn new(system: &'s System, state: &State, options: MonitorOptions) -> Result<Self> {
        let [springs, particles] = [system.springs().len() as u64, system.particles() as u64];
        // Bytes of the lists below, at most.
        memory::ensure(100 * springs + 450 * particles, "what accompanies a run")?;
        let work = Work::new(system, state);
        let springs = Springs::new(system, state, work.driven());
        let [prescribed] = system.total([system.prescribed().iter().count() as f64]);
        let is_loose = prescribed == 0.0 && !system.has_external_forces();
        let particles = ParticleSums::at(system, state, is_loose);
        let balance = EnergyBalance::new(&springs.total(), &particles, work.energy(state));
        Ok(Self {
            system,
            options,
            springs,
            work,
            is_loose,
            balance,
            before: balance,
            times: [state.time; 2],
            growth: Growth::new(system, &balance, state),
            steps: 0,
            duration: 0.0,
            error: options.threshold.map(|_| PropagatedError::none(system)),
            predictable_until: None,
            started: state.clone(),
            start: state.positions.clone(),
        })
    }

    /// Enters the state after a number of steps, the last of dt seconds.
    ///
    /// # Errors
    /// [`StepFailure::Unstable`] when energy has appeared from nowhere, if that is to end the run;
    /// [`StepFailure::NonFinite`] when an energy is not finite.
    pub fn enter(&mut self, steps: u64, state: &State, dt: f64) -> Result<(), StepFailure> {
        self.before = self.balance;
        self.times = [self.times[1], state.time];
        let springs = self.springs.enter(state, dt);
        let particles = ParticleSums::at(self.system, state, self.is_loose);
        let sums = springs.add(&self.work.enter(state, dt));
        self.balance.enter(&sums, &particles, self.work.energy(state));
        if self.has_overflowed() {
            return Err(StepFailure::NonFinite);
        }
        self.steps += 1;
        self.duration += dt;
        let grown = self.growth.enter(&self.balance, steps, state, dt);
        if !self.growth.exchanged().is_finite() {
            return Err(StepFailure::NonFinite);
        }
        if self.options.stops_unstable { grown } else { Ok(()) }
    }

    /// A step begins at this state.
    pub(super) fn begin_step(&mut self, state: &State) {
        if self.error.is_some() {
            self.started.copy_from(state);
        }
    }

    /// Propagates the error of the run over a step of dt seconds to a state, by the method that made it.
    pub(super) fn propagate(&mut self, stepper: &mut (impl TimeStepper + ?Sized), state: &State, dt: f64) {
        let Self { system, error, started, options, .. } = self;
        let Some(known) = error else { return };
        let step = CompletedStep { before: started, after: state, length: dt };
        if !stepper.propagate(known, &step) {
            *error = None;
            return;
        }
        let extent = extent(system, state, &self.start);
        known.saturate(system, extent);
        let threshold = options.threshold.unwrap_or(INACCURATE);
        if self.predictable_until.is_none() && known.norm(system) > threshold * extent {
            self.predictable_until = Some(started.time);
        }
    }

    /// The pass over the springs, for a method that goes through them anyway.
    pub(super) fn springs(&mut self) -> &mut dyn SpringVisitor {
        &mut self.springs
    }

    /// The step entered next may err by so much energy, in J, by the method's own estimate: that much growth does not count.
    pub fn doubt(&mut self, energy: f64) {
        self.growth.doubt(energy);
    }

    /// The energy of the state entered last, or that exchanged until then, is not finite.
    pub(super) fn has_overflowed(&self) -> bool {
        let Balance { work, dissipated, imbalance } = self.balance();
        ![self.balance.energy.total(), work, dissipated, imbalance].into_iter().all(f64::is_finite)
    }

    /// The record with which the run can be [continued](Self::continued).
    pub fn account(&self) -> MonitorCheckpoint {
        MonitorCheckpoint {
            balance: self.balance,
            growth: self.growth.record,
            steps: self.steps,
            duration: self.duration,
            error: self.error.clone(),
            predictable_until: self.predictable_until,
        }
    }

    /// Continues a run that began with the first of two states and has come to the second, after so many steps.
    ///
    /// # Errors
    /// Coincident ends of a spring; too little memory.
    pub fn continued(
        system: &'s System,
        [start, state]: [&State; 2],
        steps: u64,
        account: &MonitorCheckpoint,
        options: MonitorOptions,
    ) -> Result<Self> {
        let MonitorCheckpoint { balance, growth, steps: done, duration, ref error, predictable_until } = *account;
        let fresh = Self::new(system, state, options)?;
        let growth = Growth::continued(growth, &balance, steps, state);
        let error = error.clone().filter(|error| error.fits(system));
        let start = start.positions.clone();
        Ok(Self { balance, before: balance, growth, steps: done, duration, error, predictable_until, start, ..fresh })
    }

    /// [`StepFailure::Unstable`] where energy has grown at the last state, if that is to end the run.
    pub(super) fn growth(&self) -> Option<StepFailure> {
        let is_above = self.options.stops_unstable && self.growth.is_above();
        let (gained, exchanged) = (self.growth.record.gained, self.growth.exchanged());
        is_above.then_some(StepFailure::Unstable { gained, exchanged })
    }

    /// Restores the last state from before energy appeared, with its balance; returns the number of steps that led to it.
    pub(super) fn restore(&mut self, state: &mut State) -> u64 {
        let saved = &self.growth.saved;
        state.copy_from(&saved.state);
        self.balance = saved.balance;
        saved.steps
    }

    /// The propagated error of the run; `None` where it is not known.
    pub fn error(&self) -> Option<&PropagatedError> {
        self.error.as_ref()
    }

    /// The time of the state entered last, in s.
    pub fn time(&self) -> f64 {
        self.times[1]
    }

    /// Energy at the start of the run.
    pub fn initial(&self) -> Energy {
        self.balance.initial
    }

    /// Energy at the state entered last.
    pub fn energy(&self) -> Energy {
        self.balance.energy
    }

    /// The balance at the state entered last.
    pub fn balance(&self) -> Balance {
        self.balance.balance()
    }

    /// The balance at a time between the last two states and with the given energy: work and dissipation in proportion to the
    /// time.
    fn balance_between(&self, time: f64, energy: &Energy) -> Balance {
        let [start, end] = self.times;
        let share = if end > start { ((time - start) / (end - start)).clamp(0.0, 1.0) } else { 1.0 };
        let (from, to) = (self.before.balance(), self.balance.balance());
        let between = |from: f64, to: f64| from + share * (to - from);
        self.balance.balance_of(energy, between(from.work, to.work), between(from.dissipated, to.dissipated))
    }

    /// Energy and balance at a state of the last step: those entered at its end; within it work and dissipation grow in
    /// proportion to the time.
    pub fn energy_at(&self, state: &State) -> (Energy, Balance) {
        if self.time() == state.time {
            return (self.energy(), self.balance());
        }
        let energy = Energy::of(self.system, state);
        (energy, self.balance_between(state.time, &energy))
    }

    /// The indicators of accuracy at a state, ordinarily the last.
    pub fn indicators(&self, state: &State) -> ErrorIndicators {
        let extent = extent(self.system, state, &self.start);
        let error = self.error.as_ref().filter(|_| self.steps > 0);
        ErrorIndicators {
            steps: self.steps,
            duration: self.duration,
            extent,
            estimate: error.map(|error| error.norm(self.system) / extent).filter(|estimate| estimate.is_finite()),
            local_errors: error.map_or(0.0, |error| error.sum_of_local_errors() / extent),
            left_out: error.map_or(0.0, PropagatedError::left_out),
            predictable_until: self.predictable_until,
            exchanged: self.growth.exchanged(),
            gained: self.growth.record.gained,
            lost: self.growth.lost(&self.balance),
        }
    }
}

/// The distance of the particles from their centroid, or from where they started if they are all at one place; never zero.
fn extent(system: &System, state: &State, start: &[Vector3<f64>]) -> f64 {
    let positions = &state.positions[..system.own_particles()];
    let sum = positions.iter().sum::<Vector3<f64>>();
    let [count, x, y, z] = system.total([positions.len() as f64, sum.x, sum.y, sum.z]);
    let centre = Vector3::new(x, y, z) / count.max(1.0);
    let (mut spread, mut moved, mut largest) = (0.0, 0.0, 0.0_f64);
    for (x, start) in positions.iter().zip(start) {
        spread += (x - centre).norm_squared();
        moved += (x - start).norm_squared();
        largest = largest.max(x.norm_squared());
    }
    let [spread, moved] = system.total([spread, moved]).map(f64::sqrt);
    let [largest] = system.largest([largest.sqrt()]);
    // A spread by rounding is none.
    [spread, moved].into_iter().find(|&length| length > 1e-12 * largest).unwrap_or(1.0)
}

#[cfg(test)]
mod instability_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod work_tests;
