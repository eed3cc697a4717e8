//! What a method must tell so that its steps can follow an error estimate.

use super::hermite::hermite;
use crate::integrate::{Statistics, StepFailure, TimeStepper};
use crate::system::State;
use nalgebra::Vector3;

/// An estimate of the local error of a step, full-length; zero where coordinates are prescribed.
#[derive(Debug, Clone, Copy)]
pub struct ErrorEstimate<'a> {
    /// Of the positions, in m.
    pub positions: &'a [Vector3<f64>],
    /// Of the velocities, in m/s.
    pub velocities: &'a [Vector3<f64>],
}

/// A method that estimates the local error of its steps.
///
/// A step is tried, and then accepted or rejected. [`TimeStepper::restart`] is called where the motion is not smooth; a method
/// with a memory may take its next step by another formula then.
pub trait AdaptiveStepper: TimeStepper {
    /// Computes a step of dt seconds and estimates its error; the state is left as it is.
    ///
    /// # Errors
    /// Why the step could not be done.
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure>;

    /// Another estimate of the error of the step tried last, of lower order and so ordinarily larger. With one the error e of
    /// the first counts as `e²/√(e² + 0.01 ẽ²)`, after Hairer: smaller than either where both fall as their orders say, and of
    /// the order of both together less one.
    fn coarser_estimate(&self) -> Option<ErrorEstimate<'_>> {
        None
    }

    /// Makes the end of the step tried last the current state.
    fn accept(&mut self, state: &mut State);

    /// Forgets the step tried last.
    fn reject(&mut self);

    /// q, the method's order: the power of h with which the error at a fixed time falls.
    fn order(&self) -> u32;

    /// The p for which the estimate of the step tried last falls as h^(p + 1). (A formula that starts a method may be of lower
    /// order.) Before the first step, that of the method.
    fn estimate_order(&self) -> u32 {
        self.order()
    }

    /// What estimates are multiplied by: those of formulas that damp fast vibrations as the method itself does fall short of the
    /// errors in them.
    fn caution(&self) -> f64 {
        1.0
    }

    /// The share of the kinetic energy that linearising took from the motion in the step tried last, where springs turned; not known to the
    /// estimate, which compares formulas that linearise alike.
    fn rotational_damping(&self) -> f64 {
        0.0
    }

    /// Whether a step as long as the last one saves work, as a factorization.
    fn reuses_factorization(&self) -> bool {
        false
    }

    /// Whether stability bounds the steps, as those of explicit methods: errors then grow from step to step as soon as these are a little too long.
    fn is_bounded_by_stability(&self) -> bool {
        false
    }

    /// How much longer a step may at most be than the last one.
    fn largest_growth(&self) -> f64 {
        5.0
    }

    /// Sets `sample` to the motion at a time within the step accepted last, which led from `before` to `after`. Prescribed
    /// coordinates need not be right.
    ///
    /// Here the cubic Hermite polynomial through both ends, right to O(h⁴), and its derivative.
    fn interpolate(&mut self, before: &State, after: &State, time: f64, sample: &mut State) {
        hermite(before, after, time, sample);
    }

    /// To count what belongs to the run.
    fn statistics_mut(&mut self) -> &mut Statistics;
}
