//! The two explicit Euler methods, for comparison: no matrix, and a step bounded by the stiffest spring.

use super::propagated_error::LeadingTerm;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{SpringGeometry, set_total_force};
use crate::memory;
use crate::system::{State, System};
use nalgebra::Vector3;

/// Bytes for a particle, at most, and for a spring while lengths are looked at for the first time.
const PARTICLE: u64 = 150;
const SPRING: u64 = 40;

/// Asks for the memory of an explicit method that keeps so many bytes for every particle, and refuses a state of another system.
pub(super) fn ensure_room(system: &System, state: &State, particle: u64) -> Result<()> {
    state.check(system)?;
    let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
    memory::ensure(SPRING * springs + particle * particles, "the state of the method")
}

/// What a step sees of a particle: x and v, its force and mass, and where x' and v' go.
type Particle<'a> =
    ((&'a Vector3<f64>, &'a Vector3<f64>), (&'a Vector3<f64>, f64), (&'a mut Vector3<f64>, &'a mut Vector3<f64>));

/// Forces at a state, and the state that a step leads to.
struct Explicit<'s> {
    system: &'s System,
    force: Vec<Vector3<f64>>,
    next: State,
    /// Forces at a displaced state, once an error is propagated.
    displaced: Vec<Vector3<f64>>,
    statistics: Statistics,
}

impl<'s> Explicit<'s> {
    fn new(system: &'s System, state: &State) -> Result<Self> {
        ensure_room(system, state, PARTICLE)?;
        SpringGeometry::at(system, state)?;
        let force = vec![Vector3::zeros(); system.particles()];
        Ok(Self { system, force, next: state.clone(), displaced: Vec::new(), statistics: Statistics::default() })
    }

    /// `f_el + f_d + g` at a state.
    fn set_force(&mut self, state: &State) -> Result<(), StepFailure> {
        self.statistics.work.force_evaluations += 1;
        Ok(set_total_force(self.system, &state.moment(), &mut self.force)?)
    }

    /// Propagates an error over a step whose force at the start is known: sets its accelerations to those that it has there, and takes the step with them.
    fn propagate(
        &mut self,
        error: &mut PropagatedError,
        step: &CompletedStep<'_>,
        term: LeadingTerm,
        advance: impl Fn(&mut PropagatedError, f64),
    ) -> bool {
        let Self { system, force, next, displaced, statistics } = self;
        error.set_local(system, step, term);
        let epsilon = error.displace(system, step.before, step.length, next);
        if epsilon > 0.0 {
            statistics.work.force_evaluations += 1;
            displaced.resize(force.len(), Vector3::zeros());
            if set_total_force(system, &next.moment(), displaced).is_ok() {
                error.set_accelerations(system, displaced, force, epsilon);
                advance(error, step.length);
            }
        }
        error.add_local();
        true
    }

    /// Every particle, after its force is known.
    fn particles<'a>(&'a mut self, state: &'a State) -> impl Iterator<Item = Particle<'a>> {
        let Self { system, force, next, .. } = self;
        let here = state.positions.iter().zip(&state.velocities);
        let there = next.positions.iter_mut().zip(&mut next.velocities);
        here.zip(force.iter().zip(system.masses()))
            .zip(there)
            .map(|((here, (force, mass)), there)| (here, (force, *mass), there))
    }

    /// Puts prescribed coordinates in place and accepts the next state if it is finite.
    fn accept(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        self.next.time = state.time + dt;
        self.next.prescribe(self.system);
        if !self.next.is_finite() {
            return Err(StepFailure::NonFinite);
        }
        state.copy_from(&self.next);
        Ok(())
    }
}

/// Forward Euler: `x' = x + dt v`, `v' = v + dt M⁻¹ f(x, v)`. First order; gains energy at every step size.
///
/// # Examples
/// ```
/// use sprung::integrate::{ForwardEuler, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = ForwardEuler::new(&system, &state)?;
/// stepper.step(&mut state, 0.1)?;
/// // a = k (1 − l/l0)/m = 10 m/s²; the position moves by the old velocity.
/// assert_eq!((state.velocities[1].x, state.positions[1].x), (1.0, 1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ForwardEuler<'s>(Explicit<'s>);

impl<'s> ForwardEuler<'s> {
    /// For a system.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`.
    pub fn new(system: &'s System, state: &State) -> Result<Self> {
        Explicit::new(system, state).map(Self)
    }
}

impl TimeStepper for ForwardEuler<'_> {
    fn name(&self) -> &'static str {
        "forward-euler"
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.0.system, state, dt)?;
        self.0.set_force(state)?;
        for ((x, v), (force, mass), (next_x, next_v)) in self.0.particles(state) {
            *next_x = x + v * dt;
            *next_v = v + force * (dt / mass);
        }
        self.0.accept(state, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        self.0.propagate(error, step, LeadingTerm::FORWARD_EULER, |e, h| {
            for ((x, v), a) in e.positions.iter_mut().zip(&mut e.velocities).zip(&e.accelerations) {
                *x += *v * h;
                *v += a * h;
            }
        })
    }

    fn statistics(&self) -> &Statistics {
        &self.0.statistics
    }
}

/// Symplectic (semi-implicit) Euler: `v' = v + dt M⁻¹ f(x, v)`, `x' = x + dt v'`. First order; stable without damping for
/// `dt ≤ 2/ω_max`. Damping is explicit.
///
/// # Examples
/// ```
/// use sprung::integrate::{SymplecticEuler, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = SymplecticEuler::new(&system, &state)?;
/// stepper.step(&mut state, 0.1)?;
/// // a = k (1 − l/l0)/m = 10 m/s²; the position moves by the new velocity.
/// assert_eq!((state.velocities[1].x, state.positions[1].x), (1.0, 1.1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SymplecticEuler<'s>(Explicit<'s>);

impl<'s> SymplecticEuler<'s> {
    /// For a system.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`.
    pub fn new(system: &'s System, state: &State) -> Result<Self> {
        Explicit::new(system, state).map(Self)
    }
}

impl TimeStepper for SymplecticEuler<'_> {
    fn name(&self) -> &'static str {
        "symplectic-euler"
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.0.system, state, dt)?;
        self.0.set_force(state)?;
        for ((x, v), (force, mass), (next_x, next_v)) in self.0.particles(state) {
            *next_v = v + force * (dt / mass);
            *next_x = x + *next_v * dt;
        }
        self.0.accept(state, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        self.0.propagate(error, step, LeadingTerm::SYMPLECTIC_EULER, |e, h| {
            for ((x, v), a) in e.positions.iter_mut().zip(&mut e.velocities).zip(&e.accelerations) {
                *v += a * h;
                *x += *v * h;
            }
        })
    }

    fn statistics(&self) -> &Statistics {
        &self.0.statistics
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{Dop853, Verlet};
    use crate::memory::watch::asked;
    use crate::system::fixtures::row;

    /// Two springs and three particles.
    #[test]
    fn memory_is_asked_for_springs_and_particles() {
        let (system, state) = row(3);
        let bytes = |new: &dyn Fn()| asked("the state of the method", new).1;
        let verlet = bytes(&|| drop(Verlet::new(&system, &state).unwrap()));
        let euler = bytes(&|| drop(SymplecticEuler::new(&system, &state).unwrap()));
        let dop853 = bytes(&|| drop(Dop853::new(&system, &state).unwrap()));
        assert_eq!([verlet, euler, dop853], [2 * 40 + 3 * 150, 2 * 40 + 3 * 150, 2 * 40 + 3 * 700]);
    }
}
