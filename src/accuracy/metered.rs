//! Runs that end when they have cost enough, or somebody asks them to.

use crate::error::Result;
use crate::integrate::{AdaptiveStepper, ErrorEstimate, Statistics, StepFailure, TimeStepper, Watch, hermite};
use crate::linear::{CostModel, LinearSolver};
use crate::system::State;
use std::cell::Cell;

/// What a run has spent, and whether it may go on.
pub(super) struct Meter<'a> {
    costs: CostModel,
    limit: f64,
    spent: Cell<f64>,
    /// The errors that steps have estimated of themselves, added up, in m.
    local_errors: Cell<f64>,
    refused: Cell<bool>,
    go_on: &'a dyn Fn() -> bool,
}

impl<'a> Meter<'a> {
    /// For a run that may cost `limit`.
    pub fn new(costs: CostModel, limit: f64, go_on: &'a dyn Fn() -> bool) -> Self {
        Self { costs, limit, spent: Cell::new(0.0), local_errors: Cell::new(0.0), refused: Cell::new(false), go_on }
    }

    /// What the run has cost so far.
    pub fn spent(&self) -> f64 {
        self.spent.get()
    }

    /// What steps have estimated of their errors, added up, in m.
    pub fn local_errors(&self) -> f64 {
        self.local_errors.get()
    }

    /// Whether the limit has been reached.
    pub fn has_refused(&self) -> bool {
        self.refused.get()
    }

    /// Whether the run is to end here.
    pub fn is_over(&self) -> bool {
        if self.spent.get() > self.limit {
            self.refused.set(true);
        }
        self.refused.get() || !(self.go_on)()
    }
}

/// A stepper that refuses steps when it has cost too much, or is asked to stop: no step, however often cut, gets in the way of
/// that.
pub(super) struct Metered<'a, S: ?Sized> {
    pub stepper: &'a mut S,
    pub meter: &'a Meter<'a>,
    /// From this time on, in s, states between steps are as exact as the method tells them. Before, they are cubic polynomials, which cost nothing.
    pub exact_from: f64,
}

impl<'a, S: ?Sized> Metered<'a, S> {
    /// All of whose states are as exact as the method tells them.
    pub fn exact(stepper: &'a mut S, meter: &'a Meter<'a>) -> Self {
        Self { stepper, meter, exact_from: f64::NEG_INFINITY }
    }
}

impl<S: TimeStepper + ?Sized> Metered<'_, S> {
    fn meter(&self) -> Result<(), StepFailure> {
        let factor = self.stepper.linear_solver().and_then(LinearSolver::factor).map(|factor| factor.size);
        self.meter.spent.set(self.meter.costs.cost(&self.stepper.statistics().work, factor));
        if self.meter.is_over() { Err(StepFailure::Tolerance) } else { Ok(()) }
    }
}

impl<S: TimeStepper + ?Sized> TimeStepper for Metered<'_, S> {
    fn name(&self) -> &'static str {
        self.stepper.name()
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        self.stepper.linear_solver()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        self.meter()?;
        self.stepper.step(state, dt)
    }

    fn step_seen(&mut self, state: &mut State, dt: f64, watch: &mut dyn Watch) -> Result<(), StepFailure> {
        self.meter()?;
        self.stepper.step_seen(state, dt, watch)
    }

    fn restart(&mut self) {
        self.stepper.restart();
    }

    fn statistics(&self) -> &Statistics {
        self.stepper.statistics()
    }
}

impl<S: AdaptiveStepper + ?Sized> AdaptiveStepper for Metered<'_, S> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        self.meter()?;
        self.stepper.try_step(state, dt)
    }

    fn coarser_estimate(&self) -> Option<ErrorEstimate<'_>> {
        self.stepper.coarser_estimate()
    }

    fn accept(&mut self, state: &mut State) {
        self.stepper.accept(state);
        let error = self.stepper.local_error().unwrap_or(0.0);
        self.meter.local_errors.set(self.meter.local_errors.get() + error);
    }

    fn braked(&self) -> f64 {
        self.stepper.braked()
    }

    fn reject(&mut self) {
        self.stepper.reject();
    }

    fn order(&self) -> u32 {
        self.stepper.order()
    }

    fn estimate_order(&self) -> u32 {
        self.stepper.estimate_order()
    }

    fn caution(&self) -> f64 {
        self.stepper.caution()
    }

    fn gains_by_equal_steps(&self) -> bool {
        self.stepper.gains_by_equal_steps()
    }

    fn is_bounded_by_stability(&self) -> bool {
        self.stepper.is_bounded_by_stability()
    }

    fn largest_growth(&self) -> f64 {
        self.stepper.largest_growth()
    }

    fn interpolate(&mut self, before: &State, after: &State, time: f64, sample: &mut State) {
        if time >= self.exact_from {
            self.stepper.interpolate(before, after, time, sample);
        } else {
            hermite(before, after, time, sample);
        }
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        self.stepper.statistics_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{ImplicitOptions, Method};
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// With a meter that never refuses every method is itself: what it is asked for and told goes through to the last bit.
    #[test]
    fn what_is_metered_stays_what_it_is() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        let _ = [[0.0, 0.0], [1.2, 0.0], [2.0, 0.6]].map(|[x, y]| builder.particle([x, y, 0.0], 1.0));
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 1.0, damping: 0.3 });
        builder.spring(1, 2, Spring { stiffness: 30.0, rest_length: 1.1, damping: 0.0 });
        builder.hold(0);
        let (system, start) = builder.build().unwrap();
        let go_on = || true;
        let meter = Meter::new(CostModel::of(&system), f64::INFINITY, &go_on);
        for method in Method::ALL {
            let stepper = || method.stepper(&system, &start, &ImplicitOptions::default()).unwrap();
            let walk = |stepper: &mut dyn TimeStepper| {
                let mut state = start.clone();
                for (step, dt) in [0.02, 0.02, 0.03, 0.01].into_iter().enumerate() {
                    stepper.step(&mut state, dt).unwrap();
                    if step == 1 {
                        stepper.restart();
                    }
                }
                let solver = stepper.linear_solver().map(LinearSolver::name);
                (state, stepper.name(), solver, stepper.statistics().work)
            };
            let (mut plain, mut metered) = (stepper(), stepper());
            let seen = walk(&mut Metered::exact(&mut *metered, &meter));
            assert_eq!(seen, walk(&mut *plain));
            assert_eq!(seen.2.is_some(), method.is_implicit(), "{}", seen.1);
            let adaptive = || method.adaptive_stepper(&system, &start, &ImplicitOptions::default()).unwrap();
            let (Some(mut plain), Some(mut metered)) = (adaptive(), adaptive()) else { continue };
            let walk = |stepper: &mut dyn AdaptiveStepper| {
                let mut state = start.clone();
                // A step that was rejected is tried again with another matrix, even where its length stays.
                for (step, dt) in [0.02, 0.04, 0.04, 0.02, 0.03, 0.01].into_iter().enumerate() {
                    let _ = stepper.try_step(&state, dt).map(drop);
                    if step == 1 { stepper.reject() } else { stepper.accept(&mut state) }
                }
                let orders = (stepper.order(), stepper.estimate_order(), stepper.caution());
                (state, orders, stepper.statistics().work)
            };
            let seen = walk(&mut Metered::exact(&mut *metered, &meter));
            assert_eq!(seen, walk(&mut *plain));
            assert_eq!(seen.1.0, method.order());
        }
    }

    /// A run may cost just as much as its limit, and remembers that it was more.
    #[test]
    fn a_limit_may_be_reached() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, _) = builder.build().unwrap();
        let go_on = || true;
        let meter = Meter::new(CostModel::of(&system), 5.0, &go_on);
        meter.spent.set(5.0);
        assert!(!meter.is_over() && !meter.has_refused());
        meter.spent.set(5.1);
        assert!(meter.is_over() && meter.has_refused());
        meter.spent.set(0.0);
        assert!(meter.is_over());
        let stopped = || false;
        let meter = Meter::new(CostModel::of(&system), 5.0, &stopped);
        assert!(meter.is_over() && !meter.has_refused());
    }
}
