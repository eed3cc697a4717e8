//! The second-order W-method (ROS2-W, the stages of ode23s) on the matrix of linearised backward Euler: one factorization and two solves a step, whatever the stiffness option.
//!
//! **The method.** For `y' = F(y)` and any matrix J in place of `∂F/∂y`, with `W = I − τ J` and `τ = γ h`,
//!
//! ```text
//! W k = F(y),      W w = F(y + ½h k) − k,      y' = y + h (k + w).
//! ```
//!
//! Since `k = F(y) + O(h)`, the second F is taken at the midpoint to O(h²). Since `w = O(h)`, `w = F(y + ½h k) − k + τJ w`
//! gives `k + w = F(midpoint) + O(h²)`: second order for every J, so also with options that drop terms, and with a J of an
//! earlier step. J decides about stability only. With the exact J the method's stability function is
//! `(1 + (1 − 2γ)z + (½ − 2γ + γ²)z²)/(1 − γz)²`, and `γ = 1 − 1/√2` makes its last coefficient vanish: A- and L-stable. (The
//! other root, 1 + 1/√2, does too, with a far larger error.) It is the pair of stages in Shampine and Reichelt's ode23s
//! (1997); methods that keep their order with any J are due to Steihaug and Wolfbrandt (1979).
//!
//! **On positions and velocities.** With `y = (x, v)`, `F = (v, M⁻¹f)` and J from K (under the option) and G, every stage is
//! a system `W (u_x, u_v) = (r, M⁻¹s)`. Its first row says `u_v = (u_x − r)/τ`; put into the second,
//!
//! ```text
//! A (τ u_x) = s + M r/τ − G r,      A = M/τ² − G/τ − K,
//! ```
//!
//! the matrix of linearised backward Euler with dt → τ. Stage one has `r = v`, `s = f(x, v)`: it is a linearised backward Euler step of length τ.
//! Stage two has `r = v_mid − k_x` and `s = f(x_mid, v_mid) − M k_v`.
//!
//! **Kinematic particles** move, for the time of one step, at the constant velocity `v̄_c = (x_c(t+h) − x_c(t))/h`. Then
//! they are part of y with `k_x = v̄_c` and `k_v = w = 0`, and stage one gets `τ v̄_c` as the displacement of prescribed
//! coordinates; in the non-autonomous form of the method that is the time derivative `K_fc v_c` of the
//! force. A motion at piecewise constant velocity is met exactly; where a step passes a kink or a path is smooth, the chord
//! is off by O(h²) and its mean velocity is right, which keeps the order at two.
//!
//! **Error estimate** ([`ErrorEstimate`]). ode23s compares with a third-order formula. Eliminating its third stage leaves
//! one more solve with a second difference on the right,
//!
//! ```text
//! W u = F(y) − 2F(y_mid) + F(y') − (6 + √2)(k + w − F(y_mid)),      error ≈ (h/6) u,
//! ```
//!
//! which is O(h³) for every J, filtered by W⁻¹ where the system is stiff, and asymptotically the true local error where J
//! is exact.

use super::implicit::{ImplicitOptions, LinearSystem};
use super::propagated_error::LeadingTerm;
use super::{AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{SpringGeometry, add_all_forces, add_damping_product};
use crate::linear::LinearSolver;
use crate::linear::SolveFailure;
use crate::operator::Combination;
use crate::system::{State, StateView, System};
use nalgebra::Vector3;
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// Second order with the matrix of linearised backward Euler; A- and L-stable with the full stiffness.
///
/// # Examples
/// ```
/// use sprung::integrate::{ImplicitOptions, TimeStepper, WMethod};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = WMethod::new(&system, &state, &ImplicitOptions::default())?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(alias = "Rosenbrock")]
pub struct WMethod<'s> {
    linear: LinearSystem<'s>,
    held: Option<Held>,
    /// Those at which forces are evaluated; the linear system keeps the matrix's own.
    extensions: SpringGeometry,
    /// v, prescribed components at their mean velocity over the step.
    velocities: Vec<Vector3<f64>>,
    /// τ k_x and then k_x; τ w_x and then w_x; τ u_x and then u_x.
    first: Vec<Vector3<f64>>,
    second: Vec<Vector3<f64>>,
    third: Vec<Vector3<f64>>,
    middle: State,
    next: State,
    /// −r and s of the stage to solve; s becomes the right-hand side.
    minus_r: Vec<Vector3<f64>>,
    s: Vec<Vector3<f64>>,
    /// `f(x, v) + (4 + √2) f(x_mid, v_mid)`, what the error estimate needs of the stages' forces.
    forces: Vec<Vector3<f64>>,
}

/// A spring that turns by θ in a step ends longer by L = l θ²/2. The stages have its direction from the step's start and see of L what their formulas
/// make of it: on a stiff spring every step ends too long by cL, `c = 1 − 1/(4γ)` (the linear part of the extension goes, the method being L-stable, and of
/// L one quarter is met, at the second stage). The tension of that takes `c κ L²` from the motion.
const BRAKING: f64 = 1.0 - 0.25 / WMethod::GAMMA;

/// The matrix at hand: for which steps, and in how many it has been used.
#[derive(Debug, Clone, Copy)]
struct Held {
    h: f64,
    uses: u32,
}

/// How many steps with error control use one matrix. Its age costs no order, but in time damping and stability: directions
/// of springs go stale.
const USES: u32 = 5;

impl WMethod<'_> {
    /// γ = 1 − 1/√2: the matrix of a step of length h is that of backward Euler for γ h.
    pub const GAMMA: f64 = 1.0 - FRAC_1_SQRT_2;
}

impl<'s> WMethod<'s> {
    /// Prepares everything that stays the same from step to step: pattern, slot map, ordering, symbolic analysis.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        Ok(Self::of(state, LinearSystem::new(system, state, options)?))
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
        Ok(Self::of(state, LinearSystem::with_solver(system, state, options, solver)?))
    }

    fn of(state: &State, linear: LinearSystem<'s>) -> Self {
        let zeros = || vec![Vector3::zeros(); linear.system.particles()];
        let extensions = linear.extensions.clone();
        Self {
            held: None,
            extensions,
            velocities: zeros(),
            first: zeros(),
            second: zeros(),
            third: zeros(),
            middle: state.clone(),
            next: state.clone(),
            minus_r: zeros(),
            s: zeros(),
            forces: zeros(),
            linear,
        }
    }

    /// Takes A at the state's positions for steps of length h.
    fn prepare(&mut self, state: &State, h: f64) -> Result<(), StepFailure> {
        self.held = None;
        self.linear.set_extensions(state)?;
        self.linear.prepare(self.linear.policy, Combination::step(Self::GAMMA * h))?;
        self.held = Some(Held { h, uses: 0 });
        Ok(())
    }

    /// Computes `next` from a state with the matrix last prepared, which must be one for the same h.
    fn advance(&mut self, state: &State, h: f64) -> Result<(), StepFailure> {
        let tau = Self::GAMMA * h;
        let system = self.linear.system;
        self.velocities.copy_from_slice(&state.velocities);
        system.prescribed().set_mean_velocities(state.time + h, h, &state.positions, &mut self.velocities);

        self.set_force(Point::Start(state))?;
        self.forces.copy_from_slice(&self.s);
        system.prescribed().displacement(state.time + h, &state.positions, &mut self.first);
        for ((k, minus_r), v) in self.first.iter_mut().zip(&mut self.minus_r).zip(&self.velocities) {
            *k *= Self::GAMMA;
            *minus_r = -v;
        }
        solve_stage(&mut self.linear, tau, &self.minus_r, &mut self.s, &mut self.first)?;

        for (p, &v) in self.velocities.iter().enumerate() {
            let k_x = self.first[p];
            let k_v = (k_x - v) / tau;
            self.middle.positions[p] = state.positions[p] + k_x * (0.5 * h);
            self.middle.velocities[p] = v + k_v * (0.5 * h);
            self.minus_r[p] = k_x - self.middle.velocities[p];
        }
        self.middle.time = state.time + 0.5 * h;
        self.set_force(Point::Middle)?;
        for (p, mass) in system.masses().iter().enumerate() {
            self.forces[p] += self.s[p] * (4.0 + SQRT_2);
            self.s[p] -= (self.first[p] - self.velocities[p]) * (mass / tau);
        }
        self.second.fill(Vector3::zeros());
        solve_stage(&mut self.linear, tau, &self.minus_r, &mut self.s, &mut self.second)?;

        for (p, &v) in self.velocities.iter().enumerate() {
            let (k_x, w_x) = (self.first[p], self.second[p]);
            let k_v = (k_x - v) / tau;
            let w_v = (w_x + self.minus_r[p]) / tau;
            self.next.positions[p] = state.positions[p] + (k_x + w_x) * h;
            self.next.velocities[p] = v + (k_v + w_v) * h;
        }
        self.next.time = state.time + h;
        if self.next.is_finite() { Ok(()) } else { Err(StepFailure::NonFinite) }
    }

    /// Estimates the error of the step just computed, with one more force evaluation and one more solve.
    fn estimate(&mut self, h: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        const E: f64 = 6.0 + SQRT_2;
        let tau = Self::GAMMA * h;
        self.set_force(Point::Next)?;
        for (p, mass) in self.linear.system.masses().iter().enumerate() {
            let (v, v_mid, v_next) = (self.velocities[p], self.middle.velocities[p], self.next.velocities[p]);
            let rate = self.first[p] + self.second[p];
            self.minus_r[p] = (rate - v_mid) * E - (v - v_mid * 2.0 + v_next);
            self.s[p] += self.forces[p] - (v_next - v) * (E * mass / h);
        }
        self.third.fill(Vector3::zeros());
        solve_stage(&mut self.linear, tau, &self.minus_r, &mut self.s, &mut self.third)?;
        for (u, minus_r) in self.third.iter_mut().zip(&mut self.minus_r) {
            *minus_r = (*u + *minus_r) * (h / 6.0 / tau);
            *u *= h / 6.0;
        }
        Ok(ErrorEstimate { positions: &self.third, velocities: &self.minus_r })
    }

    /// Makes the computed state the current one.
    fn commit(&mut self, state: &mut State) {
        self.next.prescribe(self.linear.system);
        state.copy_from(&self.next);
    }

    /// Sets s to all forces at a point of the step.
    fn set_force(&mut self, at: Point) -> Result<(), StepFailure> {
        let Self { linear, extensions, velocities, middle, next, s, .. } = self;
        let at = match at {
            Point::Start(state) => StateView { velocities, ..state.moment() },
            Point::Middle => middle.moment(),
            Point::Next => next.moment(),
        };
        linear.statistics.work.force_evaluations += 1;
        extensions.update(linear.system, &at)?;
        s.fill(Vector3::zeros());
        add_all_forces(linear.system, extensions, &at, s);
        Ok(())
    }
}

/// Where a step evaluates the forces.
enum Point<'a> {
    Start(&'a State),
    Middle,
    Next,
}

/// The first row of `W (u_x, u_v) = (r, M⁻¹s)`: solves `A (τ u_x) = s + M r/τ − G r`. On entry u holds τ u_x of prescribed
/// coordinates, on return u_x of all; s is used up.
fn solve_stage(
    linear: &mut LinearSystem,
    tau: f64,
    minus_r: &[Vector3<f64>],
    s: &mut [Vector3<f64>],
    u: &mut [Vector3<f64>],
) -> Result<(), SolveFailure> {
    let system = linear.system;
    for ((s, mass), minus_r) in s.iter_mut().zip(system.masses()).zip(minus_r) {
        *s -= minus_r * (mass / tau);
    }
    add_damping_product(system, &linear.extensions, minus_r, s);
    let solution = linear.solve(s, u)?;
    linear.statistics.record(solution.relative_residual);
    for u in u {
        *u /= tau;
    }
    Ok(())
}

impl TimeStepper for WMethod<'_> {
    fn name(&self) -> &'static str {
        "w2"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.linear.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        self.prepare(state, dt)?;
        self.advance(state, dt)?;
        self.commit(state);
        Ok(())
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        // R(z) = (1 + (1 − 2γ) z)/(1 − γz)² = (1 + c) w² − c w with c = (1 − 2γ)/γ, which exceeds e^z by (3γ² − 2γ³ − 1/6) z³.
        const GAMMA: f64 = WMethod::GAMMA;
        const C: f64 = (1.0 - 2.0 * GAMMA) / GAMMA;
        let Self { linear, first, s, .. } = self;
        error.set_local(
            linear.system,
            step,
            LeadingTerm::second_order(3.0 * GAMMA * GAMMA - 2.0 * GAMMA * GAMMA * GAMMA - 1.0 / 6.0),
        );
        error.add_braking(linear.system, &linear.extensions, step, BRAKING);
        let tau = GAMMA * step.length;
        s.fill(Vector3::zeros());
        linear.resolve(tau, [&mut error.positions, &mut error.velocities], s, first);
        error.keep();
        error.scale(1.0 + C);
        error.add_local();
        s.fill(Vector3::zeros());
        linear.resolve(tau, [&mut error.positions, &mut error.velocities], s, first);
        error.add_kept(-C);
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.linear.statistics
    }
}

impl AdaptiveStepper for WMethod<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        match &mut self.held {
            Some(held) if held.h == dt && held.uses < USES => held.uses += 1,
            _ => self.prepare(state, dt)?,
        }
        self.advance(state, dt)?;
        self.estimate(dt)
    }

    fn accept(&mut self, state: &mut State) {
        self.commit(state);
    }

    fn reject(&mut self) {
        self.held = None;
    }

    fn order(&self) -> u32 {
        2
    }

    /// Measured on random scenes that magnify errors up to a hundredfold, of which none may end twenty tolerances off: methods of higher order
    /// stay far below their tolerance on ordinary scenes, this one does not.
    fn safety_factor(&self) -> f64 {
        3.0
    }

    fn reuses_factorization(&self) -> bool {
        true
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.linear.statistics
    }
}

#[cfg(test)]
mod tests;
