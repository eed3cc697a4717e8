//! RODAS4, a stiffly accurate Rosenbrock method of fourth order, on the matrix of linearised backward Euler: one factorization and six solves a step.
//!
//! **The method** in Hairer and Wanner's transformed form, for `y' = F(y)`, its Jacobian J at the step's beginning and τ = γ h:
//!
//! ```text
//! (I/τ − J) u_i = F(y + Σ A_ij u_j) + Σ C_ij u_j/h,      y' = y + Σ b_i u_i,      error ≈ u_6.
//! ```
//!
//! A- and L-stable, and the last stage is the difference from an embedded method of third order.
//!
//! **On positions and velocities.** With `r = (r_x, M⁻¹ s)` the right-hand side of a stage, `K = ∂f_el/∂x`, `G = ∂f_d/∂v` and
//! `D = ∂f_d/∂x`, its first row says `u_v = u_x/τ − r_x`; put into the second,
//!
//! ```text
//! (A − D) u_x = s + M r_x/τ − G r_x,      A = M/τ² − G/τ − K,
//! ```
//!
//! the matrix of linearised backward Euler with dt → τ. D, from damped springs that turn, is not symmetric and stays out of the matrix. Left out
//! altogether it would cost all orders but the first. One correction of the defect, `A u = b`, then `A u' = b + D u`, leaves
//! `(A⁻¹ D)² = O(h⁴)` of u, which is O(h) itself: the method keeps its order. So a stage is one solve without damping and two
//! with it.
//!
//! **Never softened.** The order rests on the exact J. Where A is not positive definite the step is refused as indefinite,
//! whatever the stiffness option: with error control a shorter one is tried, and a step of fixed length is done in parts, at
//! most 4⁵ of them. A mode that grows as e^(σt) makes A(γh) indefinite from σh = 4 on, where the method has a pole; at σh = 2 it
//! grows by 2.6 % too much in a step, at 3 thirteen times. So parts are quarters.
//!
//! **How wrong a step is.** u_6 is the error of a formula of third order; the method's own is a power of h higher. On a vibration of
//! frequency ω, z = ωh, it is `|R(iz) − e^{iz}| = 0.15 z |u_6|`, within a third up to z = 2, and of the size of u_6 beyond, where positions
//! are hardly in it. What vibrates tells its pace itself: `h ‖u_6v‖ = z ‖u_6x‖`. So the local error of a step is about
//! `min(‖u_6x‖, 0.15 h ‖u_6v‖)`, which is what steps of any length report of themselves.
//!
//! **Kinematic particles** move at a constant velocity v_c between the kinks of their paths, where steps are cut. There they are
//! part of y: `u_v = 0` and `u_x = τ r_x`, which enters the right-hand side as the displacement of
//! prescribed coordinates does in linearised backward Euler, and the correction too. In the non-autonomous form of the method that is its term with
//! `∂F/∂t = K_fc v_c + D_fc v_c`.
//!
//! Source: Hairer and Wanner, Solving Ordinary Differential Equations II, IV.7, IV.10, and their code rodas.f.

mod adaptive;
mod brake;
mod coefficients;
mod errors;

use super::adaptive::norm_of_all;
use super::implicit::{ImplicitOptions, LinearSystem};
use super::substeps::Substep;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, StiffnessPolicy, TimeStepper};
use crate::error::{Error, Result};
use crate::force::{add_damping_differential, add_damping_product, add_force_rate, set_total_force};
use crate::linear::{LinearSolver, SolveFailure};
use crate::operator::Combination;
use crate::system::{State, System};
use coefficients::{A, B, C, GAMMA, RATES, Row, STAGES, TIMES, add_multiples};
use nalgebra::Vector3;

/// Fourth order with the full stiffness, A- and L-stable; steps with an indefinite matrix are refused or cut.
///
/// # Examples
/// ```
/// use sprung::integrate::{ImplicitOptions, Rodas4, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default())?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(alias = "Rosenbrock")]
pub struct Rodas4<'s> {
    linear: LinearSystem<'s>,
    is_damped: bool,
    /// u_x and u_v of the stages.
    displacements: Vec<Vec<Vector3<f64>>>,
    velocities: Vec<Vec<Vector3<f64>>>,
    /// Where the step begins, prescribed velocities being those of the step; where a stage is, and where the step ends.
    base: State,
    point: State,
    next: State,
    /// r_x, the right-hand side b, and b + D u.
    r: Vec<Vector3<f64>>,
    b: Vec<Vector3<f64>>,
    corrected: Vec<Vector3<f64>>,
    /// ∂f/∂t where the step begins, in N/s.
    rate: Vec<Vector3<f64>>,
    /// Of positions, in the step done last, in m.
    local_error: f64,
    /// The length of the last part of a step, in s, for which the matrix is.
    part: f64,
    /// The last step's length, in s, and the error that its stages were solved for, see [`errors::of_stages`].
    last: Option<(f64, f64)>,
    /// The largest residual of the stages, in N.
    residual: f64,
}

/// The shortest part of a step of fixed length that is tried.
const SHORTEST_PART: f64 = 1.0 / 1024.0;

impl Rodas4<'_> {
    /// γ: the matrix of a step of length h is that of backward Euler for γ h.
    pub const GAMMA: f64 = GAMMA;
}

impl<'s> Rodas4<'s> {
    /// Prepares everything that stays the same from step to step: pattern, slot map, ordering, symbolic analysis. The stiffness
    /// option has no say.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; external forces without derivatives, which the method needs.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        check(system)?;
        let options = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, ..*options };
        Ok(Self::of(system, state, LinearSystem::new(system, state, &options)?))
    }

    /// As [`new`](Self::new), with a linear solver of your own, which need not be one of this crate's; `options.linear` then only
    /// says how exactly it is to solve, and what interrupts.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_solver(
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
        solver: Box<dyn LinearSolver + 's>,
    ) -> Result<Self> {
        check(system)?;
        let options = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, ..*options };
        Ok(Self::of(system, state, LinearSystem::with_solver(system, state, &options, solver)?))
    }

    fn of(system: &'s System, state: &State, linear: LinearSystem<'s>) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self {
            linear,
            is_damped: system.is_damped(),
            displacements: (0..STAGES).map(|_| zeros()).collect(),
            velocities: (0..STAGES).map(|_| zeros()).collect(),
            base: state.clone(),
            point: state.clone(),
            next: state.clone(),
            r: zeros(),
            b: zeros(),
            corrected: zeros(),
            rate: zeros(),
            local_error: 0.0,
            part: 0.0,
            last: None,
            residual: 0.0,
        }
    }

    /// Computes `next`, h seconds after `base`. No kink may be in between. Stages are solved as exactly as the error of the step is worth.
    fn advance(&mut self, h: f64) -> Result<(), StepFailure> {
        if let Some((last, error)) = self.last {
            self.linear.exactness.learn(errors::of_step(h, last, error));
        }
        // A step that is not exact enough is worth another two; its error then hardly changes.
        for _ in 0..3 {
            let mass_factor = self.compute(h)?;
            if !self.linear.exactness.follows() {
                return Ok(());
            }
            let [x, v] = self.embedded();
            let error = errors::of_stages(self.linear.system, x, v, h);
            self.last = Some((h, error));
            if self.linear.exactness.suffices(self.residual, mass_factor, error) {
                break;
            }
            self.linear.exactness.learn(error);
        }
        Ok(())
    }

    /// Computes `next`; returns what the matrix has of M.
    fn compute(&mut self, h: f64) -> Result<f64, StepFailure> {
        (self.residual, self.part) = (0.0, h);
        let system = self.linear.system;
        system.prescribed().set_velocities(self.base.time + 0.5 * h, &mut self.base.velocities);
        self.linear.set_extensions(&self.base)?;
        self.rate.fill(Vector3::zeros());
        add_force_rate(system, &self.linear.extensions, &self.base.moment(), &mut self.rate);
        let combination = Combination::step(GAMMA * h);
        self.linear.prepare_whole(combination)?;
        for stage in 0..STAGES {
            self.set_point(A.get(stage).unwrap_or(&B));
            self.point.time = self.base.time + h * TIMES.get(stage).unwrap_or(&1.0);
            self.set_right_hand_side(stage, h)?;
            self.solve(stage, h)?;
        }
        self.set_point(&B);
        std::mem::swap(&mut self.point, &mut self.next);
        self.next.time = self.base.time + h;
        if self.next.is_finite() { Ok(combination.mass) } else { Err(StepFailure::NonFinite) }
    }

    /// u_6, whose positions and velocities are the difference from the embedded formula.
    fn embedded(&self) -> [&[Vector3<f64>]; 2] {
        [&self.displacements, &self.velocities].map(|stages| stages.last().map_or(&[][..], Vec::as_slice))
    }

    /// Makes the last stage the estimate of the step just computed, of h seconds: what it has of prescribed coordinates is their way, not
    /// an error. Returns about the error of the step's positions, in m.
    fn judge(&mut self, h: f64) -> f64 {
        let system = self.linear.system;
        let (Some(x), Some(v)) = (self.displacements.last_mut(), self.velocities.last()) else { return 0.0 };
        for (dof, ..) in system.prescribed().iter() {
            if let Some(x) = x.get_mut(dof.particle) {
                x[dof.axis] = 0.0;
            }
        }
        errors::of_positions(system, x, v, h)
    }

    /// Sets `point` to `y + Σ row_j u_j`.
    fn set_point(&mut self, row: &Row) {
        self.point.copy_from(&self.base);
        add_multiples(row, 1.0, &self.displacements, &mut self.point.positions);
        add_multiples(row, 1.0, &self.velocities, &mut self.point.velocities);
    }

    /// Sets r_x, b and, of u_x, the prescribed entries, for a stage at `point`.
    fn set_right_hand_side(&mut self, stage: usize, h: f64) -> Result<(), StepFailure> {
        let system = self.linear.system;
        let tau = GAMMA * h;
        let Self { linear, point, r, b, corrected, displacements, velocities, rate, .. } = self;
        let row = C.get(stage).unwrap_or(&B);
        r.copy_from_slice(&point.velocities);
        add_multiples(row, 1.0 / h, displacements, r);
        linear.statistics.work.force_evaluations += 1;
        set_total_force(system, &point.moment(), b)?;
        // M (Σ C_ij u_v + r_x τ⁻¹), by way of a buffer that is free now.
        for (sum, r) in corrected.iter_mut().zip(&*r) {
            *sum = r / tau;
        }
        add_multiples(row, 1.0 / h, velocities, corrected);
        for ((b, sum), mass) in b.iter_mut().zip(&*corrected).zip(system.masses()) {
            *b += sum * *mass;
        }
        let slope = h * RATES.get(stage).unwrap_or(&0.0);
        for (b, rate) in b.iter_mut().zip(&*rate) {
            *b += rate * slope;
        }
        // −G r_x: damping forces at the velocities −r_x.
        for (minus, r) in corrected.iter_mut().zip(&*r) {
            *minus = -r;
        }
        add_damping_product(system, &linear.extensions, corrected, b);
        Ok(())
    }

    /// Solves for u of a stage.
    fn solve(&mut self, stage: usize, h: f64) -> Result<(), SolveFailure> {
        let system = self.linear.system;
        let tau = GAMMA * h;
        let Self { linear, is_damped, displacements, velocities, base, r, b, corrected, residual, .. } = self;
        let (Some(x), Some(v)) = (displacements.get_mut(stage), velocities.get_mut(stage)) else { return Ok(()) };
        prescribe(system, tau, r, x);
        let mut solution = linear.solve_as_needed(b, x)?;
        *residual = residual.max(linear.residual);
        if *is_damped {
            corrected.copy_from_slice(b);
            add_damping_differential(system, &linear.extensions, &base.velocities, x, corrected);
            prescribe(system, tau, r, x);
            solution = linear.solve_as_needed(corrected, x)?;
            *residual = residual.max(linear.residual);
        }
        linear.statistics.record(solution.relative_residual);
        for ((v, x), r) in v.iter_mut().zip(&*x).zip(&*r) {
            *v = x / tau - r;
        }
        // Zero but for rounding.
        for (dof, ..) in system.prescribed().iter() {
            if let Some(v) = v.get_mut(dof.particle) {
                v[dof.axis] = 0.0;
            }
        }
        Ok(())
    }

    /// Advances `base` over a piece of a step, in parts where the matrix is indefinite.
    fn advance_in_parts(&mut self, piece: &Substep, dt: f64) -> Result<(), StepFailure> {
        let mut h = piece.length();
        loop {
            let left = piece.end - self.base.time;
            let is_last = h >= left * (1.0 - 1e-12);
            let part = if is_last { left } else { h };
            match self.advance(part) {
                Ok(()) => {
                    let error = self.judge(part);
                    self.local_error += error;
                    if is_last {
                        self.next.time = piece.end;
                    }
                    self.next.prescribe(self.linear.system);
                    std::mem::swap(&mut self.base, &mut self.next);
                    if is_last {
                        return Ok(());
                    }
                }
                Err(StepFailure::Solve(SolveFailure::Indefinite(_))) if h > SHORTEST_PART * dt => {
                    self.linear.statistics.rejected_steps += 1;
                    h = 0.25 * h.min(left);
                }
                Err(failure) => return Err(failure),
            }
        }
    }
}

/// Sets u_x of prescribed coordinates to τ r_x, and of all others to zero.
fn prescribe(system: &System, tau: f64, r: &[Vector3<f64>], x: &mut [Vector3<f64>]) {
    x.fill(Vector3::zeros());
    for (dof, ..) in system.prescribed().iter() {
        if let (Some(x), Some(r)) = (x.get_mut(dof.particle), r.get(dof.particle)) {
            x[dof.axis] = tau * r[dof.axis];
        }
    }
}

/// The order of the method hangs on the exact Jacobian.
fn check(system: &System) -> Result<()> {
    if !system.knows_external_derivatives() {
        return Err(Error::Unsupported(
            "rodas4 takes no external forces that do not hand out their derivatives; use bdf2 or w2".into(),
        ));
    }
    Ok(())
}

impl TimeStepper for Rodas4<'_> {
    fn name(&self) -> &'static str {
        "rodas4"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.linear.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        let (mut time, end) = (state.time, state.time + dt);
        self.base.copy_from(state);
        self.local_error = 0.0;
        while let Some(piece) = Substep::next(self.linear.system.prescribed(), time, end, dt) {
            self.advance_in_parts(&piece, dt)?;
            time = piece.end;
        }
        state.copy_from(&self.base);
        Ok(())
    }

    /// With the matrix of τ = h/4, Φ is ((1 + z/4)/(1 − z/4))² = (2w − 1)²: two steps of the midpoint rule, which keep the amplitude of every
    /// vibration. δ is the embedded estimate u_6, of the size that its header derives.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { linear, b, corrected, displacements, velocities, part, local_error, .. } = self;
        let (Some(x), Some(v)) = (displacements.last(), velocities.last()) else { return false };
        let parts = (step.length / *part).round().clamp(1.0, 1.0 / SHORTEST_PART);
        for _ in 0..2 * parts as u32 {
            error.keep();
            b.fill(Vector3::zeros());
            linear.resolve(GAMMA * *part, [&mut error.positions, &mut error.velocities], b, corrected);
            error.scale(2.0);
            error.add_kept(-1.0);
        }
        let size = norm_of_all(linear.system, x);
        error.set_local_to(linear.system, if size > 0.0 { *local_error / size } else { 0.0 }, [x, v]);
        error.add_local();
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.linear.statistics
    }
}

#[cfg(test)]
mod tests;
