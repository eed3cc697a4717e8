//! Backward Euler with the nonlinear equations solved to convergence.
//!
//! `M (v' − v)/dt = f_el(x') + f_d(x', v') + g` with `x' = x + δx`, `v' = δx/dt`, by Newton's method in δx.

use super::implicit::{ImplicitOptions, LinearSystem};
use super::linear_backward_euler::advance;
use super::newton::{Newton, NewtonOptions};
use super::propagated_error::LeadingTerm;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::linear::LinearSolver;
use crate::system::{State, System};

/// Backward Euler, first order, nonlinear.
///
/// # Examples
/// ```
/// use sprung::integrate::{BackwardEuler, ImplicitOptions, NewtonOptions, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = BackwardEuler::new(&system, &state, &ImplicitOptions::default(), NewtonOptions::default())?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct BackwardEuler<'s>(Newton<'s>);

impl<'s> BackwardEuler<'s> {
    /// Prepares everything that stays the same from step to step.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; options that make no sense.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions, newton: NewtonOptions) -> Result<Self> {
        newton.check()?;
        Newton::new(system, state, options, newton).map(Self)
    }

    /// As [`new`](Self::new), with a linear solver of your own, which need not be one of this crate's; `options.linear` then only
    /// says how exactly it is to solve, and what interrupts.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a system too large for the memory.
    pub fn with_solver(
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
        newton: NewtonOptions,
        solver: Box<dyn LinearSolver + 's>,
    ) -> Result<Self> {
        newton.check()?;
        let linear = LinearSystem::with_solver(system, state, options, solver)?;
        Ok(Self(Newton::of(linear, state, newton)))
    }
}

impl TimeStepper for BackwardEuler<'_> {
    fn name(&self) -> &'static str {
        "backward-euler"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.0.linear.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.0.linear.system, state, dt)?;
        let system = self.0.linear.system;
        system.prescribed().displacement(state.time + dt, &state.positions, &mut self.0.displacement);
        self.0.solve(state, dt)?;
        advance(system, state, &self.0.displacement, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        error.set_local(self.0.linear.system, step, LeadingTerm::BACKWARD_EULER);
        self.0.resolve(step.length, error);
        error.add_local();
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.0.linear.statistics
    }
}
