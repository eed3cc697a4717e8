//! Backward Euler with the nonlinear equations solved to convergence.
//!
//! `M (v' − v)/dt = f_el(x') + f_d(x', v') + g` with `x' = x + δx`, `v' = δx/dt`, by Newton's method in δx.

use super::implicit::ImplicitOptions;
use super::linear_backward_euler::advance;
use super::newton::{Newton, NewtonOptions};
use super::{Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::linear::LinearSolver;
use crate::system::{State, System};

/// Backward Euler, first order, nonlinear.
pub struct BackwardEuler<'s>(Newton<'s>);

impl<'s> BackwardEuler<'s> {
    /// Prepares everything that stays the same from step to step.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions, newton: NewtonOptions) -> Result<Self> {
        Newton::new(system, state, options, newton).map(Self)
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
        let system = self.0.linear.system;
        system.prescribed().displacement(state.time + dt, &state.positions, &mut self.0.displacement);
        self.0.solve(state, dt)?;
        advance(system, state, &self.0.displacement, dt)
    }

    fn statistics(&self) -> &Statistics {
        &self.0.linear.statistics
    }
}
