//! A method with its step or tolerance, and what finer steps are expected to cost and to gain.

use crate::accuracy::{Configuration, StepControl};

/// The factor by which the second run's steps are finer, at least: the least for which its difference from the first tells the error of that.
pub const FINER: f64 = 2.0;

/// The tolerance below which the error estimates of steps are rounding, for double precision and methods of order eight.
pub const LEAST_TOLERANCE: f64 = 1e-11;

/// A method with its step or tolerance.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    pub configuration: Configuration,
    pub control: StepControl,
}

impl Candidate {
    /// With steps so many times as fine, by the order of the method.
    pub fn finer(self, factor: f64) -> Self {
        let order = self.configuration.method.order() as i32;
        let control = match self.control {
            StepControl::Step(dt) => StepControl::Step(dt / factor),
            StepControl::Adaptive { rtol, first_step } => {
                StepControl::Adaptive { rtol: (rtol / factor.powi(order)).max(LEAST_TOLERANCE), first_step }
            }
        };
        Self { control, ..self }
    }

    /// The factor by which errors with steps so many times as fine are expected to be smaller: half of the digits that the order promises.
    pub fn improvement(&self, factor: f64) -> f64 {
        factor.powf(0.5 * f64::from(self.configuration.method.order()))
    }

    /// True if the error of a candidate of the same method with coarser steps fell to this one as expected.
    pub fn pays(&self, error: f64, before: Option<(Self, f64)>) -> bool {
        before.is_some_and(|(coarse, error_before)| {
            let finer = coarse.cost_ratio(self);
            let is_same = coarse.configuration.method == self.configuration.method;
            is_same && error.is_finite() && error * self.improvement(finer) <= error_before
        })
    }

    pub fn is_at_the_limit(&self) -> bool {
        matches!(self.control, StepControl::Adaptive { rtol, .. } if rtol <= LEAST_TOLERANCE)
    }

    /// The rounding of a run of so many steps, relative to the extent: a unit a step, or that of error estimates where tolerances end.
    pub fn rounding(&self, steps: u64) -> f64 {
        match self.control {
            StepControl::Step(_) => 0.5 * f64::EPSILON * steps as f64,
            StepControl::Adaptive { .. } if self.is_at_the_limit() => LEAST_TOLERANCE,
            StepControl::Adaptive { .. } => 0.0,
        }
    }

    /// The cost of a run of another candidate over that of this one, by their orders; 1 for another kind of steps.
    pub fn cost_ratio(&self, other: &Self) -> f64 {
        match (self.control, other.control) {
            (StepControl::Step(dt), StepControl::Step(finer)) => dt / finer,
            (StepControl::Adaptive { rtol, .. }, StepControl::Adaptive { rtol: finer, .. }) => {
                (rtol / finer).powf(1.0 / f64::from(self.configuration.method.order()))
            }
            _ => 1.0,
        }
    }
}
