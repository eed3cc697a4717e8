//! The second-order backward differentiation formula, linearised where the step ends: one factorization and one solve a step
//! in the ordinary case.
//!
//! **The formula.** With `ω = h/h₋`, the ratio of this step to the last one, and `β = ω²/(1 + 2ω)`,
//!
//! ```text
//! x̃ = x + β (x − x₋),   ṽ = v + β (v − v₋),   τ = h (1 + ω)/(1 + 2ω),
//! x' = x̃ + τ v',        M (v' − ṽ)/τ = f_el(x') + f_d(x', v') + g:
//! ```
//!
//! a backward Euler step over τ from the point (x̃, ṽ). Equal steps have β = 1/3 and τ = 2h/3. Second order, L-stable with equal steps,
//! and stable for any sequence of steps with ratios below 1 + √2. Where there is no past, ω = 0 makes it the backward Euler step over
//! h: the first step is one, and so is every step whose past says nothing about its future, see [`History`]. An error of second
//! order made once costs no order. (Choi and Ko, 2002, use the formula for cloth.)
//!
//! **One iteration.** The equations are solved by a quasi-Newton iteration that starts not at x but at the predicted state
//!
//! ```text
//! y = x + h v + ½ h ω (v − v₋),      w = (y − x̃)/τ
//! ```
//!
//! (prescribed particles where they will be), with the exact residual there:
//!
//! ```text
//! A(τ; y) d = −[M (w − ṽ)/τ − f_el(y) − f_d(y, w) − g],     x' = y + d,     v' = (x' − x̃)/τ.
//! ```
//!
//! As y is off by O(h³) only, one iteration with any matrix that contracts is the formula up to O(h⁴) or better: the matrix decides
//! how fast the iteration converges and not where to, so every stiffness option keeps the order. The on-demand policy takes the one
//! of [`tension`]. A spring that turns is not
//! braked by the stretch that its turning by v h would bring, as it is when forces are linearised at x.
//!
//! **When one iteration is not enough** is seen by the residual at x', see [`iteration`].

mod history;
mod iteration;
mod tension;

use self::history::History;
use self::iteration::Iteration;
use super::implicit::ImplicitOptions;
use super::{Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::linear::LinearSolver;
use crate::system::{State, System};

/// The second-order backward differentiation formula with variable steps, linearised where the step ends.
#[doc(alias = "BDF2")]
pub struct Bdf2<'s> {
    iteration: Iteration<'s>,
    history: History,
    /// (x̃, ṽ) at the time of the step's start.
    base: State,
    next: State,
}

impl<'s> Bdf2<'s> {
    /// Prepares everything that stays the same from step to step: pattern, slot map, ordering, symbolic analysis.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        Ok(Self {
            iteration: Iteration::new(system, state, options)?,
            history: History::new(system, state),
            base: state.clone(),
            next: state.clone(),
        })
    }

    /// Computes `next`, h seconds after a state.
    fn advance(&mut self, state: &State, h: f64) -> Result<(), StepFailure> {
        let Self { iteration, history, base, next } = self;
        let system = iteration.system();
        let ratio = history.ratio(system, state, h);
        let tau = h * (1.0 + ratio) / (1.0 + 2.0 * ratio);
        let beta = ratio * ratio / (1.0 + 2.0 * ratio);
        let before = history.before();
        for p in 0..system.particles() {
            let (x, v) = (state.positions[p], state.velocities[p]);
            // Without a past there may be none to multiply with zero.
            let (dx, dv) =
                if ratio > 0.0 { (x - before.positions[p], v - before.velocities[p]) } else { Default::default() };
            base.positions[p] = x + dx * beta;
            base.velocities[p] = v + dv * beta;
            next.positions[p] = x + (v + dv * (0.5 * ratio)) * h;
        }
        next.time = state.time + h;
        system.prescribed().set_positions(next.time, &mut next.positions);
        if ratio == 0.0 {
            iteration.forget(state);
        }
        iteration.solve(state, base, next, tau)?;
        next.prescribe(system);
        if next.is_finite() { Ok(()) } else { Err(StepFailure::NonFinite) }
    }
}

impl TimeStepper for Bdf2<'_> {
    fn name(&self) -> &'static str {
        "bdf2"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.iteration.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        self.advance(state, dt)?;
        self.history.record(state, &self.next, dt);
        state.copy_from(&self.next);
        Ok(())
    }

    fn statistics(&self) -> &Statistics {
        self.iteration.statistics()
    }
}
