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
//! the matrix of linearised backward Euler with dt → τ. D, from damped springs that turn, is not symmetric and stays out of the matrix. Two
//! corrections of the defect, `A u = b`, then `A u' = b + D u`, leave `(A⁻¹ D)³ = O(h⁶)` of u_x, which is O(h) itself: O(h⁶) in u_v after the
//! division by τ. One correction would cost an order. So a stage is one solve without damping and three with it.
//!
//! **Never regularized.** The order needs the exact J. Where A is not positive definite the step is refused as indefinite, whatever the stiffness
//! option: with error control a shorter one is tried, and a step of fixed length is done in quarters, and these in quarters, at most 4⁵ parts. (A
//! mode that grows as e^(σt) makes A(γh) indefinite from σh = 4 on, where the method has a pole; at σh = 2 it grows by 2.6 % too much, at 3 by a
//! factor of 13.)
//!
//! **Local error.** u_6 is the error of a formula of third order; the method's own is a power of h higher. On a vibration of frequency ω, z = ωh, it
//! is `|R(iz) − e^{iz}| = 0.15 z |u_6|`, within a third up to z = 2, and of the size of u_6 beyond. The vibration itself gives its frequency:
//! `h ‖u_6v‖ = z ‖u_6x‖`. So the local error of a step is about `min(‖u_6x‖, 0.15 h ‖u_6v‖)`.
//!
//! **Kinematic particles** move at a constant velocity v_c between the kinks of their paths, where steps are cut. They are part of y with
//! `u_v = 0` and `u_x = τ r_x`, the displacement of prescribed coordinates in the right-hand side and in the correction.
//!
//! Source: Hairer and Wanner, Solving Ordinary Differential Equations II, IV.7, IV.10, and their code rodas.f (METH = 1), whose coefficients these
//! are.

use super::implicit::{ImplicitOptions, LinearSystem, of_linear_system};
use super::linear_tolerance::mass_norm;
use super::substeps::{Substep, substeps};
use super::{
    AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, StiffnessPolicy,
    TimeStepper, fits, norm_of_all, zero_prescribed,
};
use crate::error::{Error, Result};
use crate::force::{SpringGeometry, add_damping_differential, add_damping_product, add_force_rate, set_total_force};
use crate::linear::{LinearSolver, SolveFailure};
use crate::operator::Combination;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;

const STAGES: usize = 6;

type Row = [f64; STAGES];

/// γ: the matrix of a step of length h is that of backward Euler for γ h.
pub(super) const GAMMA: f64 = 0.25;

/// The combination of earlier stages at the point of each stage.
#[rustfmt::skip]
const A: [Row; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.544, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0, 0.0],
    [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0, 0.0],
];

/// The combination of earlier stages in its right-hand side, over h.
#[rustfmt::skip]
const C: [Row; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-5.6688, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0, 0.0],
    [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0, 0.0],
    [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616, 0.0, 0.0],
    [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054, 0.0],
];

/// The time of each stage, and the factor of the forces' rate of change in its right-hand side, both over h.
const TIMES: Row = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];
const RATES: Row = [0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0];

/// The combination of stages in the new state: the point of the last stage, and the last stage.
const B: Row = [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0, 1.0];

/// Fourth order with the full stiffness, A- and L-stable; steps with an indefinite matrix are refused or cut.
#[doc(alias = "Rosenbrock")]
pub struct Rodas4<'s> {
    linear: LinearSystem<'s>,
    is_damped: bool,
    /// u_x and u_v of the stages.
    displacements: [Vec<Vector3<f64>>; STAGES],
    velocities: [Vec<Vector3<f64>>; STAGES],
    /// The start of the step with the step's prescribed velocities, the point of the current stage, and the end of the step.
    base: State,
    point: State,
    next: State,
    /// r_x, the right-hand side b, and b + D u.
    r: Vec<Vector3<f64>>,
    b: Vec<Vector3<f64>>,
    corrected: Vec<Vector3<f64>>,
    /// ∂f/∂t at the start of the step, in N/s.
    rate: Vec<Vector3<f64>>,
    /// The error of positions in the last step, in m.
    local_error: f64,
    /// The length of the last part of a step, in s, to which the matrix belongs.
    part: f64,
    /// The last step's length, in s, and the error of its stages, in m √kg.
    last: Option<(f64, f64)>,
    /// The largest residual of the stages, in N.
    residual: f64,
}

/// The shortest part of a step of fixed length that is tried.
const SHORTEST_PART: f64 = 1.0 / 1024.0;

impl<'s> Rodas4<'s> {
    /// Prepares pattern, ordering and symbolic analysis once for all steps. The stiffness option is ignored.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a state of another system; a matrix that is too large; external forces without derivatives.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        let options = exact(system, options)?;
        Ok(Self::of(system, state, LinearSystem::new(system, state, &options)?))
    }

    /// As [`new`](Self::new), with your own linear solver; of `options.linear` only the tolerance and the interrupt apply.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_solver(
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
        solver: Box<dyn LinearSolver + 's>,
    ) -> Result<Self> {
        let options = exact(system, options)?;
        Ok(Self::of(system, state, LinearSystem::with_solver(system, state, &options, solver)?))
    }

    fn of(system: &'s System, state: &State, linear: LinearSystem<'s>) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self {
            linear,
            is_damped: system.is_damped(),
            displacements: std::array::from_fn(|_| zeros()),
            velocities: std::array::from_fn(|_| zeros()),
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

    /// Computes `next`, h seconds after `base`. No kink may be in between. The accuracy of the solves follows the error of the step.
    fn advance(&mut self, h: f64) -> Result<(), StepFailure> {
        if let Some((last, error)) = self.last {
            // The error of the embedded formula falls with the fourth power; longer steps are not trusted to follow that.
            self.linear.adaptive_tolerance.record(error * (h / last).min(1.0).powi(4));
        }
        // A step that is not accurate enough is computed again, twice at most; its error then hardly changes.
        for _ in 0..3 {
            let inertia = self.compute(h)?;
            if !self.linear.adaptive_tolerance.is_adaptive {
                return Ok(());
            }
            // In the norm of M a tenth of the local error: the new state has up to thirteen times the error of a stage.
            let system = self.linear.system;
            let error = 0.1 * local_error(|u| mass_norm(system, |p| u[p]), self.embedded(), h);
            self.last = Some((h, error));
            if self.linear.adaptive_tolerance.suffices(self.residual, inertia, error) {
                break;
            }
            self.linear.adaptive_tolerance.record(error);
        }
        Ok(())
    }

    /// Computes `next`; returns the factor of M in the matrix.
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
            self.set_point(&A[stage]);
            self.point.time = self.base.time + h * TIMES[stage];
            self.set_right_hand_side(stage, h)?;
            self.solve(stage, h)?;
        }
        self.set_point(&B);
        std::mem::swap(&mut self.point, &mut self.next);
        self.next.time = self.base.time + h;
        StepFailure::unless_finite(system, self.next.is_finite())?;
        Ok(combination.mass)
    }

    /// Sets `point` to `y + Σ row_j u_j`.
    fn set_point(&mut self, row: &Row) {
        self.point.copy_from(&self.base);
        add_multiples(row, 1.0, &self.displacements, &mut self.point.positions);
        add_multiples(row, 1.0, &self.velocities, &mut self.point.velocities);
    }

    /// Sets r_x and b of a stage at `point`.
    fn set_right_hand_side(&mut self, stage: usize, h: f64) -> Result<(), StepFailure> {
        let system = self.linear.system;
        let tau = GAMMA * h;
        let Self { linear, point, r, b, corrected, displacements, velocities, rate, .. } = self;
        r.copy_from_slice(&point.velocities);
        add_multiples(&C[stage], 1.0 / h, displacements, r);
        linear.statistics.work.force_evaluations += 1;
        set_total_force(system, &point.moment(), b)?;
        // M (Σ C_ij u_v + r_x τ⁻¹), in a buffer that is free here.
        for (sum, r) in corrected.iter_mut().zip(&*r) {
            *sum = r / tau;
        }
        add_multiples(&C[stage], 1.0 / h, velocities, corrected);
        let slope = h * RATES[stage];
        for (p, mass) in system.masses().iter().enumerate() {
            b[p] += corrected[p] * *mass;
            b[p] += rate[p] * slope;
            // −G r_x: damping forces at the velocities −r_x.
            corrected[p] = -r[p];
        }
        add_damping_product(system, &linear.extensions, corrected, b);
        Ok(())
    }

    /// Solves for u of a stage.
    fn solve(&mut self, stage: usize, h: f64) -> Result<(), SolveFailure> {
        let system = self.linear.system;
        let tau = GAMMA * h;
        let Self { linear, is_damped, displacements, velocities, base, r, b, corrected, residual, .. } = self;
        let (x, v) = (&mut displacements[stage], &mut velocities[stage]);
        prescribe(system, tau, r, x);
        let mut solution = linear.solve(None, b, x)?;
        *residual = residual.max(linear.residual);
        for _ in 0..if *is_damped { 2 } else { 0 } {
            corrected.copy_from_slice(b);
            add_damping_differential(system, &linear.extensions, &base.velocities, x, corrected);
            prescribe(system, tau, r, x);
            solution = linear.solve(None, corrected, x)?;
            *residual = residual.max(linear.residual);
        }
        linear.statistics.record_residual(solution.relative_residual);
        for ((v, x), r) in v.iter_mut().zip(&*x).zip(&*r) {
            *v = x / tau - r;
        }
        zero_prescribed(system, v);
        Ok(())
    }

    /// Makes the last stage the error estimate of the step just computed, of h seconds, whose prescribed coordinates have none. Returns the local
    /// error of the step's positions, in m.
    fn finish_estimate(&mut self, h: f64) -> f64 {
        let system = self.linear.system;
        zero_prescribed(system, &mut self.displacements[STAGES - 1]);
        local_error(|u| norm_of_all(system, u), self.embedded(), h)
    }

    /// u_6, whose positions and velocities are the difference from the embedded formula.
    fn embedded(&self) -> [&[Vector3<f64>]; 2] {
        [&self.displacements[STAGES - 1], &self.velocities[STAGES - 1]]
    }

    /// Advances `base` over a substep of a step of dt seconds, in parts where the matrix is indefinite.
    fn advance_in_parts(&mut self, substep: &Substep, dt: f64) -> Result<(), StepFailure> {
        let mut h = substep.length();
        loop {
            let left = substep.end - self.base.time;
            let is_last = h >= left * (1.0 - 1e-12);
            let part = if is_last { left } else { h };
            match self.advance(part) {
                Ok(()) => {
                    self.local_error += self.finish_estimate(part);
                    if is_last {
                        self.next.time = substep.end;
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

/// Options with the full stiffness; refuses a system without an exact Jacobian.
fn exact(system: &System, options: &ImplicitOptions) -> Result<ImplicitOptions> {
    if !system.knows_external_derivatives() {
        return Err(Error::Unsupported(
            "rodas4 needs the derivatives of external forces, and some have none; use bdf2 or w2".into(),
        ));
    }
    Ok(ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, ..*options })
}

/// Adds `factor Σ row_j u_j`.
fn add_multiples(row: &Row, factor: f64, stages: &[Vec<Vector3<f64>>; STAGES], to: &mut [Vector3<f64>]) {
    for (stage, &coefficient) in stages.iter().zip(row).filter(|(_, coefficient)| **coefficient != 0.0) {
        let coefficient = coefficient * factor;
        for (to, u) in to.iter_mut().zip(stage) {
            *to += u * coefficient;
        }
    }
}

/// Sets u_x of prescribed coordinates to τ r_x, and of all others to zero.
fn prescribe(system: &System, tau: f64, r: &[Vector3<f64>], x: &mut [Vector3<f64>]) {
    x.fill(Vector3::zeros());
    for (dof, ..) in system.prescribed().iter() {
        x[dof.particle][dof.axis] = tau * r[dof.particle][dof.axis];
    }
}

/// `min(‖u_6x‖, 0.15 h ‖u_6v‖)` in a norm.
fn local_error(norm: impl Fn(&[Vector3<f64>]) -> f64, [x, v]: [&[Vector3<f64>]; 2], h: f64) -> f64 {
    norm(x).min(0.15 * h * norm(v))
}

/// The share of the kinetic energy K that a step of h seconds takes from springs that turn: `0.4 Σ U²/K_s / K` with `K_s = ½ μ v⊥²` across a spring,
/// and `U = ½ κ L²`, `L = (h v⊥)²/(2 l)` of straight motion. (Fitted to a turning rod with U well below K_s.)
fn rotational_damping(system: &System, extensions: &SpringGeometry, velocities: &[Vector3<f64>], h: f64) -> f64 {
    let inverse = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    // A spring without a rest length is not stretched by turning.
    let turning = extensions.springs(system).filter(|((.., spring), _)| spring.rest_length > 0.0);
    let taken = turning.map(|((_, [i, j], spring), at)| {
        let v = velocities[i] - velocities[j];
        let across = v.norm_squared() - at.direction.dot(&v).powi(2);
        let lift = 0.5 * h * h * across / at.length;
        let half = 0.5 * spring.axial_stiffness();
        half * lift * lift * half * (inverse(i) + inverse(j)) * lift * h * h / at.length
    });
    let taken = 0.4 * taken.sum::<f64>();
    let kinetic = system.masses().iter().zip(velocities).map(|(mass, v)| 0.5 * mass * v.norm_squared()).sum::<f64>();
    if taken > 0.0 { taken / kinetic } else { 0.0 }
}

impl TimeStepper for Rodas4<'_> {
    of_linear_system!("rodas4", linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        let system = self.linear.system;
        StepFailure::of_arguments(system, state, dt)?;
        self.base.copy_from(state);
        self.local_error = 0.0;
        for substep in substeps(system.prescribed(), state.time, dt) {
            self.advance_in_parts(&substep, dt)?;
        }
        state.copy_from(&self.base);
        Ok(())
    }

    /// With the matrix of τ = h/4, Φ is ((1 + z/4)/(1 − z/4))² = (2w − 1)²: two steps of the midpoint rule. δ is u_6, scaled to the local error.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { linear, b, corrected, displacements, velocities, part, local_error, .. } = self;
        if !fits(linear.system, error, step) {
            return false;
        }
        let parts = (step.length / *part).round().clamp(1.0, 1.0 / SHORTEST_PART);
        for _ in 0..2 * parts as u32 {
            error.change(|e, kept, _| *kept = *e);
            b.fill(Vector3::zeros());
            linear.resolve(GAMMA * *part, [&mut error.positions, &mut error.velocities], b, corrected);
            error.change(|e, kept, _| *e = *e * 2.0 - *kept);
        }
        let embedded = [&displacements[STAGES - 1][..], &velocities[STAGES - 1]];
        error.set_local_to(linear.system, *local_error, embedded);
        error.add_local();
        true
    }
}

impl AdaptiveStepper for Rodas4<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        self.base.copy_from(state);
        self.advance(dt)?;
        self.local_error = self.finish_estimate(dt);
        let [positions, velocities] = self.embedded();
        Ok(ErrorEstimate { positions, velocities })
    }

    fn accept(&mut self, state: &mut State) {
        self.next.prescribe(self.linear.system);
        state.copy_from(&self.next);
    }

    fn order(&self) -> u32 {
        4
    }

    fn estimate_order(&self) -> u32 {
        3
    }

    fn rotational_damping(&self) -> f64 {
        let h = self.next.time - self.base.time;
        rotational_damping(self.linear.system, &self.linear.extensions, &self.base.velocities, h)
    }

    /// Fitted to stiff rods, which end with up to thirty times the error at the coarsest tolerances without it.
    fn safety_factor(&self) -> f64 {
        5.0
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.linear.statistics
    }
}

#[cfg(test)]
mod tests;
