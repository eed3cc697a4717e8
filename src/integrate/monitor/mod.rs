//! Monitoring of a run: its energy balance, a check for instability, and its propagated error.
//!
//! A [`Monitor`] is handed to [`run_monitored`](super::run_monitored), which enters every accepted step. Each entry takes one pass over the springs
//! and one over the particles and updates the [`Balance`], the instability check (`instability`: energy gained without a source ends the run as
//! [`StepFailure::Unstable`], with the last state before the gain) and the [`PropagatedError`], advanced by the method that took the step.

mod energy_balance;
mod indicators;
mod instability;
mod load_work;
mod work;

pub use energy_balance::Balance;
pub use indicators::{ErrorIndicators, INACCURATE, percent, threshold};

use super::{CompletedStep, PropagatedError, StepFailure, TimeStepper, free_square, sum_of_all};
use crate::error::Result;
use crate::force::{Energy, SpringEnergies};
use crate::memory;
use crate::system::{State, System, extent};
use energy_balance::{EnergyBalance, ParticleSums};
use instability::{GrowthRecord, SavedState};
use serde::{Deserialize, Serialize};
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

/// The record of a run so far, with which it is continued in another process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorCheckpoint {
    #[serde(rename = "ledger")]
    balance: EnergyBalance,
    #[serde(rename = "past")]
    growth: GrowthRecord,
    steps: u64,
    duration: f64,
    /// `None` where errors are not propagated, or the method does not know how.
    error: Option<PropagatedError>,
    predictable_until: Option<f64>,
}

/// The monitor of a run; see the module, and [`run_monitored`](super::run_monitored) for an example.
pub struct Monitor<'s> {
    system: &'s System,
    options: MonitorOptions,
    springs: SpringEnergies<'s>,
    work: Work<'s>,
    /// Nothing holds the scene.
    is_loose: bool,
    /// Steps have error control.
    is_accurate: bool,
    record: MonitorCheckpoint,
    /// The last state from before energy appeared.
    saved: SavedState,
    last: State,
    /// Time and balance of the state before.
    before: (f64, Balance),
    /// The state at the start of the run.
    start: State,
}

impl<'s> Monitor<'s> {
    /// At the start of a run.
    ///
    /// # Errors
    /// A state of another system; too little memory.
    pub fn new(system: &'s System, state: &State, options: MonitorOptions) -> Result<Self> {
        state.check(system)?;
        let [springs, particles] = [system.springs().len() as u64, system.particles() as u64];
        // Bytes of the lists below, at most.
        memory::ensure(100 * springs + 450 * particles, "what accompanies a run")?;
        let work = Work::new(system, state);
        let springs = SpringEnergies::new(system, state, work.driven());
        let [prescribed] = system.total([system.prescribed().len() as f64]);
        let is_loose = prescribed == 0.0 && !system.has_external_forces();
        let particles = ParticleSums::at(system, state, is_loose);
        let balance = EnergyBalance::new(&springs.total().of_all_parts(system), &particles, work.energy(state));
        let record = MonitorCheckpoint {
            balance,
            growth: GrowthRecord::new(system, &balance, state),
            steps: 0,
            duration: 0.0,
            error: options.threshold.map(|_| PropagatedError::none(system)),
            predictable_until: None,
        };
        Ok(Self {
            system,
            options,
            springs,
            work,
            is_loose,
            is_accurate: false,
            record,
            saved: SavedState { steps: 0, state: state.clone(), balance },
            last: state.clone(),
            before: (state.time, balance.balance()),
            start: state.clone(),
        })
    }

    /// Continues a run that began with the first of two states and has come to the second, after so many steps.
    ///
    /// # Errors
    /// A state of another system; too little memory.
    pub fn continued(
        system: &'s System,
        [start, state]: [&State; 2],
        steps: u64,
        account: &MonitorCheckpoint,
        options: MonitorOptions,
    ) -> Result<Self> {
        start.check(system)?;
        let mut monitor = Self::new(system, state, options)?;
        monitor.start.copy_from(start);
        monitor.record = account.clone();
        monitor.record.error.take_if(|error| !error.fits(system));
        (monitor.saved.steps, monitor.saved.balance) = (steps, account.balance);
        monitor.before.1 = account.balance.balance();
        Ok(monitor)
    }

    /// The record with which the run can be [continued](Self::continued).
    pub fn account(&self) -> MonitorCheckpoint {
        self.record.clone()
    }

    /// Enters the state after a number of steps, the last of dt seconds.
    ///
    /// # Errors
    /// [`StepFailure::Unstable`] when energy has appeared from nowhere, if that is to end the run; [`StepFailure::NonFinite`] when an energy is not
    /// finite; a state of another system, or a dt that is not positive.
    pub fn enter(&mut self, steps: u64, state: &State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.system, state, dt)?;
        self.before = (self.last.time, self.balance());
        let work = self.work.enter(&self.last, state, dt, self.is_accurate);
        let sums = self.springs.enter(state, dt).add(&work).of_all_parts(self.system);
        let particles = ParticleSums::at(self.system, state, self.is_loose);
        self.last.copy_from(state);
        self.record.balance.enter(&sums, &particles, self.work.energy(state));
        if self.has_overflowed() {
            return Err(StepFailure::NonFinite);
        }
        let MonitorCheckpoint { balance, growth, steps: done, duration, .. } = &mut self.record;
        *done += 1;
        *duration += dt;
        if self.system.has_forces_in_time() {
            growth.load(self.system, &self.start, state.time, dt);
        }
        let (is_calm, grown) = growth.enter(balance, dt);
        if is_calm {
            self.saved.update(steps, state, balance);
        }
        if !growth.exchanged().is_finite() {
            return Err(StepFailure::NonFinite);
        }
        if self.options.stops_unstable { grown } else { Ok(()) }
    }

    /// Propagates the error of the run over a step of dt seconds to a state, by the method that made it.
    pub(super) fn propagate(&mut self, stepper: &mut (impl TimeStepper + ?Sized), state: &State, dt: f64) {
        let Self {
            system, record: MonitorCheckpoint { error, predictable_until, .. }, last, options, is_accurate, ..
        } = self;
        let Some(known) = error else { return };
        known.pass_load_kinks(system, last, dt);
        let step = CompletedStep { before: last, after: state, length: dt };
        if !stepper.propagate(known, &step) {
            *error = None;
            return;
        }
        // Steps with error control are short where forces jump.
        if !*is_accurate {
            known.add_jumps(system, &step);
        }
        let extent = known.saturate(system, extent(Some(system), &state.positions, &self.start.positions));
        let threshold = options.threshold.unwrap_or(INACCURATE);
        if predictable_until.is_none() && known.norm(system) > threshold * extent {
            *predictable_until = Some(last.time);
        }
    }

    /// The pass over the springs, for a method that goes through them anyway.
    pub(super) fn springs(&mut self) -> &mut SpringEnergies<'s> {
        &mut self.springs
    }

    /// The step entered next may err by so much energy, in J, by the method's own estimate: that much growth does not count. The velocities of such a
    /// run count as resolved.
    pub fn doubt(&mut self, energy: f64) {
        self.is_accurate = true;
        self.record.growth.doubt(energy);
    }

    /// The energy of the state entered last, or that exchanged until then, is not finite.
    pub(super) fn has_overflowed(&self) -> bool {
        // Every other energy is a term of it.
        !self.balance().imbalance.is_finite()
    }

    /// [`StepFailure::Unstable`] where energy has grown at the last state, if that is to end the run.
    pub(super) fn growth(&self) -> Option<StepFailure> {
        let growth = &self.record.growth;
        let is_above = self.options.stops_unstable && growth.is_above();
        is_above.then(|| StepFailure::Unstable { gained: growth.gained, exchanged: growth.exchanged() })
    }

    /// Restores the last state from before energy appeared, with its balance; returns the number of steps that led to it.
    pub(super) fn restore(&mut self, state: &mut State) -> u64 {
        state.copy_from(&self.saved.state);
        self.record.balance = self.saved.balance;
        self.saved.steps
    }

    /// The propagated error of the run; `None` where it is not known.
    pub fn error(&self) -> Option<&PropagatedError> {
        self.record.error.as_ref()
    }

    /// Energy at the start of the run.
    pub fn initial(&self) -> Energy {
        self.record.balance.initial
    }

    /// Energy at the state entered last.
    pub fn energy(&self) -> Energy {
        self.record.balance.energy
    }

    /// The balance at the state entered last.
    pub fn balance(&self) -> Balance {
        self.record.balance.balance()
    }

    /// Energy and balance at a state of the last step, within which work and dissipation grow in proportion to the time.
    pub fn energy_at(&self, state: &State) -> (Energy, Balance) {
        if self.last.time == state.time {
            return (self.energy(), self.balance());
        }
        let energy = Energy::of(self.system, state);
        (energy, self.balance_between(state.time, &energy))
    }

    fn balance_between(&self, time: f64, energy: &Energy) -> Balance {
        let ((start, from), end, to) = (self.before, self.last.time, self.balance());
        let share = if end > start { ((time - start) / (end - start)).clamp(0.0, 1.0) } else { 1.0 };
        let between = |from: f64, to: f64| from + share * (to - from);
        let (work, dissipated) = (between(from.work, to.work), between(from.dissipated, to.dissipated));
        self.record.balance.balance_of(energy, work, dissipated)
    }

    /// The indicators of accuracy at a state, ordinarily the last.
    pub fn indicators(&self, state: &State) -> ErrorIndicators {
        let MonitorCheckpoint { growth, steps, error, predictable_until, .. } = &self.record;
        let extent = extent(Some(self.system), &state.positions, &self.start.positions);
        let error = error.as_ref().filter(|_| *steps > 0);
        // Every step rounds the positions that move; without an error nothing does.
        let moving = sum_of_all(self.system, |p| free_square(self.system, p, &state.positions[p])).sqrt();
        let rounding = 0.5 * f64::EPSILON * (*steps as f64).sqrt() * moving;
        let estimate = error.map(|error| error.norm(self.system));
        let estimate = estimate.map(|error| if error > 0.0 { error.max(rounding) } else { error } / extent);
        ErrorIndicators {
            extent,
            estimate: estimate.filter(|estimate| estimate.is_finite()),
            local_errors: error.map_or(0.0, |error| error.sum_of_local_errors() / extent),
            predictable_until: *predictable_until,
            exchanged: growth.exchanged(),
            gained: growth.gained,
        }
    }
}

#[cfg(test)]
mod instability_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod work_tests;
