//! The two explicit Euler methods, for comparison: no matrix, and a step bounded by the stiffest spring.

use super::{Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{Extensions, add_damping_force, add_elastic_force, add_external_forces, add_weight};
use crate::system::{State, System};
use nalgebra::Vector3;

/// Forces at a state, and the state that a step leads to.
struct Explicit<'s> {
    system: &'s System,
    extensions: Extensions,
    force: Vec<Vector3<f64>>,
    next: State,
    statistics: Statistics,
}

impl<'s> Explicit<'s> {
    fn new(system: &'s System, state: &State) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let force = vec![Vector3::zeros(); system.particles()];
        Ok(Self { system, extensions, force, next: state.clone(), statistics: Statistics::default() })
    }

    /// `f_el + f_d + g` at a state.
    fn set_force(&mut self, state: &State) -> Result<(), StepFailure> {
        let Self { system, extensions, force, .. } = self;
        self.statistics.work.force_evaluations += 1;
        extensions.update(system, &state.positions)?;
        force.fill(Vector3::zeros());
        add_elastic_force(system, extensions, force);
        add_damping_force(system, extensions, &state.velocities, force);
        add_weight(system, force);
        add_external_forces(system, &state.moment(), force);
        Ok(())
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
        self.0.set_force(state)?;
        let Explicit { system, force, next, .. } = &mut self.0;
        for (p, mass) in system.masses().iter().enumerate() {
            next.positions[p] = state.positions[p] + state.velocities[p] * dt;
            next.velocities[p] = state.velocities[p] + force[p] * (dt / mass);
        }
        self.0.accept(state, dt)
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
        self.0.set_force(state)?;
        let Explicit { system, force, next, .. } = &mut self.0;
        for (p, mass) in system.masses().iter().enumerate() {
            next.velocities[p] = state.velocities[p] + force[p] * (dt / mass);
            next.positions[p] = state.positions[p] + next.velocities[p] * dt;
        }
        self.0.accept(state, dt)
    }

    fn statistics(&self) -> &Statistics {
        &self.0.statistics
    }
}
