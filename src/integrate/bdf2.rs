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
//!
//! **Error estimate** ([`ErrorEstimate`](super::ErrorEstimate)), of differences of velocities alone, see [`estimate`]. No step takes
//! over the matrix of the last one: its directions are stale, and what an error along a stiff spring puts across it then is many times the
//! step's own error, however well the iteration contracts. (A stiff rod that swings down with a tolerance of 1e-2 ended 57 % off.)

mod estimate;
mod history;
mod iteration;
mod tension;

use self::estimate::Estimate;
use self::history::History;
use self::iteration::Iteration;
use super::implicit::{ImplicitOptions, LinearSystem};
use super::propagated_error::LeadingTerm;
use super::{AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::linear::LinearSolver;
use crate::system::{State, System};

/// The second-order backward differentiation formula with variable steps, linearised where the step ends.
///
/// # Examples
/// ```
/// use sprung::integrate::{Bdf2, ImplicitOptions, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Bdf2::new(&system, &state, &ImplicitOptions::default())?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(alias = "BDF2")]
pub struct Bdf2<'s> {
    iteration: Iteration<'s>,
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
    /// Prepares everything that stays the same from step to step: pattern, slot map, ordering, symbolic analysis.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        Ok(Self::of(system, state, LinearSystem::new(system, state, options)?))
    }

    /// As [`new`](Self::new), with a linear solver of your own, which need not be one of this crate's; `options.linear` then only
    /// says how exactly it is to solve, and what interrupts.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a system too large for the memory.
    pub fn with_solver(
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
        solver: Box<dyn LinearSolver + 's>,
    ) -> Result<Self> {
        Ok(Self::of(system, state, LinearSystem::with_solver(system, state, options, solver)?))
    }

    fn of(system: &'s System, state: &State, linear: LinearSystem<'s>) -> Self {
        Self {
            iteration: Iteration::new(linear, state),
            history: History::new(system, state),
            estimate: Estimate::new(system),
            base: state.clone(),
            next: state.clone(),
            step: 0.0,
            ratio: 1.0,
        }
    }

    /// Computes `next`, h seconds after a state, with the given ratio to the last step.
    fn advance(&mut self, state: &State, h: f64, ratio: f64) -> Result<(), StepFailure> {
        let Self { iteration, history, base, next, .. } = self;
        let system = iteration.system();
        let tau = duration(h, ratio);
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
            next.velocities[p] = v + dv * ratio;
        }
        next.time = state.time + h;
        base.time = next.time - tau;
        system.prescribed().set_positions(next.time, &mut next.positions);
        if ratio == 0.0 {
            iteration.forget(state);
        }
        iteration.solve(state, base, next, tau)?;
        next.prescribe(system);
        (self.step, self.ratio) = (h, ratio);
        StepFailure::of_any(system, if next.is_finite() { Ok(()) } else { Err(StepFailure::NonFinite) })
    }

    /// Makes the computed state the current one.
    fn commit(&mut self, state: &mut State) {
        self.estimate.record(&self.history, state, self.ratio);
        self.history.record(state, &self.next, self.step);
        state.copy_from(&self.next);
    }
}

/// How much longer a step with error control may be than the last: safely below 1 + √2.
const GROWTH: f64 = 2.0;

/// Errors of the formula all have one sign as motions swing, and add up where those of other methods cancel; what it damps, estimates do
/// not see. Measured on random scenes that magnify errors up to a hundredfold, of which none may end twenty tolerances off.
const SAFETY_FACTOR: f64 = 36.0;

/// τ of a step of h seconds.
fn duration(h: f64, ratio: f64) -> f64 {
    h * (1.0 + ratio) / (1.0 + 2.0 * ratio)
}

impl TimeStepper for Bdf2<'_> {
    fn name(&self) -> &'static str {
        "bdf2"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.iteration.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.iteration.system(), state, dt)?;
        let ratio = self.history.ratio(self.iteration.system(), state, dt);
        self.estimate.forget();
        self.advance(state, dt, ratio)?;
        self.commit(state);
        Ok(())
    }

    fn restart(&mut self) {
        self.history.forget();
        self.estimate.forget();
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        // e' = w (e + β (e − e₋) + δ), as the formula itself.
        let (ratio, system) = (self.ratio, self.iteration.system());
        let term = if ratio > 0.0 {
            LeadingTerm::second_order((1.0 + ratio) / (1.0 + 2.0 * ratio) * (1.0 + 1.0 / ratio) / 6.0)
        } else {
            LeadingTerm::BACKWARD_EULER
        };
        error.set_local(system, step, term);
        error.extrapolate(ratio * ratio / (1.0 + 2.0 * ratio));
        error.add_local();
        self.iteration.resolve(duration(step.length, ratio), error);
        true
    }

    fn statistics(&self) -> &Statistics {
        self.iteration.statistics()
    }
}

impl AdaptiveStepper for Bdf2<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        StepFailure::of_arguments(self.iteration.system(), state, dt)?;
        let mut ratio = self.history.ratio(self.iteration.system(), state, dt);
        // Without an estimate before it the past says nothing about errors: the step starts anew.
        if ratio == 0.0 || !self.estimate.is_known() {
            ratio = 0.0;
            self.iteration.accelerations(state, self.estimate.begin())?;
        } else {
            self.estimate.go_on();
        }
        self.advance(state, dt, ratio)?;
        Ok(self.estimate.of_step(&self.history, state, &self.next, dt, ratio))
    }

    fn accept(&mut self, state: &mut State) {
        self.commit(state);
    }

    fn reject(&mut self) {}

    fn order(&self) -> u32 {
        2
    }

    fn estimate_order(&self) -> u32 {
        if self.ratio > 0.0 { 2 } else { 1 }
    }

    fn safety_factor(&self) -> f64 {
        SAFETY_FACTOR
    }

    fn largest_growth(&self) -> f64 {
        GROWTH
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        self.iteration.statistics_mut()
    }
}
