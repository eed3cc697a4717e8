//! The two explicit Euler methods, for comparison: no matrix, and steps bounded by the stiffest spring.

use super::propagated_error::LeadingTerm;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper, check_room, fits};
use crate::error::Result;
use crate::force::{SpringGeometry, set_total_force};
use crate::system::{State, System};
use nalgebra::Vector3;

/// Refuses a state of another system, coincident ends of a spring, and an explicit method of too many bytes for each particle.
pub(super) fn check_explicit(system: &System, state: &State, particle: u64) -> Result<()> {
    // The geometry has 40 bytes for a spring.
    check_room(system, state, [40, particle])?;
    SpringGeometry::at(system, state)?;
    Ok(())
}

/// Maps x, v, `dv = dt a` and dt of a particle, or of its error, to x' and v'.
type Advance = fn(Vector3<f64>, Vector3<f64>, Vector3<f64>, f64) -> [Vector3<f64>; 2];

fn advance_forward(x: Vector3<f64>, v: Vector3<f64>, dv: Vector3<f64>, dt: f64) -> [Vector3<f64>; 2] {
    [x + v * dt, v + dv]
}

fn advance_symplectic(x: Vector3<f64>, v: Vector3<f64>, dv: Vector3<f64>, dt: f64) -> [Vector3<f64>; 2] {
    [x + (v + dv) * dt, v + dv]
}

/// An explicit Euler method, of first order: [forward](Self::forward) or [symplectic](Self::symplectic).
pub struct ExplicitEuler<'s> {
    system: &'s System,
    name: &'static str,
    advance: Advance,
    term: LeadingTerm,
    force: Vec<Vector3<f64>>,
    next: State,
    /// Forces at a displaced state, once an error is propagated.
    displaced: Vec<Vector3<f64>>,
    statistics: Statistics,
}

impl<'s> ExplicitEuler<'s> {
    /// Forward Euler: `x' = x + dt v`, `v' = v + dt M⁻¹ f(x, v)`. Gains energy at every step size.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a state of another system; too little memory.
    pub fn forward(system: &'s System, state: &State) -> Result<Self> {
        Self::new(system, state, "forward-euler", advance_forward, LeadingTerm::FORWARD_EULER)
    }

    /// Symplectic (semi-implicit) Euler: `v' = v + dt M⁻¹ f(x, v)`, `x' = x + dt v'`. Stable without damping for `dt ≤ 2/ω_max`.
    ///
    /// # Errors
    /// As of [`forward`](Self::forward).
    pub fn symplectic(system: &'s System, state: &State) -> Result<Self> {
        Self::new(system, state, "symplectic-euler", advance_symplectic, LeadingTerm::SYMPLECTIC_EULER)
    }

    fn new(system: &'s System, state: &State, name: &'static str, advance: Advance, term: LeadingTerm) -> Result<Self> {
        check_explicit(system, state, 150)?;
        Ok(Self {
            system,
            name,
            advance,
            term,
            force: vec![Vector3::zeros(); system.particles()],
            next: state.clone(),
            displaced: Vec::new(),
            statistics: Statistics::default(),
        })
    }
}

impl TimeStepper for ExplicitEuler<'_> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn load_kinks(&self) -> &[f64] {
        self.system.prescribed().load_kinks()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        let Self { system, force, next, .. } = self;
        StepFailure::of_arguments(system, state, dt)?;
        self.statistics.work.force_evaluations += 1;
        set_total_force(system, &state.moment(), force)?;
        for (p, mass) in system.masses().iter().enumerate() {
            let (x, v) = (state.positions[p], state.velocities[p]);
            [next.positions[p], next.velocities[p]] = (self.advance)(x, v, force[p] * (dt / mass), dt);
        }
        next.time = state.time + dt;
        next.prescribe(system);
        StepFailure::unless_finite(system, next.is_finite())?;
        state.copy_from(next);
        Ok(())
    }

    /// Φ is the step itself, with the accelerations of the error as a difference quotient.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { system, force, next, displaced, statistics, .. } = self;
        if !fits(system, error, step) {
            return false;
        }
        error.set_local(system, step, self.term);
        let epsilon = error.displace(system, step.before, step.length, next);
        if epsilon > 0.0 {
            statistics.work.force_evaluations += 1;
            displaced.resize(force.len(), Vector3::zeros());
            if set_total_force(system, &next.moment(), displaced).is_ok() {
                error.set_accelerations(system, displaced, force, epsilon);
                for ((x, v), a) in error.positions.iter_mut().zip(&mut error.velocities).zip(&error.accelerations) {
                    [*x, *v] = (self.advance)(*x, *v, a * step.length, step.length);
                }
            }
        }
        error.add_local();
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

#[cfg(test)]
mod tests {
    use crate::integrate::Method;
    use crate::integrate::fixtures::stepper;
    use crate::memory::watch::asked;
    use crate::system::fixtures::row;

    /// Two springs and three particles.
    #[test]
    fn memory_is_asked_for_springs_and_particles() {
        let (system, state) = row(3);
        for (method, particle) in [(Method::Verlet, 150), (Method::SymplecticEuler, 150), (Method::Dop853, 700)] {
            let (_, bytes) = asked("the state of the method", || drop(stepper(method, &system, &state)));
            assert_eq!(bytes, 2 * 40 + 3 * particle, "{method:?}");
        }
    }
}
