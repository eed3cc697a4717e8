//! The second-order backward differentiation formula, linearised where the step ends: one factorization and one solve a step in the ordinary case.
//!
//! **The formula.** With `ω = h/h₋`, the ratio of this step to the last one, and `β = ω²/(1 + 2ω)`,
//!
//! ```text
//! x̃ = x + β (x − x₋),   ṽ = v + β (v − v₋),   τ = h (1 + ω)/(1 + 2ω),
//! x' = x̃ + τ v',        M (v' − ṽ)/τ = f_el(x') + f_d(x', v') + g:
//! ```
//!
//! a backward Euler step over τ from the point (x̃, ṽ). L-stable with equal steps, and stable for ratios below 1 + √2. Where there is no past, see
//! [`history`], ω = 0 makes it the backward Euler step over h; one error of second order costs no order. (Choi and Ko, 2002, use the formula for
//! cloth.)
//!
//! **One iteration.** The equations are solved by a quasi-Newton iteration from the predicted state
//!
//! ```text
//! y = x + h v + ½ h ω (v − v₋),      w = (y − x̃)/τ
//! ```
//!
//! (prescribed particles at their new place), with the exact residual there:
//!
//! ```text
//! A(τ; y) d = −[M (w − ṽ)/τ − f_el(y) − f_d(y, w) − g],     x' = y + d,     v' = (x' − x̃)/τ.
//! ```
//!
//! As y is off by O(h³) only, one iteration with any matrix that contracts is the formula up to O(h⁴) or better. The on-demand policy takes the
//! matrix of [`iteration`], where the residual at x' decides whether one iteration is enough. No step reuses the matrix of the last one: its
//! directions are outdated, and an error along a stiff spring then has a part across it of many times the step's own error.

mod history;
mod iteration;

use super::implicit::{ImplicitOptions, LinearSystem, constructors, of_linear_system};
use super::newton::{Newton, NewtonOptions};
use super::propagated_error::LeadingTerm;
use super::{
    AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, TimeStepper, fits,
};
use crate::error::Result;
use crate::force::set_accelerations;
use crate::linear::LinearSolver;
use crate::system::{State, System};
use history::{Estimate, History, MOST_GROWTH};
use iteration::Tensions;

/// The second-order backward differentiation formula with variable steps, linearised where the step ends.
#[doc(alias = "BDF2")]
pub struct Bdf2<'s> {
    newton: Newton<'s>,
    tensions: Tensions,
    history: History,
    estimate: Estimate,
    /// (x̃, ṽ) at the time of the step's start.
    base: State,
    next: State,
    /// Length of the step to `next`, in s, and its ratio to the one before.
    step: f64,
    ratio: f64,
}

impl<'s> Bdf2<'s> {
    constructors!();

    fn of(mut linear: LinearSystem<'s>, state: &State) -> Result<Self> {
        let system = linear.system;
        // A correction is of the size of a step's error; without a preconditioner errors may be a hundred times the residuals.
        let strictest = &mut linear.adaptive_tolerance.strictest;
        *strictest = strictest.max(1e-7);
        Ok(Self {
            newton: Newton::new(linear, state, NewtonOptions::default())?,
            tensions: Tensions::new(system),
            history: History::new(system, state),
            estimate: Estimate::new(system),
            base: state.clone(),
            next: state.clone(),
            step: 0.0,
            ratio: 1.0,
        })
    }

    /// Computes `next`, h seconds after a state, with the given ratio to the last step.
    fn advance(&mut self, state: &State, h: f64, ratio: f64) -> Result<(), StepFailure> {
        let Self { newton, tensions, history, base, next, .. } = self;
        let system = newton.linear.system;
        let tau = duration(h, ratio);
        let beta = ratio * ratio / (1.0 + 2.0 * ratio);
        let before = &history.before;
        for p in 0..system.particles() {
            let (x, v) = (state.positions[p], state.velocities[p]);
            // Without a past there may be no finite number to multiply with zero.
            let (dx, dv) =
                if ratio > 0.0 { (x - before.positions[p], v - before.velocities[p]) } else { Default::default() };
            base.positions[p] = x + dx * beta;
            base.velocities[p] = v + dv * beta;
            next.positions[p] = x + (v + dv * (0.5 * ratio)) * h;
            next.velocities[p] = v + dv * ratio;
        }
        next.time = state.time + h;
        base.time = next.time - tau;
        system.prescribed().set_positions(next.time, &mut next.positions);
        if ratio == 0.0 {
            tensions.set(system, state);
        }
        iteration::solve(newton, tensions, state, base, next, tau)?;
        next.prescribe(system);
        (self.step, self.ratio) = (h, ratio);
        StepFailure::unless_finite(system, next.is_finite())
    }
    fn commit(&mut self, state: &mut State) {
        self.estimate.record(&self.history, state, self.ratio);
        self.history.record(state, &self.next, self.step);
        state.copy_from(&self.next);
    }
}

/// τ of a step of h seconds.
fn duration(h: f64, ratio: f64) -> f64 {
    h * (1.0 + ratio) / (1.0 + 2.0 * ratio)
}

impl TimeStepper for Bdf2<'_> {
    of_linear_system!("bdf2", newton.linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        let system = self.newton.linear.system;
        StepFailure::of_arguments(system, state, dt)?;
        let ratio = self.history.ratio(system, state, dt);
        self.estimate.clear();
        self.advance(state, dt, ratio)?;
        self.commit(state);
        Ok(())
    }

    fn restart(&mut self) {
        self.history.clear();
        self.estimate.clear();
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let (ratio, system) = (self.ratio, self.newton.linear.system);
        if !fits(system, error, step) {
            return false;
        }
        // e' = w (e + β (e − e₋) + δ), as the formula itself.
        let term = if ratio > 0.0 {
            LeadingTerm::second_order((1.0 + ratio) / (1.0 + 2.0 * ratio) * (1.0 + 1.0 / ratio) / 6.0)
        } else {
            LeadingTerm::BACKWARD_EULER
        };
        error.set_local(system, step, term);
        let beta = ratio * ratio / (1.0 + 2.0 * ratio);
        error.change(|e, before, local| (*before, *e) = (*e, *e + (*e - *before) * beta + local));
        self.newton.resolve(duration(step.length, ratio), error);
        true
    }
}

impl AdaptiveStepper for Bdf2<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        let linear = &mut self.newton.linear;
        let system = linear.system;
        StepFailure::of_arguments(system, state, dt)?;
        // Without an estimate of the last step the past says nothing about errors: the step starts anew.
        let ratio = if self.estimate.is_known() { self.history.ratio(system, state, dt) } else { 0.0 };
        self.estimate.is_first = ratio == 0.0;
        if self.estimate.is_first {
            linear.statistics.work.force_evaluations += 1;
            linear.set_extensions(state)?;
            set_accelerations(system, &linear.extensions, &state.moment(), &mut self.estimate.accelerations);
        }
        self.advance(state, dt, ratio)?;
        Ok(self.estimate.of_step(system, &self.history, [state, &self.next], dt, ratio))
    }

    fn accept(&mut self, state: &mut State) {
        if state.check(self.newton.linear.system).is_ok() {
            self.commit(state);
        }
    }

    fn order(&self) -> u32 {
        2
    }

    fn estimate_order(&self) -> u32 {
        if self.ratio > 0.0 { 2 } else { 1 }
    }

    /// Errors of the formula have the same sign throughout a vibration, and estimates do not see what it damps. Fitted to random scenes that magnify
    /// errors up to a hundredfold, so that none ends twenty tolerances off.
    fn safety_factor(&self) -> f64 {
        36.0
    }

    fn largest_growth(&self) -> f64 {
        MOST_GROWTH
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.newton.linear.statistics
    }
}
