//! Backward Euler with the forces linearised at the start of the step (linearly implicit or semi-implicit Euler, the method of the
//! lecture notes in `spring`): one linear solve a step.
//!
//! Backward Euler, `M (v' − v)/dt = f_el(x') + f_d(x', v') + g` with `v' = δx/dt`, linearised at x with
//! `f_el(x') ≈ f_el(x) + K δx` and `f_d(x', v') ≈ G v'`, becomes
//!
//! ```text
//! A δx = b,   A = M/dt² − G/dt − K,   b = M v/dt + g + f_el(x),   x' = x + δx,   v' = δx/dt.
//! ```
//!
//! In this form no damping stands on the right. Prescribed particles move by the known δx_c; their rows and columns leave
//! the system, and the free rows get `b_f −= A_fc δx_c`.

use super::implicit::{ImplicitOptions, LinearSystem};
use super::linear_tolerance::mass_norm;
use super::propagated_error::{LeadingTerm, on_axes};
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{add_elastic_force, add_undamped_external_forces, add_weight, set_total_force};
use crate::linear::LinearSolver;
use crate::operator::Combination;
use crate::system::{State, System};
use nalgebra::Vector3;

/// Linearised (linearly implicit) backward Euler, first order.
///
/// # Examples
/// ```
/// use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = LinearBackwardEuler::new(&system, &state, &ImplicitOptions::default())?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct LinearBackwardEuler<'s> {
    linear: LinearSystem<'s>,
    force: Vec<Vector3<f64>>,
    displacement: Vec<Vector3<f64>>,
}

impl<'s> LinearBackwardEuler<'s> {
    /// Prepares everything that stays the same from step to step: pattern, slot map, ordering, symbolic analysis.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        LinearSystem::new(system, state, options).map(Self::of)
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
        LinearSystem::with_solver(system, state, options, solver).map(Self::of)
    }

    fn of(linear: LinearSystem<'s>) -> Self {
        let zeros = || vec![Vector3::zeros(); linear.system.particles()];
        Self { force: zeros(), displacement: zeros(), linear }
    }
}

impl TimeStepper for LinearBackwardEuler<'_> {
    fn name(&self) -> &'static str {
        "linear-backward-euler"
    }

    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        Some(self.linear.solver())
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        let Self { linear, force, displacement } = self;
        let system = linear.system;
        let time = state.time + dt;
        linear.set_extensions(&*state)?;
        linear.statistics.work.force_evaluations += 1;
        set_right_hand_side(linear, state, dt, force);
        system.prescribed().displacement(time, &state.positions, displacement);
        linear.prepare(linear.policy, Combination::step(dt))?;
        // The first omitted term of x' = x + dt v' is ½ dt² a, with dt a = v' − v.
        let error = |d: &[Vector3<f64>]| 0.5 * mass_norm(system, |p| d[p] - state.velocities[p] * dt);
        let solution = linear.solve_within(force, displacement, error)?;
        linear.statistics.record(solution.relative_residual);
        advance(system, state, displacement, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { linear, force, displacement } = self;
        let system = linear.system;
        error.set_local(system, step, LeadingTerm::BACKWARD_EULER);
        // What linearising left out: the residual of the step's nonlinear equations.
        linear.statistics.work.force_evaluations += 1;
        if set_total_force(system, &step.after.moment(), force).is_err() {
            return true;
        }
        let change = |p: usize| step.after.velocities[p] - step.before.velocities[p];
        let [mut left_out, mut balanced] = [0.0, 0.0];
        for (p, (r, mass)) in force.iter_mut().zip(system.masses()).enumerate() {
            let free = system.dofs().free_axes(p);
            let inertia = change(p) * (mass / step.length);
            *r = on_axes(*r - inertia, free);
            if p < system.own_particles() {
                left_out += r.norm_squared();
                balanced += on_axes(inertia, free).norm_squared();
            }
        }
        let [left_out, balanced] = system.total([left_out, balanced]).map(f64::sqrt);
        error.leave_out(left_out, balanced);
        let e = [&mut error.positions[..], &mut error.velocities[..]];
        linear.resolve(step.length, e, force, displacement);
        error.add_local();
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.linear.statistics
    }
}

/// `b = M v/dt + g + f_el(x) + f_ext − D v`, full-length and without the coupling to prescribed particles.
pub(super) fn set_right_hand_side(linear: &LinearSystem, state: &State, dt: f64, b: &mut [Vector3<f64>]) {
    let system = linear.system;
    for ((b, mass), v) in b.iter_mut().zip(system.masses()).zip(&state.velocities) {
        *b = v * (mass / dt);
    }
    add_weight(system, b);
    add_undamped_external_forces(system, &linear.extensions, &state.moment(), b);
    add_elastic_force(system, &linear.extensions, b);
}

/// `x += δx`, `v = δx/dt`, `t += dt`; prescribed coordinates exactly where their motion has them.
///
/// # Errors
/// When the new state would not be finite; the state is then as it was.
pub(super) fn advance(
    system: &System,
    state: &mut State,
    displacement: &[Vector3<f64>],
    dt: f64,
) -> Result<(), StepFailure> {
    let is_finite = |v: Vector3<f64>| State::is_finite_vector(&v);
    let mut moved = state.positions.iter().zip(displacement);
    let is_good = (state.time + dt).is_finite() && moved.all(|(x, d)| is_finite(x + d) && is_finite(d / dt));
    StepFailure::of_any(system, if is_good { Ok(()) } else { Err(StepFailure::NonFinite) })?;
    state.time += dt;
    for ((x, v), d) in state.positions.iter_mut().zip(&mut state.velocities).zip(displacement) {
        *x += d;
        *v = d / dt;
    }
    system.prescribed().set_positions(state.time, &mut state.positions);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::advance;
    use crate::integrate::StepFailure;
    use crate::system::{State, SystemBuilder};
    use nalgebra::Vector3;

    /// Positions or velocities that would overflow are refused, and the state stays as it was.
    #[test]
    fn states_stay_finite() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.9e150, -0.9e150, 0.0], 1.0);
        let (system, start) = builder.build().unwrap();
        let step = |displacement: [f64; 3], dt: f64| {
            let mut state = start.clone();
            let outcome = advance(&system, &mut state, &[Vector3::from(displacement)], dt);
            assert_eq!(outcome.is_err(), state == start);
            outcome
        };
        assert_eq!(step([0.5e150, 0.0, 0.0], 1.0), Err(StepFailure::NonFinite));
        assert_eq!(step([-0.5e150, 0.0, 0.0], 1.0), Ok(()));
        assert_eq!(step([0.0, 0.0, 0.5e150], 0.1), Err(StepFailure::NonFinite));
        assert_eq!(step([0.0, 0.0, 0.5e150], 10.0), Ok(()));
        // So are times.
        let later =
            |time: f64, dt: f64| advance(&system, &mut State { time, ..start.clone() }, &[Vector3::zeros()], dt);
        assert_eq!((later(f64::MAX, f64::MAX), later(1e200, 1e200)), (Err(StepFailure::NonFinite), Ok(())));
    }
}
