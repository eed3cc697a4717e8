//! The energy balance of a run, the watch over energy from nowhere, and the propagated error of the run.
//!
//! After every accepted step one pass over the springs and one over the particles see the new state. Sums are made in blocks, so that they
//! have the same bits whatever the number of threads.

mod batch;
mod constraint_work;
mod energy_balance;
mod external;
mod growth;
mod indicators;
mod particles;
mod springs;
mod sums;

pub use energy_balance::Balance;
pub use indicators::{ErrorIndicators, INACCURATE, Warning, percent, threshold};

use super::{CompletedStep, PropagatedError, SpringVisitor, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{Energy, actuation_power};
use crate::memory;
use crate::system::{State, System};
use constraint_work::ConstraintWork;
use energy_balance::EnergyBalance;
use external::External;
use growth::{Growth, Past, Unstable};
use nalgebra::Vector3;
use particles::Particles;
use serde::{Deserialize, Serialize};
use springs::Springs;

/// What a monitor is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorOptions {
    /// The relative position error until which positions count as predictable; `None` where the errors of steps are not to be propagated, and nothing is
    /// known of the error.
    pub threshold: Option<f64>,
    /// Whether energy from nowhere ends the run.
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

/// What a monitor knows of a run: enough to go on from a state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorCheckpoint {
    ledger: EnergyBalance,
    past: Past,
    steps: u64,
    duration: f64,
    error: Option<PropagatedError>,
    predictable_until: Option<f64>,
}

/// Accompanies a run; see the module.
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
    particles: Particles<'s>,
    drive: ConstraintWork<'s>,
    external: Option<External>,
    /// The power that springs take up by changing their rest lengths, in W.
    power: f64,
    ledger: EnergyBalance,
    /// At the state before, with its time.
    before: EnergyBalance,
    times: [f64; 2],
    growth: Growth,
    steps: u64,
    duration: f64,
    /// The error of the run, where it is to be known and the method knows how.
    error: Option<PropagatedError>,
    predictable_until: Option<f64>,
    /// Where the step at hand began, where errors are propagated.
    started: State,
    start: Vec<Vector3<f64>>,
}

/// Bytes of what is kept of a spring and of a particle, at most; the last batch of springs is filled up.
const SPRING: u64 = 100;
const PARTICLE: u64 = 450;

/// The parabola of a rate over a step in Legendre polynomials, see `springs`.
struct Sides {
    mean: f64,
    slope: f64,
    bend: f64,
}

impl<'s> Monitor<'s> {
    /// From the state that a run starts from.
    ///
    /// # Errors
    /// Coincident ends of a spring; too little memory.
    pub fn new(system: &'s System, state: &State, options: MonitorOptions) -> Result<Self> {
        let [springs, particles] = [system.springs().len() as u64, system.particles() as u64];
        memory::ensure(SPRING * springs + PARTICLE * particles, "what accompanies a run")?;
        let drive = ConstraintWork::new(system, state);
        let mut springs = Springs::new(system, state, drive.springs());
        let particles = Particles::new(system);
        let sums = (springs.pass(&state.moment(), 0.0), particles.pass(state));
        let ledger = EnergyBalance::new(&sums.0, &sums.1, drive.energy(state));
        let growth = Growth::new(system, &ledger, state);
        Ok(Self {
            system,
            options,
            springs,
            particles,
            drive,
            external: External::new(system, state),
            power: actuation_power(system, &state.moment()),
            ledger,
            before: ledger,
            times: [state.time; 2],
            growth,
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
    /// [`StepFailure::Unstable`] when energy has appeared from nowhere, if that is to end the run.
    pub fn enter(&mut self, steps: u64, state: &State, dt: f64) -> Result<(), StepFailure> {
        self.before = self.ledger;
        self.times = [self.times[1], state.time];
        let (springs, particles) = (self.springs.enter(state, dt), self.particles.pass(state));
        let mut exchange = self.drive.pass(state, dt);
        exchange.work += self.external.as_mut().map_or(0.0, |external| external.pass(self.system, state));
        // The trapezoidal rule of what springs take up by changing their rest lengths.
        let power = actuation_power(self.system, &state.moment());
        exchange.work += 0.5 * (self.power + power) * dt;
        self.power = power;
        self.ledger.enter(&springs, &particles, self.drive.energy(state), &exchange);
        if self.has_overflowed() {
            return Err(StepFailure::NonFinite);
        }
        self.steps += 1;
        self.duration += dt;
        let grown = self.growth.enter(&self.ledger, steps, state, dt);
        if !self.growth.exchanged().is_finite() {
            return Err(StepFailure::NonFinite);
        }
        match grown {
            Some(Unstable { gained, exchanged }) if self.options.stops_unstable => {
                Err(StepFailure::Unstable { gained, exchanged })
            }
            _ => Ok(()),
        }
    }

    /// Takes note of where a step begins.
    pub(super) fn begin_step(&mut self, state: &State) {
        if self.error.is_some() {
            self.started.copy_from(state);
        }
    }

    /// Propagates the error of the run over a step of dt seconds to a state, by the method that did it.
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

    /// The account of the springs, for a method that goes through them anyway.
    pub(super) fn springs(&mut self) -> &mut dyn SpringVisitor {
        &mut self.springs
    }

    /// Says that the step entered next may err by so much energy, in J, by the method's own estimate: that much of growth is none.
    pub fn doubt(&mut self, energy: f64) {
        self.growth.doubt(energy);
    }

    /// Whether the energy of the state entered last, or what has been exchanged until then, is no number.
    pub(super) fn has_overflowed(&self) -> bool {
        let Balance { work, dissipated, imbalance } = self.balance();
        ![self.ledger.energy.total(), work, dissipated, imbalance].into_iter().all(f64::is_finite)
    }

    /// What it knows of the run so far, to go on with.
    pub fn account(&self) -> MonitorCheckpoint {
        MonitorCheckpoint {
            ledger: self.ledger,
            past: self.growth.past(),
            steps: self.steps,
            duration: self.duration,
            error: self.error.clone(),
            predictable_until: self.predictable_until,
        }
    }

    /// Goes on with a run that began with the first of two states and has come to the second, after so many steps: with what it
    /// knew of it, but for the last step, of which the figures that compare two steps begin anew.
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
        let MonitorCheckpoint { ledger, ref past, steps: done, duration, ref error, predictable_until } = *account;
        let fresh = Self::new(system, state, options)?;
        let growth = Growth::continued(past, &ledger, steps, state);
        let error = error.clone().filter(|error| error.fits(system));
        let start = start.positions.clone();
        Ok(Self { ledger, before: ledger, growth, steps: done, duration, error, predictable_until, start, ..fresh })
    }

    /// The failure that energy from nowhere makes of a run at its last state, where it has grown and is to end the run.
    pub(super) fn growth(&self) -> Option<StepFailure> {
        let is_above = self.options.stops_unstable && self.growth.is_above();
        is_above.then(|| StepFailure::Unstable { gained: self.growth.gained, exchanged: self.growth.exchanged() })
    }

    /// Puts back the last state from before energy appeared, and its account; returns the number of steps that led to it.
    pub(super) fn restore(&mut self, state: &mut State) -> u64 {
        let kept = self.growth.kept();
        state.copy_from(&kept.state);
        self.ledger = kept.ledger;
        kept.steps
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
        self.ledger.initial
    }

    /// Energy at the state entered last.
    pub fn energy(&self) -> Energy {
        self.ledger.energy
    }

    /// Where the energy went until the state entered last.
    pub fn balance(&self) -> Balance {
        self.ledger.balance()
    }

    /// Where the energy went until a state between the last two, which has the given energy: work and dissipation in
    /// proportion to the time.
    pub fn balance_between(&self, time: f64, energy: &Energy) -> Balance {
        let [start, end] = self.times;
        let share = if end > start { ((time - start) / (end - start)).clamp(0.0, 1.0) } else { 1.0 };
        let (from, to) = (self.before.balance(), self.ledger.balance());
        let between = |from: f64, to: f64| from + share * (to - from);
        self.ledger.balance_of(energy, between(from.work, to.work), between(from.dissipated, to.dissipated))
    }

    /// Energy at a state of the last step, and where it went until then: of the one entered last as it was entered, of one before it
    /// as [`balance_between`](Self::balance_between) says.
    pub fn energy_at(&self, state: &State) -> (Energy, Balance) {
        if self.time() == state.time {
            return (self.energy(), self.balance());
        }
        let energy = Energy::of(self.system, state);
        (energy, self.balance_between(state.time, &energy))
    }

    /// What the run says of its accuracy up to a state, as a rule its last.
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
            gained: self.growth.gained,
            lost: self.growth.lost(&self.ledger),
        }
    }
}

/// The distance of the particles from their centroid; where they are all at one place, from where they started; never zero.
fn extent(system: &System, state: &State, start: &[Vector3<f64>]) -> f64 {
    let positions = &state.positions[..system.own_particles()];
    let sum = positions.iter().sum::<Vector3<f64>>();
    let [count, x, y, z] = system.total([positions.len() as f64, sum.x, sum.y, sum.z]);
    let centre = Vector3::new(x, y, z) / count.max(1.0);
    let (mut spread, mut way, mut largest) = (0.0, 0.0, 0.0_f64);
    for (x, start) in positions.iter().zip(start) {
        spread += (x - centre).norm_squared();
        way += (x - start).norm_squared();
        largest = largest.max(x.norm_squared());
    }
    let [spread, way] = system.total([spread, way]).map(f64::sqrt);
    let [largest] = system.largest([largest.sqrt()]);
    [spread, way].into_iter().find(|&length| length > 1e-12 * largest).unwrap_or(1.0)
}

#[cfg(test)]
mod account_tests;
#[cfg(all(test, feature = "scene"))]
mod tests;
