//! What accompanies a run: the energy ledger, the watch over energy from nowhere, and the figures that say how wrong it is.
//!
//! After every accepted step one pass over the springs and one over the particles see the new state. They need no force but
//! that of methods whose linearisation is in question; sums are made in blocks, so that they have the same bits whatever the
//! number of threads.

mod aside;
mod batch;
mod driven;
mod external;
mod figures;
mod forces;
mod growth;
mod indicator;
mod ledger;
mod particles;
mod springs;
mod sums;

pub use figures::Figures;
pub use indicator::{Warning, percent};
pub use ledger::Balance;

use super::carried::Kept;
use super::watch::Watch;
use super::{CarriedErrors, Method, StepFailure, StiffnessPolicy, TimeStepper};
use crate::error::Result;
use crate::force::Energy;
use crate::memory;
use crate::spring::Stiffness;
use crate::system::{Axes, State, System};
use aside::Aside;
use driven::Drive;
use external::External;
use figures::Trail;
use forces::Forces;
use growth::{Growth, Past, Unstable};
use ledger::Ledger;
use nalgebra::Vector3;
use particles::Particles;
use serde::{Deserialize, Serialize};
use springs::Springs;

/// What a monitor is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MonitorOptions {
    /// Whether forces are evaluated at every new state, for [`Figures::defect`].
    pub forces: bool,
    /// Whether springs that turn are looked at, for [`Figures::lifted`] and [`Figures::lifted_twice`].
    pub turning: bool,
    /// Whether the paths of particles are, for [`Figures::third`] and [`Figures::slip`].
    pub paths: bool,
    /// Whether a method that knows how is to carry the errors of its steps on, for [`Figures::carried`].
    pub errors: bool,
    /// Whether energy from nowhere ends the run.
    pub stops_unstable: bool,
}

impl MonitorOptions {
    /// The energy ledger alone, and what costs nothing beside it.
    pub const LEDGER: Self = Self { forces: false, turning: false, paths: false, errors: false, stops_unstable: true };

    /// What the indicators of a method need; the other figures stay zero. Forces, where only its linearisation is in question: the others
    /// solve their equations, or have none; without transverse stiffness there is nothing that brakes.
    pub fn of(method: Method, stiffness: StiffnessPolicy) -> Self {
        let brakes = stiffness != StiffnessPolicy::Always(Stiffness::Axial);
        Self {
            forces: method == Method::LinearBackwardEuler && brakes,
            turning: matches!(method, Method::W2 | Method::Rodas4),
            paths: matches!(method, Method::W2 | Method::Bdf2 | Method::SymplecticEuler),
            errors: method.carries_errors(),
            ..Self::LEDGER
        }
    }
}

/// All figures that need no forces.
impl Default for MonitorOptions {
    fn default() -> Self {
        Self { turning: true, paths: true, errors: true, ..Self::LEDGER }
    }
}

/// What a monitor knows of a run: enough to go on from a state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Account {
    ledger: Ledger,
    past: Past,
    trail: Trail,
    carried: Option<Kept>,
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
    drive: Drive<'s>,
    aside: Aside<'s>,
    external: Option<External>,
    forces: Option<Forces>,
    ledger: Ledger,
    /// At the state before, with its time.
    before: Ledger,
    times: [f64; 2],
    growth: Growth,
    trail: Trail,
    /// What the steps so far have made wrong, where that is to be known.
    carried: Option<CarriedErrors>,
    start: Vec<Vector3<f64>>,
    /// Whether there are fewer springs than degrees of freedom.
    can_fold: bool,
    /// Of a particle that moves, in the mean, in kg.
    mass: f64,
}

/// Forces are evaluated in the first steps, and then in one of so many: what linearising leaves out is compared with what it balances in
/// the same steps, and an evaluation at every one would cost a tenth of a short step.
const LOOKS: u64 = 8;

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
        let drive = Drive::new(system, state);
        let mut springs = Springs::new(system, state, drive.springs(), options.turning);
        let mut particles = Particles::new(system, state, options.paths);
        let sums = (springs.pass(&state.moment(), 0.0), particles.pass(state, 0.0, None));
        let ledger = Ledger::new(&sums.0, &sums.1, drive.energy(state));
        let growth = Growth::new(system, &ledger, state);
        let forces = options.forces.then(|| Forces::new(system, state)).transpose()?;
        Ok(Self {
            system,
            options,
            springs,
            particles,
            drive,
            aside: Aside::new(system),
            external: External::new(system, state),
            forces,
            ledger,
            before: ledger,
            times: [state.time; 2],
            growth,
            trail: Trail::default(),
            carried: options.errors.then(|| CarriedErrors::none(system)),
            start: state.positions.clone(),
            can_fold: can_fold(system),
            mass: mean_mass(system),
        })
    }

    /// Enters the state after a number of steps, the last of dt seconds; `local_error` is the norm of the method's own estimate of
    /// the step's position error, in m.
    ///
    /// # Errors
    /// [`StepFailure::Unstable`] when energy has appeared from nowhere, if that is to end the run.
    pub fn enter(&mut self, steps: u64, state: &State, dt: f64, local_error: Option<f64>) -> Result<(), StepFailure> {
        self.before = self.ledger;
        self.times = [self.times[1], state.time];
        let looks = steps <= LOOKS || steps.is_multiple_of(LOOKS);
        let forces = self.forces.as_mut().filter(|_| looks);
        let force = forces.and_then(|forces| forces.at(self.system, state));
        let (springs, particles) = (self.springs.enter(state, dt), self.particles.pass(state, dt, force));
        let mut exchange = self.drive.pass(state, dt);
        exchange.work += self.external.as_mut().map_or(0.0, |external| external.pass(self.system, state));
        self.ledger.enter(&springs, &particles, self.drive.energy(state), &exchange);
        if self.has_overflowed() {
            return Err(StepFailure::NonFinite);
        }
        let detour = self.aside.pass(self.times, state);
        self.growth.miss(detour.missed(self.before.energy.elastic.max(self.ledger.energy.elastic)));
        self.trail.enter(dt, &springs, &particles, &detour, local_error);
        match self.growth.enter(&self.ledger, steps, state, dt) {
            Some(Unstable { gained, exchanged }) if self.options.stops_unstable => {
                Err(StepFailure::Unstable { gained, exchanged })
            }
            _ => Ok(()),
        }
    }

    /// Lets a stepper begin with what the monitor knows of the errors of steps before.
    pub(super) fn begin(&self, stepper: &mut (impl TimeStepper + ?Sized)) {
        if let Some(carried) = &self.carried {
            stepper.carry_errors(carried.clone());
        }
    }

    /// Takes over what a stepper has carried on.
    pub(super) fn carry(&mut self, errors: Option<&CarriedErrors>) {
        if let (Some(carried), Some(errors)) = (&mut self.carried, errors) {
            carried.clone_from(errors);
        }
    }

    /// The account of the springs, for a method that goes through them anyway.
    pub(super) fn springs(&mut self) -> &mut dyn Watch {
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
    pub fn account(&self) -> Account {
        Account {
            ledger: self.ledger,
            past: self.growth.past(),
            trail: self.trail,
            carried: self.carried.as_ref().map(CarriedErrors::kept),
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
        account: &Account,
        options: MonitorOptions,
    ) -> Result<Self> {
        let Account { ledger, ref past, trail, ref carried } = *account;
        let fresh = Self::new(system, state, options)?;
        let growth = Growth::continued(past, &ledger, steps, state);
        let carried = carried.as_ref().map(|kept| CarriedErrors::of(system, kept));
        let start = start.positions.clone();
        Ok(Self { ledger, before: ledger, growth, trail, carried, start, ..fresh })
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

    /// The figures of the run up to a state, as a rule its last.
    pub fn figures(&self, state: &State) -> Figures {
        let figures = self.trail.figures(self.extent(state));
        let (gained, lost) = (self.growth.gained, self.growth.lost(&self.ledger));
        let aside = figures.aside / self.mass.sqrt();
        let carried = self.carried.as_ref().map_or(0.0, |carried| carried.norm(self.system)) / figures.extent;
        let way = |energy: f64| figures.duration * (2.0 * energy.max(0.0) / self.mass).sqrt() / figures.extent;
        Figures {
            exchanged: self.growth.exchanged(),
            gained,
            lost,
            lost_way: way(lost),
            gained_way: way(gained),
            can_fold: self.can_fold,
            aside,
            carried,
            ..figures
        }
    }

    /// The distance of the particles from their centre; where they are all at one place, from where they started; never zero.
    fn extent(&self, state: &State) -> f64 {
        let system = self.system;
        let positions = &state.positions[..system.own_particles()];
        let sum = positions.iter().sum::<Vector3<f64>>();
        let [count, x, y, z] = system.total([positions.len() as f64, sum.x, sum.y, sum.z]);
        let centre = Vector3::new(x, y, z) / count.max(1.0);
        let spread = positions.iter().map(|x| (x - centre).norm_squared()).sum::<f64>();
        let way = positions.iter().zip(&self.start).map(|(x, y)| (x - y).norm_squared()).sum::<f64>();
        let [spread, way] = system.total([spread, way]).map(f64::sqrt);
        let [largest] = system.largest([positions.iter().map(|x| x.norm()).fold(0.0, f64::max)]);
        [spread, way].into_iter().find(|&length| length > 1e-12 * largest).unwrap_or(1.0)
    }
}

/// Whether a scene can fold, turn or fall without stretching a spring.
fn can_fold(system: &System) -> bool {
    let springs = system.active_springs().iter().filter(|&&spring| system.counts(spring as usize)).count();
    let [springs, dofs] = system.total([springs as f64, system.dofs().first_row(system.own_particles()) as f64]);
    system.dimension() > 1 && springs < dofs
}

/// The mean mass of the particles that move, in kg; one where there are none.
fn mean_mass(system: &System) -> f64 {
    let moves = |&p: &usize| system.dofs().free_axes(p) != Axes::NONE;
    let masses = (0..system.own_particles()).filter(moves).map(|p| system.masses()[p]);
    let [count, mass] = masses.fold([0.0, 0.0], |[count, sum], mass| [count + 1.0, sum + mass]);
    let [count, mass] = system.total([count, mass]);
    if count > 0.0 { mass / count } else { 1.0 }
}

#[cfg(test)]
mod account_tests;
#[cfg(all(test, feature = "scene"))]
mod along_tests;
#[cfg(all(test, feature = "scene"))]
mod tests;
