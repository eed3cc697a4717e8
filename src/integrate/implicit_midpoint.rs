//! The implicit midpoint rule, with the nonlinear equations solved to convergence.
//!
//! `x' = x + h v_mid`, `M (v' − v)/h = f_el(x_mid) + f_d(x_mid, v_mid) + g` at the means `x_mid = (x + x')/2`, `v_mid = (v + v')/2`. Since
//! `x_mid = x + (h/2) v_mid` and `M (v_mid − v)/(h/2) = f(x_mid, v_mid)`, the midpoint is a backward Euler step of length h/2, solved by Newton's
//! method; then `x' = 2x_mid − x`, `v' = 2v_mid − v`.
//!
//! Second order, symmetric and symplectic; conserves linear and angular momentum exactly. A-stable without numerical damping: with steps that do not
//! resolve the fastest vibration the nonlinearity of undamped springs pumps energy into vibrations, and the run may end `not-converged`. Prescribed
//! coordinates follow the chord of their motion over the step, which keeps the order at kinks.

use super::implicit::{ImplicitOptions, LinearSystem, constructors, of_linear_system};
use super::newton::{Newton, NewtonOptions};
use super::propagated_error::LeadingTerm;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper, fits};
use crate::error::Result;
use crate::linear::LinearSolver;
use crate::system::{State, System};

/// The implicit midpoint rule, second order, nonlinear.
pub struct ImplicitMidpoint<'s> {
    newton: Newton<'s>,
    next: State,
}

impl<'s> ImplicitMidpoint<'s> {
    constructors!(newton: NewtonOptions);

    fn of(linear: LinearSystem<'s>, state: &State, newton: NewtonOptions) -> Result<Self> {
        Ok(Self { newton: Newton::new(linear, state, newton)?, next: state.clone() })
    }
}

impl TimeStepper for ImplicitMidpoint<'_> {
    of_linear_system!("implicit-midpoint", newton.linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.newton.linear.system, state, dt)?;
        let Self { newton, next } = self;
        let system = newton.linear.system;
        system.prescribed().displacement(state.time + dt, &state.positions, &mut newton.displacement);
        for d in &mut newton.displacement {
            *d *= 0.5;
        }
        newton.solve(state, 0.5 * dt)?;
        for (p, d) in newton.displacement.iter().enumerate() {
            next.positions[p] = state.positions[p] + d * 2.0;
            next.velocities[p] = d * (4.0 / dt) - state.velocities[p];
        }
        next.time = state.time + dt;
        next.prescribe(system);
        StepFailure::unless_finite(system, next.is_finite())?;
        state.copy_from(next);
        Ok(())
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let system = self.newton.linear.system;
        if !fits(system, error, step) {
            return false;
        }
        // (1 + z/2)/(1 − z/2) = 2w − 1, and δ stands in the implicit equations: e' = w (2e + δ) − e.
        error.set_local(system, step, LeadingTerm::IMPLICIT_MIDPOINT);
        error.change(|e, kept, local| (*kept, *e) = (*e, *e * 2.0 + local));
        self.newton.resolve(0.5 * step.length, error);
        error.change(|e, kept, _| *e -= *kept);
        true
    }
}
