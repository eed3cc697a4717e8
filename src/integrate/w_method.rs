//! The second-order W-method (ROS2-W, the stages of ode23s) on the matrix of linearised backward Euler: one factorization and two solves a step,
//! whatever the stiffness option.
//!
//! **The method.** For `y' = F(y)` and any matrix J in place of `∂F/∂y`, with `W = I − τ J` and `τ = γ h`,
//!
//! ```text
//! W k = F(y),      W w = F(y + ½h k) − k,      y' = y + h (k + w).
//! ```
//!
//! As `k = F(y) + O(h)` and `w = O(h)`, `k + w = F(midpoint) + O(h²)`: second order for every J, with dropped terms or of an earlier step. With the
//! exact J the stability function is `(1 + (1 − 2γ)z + (½ − 2γ + γ²)z²)/(1 − γz)²`; its last coefficient vanishes for `γ = 1 − 1/√2`: A- and
//! L-stable. Sources: the stages of Shampine and Reichelt's ode23s (1997); Steihaug and Wolfbrandt (1979) for methods that keep their order with any
//! J.
//!
//! **On positions and velocities.** With `y = (x, v)`, `F = (v, M⁻¹f)` and J from K (under the option) and G, every stage is
//! a system `W (u_x, u_v) = (r, M⁻¹s)`. Its first row says `u_v = (u_x − r)/τ`; put into the second,
//!
//! ```text
//! A (τ u_x) = s + M r/τ − G r,      A = M/τ² − G/τ − K.
//! ```
//!
//! Stage one has `r = v`, `s = f(x, v)`: it is a linearised backward Euler step of length τ. Stage two has `r = v_mid − k_x` and
//! `s = f(x_mid, v_mid) − M k_v`.
//!
//! **Kinematic particles** move, for the time of one step, at the constant velocity `v̄_c = (x_c(t+h) − x_c(t))/h`. They are part of y with
//! `k_x = v̄_c` and `k_v = w = 0`. Where a step passes a kink or a path is smooth, the chord is off by O(h²), which keeps the order at two.
//!
//! **Error estimate.** ode23s compares with a third-order formula. Eliminating its third stage leaves one more solve,
//!
//! ```text
//! W u = F(y) − 2F(y_mid) + F(y') − (6 + √2)(k + w − F(y_mid)),      error ≈ (h/6) u,
//! ```
//!
//! which is O(h³) for every J, filtered by W⁻¹ where the system is stiff, and asymptotically the true local error with the exact J.

use super::backward_euler::set_right_hand_side;
use super::implicit::{ImplicitOptions, LinearSystem, constructors, of_linear_system};
use super::propagated_error::LeadingTerm;
use super::{
    AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, StiffnessPolicy,
    TimeStepper, fits,
};
use crate::error::Result;
use crate::force::{SpringGeometry, add_all_forces, add_damping_product};
use crate::linear::{LinearSolver, SolveFailure};
use crate::operator::Combination;
use crate::system::{State, StateView, System};
use nalgebra::Vector3;
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// Second order with the matrix of linearised backward Euler; A- and L-stable with the full stiffness.
#[doc(alias = "Rosenbrock")]
pub struct WMethod<'s> {
    linear: LinearSystem<'s>,
    /// The step length of the current matrix, in s, and the number of steps that have reused it.
    matrix: Option<(f64, u32)>,
    /// The geometry at which forces are evaluated; the linear system has the matrix's own.
    extensions: SpringGeometry,
    /// v, with prescribed components at their mean velocity over the step.
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
    /// `f(x, v) + (4 + √2) f(x_mid, v_mid)`, the stages' forces in the error estimate.
    forces: Vec<Vector3<f64>>,
}

impl WMethod<'_> {
    /// γ = 1 − 1/√2: the matrix of a step of length h is that of backward Euler for γ h.
    pub const GAMMA: f64 = 1.0 - FRAC_1_SQRT_2;
}

impl<'s> WMethod<'s> {
    constructors!();

    fn of(linear: LinearSystem<'s>, state: &State) -> Result<Self> {
        let zeros = || vec![Vector3::zeros(); linear.system.particles()];
        Ok(Self {
            matrix: None,
            extensions: linear.extensions.clone(),
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
        })
    }

    /// Prepares A at the state's positions for steps of length h.
    fn prepare(&mut self, state: &State, h: f64) -> Result<(), StepFailure> {
        self.matrix = None;
        self.linear.set_extensions(state)?;
        if self.linear.policy == StiffnessPolicy::Progressive {
            set_right_hand_side(self.linear.system, &self.linear.extensions, state, Self::GAMMA * h, &mut self.s);
            self.linear.begin(&self.s, true);
        }
        self.linear.prepare(self.linear.policy, Combination::step(Self::GAMMA * h))?;
        self.matrix = Some((h, 0));
        Ok(())
    }

    /// Computes `next` from a state with the prepared matrix, which must be for the same h.
    fn advance(&mut self, state: &State, h: f64) -> Result<(), StepFailure> {
        let tau = Self::GAMMA * h;
        let Self { linear, extensions, velocities, first, second, middle, next, minus_r, s, forces, .. } = self;
        let system = linear.system;
        velocities.copy_from_slice(&state.velocities);
        system.prescribed().set_mean_velocities(state.time + h, h, &state.positions, velocities);

        set_force(linear, extensions, &StateView { velocities: &*velocities, ..state.moment() }, s)?;
        forces.copy_from_slice(s);
        system.prescribed().displacement(state.time + h, &state.positions, first);
        for ((k, minus_r), v) in first.iter_mut().zip(&mut *minus_r).zip(&*velocities) {
            *k *= Self::GAMMA;
            *minus_r = -v;
        }
        solve_stage(linear, tau, minus_r, s, first)?;

        for (p, &v) in velocities.iter().enumerate() {
            let k_x = first[p];
            let k_v = (k_x - v) / tau;
            middle.positions[p] = state.positions[p] + k_x * (0.5 * h);
            middle.velocities[p] = v + k_v * (0.5 * h);
            minus_r[p] = k_x - middle.velocities[p];
        }
        middle.time = state.time + 0.5 * h;
        set_force(linear, extensions, &middle.moment(), s)?;
        for (p, mass) in system.masses().iter().enumerate() {
            forces[p] += s[p] * (4.0 + SQRT_2);
            s[p] -= (first[p] - velocities[p]) * (mass / tau);
        }
        second.fill(Vector3::zeros());
        solve_stage(linear, tau, minus_r, s, second)?;

        for (p, &v) in velocities.iter().enumerate() {
            let (k_x, w_x) = (first[p], second[p]);
            let k_v = (k_x - v) / tau;
            let w_v = (w_x + minus_r[p]) / tau;
            next.positions[p] = state.positions[p] + (k_x + w_x) * h;
            next.velocities[p] = v + (k_v + w_v) * h;
        }
        next.time = state.time + h;
        StepFailure::unless_finite(system, next.is_finite())
    }

    /// Estimates the error of the step just computed, with one more force evaluation and one more solve.
    fn estimate(&mut self, h: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        let (e, tau) = (6.0 + SQRT_2, Self::GAMMA * h);
        let Self { linear, extensions, velocities, first, second, third, middle, next, minus_r, s, forces, .. } = self;
        set_force(linear, extensions, &next.moment(), s)?;
        for (p, mass) in linear.system.masses().iter().enumerate() {
            let (v, v_mid, v_next) = (velocities[p], middle.velocities[p], next.velocities[p]);
            let rate = first[p] + second[p];
            minus_r[p] = (rate - v_mid) * e - (v - v_mid * 2.0 + v_next);
            s[p] += forces[p] - (v_next - v) * (e * mass / h);
        }
        third.fill(Vector3::zeros());
        solve_stage(linear, tau, minus_r, s, third)?;
        for (u, minus_r) in third.iter_mut().zip(&mut *minus_r) {
            *minus_r = (*u + *minus_r) * (h / 6.0 / tau);
            *u *= h / 6.0;
        }
        Ok(ErrorEstimate { positions: third, velocities: minus_r })
    }

    fn commit(&mut self, state: &mut State) {
        self.next.prescribe(self.linear.system);
        state.copy_from(&self.next);
    }
}

/// Sets s to all forces at a point of the step, and `extensions` to the geometry there.
fn set_force(
    linear: &mut LinearSystem,
    extensions: &mut SpringGeometry,
    at: &StateView<'_>,
    s: &mut [Vector3<f64>],
) -> Result<(), StepFailure> {
    linear.statistics.work.force_evaluations += 1;
    extensions.update(linear.system, at)?;
    s.fill(Vector3::zeros());
    add_all_forces(linear.system, extensions, at, s);
    Ok(())
}

/// Solves `A (τ u_x) = s + M r/τ − G r`. On entry u holds τ u_x of prescribed coordinates, on return u_x of all; s is used up.
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
    let solution = linear.solve(Some(linear.adaptive_tolerance.strictest), s, u)?;
    linear.statistics.record_residual(solution.relative_residual);
    for u in u {
        *u /= tau;
    }
    Ok(())
}

impl TimeStepper for WMethod<'_> {
    of_linear_system!("w2", linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        self.prepare(state, dt)?;
        self.advance(state, dt)?;
        self.commit(state);
        Ok(())
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        // R(z) = (1 + (1 − 2γ) z)/(1 − γz)² = (1 + c) w² − c w with c = (1 − 2γ)/γ, which exceeds e^z by (3γ² − 2γ³ − 1/6) z³.
        let gamma = Self::GAMMA;
        let c = (1.0 - 2.0 * gamma) / gamma;
        let term = LeadingTerm::second_order(3.0 * gamma * gamma - 2.0 * gamma * gamma * gamma - 1.0 / 6.0);
        // A spring that turns by θ in a step ends longer by L = l θ²/2, of which the second stage alone sees a quarter: on a stiff spring every step
        // ends too long by cL, c = 1 − 1/(4γ), and the tension of that takes c κ L² from the motion.
        let braking = 1.0 - 0.25 / gamma;
        let Self { linear, first, s, .. } = self;
        if !fits(linear.system, error, step) {
            return false;
        }
        error.set_local(linear.system, step, term);
        error.add_braking(linear.system, &linear.extensions, step, braking);
        let tau = gamma * step.length;
        s.fill(Vector3::zeros());
        linear.resolve(tau, [&mut error.positions, &mut error.velocities], s, first);
        error.change(|e, kept, local| (*kept, *e) = (*e, *e * (1.0 + c) + local));
        s.fill(Vector3::zeros());
        linear.resolve(tau, [&mut error.positions, &mut error.velocities], s, first);
        error.change(|e, kept, _| *e -= *kept * c);
        true
    }
}

impl AdaptiveStepper for WMethod<'_> {
    /// Up to six steps of one length share a matrix. Its age costs no order, but stability: directions of springs become outdated.
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        match &mut self.matrix {
            Some((h, uses)) if *h == dt && *uses < 5 => *uses += 1,
            _ => self.prepare(state, dt)?,
        }
        self.advance(state, dt)?;
        self.estimate(dt)
    }

    fn accept(&mut self, state: &mut State) {
        self.commit(state);
    }

    fn reject(&mut self) {
        self.matrix = None;
    }

    fn order(&self) -> u32 {
        2
    }

    /// Fitted to random scenes that magnify errors up to a hundredfold, so that none ends twenty tolerances off.
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
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;
    use crate::spring::Stiffness;

    /// With the exact Jacobian the estimate is what positions and velocities lack, up to a part that falls with h.
    #[test]
    fn the_estimate_is_the_local_error_of_short_steps() {
        let particles = [([0.0; 3], 1.0), ([1.0, 0.1, -0.2], 0.7), ([1.3, 0.9, -0.4], 0.4)];
        let mut builder = scene(&particles, &[(0, 1), (1, 2), (0, 2)].map(|(i, j)| (i, j, [40.0, 0.9, 0.0])));
        builder.gravity(0.0, 0.0, -10.0).hold(0);
        let (system, mut start) = builder.build().unwrap();
        start.velocities[1] = Vector3::new(0.3, -1.0, 2.0);
        start.velocities[2] = Vector3::new(-0.4, 0.5, 1.0);
        let options = ImplicitOptions { stiffness: Stiffness::Full.into(), ..ImplicitOptions::default() };
        let mut stepper = WMethod::new(&system, &start, &options).unwrap();
        for (h, within) in [(4e-3, 0.04), (1e-3, 0.01)] {
            let mut exact = start.clone();
            (0..256).for_each(|_| stepper.step(&mut exact, h / 256.0).unwrap());
            let estimate = stepper.try_step(&start, h).unwrap();
            let [positions, velocities] = [estimate.positions, estimate.velocities].map(<[_]>::to_vec);
            let mut end = start.clone();
            stepper.accept(&mut end);
            for (what, estimate, end, exact) in [
                ("positions", positions, &end.positions, &exact.positions),
                ("velocities", velocities, &end.velocities, &exact.velocities),
            ] {
                let (mut rest, mut missing) = (0.0, 0.0);
                for ((estimate, end), exact) in estimate.iter().zip(end).zip(exact) {
                    rest += (estimate - (exact - end)).norm_squared();
                    missing += (exact - end).norm_squared();
                }
                let part = (rest / missing).sqrt();
                assert!(part < within, "{what}, {h} s: {part}");
            }
        }
    }
}
