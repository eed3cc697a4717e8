//! Backward Euler with the nonlinear equations solved: Newton's method with a line search.
//!
//! The new positions x' = x + δx solve, on the free coordinates,
//!
//! ```text
//! r(δx) = M (δx/dt − v)/dt − f_el(x + δx) − f_d(x + δx, δx/dt) − g = 0.
//! ```
//!
//! The first guess is the linearised step. Then `A(x') Δ = −r` with `A = M/dt² − G/dt − K` at x', which is the Jacobian of
//! r but for the change of the damping directions (left out: it is not symmetric, and small near the solution). Without
//! damping r is the gradient of the incremental potential
//!
//! ```text
//! Φ(δx) = ½ (δx − dt v)ᵀ M (δx − dt v)/dt² + U(x + δx) − gᵀ(x + δx)
//! ```
//!
//! and a step must make Φ fall; near the solution, where Φ has no digits left to fall by, and with damping, where there
//! is no potential, `‖r‖` must fall.

use super::implicit::{ImplicitOptions, LinearSystem};
use super::linear_backward_euler::{advance, set_right_hand_side};
use super::{NotSolved, Statistics, StepFailure, TimeStepper};
use crate::error::Result;
use crate::force::{Energy, add_damping_force, add_elastic_force, add_weight};
use crate::operator::Combination;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;

/// When Newton's method is done, and when it gives up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonOptions {
    /// Converged at `‖r‖ ≤ tolerance·s`, s the norm of the magnitudes of the forces that balance in r (and never
    /// below what rounding the positions does to r).
    pub tolerance: f64,
    /// The most iterations a step may take.
    pub iteration_limit: u64,
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { tolerance: 1e-10, iteration_limit: 100 }
    }
}

/// The least decrease that a step must bring, as a part of what its slope promises (Armijo).
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// How often a step is halved before the line search gives up.
const HALVINGS: usize = 40;

/// Backward Euler, first order, nonlinear.
pub struct BackwardEuler<'s> {
    linear: LinearSystem<'s>,
    newton: NewtonOptions,
    /// Whether r is a gradient: no damping.
    has_potential: bool,
    /// −r, full-length.
    force: Vec<Vector3<f64>>,
    displacement: Vec<Vector3<f64>>,
    correction: Vec<Vector3<f64>>,
    trial: State,
}

/// A point of the line search: the norm of r, and Φ where it exists.
#[derive(Clone, Copy)]
struct Merit {
    residual: f64,
    potential: Option<f64>,
}

impl<'s> BackwardEuler<'s> {
    /// Prepares everything that stays the same from step to step.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions, newton: NewtonOptions) -> Result<Self> {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Ok(Self {
            linear: LinearSystem::new(system, state, options)?,
            newton,
            has_potential: !system.is_damped(),
            force: zeros(),
            displacement: zeros(),
            correction: zeros(),
            trial: state.clone(),
        })
    }

    /// Sets `force` to −r at `displacement + step·correction`; returns its norms.
    fn evaluate(&mut self, state: &State, dt: f64, step: f64) -> Result<Merit, StepFailure> {
        let Self { linear, force, displacement, correction, trial, .. } = self;
        let system = linear.system;
        for p in 0..system.particles() {
            let d = displacement[p] + correction[p] * step;
            trial.positions[p] = state.positions[p] + d;
            trial.velocities[p] = d / dt;
        }
        linear.statistics.work.force_evaluations += 1;
        linear.set_extensions(&trial.positions)?;
        for (p, mass) in system.masses().iter().enumerate() {
            force[p] = (state.velocities[p] - trial.velocities[p]) * (mass / dt);
        }
        add_elastic_force(system, &linear.extensions, force);
        add_damping_force(system, &linear.extensions, &trial.velocities, force);
        add_weight(system, force);
        let residual = free_norm(system, force);
        if !residual.is_finite() {
            return Err(StepFailure::NonFinite);
        }
        let potential = self.has_potential.then(|| {
            let change = |p: usize| (trial.velocities[p] - state.velocities[p]).norm_squared();
            let inertia: f64 = system.masses().iter().enumerate().map(|(p, m)| 0.5 * m * change(p)).sum();
            let energy = Energy::of(system, trial);
            inertia + energy.elastic + energy.gravitational
        });
        Ok(Merit { residual, potential })
    }

    /// Halves the step along `correction` until the merit falls enough; adds it to `displacement`.
    fn line_search(&mut self, state: &State, dt: f64, from: Merit, slope: f64) -> Result<Option<Merit>, StepFailure> {
        let mut step = 1.0;
        for _ in 0..HALVINGS {
            match self.evaluate(state, dt, step) {
                Ok(merit) if merit.improves(&from, step, slope) => {
                    for (d, c) in self.displacement.iter_mut().zip(&self.correction) {
                        *d += c * step;
                    }
                    return Ok(Some(merit));
                }
                // A trial that overflows or collapses a spring is only too long.
                Ok(_) | Err(StepFailure::NonFinite | StepFailure::DegenerateSpring(_)) => step *= 0.5,
                Err(failure) => return Err(failure),
            }
        }
        Ok(None)
    }
}

impl Merit {
    fn improves(&self, from: &Self, step: f64, slope: f64) -> bool {
        let falls = |(to, from): (f64, f64)| to <= from + SUFFICIENT_DECREASE * step * slope;
        self.potential.zip(from.potential).is_some_and(falls)
            || self.residual <= (1.0 - SUFFICIENT_DECREASE * step) * from.residual
    }
}

impl TimeStepper for BackwardEuler<'_> {
    fn name(&self) -> &'static str {
        "backward-euler"
    }

    fn solver(&self) -> Option<&'static str> {
        Some(self.linear.solver())
    }

    fn preconditioner(&self) -> Option<&'static str> {
        self.linear.preconditioner()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        let system = self.linear.system;
        self.linear.set_extensions(&state.positions)?;
        self.linear.statistics.work.force_evaluations += 1;
        set_right_hand_side(&self.linear, state, dt, &mut self.force);
        system.prescribed().displacement(state.time + dt, &state.positions, &mut self.displacement);
        self.linear.prepare_and_solve(Combination::step(dt), &self.force, &mut self.displacement)?;

        self.correction.fill(Vector3::zeros());
        let mut merit = self.evaluate(state, dt, 0.0)?;
        let mut iterations = 0;
        loop {
            let balance = self.balance(state, dt);
            if merit.residual <= self.newton.tolerance * balance.forces + balance.rounding {
                break;
            }
            let failed = |reason| {
                let relative_residual = merit.residual / balance.forces;
                Err(StepFailure::Newton { iterations, relative_residual, reason })
            };
            if iterations >= self.newton.iteration_limit {
                return failed(NotSolved::IterationLimit);
            }
            self.linear.statistics.work.newton_iterations += 1;
            self.correction.fill(Vector3::zeros());
            self.linear.prepare_and_solve(Combination::step(dt), &self.force, &mut self.correction)?;
            // dΦ/dstep = rᵀΔ = −forceᵀΔ.
            let slope = -self.force.iter().zip(&self.correction).map(|(f, c)| f.dot(c)).sum::<f64>();
            match self.line_search(state, dt, merit, slope)? {
                Some(next) => merit = next,
                None => return failed(NotSolved::LineSearch),
            }
            iterations += 1;
        }
        advance(system, state, &self.displacement, dt)
    }

    fn statistics(&self) -> &Statistics {
        &self.linear.statistics
    }
}

/// What r is small against, in N.
#[derive(Clone, Copy)]
struct Balance {
    /// Norm of the forces that balance in r, their magnitudes added up particle by particle.
    forces: f64,
    /// Norm of the change of r by rounding the positions: nothing below it can be asked for.
    rounding: f64,
}

impl BackwardEuler<'_> {
    /// At the last evaluated point. Uses `correction` as scratch: x holds magnitudes of forces, y those of roundings.
    fn balance(&mut self, state: &State, dt: f64) -> Balance {
        let Self { linear, correction: sums, trial, .. } = self;
        let system = linear.system;
        let gravity = system.gravity().norm();
        for (p, mass) in system.masses().iter().enumerate() {
            let momentum = state.velocities[p].norm() + trial.velocities[p].norm();
            sums[p] = Vector3::new(mass * (momentum / dt + gravity), 0.0, 0.0);
        }
        for ((_, [i, j], spring), at) in system.active().zip(linear.extensions.iter()) {
            let force = (spring.stiffness * spring.strain(at)).abs();
            let reach = trial.positions[i].norm() + trial.positions[j].norm();
            let rounding = f64::EPSILON * spring.stiffness / spring.rest_length * reach;
            sums[i] += Vector3::new(force, rounding, 0.0);
            sums[j] += Vector3::new(force, rounding, 0.0);
        }
        let norm = |component: usize| {
            let free = sums.iter().enumerate().filter(|&(p, _)| system.dofs().free_axes(p) != Axes::NONE);
            free.map(|(_, s)| s[component] * s[component]).sum::<f64>().sqrt()
        };
        Balance { forces: norm(0), rounding: norm(1) }
    }
}

/// The Euclidean norm over free coordinates.
fn free_norm(system: &System, v: &[Vector3<f64>]) -> f64 {
    let dofs = system.dofs();
    let squares =
        v.iter().enumerate().map(|(p, v)| dofs.free_axes(p).iter().map(|axis| v[axis] * v[axis]).sum::<f64>());
    squares.sum::<f64>().sqrt()
}
