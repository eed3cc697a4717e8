//! Steps that are tried and, where they are exact enough, accepted.

use super::Rodas4;
use super::brake::braked;
use crate::integrate::{AdaptiveStepper, ErrorEstimate, Statistics, StepFailure};
use crate::system::State;

impl AdaptiveStepper for Rodas4<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        self.base.copy_from(state);
        self.advance(dt)?;
        self.local_error = self.judge(dt);
        let [positions, velocities] = self.embedded();
        Ok(ErrorEstimate { positions, velocities })
    }

    fn accept(&mut self, state: &mut State) {
        self.next.prescribe(self.linear.system);
        state.copy_from(&self.next);
    }

    fn reject(&mut self) {}

    fn order(&self) -> u32 {
        4
    }

    fn estimate_order(&self) -> u32 {
        3
    }

    fn rotational_damping(&self) -> f64 {
        braked(self.linear.system, &self.linear.extensions, &self.base.velocities, self.next.time - self.base.time)
    }

    /// Measured on stiff rods, which end with up to thirty times the error at the coarsest tolerances without it.
    fn safety_factor(&self) -> f64 {
        5.0
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.linear.statistics
    }
}
