//! The quasi-Newton iteration of a step: from a prediction, with the exact residual.

use crate::error::Result;
use crate::integrate::implicit::ImplicitOptions;
use crate::integrate::newton::{Newton, NewtonOptions};
use crate::integrate::{Statistics, StepFailure, StiffnessPolicy};
use crate::linear::LinearSolver;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{State, System};

/// The equations of a step and what solves them.
pub(super) struct Iteration<'s> {
    newton: Newton<'s>,
}

impl<'s> Iteration<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        let newton = Newton::new(system, state, options, NewtonOptions { tolerance: 1e-8, ..Default::default() })?;
        Ok(Self { newton })
    }

    pub fn system(&self) -> &'s System {
        self.newton.linear.system
    }

    pub fn solver(&self) -> &dyn LinearSolver {
        self.newton.linear.solver()
    }

    pub fn statistics(&self) -> &Statistics {
        &self.newton.linear.statistics
    }

    /// Solves for `next`, which is the prediction on entry, by a backward Euler step over τ seconds from `base`.
    pub fn solve(&mut self, base: &State, next: &mut State, tau: f64) -> Result<(), StepFailure> {
        let system = self.system();
        for (p, d) in self.newton.displacement.iter_mut().enumerate() {
            *d = next.positions[p] - base.positions[p];
        }
        self.correct(base, tau)?;
        for (p, d) in self.newton.displacement.iter().enumerate() {
            next.positions[p] = base.positions[p] + d;
            next.velocities[p] = d / tau;
        }
        system.prescribed().set_positions(next.time, &mut next.positions);
        Ok(())
    }

    /// Corrects the displacement once.
    fn correct(&mut self, base: &State, tau: f64) -> Result<(), StepFailure> {
        let Self { newton } = self;
        let step = Combination::step(tau);
        newton.here(base, tau)?;
        match newton.linear.policy {
            StiffnessPolicy::OnDemand => newton.linear.prepare(Stiffness::Axial.into(), step)?,
            policy => newton.linear.prepare(policy, step)?,
        }
        newton.correct()?;
        Ok(())
    }
}
