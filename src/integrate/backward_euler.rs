//! Backward Euler: linearised at the start of the step (linearly implicit or semi-implicit Euler, the method of the lecture notes in `spring`), and
//! with the nonlinear equations solved to convergence.
//!
//! The equations `M (v' − v)/dt = f_el(x') + f_d(x', v') + g` with `x' = x + δx`, `v' = δx/dt` are solved by Newton's method in δx; or
//! linearised at x with `f_el(x') ≈ f_el(x) + K δx` and `f_d(x', v') ≈ G v'`, they become
//!
//! ```text
//! A δx = b,   A = M/dt² − G/dt − K,   b = M v/dt + g + f_el(x),   x' = x + δx,   v' = δx/dt.
//! ```
//!
//! Prescribed particles move by the known δx_c; their rows and columns leave the system, and the free rows get `b_f −= A_fc δx_c`.

use super::implicit::{ImplicitOptions, LinearSystem, constructors, of_linear_system};
use super::linear_tolerance::mass_norm;
use super::newton::{Newton, NewtonOptions};
use super::propagated_error::LeadingTerm;
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper, fits};
use crate::error::Result;
use crate::force::{SpringGeometry, add_elastic_force, add_undamped_external_forces, add_weight, set_total_force};
use crate::linear::LinearSolver;
use crate::operator::Combination;
use crate::system::{State, System};
use nalgebra::Vector3;

/// Linearised (linearly implicit) backward Euler, first order.
pub struct LinearBackwardEuler<'s> {
    linear: LinearSystem<'s>,
    force: Vec<Vector3<f64>>,
    displacement: Vec<Vector3<f64>>,
}

impl<'s> LinearBackwardEuler<'s> {
    constructors!();

    fn of(linear: LinearSystem<'s>, _: &State) -> Result<Self> {
        let zeros = || vec![Vector3::zeros(); linear.system.particles()];
        Ok(Self { force: zeros(), displacement: zeros(), linear })
    }
}

impl TimeStepper for LinearBackwardEuler<'_> {
    of_linear_system!("linear-backward-euler", linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.linear.system, state, dt)?;
        let Self { linear, force, displacement } = self;
        let system = linear.system;
        let time = state.time + dt;
        linear.set_extensions(&*state)?;
        linear.statistics.work.force_evaluations += 1;
        set_right_hand_side(system, &linear.extensions, state, dt, force);
        system.prescribed().displacement(time, &state.positions, displacement);
        // At δ = 0 the residual of the step's equations is −b.
        linear.begin(force, true);
        linear.prepare(linear.policy, Combination::step(dt))?;
        // The first omitted term of x' = x + dt v' is ½ dt² a, with dt a = v' − v.
        let error = |d: &[Vector3<f64>]| 0.5 * mass_norm(system, |p| d[p] - state.velocities[p] * dt);
        let solution = linear.solve_within(force, displacement, error)?;
        linear.statistics.record_residual(solution.relative_residual);
        advance(system, state, displacement, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { linear, force, displacement } = self;
        let system = linear.system;
        if !fits(system, error, step) {
            return false;
        }
        error.set_local(system, step, LeadingTerm::BACKWARD_EULER);
        // What linearising left out is the residual of the step's nonlinear equations.
        linear.statistics.work.force_evaluations += 1;
        if set_total_force(system, &step.after.moment(), force).is_err() {
            return true;
        }
        let [mut left_out, mut balanced] = [0.0, 0.0];
        for (p, (r, mass)) in force.iter_mut().zip(system.masses()).enumerate() {
            let free = system.dofs().free_axes(p);
            let inertia = (step.after.velocities[p] - step.before.velocities[p]) * (mass / step.length);
            *r = free.project(&(*r - inertia));
            if p < system.own_particles() {
                left_out += r.norm_squared();
                balanced += free.project(&inertia).norm_squared();
            }
        }
        let [left_out, balanced] = system.total([left_out, balanced]).map(f64::sqrt);
        error.leave_out(left_out, balanced);
        let e = [&mut error.positions[..], &mut error.velocities[..]];
        linear.resolve(step.length, e, force, displacement);
        error.add_local();
        true
    }
}

/// `b = M v/dt + g + f_el(x) + f_ext − D v`, full-length and without the coupling to prescribed particles.
pub(super) fn set_right_hand_side(
    system: &System,
    extensions: &SpringGeometry,
    state: &State,
    dt: f64,
    b: &mut [Vector3<f64>],
) {
    for ((b, mass), v) in b.iter_mut().zip(system.masses()).zip(&state.velocities) {
        *b = v * (mass / dt);
    }
    add_weight(system, b);
    add_undamped_external_forces(system, extensions, &state.moment(), b);
    add_elastic_force(system, extensions, b);
}

/// `x += δx`, `v = δx/dt`, `t += dt`; prescribed coordinates exactly where their motion has them. A state that is not finite is refused, and unchanged.
fn advance(system: &System, state: &mut State, displacement: &[Vector3<f64>], dt: f64) -> Result<(), StepFailure> {
    let is_finite = |v: Vector3<f64>| State::is_finite_vector(&v);
    let mut moved = state.positions.iter().zip(displacement);
    let are_finite = (state.time + dt).is_finite() && moved.all(|(x, d)| is_finite(x + d) && is_finite(d / dt));
    StepFailure::unless_finite(system, are_finite)?;
    state.time += dt;
    for ((x, v), d) in state.positions.iter_mut().zip(&mut state.velocities).zip(displacement) {
        *x += d;
        *v = d / dt;
    }
    system.prescribed().set_positions(state.time, &mut state.positions);
    Ok(())
}

/// Backward Euler, first order, nonlinear.
pub struct BackwardEuler<'s> {
    newton: Newton<'s>,
}

impl<'s> BackwardEuler<'s> {
    constructors!(newton: NewtonOptions);

    fn of(linear: LinearSystem<'s>, state: &State, newton: NewtonOptions) -> Result<Self> {
        Ok(Self { newton: Newton::new(linear, state, newton)? })
    }
}

/// For comparisons of the answers to an indefinite matrix.
#[cfg(feature = "report")]
impl BackwardEuler<'_> {
    /// Keeps an option for all iterations.
    pub(crate) fn keep_option(&mut self) {
        self.newton.keeps_option = true;
    }

    /// Transverse terms that the matrices of all solves have dropped or mirrored.
    pub(crate) fn changed_terms(&self) -> u64 {
        self.newton.linear.changed_terms
    }
}

impl TimeStepper for BackwardEuler<'_> {
    of_linear_system!("backward-euler", newton.linear);

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        let system = self.newton.linear.system;
        StepFailure::of_arguments(system, state, dt)?;
        system.prescribed().displacement(state.time + dt, &state.positions, &mut self.newton.displacement);
        self.newton.solve(state, dt)?;
        advance(system, state, &self.newton.displacement, dt)
    }

    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let system = self.newton.linear.system;
        if !fits(system, error, step) {
            return false;
        }
        error.set_local(system, step, LeadingTerm::BACKWARD_EULER);
        self.newton.resolve(step.length, error);
        error.add_local();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;

    /// Positions, velocities or times that would overflow are refused, and the state is unchanged.
    #[test]
    fn states_stay_finite() {
        let (system, start) = scene(&[([0.9e150, -0.9e150, 0.0], 1.0)], &[]).build().unwrap();
        let step = |time: f64, displacement: [f64; 3], dt: f64| {
            let start = State { time, ..start.clone() };
            let mut state = start.clone();
            let outcome = advance(&system, &mut state, &[Vector3::from(displacement)], dt);
            assert_eq!(outcome.is_err(), state == start);
            outcome
        };
        let refused = Err(StepFailure::NonFinite);
        assert_eq!([step(0.0, [0.5e150, 0.0, 0.0], 1.0), step(0.0, [-0.5e150, 0.0, 0.0], 1.0)], [refused, Ok(())]);
        assert_eq!([step(0.0, [0.0, 0.0, 0.5e150], 0.1), step(0.0, [0.0, 0.0, 0.5e150], 10.0)], [refused, Ok(())]);
        assert_eq!([step(f64::MAX, [0.0; 3], f64::MAX), step(1e200, [0.0; 3], 1e200)], [refused, Ok(())]);
    }
}
