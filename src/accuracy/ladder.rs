//! One configuration at shorter and shorter steps, and what its results say about their own error.

use super::{Configuration, Pace, relative_position_error, trial};
use crate::error::Result;
use crate::integrate::Status;
use crate::linear::CostModel;
use crate::system::{State, System};
use nalgebra::Vector3;

/// A motion to be computed.
pub(super) struct Task<'a> {
    pub system: &'a System,
    pub start: &'a State,
    pub duration: f64,
    pub costs: CostModel,
    pub go_on: &'a dyn Fn() -> bool,
}

/// A completed run.
pub(super) struct Rung {
    pub pace: Pace,
    pub positions: Vec<Vector3<f64>>,
    pub cost: f64,
    /// The distance from the rung before; `None` where that failed.
    change: Option<f64>,
}

/// Runs of one configuration, every one with half the step (a quarter of the tolerance) of the one before.
///
/// With an error `e(h) ≈ C hᵖ` the change from 2h to h is `(2ᵖ − 1) e(h)`; the ratio of two changes tells p. A quarter of
/// the tolerance halves the steps of a second-order method, so the same holds there.
pub(super) struct Ladder {
    pub configuration: Configuration,
    pub rungs: Vec<Rung>,
    /// Whether its rungs can still be of use.
    pub open: bool,
    pace: Pace,
    last_cost: f64,
    order: f64,
}

/// The first rung has this many steps, and the first adaptive one this tolerance.
const FIRST_STEPS: f64 = 4.0;
const FIRST_TOLERANCE: f64 = 0.2;

/// A ladder is given up after this many steps.
const MOST_STEPS: f64 = 4e6;

/// The lowest order that counts as convergence.
const LOWEST_ORDER: f64 = 0.5;

impl Ladder {
    pub fn fixed(configuration: Configuration, duration: f64) -> Self {
        Self::new(configuration, Pace::Step(duration / FIRST_STEPS))
    }

    pub fn adaptive(configuration: Configuration, duration: f64) -> Self {
        Self::new(configuration, Pace::Adaptive { rtol: FIRST_TOLERANCE, first_step: duration / 64.0 })
    }

    fn new(configuration: Configuration, pace: Pace) -> Self {
        let order = configuration.method.order().into();
        Self { configuration, rungs: Vec::new(), open: true, pace, last_cost: 0.0, order }
    }

    /// About what the next rung costs; nothing before the first.
    pub fn next_cost(&self) -> f64 {
        2.0 * self.last_cost
    }

    /// Runs at the next pace. Says what it cost, failed or not.
    pub fn climb(&mut self, task: &Task<'_>) -> Result<f64> {
        let (pace, configuration) = (self.pace, &self.configuration);
        let run = trial(task.system, task.start, configuration, pace, task.duration, task.go_on)?;
        let cost = task.costs.cost(&run.statistics.work, run.factor).max(1.0);
        self.pace = match pace {
            Pace::Step(dt) => Pace::Step(0.5 * dt),
            Pace::Adaptive { rtol, first_step } => Pace::Adaptive { rtol: 0.25 * rtol, first_step: 0.5 * first_step },
        };
        let steps = match self.pace {
            Pace::Step(dt) => task.duration / dt,
            Pace::Adaptive { .. } => 2.0 * run.steps as f64,
        };
        let shortest = matches!(self.pace, Pace::Adaptive { rtol, .. } if rtol < 1e-13);
        if steps > MOST_STEPS || shortest || run.status == Status::Interrupted {
            self.open = false;
        }
        if run.status == Status::Completed {
            let positions = run.state.positions;
            let change = self.rungs.last().map(|last| task.distance(&last.positions, &positions));
            self.rungs.push(Rung { pace, positions, cost, change });
            self.last_cost = cost;
        } else {
            // A run that breaks down early says nothing about what a longer one costs.
            self.rungs.clear();
            self.last_cost = self.last_cost.max(0.5 * cost);
        }
        Ok(cost)
    }

    /// The order seen in the last two changes.
    fn observed_order(&self) -> Option<f64> {
        let [.., a, b] = self.rungs.as_slice() else { return None };
        let order = (a.change? / b.change?).log2();
        order.is_finite().then_some(order)
    }

    /// Estimated relative error of the last rung; `None` as long as the rungs do not converge. A change that is small by
    /// chance, as when an error passes through zero, is taken for what the change before makes of it at the method's order.
    pub fn estimate(&self) -> Option<f64> {
        let [.., before, last] = self.rungs.as_slice() else { return None };
        let (before, change) = (before.change?, last.change?);
        if change.max(before) == 0.0 {
            return Some(0.0);
        }
        let order = (before / change).log2().min(self.order);
        let expected = 0.7 * before / self.order.exp2();
        (order > LOWEST_ORDER).then(|| change.max(expected) / (order.exp2() - 1.0))
    }

    /// The limit that the last rungs point to, and an estimate of its relative error.
    pub fn limit(&self) -> Option<(Vec<Vector3<f64>>, f64)> {
        let error = self.estimate()?;
        let [.., coarse, fine] = self.rungs.as_slice() else { return None };
        // Where the observed order is that of the method the leading term of the error is known, and can be taken off.
        let asymptotic = self.observed_order().is_some_and(|order| (order - self.order).abs() < 0.25);
        if !asymptotic {
            return Some((fine.positions.clone(), error));
        }
        let factor = 1.0 / (self.order.exp2() - 1.0);
        let pairs = fine.positions.iter().zip(&coarse.positions);
        Some((pairs.map(|(fine, coarse)| fine + (fine - coarse) * factor).collect(), 0.5 * error))
    }

    /// The least cost at which the error falls below `target`, by the power law through the last rung; errors are measured
    /// against `limit` where there is one.
    pub fn predicted_cost(&self, target: f64) -> Option<f64> {
        let last = self.rungs.last()?;
        Some(last.cost * (self.estimate()? / target).powf(1.0 / self.order))
    }

    /// The longest pace that keeps the error, measured against `limit`, below `target`, with its cost; `None` where no
    /// rung does.
    pub fn longest_pace(&self, task: &Task<'_>, limit: &[Vector3<f64>], target: f64) -> Option<(Pace, f64)> {
        let errors: Vec<f64> = self.rungs.iter().map(|rung| task.distance(&rung.positions, limit)).collect();
        // From the end: the first rung all of whose successors are good enough.
        let good = errors.iter().rev().take_while(|error| **error <= target).count();
        let index = self.rungs.len().checked_sub(good).filter(|_| good > 0)?;
        let rung = self.rungs.get(index)?;
        let error = errors.get(index)?;
        // Between this rung and the failing one before the error follows a power law; to stay off its wiggles the step is
        // lengthened only as far as the order of the method allows.
        let stretch = (target / error.max(1e-300)).powf(1.0 / self.order).clamp(1.0, 1.9);
        let pace = match rung.pace {
            Pace::Step(dt) => Pace::Step(dt * stretch),
            Pace::Adaptive { rtol, first_step } => {
                Pace::Adaptive { rtol: rtol * stretch.powf(self.order), first_step: first_step * stretch }
            }
        };
        Some((pace, rung.cost / stretch))
    }
}

impl Task<'_> {
    /// Relative distance of two configurations at the end.
    pub fn distance(&self, x: &[Vector3<f64>], reference: &[Vector3<f64>]) -> f64 {
        relative_position_error(x, reference, &self.start.positions)
    }
}
