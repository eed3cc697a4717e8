//! Newton's method for the equations of a backward Euler step; implicit midpoint solves the same ones over half a step.
//!
//! The displacement δ over dt seconds solves, on the free coordinates,
//!
//! ```text
//! r(δ) = M (δ/dt − v)/dt − f_el(x + δ) − f_d(x + δ, δ/dt) − g = 0.
//! ```
//!
//! **Direction.** The Jacobian of r is `J = A − D` with `A = M/dt² − G/dt − K` at x + δ, the matrix of linearised backward Euler, and D the change
//! of the damping force when springs turn, `−b ((nᵀw) P + n (P w)ᵀ)` with `P = (I − nnᵀ)/l`, `w = v_i − v_j` for each spring
//! ([`Spring::damping_differential`](crate::Spring::damping_differential)). D is not symmetric and can be of either sign, so
//! it stays out of the matrix; but it is small, of the order of the angle by which springs turn in a step. So `J Δ = −r` is
//! solved by refinement, `A Δ₀ = −r`, `A Δ_{i+1} = D Δ_i`, `Δ = Σ Δ_i`, each a solve with the matrix at hand. The stiffness
//! option is the filter that keeps A positive definite; with `full` the convergence is quadratic, damped or not.
//!
//! **How exactly.** `‖J Δ + r‖ ≤ η ‖r‖` with a [`Forcing`] term η that keeps the convergence quadratic. It is the tolerance of
//! conjugate gradients (in place of the one that the user sets, which is its floor), and ends the refinement.
//!
//! **Globalisation.** Without damping r is the gradient of the incremental potential
//!
//! ```text
//! Φ(δ) = ½ (δ/dt − v)ᵀ M (δ/dt − v) + U(x + δ) − gᵀδ,
//! ```
//!
//! with it the damping forces do work `−∫ f_dᵀ dδ` along the line searched, taken by the trapezoidal rule. Their sum φ has the
//! slope `φ' = rᵀΔ`, and a step s must bring the decrease `φ(s) ≤ φ(0) + c s φ'(0)` (Armijo). Near the solution φ has no digits
//! left to fall by; then its slope must have fallen, `φ'(s) ≤ (1 − 2c)|φ'(0)|`, which for a quadratic φ says the same (the
//! "approximate Wolfe" condition of Hager and Zhang, 2005). The iteration starts from the predicted state, δ = dt v. (From
//! staying, δ = 0, its first full step would be the linearised one, which brakes springs that turn.) Where it comes to nothing from
//! there, it starts again from staying.
//!
//! **The matrix** is that of the stiffness option as long as it serves, and otherwise one that does, see [`Filter`].

mod options;

pub use options::NewtonOptions;

use super::forcing::Forcing;
use super::implicit::{ImplicitOptions, LinearSystem};
use super::line_search::{Balance, Point};
use super::newton_matrix::{Filter, Matrix};
use super::{NotSolved, PropagatedError, StepFailure, StiffnessPolicy};
use crate::error::Result;
use crate::force::{add_damping_differential, add_damping_force, add_elastic_force, add_external_forces, add_weight};
use crate::linear::SolveFailure;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{State, System};
use nalgebra::Vector3;

/// How often a step is shortened before the line search gives up.
const SHORTENINGS: usize = 40;

/// How often a direction is refined by the change of damping directions.
const REFINEMENTS: usize = 8;

/// Digits of φ that rounding leaves, relative to the magnitudes of its terms.
const NOISE: f64 = 1e-13;

/// The nonlinear equations of a step: linear system, options and buffers, all full-length.
pub(super) struct Newton<'s> {
    pub linear: LinearSystem<'s>,
    options: NewtonOptions,
    /// Whether there are forces without a potential: of damping, or external.
    is_damped: bool,
    /// δ; its prescribed entries are given, its free ones the solution.
    pub displacement: Vec<Vector3<f64>>,
    /// −r at the point last evaluated.
    force: Vec<Vector3<f64>>,
    /// Δ, its last part, and the right-hand side for that.
    direction: Vec<Vector3<f64>>,
    part: Vec<Vector3<f64>>,
    defect: Vec<Vector3<f64>>,
    trial: State,
}

impl<'s> Newton<'s> {
    pub fn new(system: &'s System, state: &State, implicit: &ImplicitOptions, options: NewtonOptions) -> Result<Self> {
        Ok(Self::of(LinearSystem::new(system, state, implicit)?, state, options))
    }

    /// With the linear system given.
    pub fn of(linear: LinearSystem<'s>, state: &State, options: NewtonOptions) -> Self {
        let system = linear.system;
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self {
            linear,
            options,
            is_damped: system.is_damped() || system.has_external_forces(),
            displacement: zeros(),
            force: zeros(),
            direction: zeros(),
            part: zeros(),
            defect: zeros(),
            trial: state.clone(),
        }
    }

    /// Solves for the free entries of `displacement` over dt seconds from a state.
    ///
    /// Where the iteration from the predicted state comes to nothing, it starts again from staying.
    pub fn solve(&mut self, state: &State, dt: f64) -> Result<(), StepFailure> {
        let coast = self.start(state, dt, 1.0);
        let solved = coast.and_then(|point| self.iterate(point, state, dt, self.linear.policy, false));
        match solved {
            Err(failure) if has_no_way(&failure) => {
                let stay = self.start(state, dt, 0.0)?;
                self.iterate(stay, state, dt, self.linear.policy, false)
            }
            solved => solved,
        }
    }

    /// Applies the resolvent of the matrix at hand to an error, see [`LinearSystem::resolve`].
    pub fn resolve(&mut self, tau: f64, error: &mut PropagatedError) {
        self.defect.fill(Vector3::zeros());
        let e = [&mut error.positions[..], &mut error.velocities[..]];
        self.linear.resolve(tau, e, &mut self.defect, &mut self.part);
    }

    /// As [`solve`](Self::solve) from where `displacement` is, and only until a whole step leaves less to correct than it corrected
    /// itself.
    pub fn refine(&mut self, state: &State, dt: f64) -> Result<(), StepFailure> {
        let point = self.evaluate(state, dt, 0.0)?;
        self.iterate(point, state, dt, Stiffness::Tension.into(), true)
    }

    fn iterate(
        &mut self,
        mut point: Point,
        state: &State,
        dt: f64,
        policy: StiffnessPolicy,
        is_loose: bool,
    ) -> Result<(), StepFailure> {
        let mut filter = Filter::new(policy);
        let mut forcing = Forcing::new(self.linear.exactness.strictest());
        let mut iterations = 0;
        loop {
            let balance = {
                let Self { linear, trial, part, .. } = self;
                Balance::of(linear.system, &linear.extensions, [state, trial], dt, part)
            };
            let target = self.options.tolerance * balance.forces + balance.rounding;
            let failed = move |reason| {
                let relative_residual = point.residual / balance.forces;
                Err(StepFailure::Newton { iterations, relative_residual, reason })
            };
            if point.residual <= target {
                self.linear.statistics.record(point.residual / balance.forces.max(f64::MIN_POSITIVE));
                return Ok(());
            }
            if iterations >= self.options.iteration_limit {
                return failed(NotSolved::IterationLimit);
            }
            iterations += 1;
            self.linear.statistics.work.newton_iterations += 1;
            let eta = forcing.next(point.residual, target);
            [point.slope, point.damping_slope] = self.direct(&mut filter, Combination::step(dt), eta)?;
            if point.slope >= 0.0 {
                return failed(NotSolved::Ascent);
            }
            let Some((step, next)) = self.line_search(state, dt, point) else {
                return failed(NotSolved::LineSearch);
            };
            filter.learn(step, next.residual / point.residual, self.linear.is_softened());
            // Along the direction the matrix has the norm −rᵀΔ.
            if is_loose && step == 1.0 && self.left() < -point.slope {
                return Ok(());
            }
            point = next;
        }
    }

    /// Evaluates r at `displacement`, without the potential; returns its slope along Δ.
    pub fn residual(&mut self, state: &State, dt: f64) -> Result<f64, StepFailure> {
        self.place(state, dt, 0.0)?;
        let Self { linear, force, direction, trial, .. } = self;
        let system = linear.system;
        for (p, mass) in system.masses().iter().enumerate() {
            force[p] = (trial.velocities[p] - state.velocities[p]) * (-mass / dt) + system.gravity() * *mass;
        }
        add_elastic_force(system, &linear.extensions, force);
        add_external_forces(system, &trial.moment(), force);
        if system.is_damped() {
            add_damping_force(system, &linear.extensions, &trial.velocities, force);
        }
        let slope = -dot(system, force, direction);
        if free_norm(system, force).is_finite() && slope.is_finite() { Ok(slope) } else { Err(StepFailure::NonFinite) }
    }

    /// Moves by `Δ = A⁻¹(−r)` with the matrix last prepared; returns `Δᵀ A Δ`. Prescribed coordinates must be where they are to be.
    /// `error` is ‖E‖_M of the step with a displacement and Δ, in m √kg.
    pub fn correct(&mut self, error: impl Fn(&[Vector3<f64>], &[Vector3<f64>]) -> f64) -> Result<f64, SolveFailure> {
        let Self { linear, force, direction, displacement, .. } = self;
        direction.fill(Vector3::zeros());
        let solution = linear.solve_within(force, direction, |d| error(displacement, d))?;
        linear.statistics.record(solution.relative_residual);
        let energy = dot(linear.system, force, direction);
        self.move_by(1.0);
        Ok(energy)
    }

    /// Takes the last move back.
    pub fn take_back(&mut self) {
        self.move_by(-1.0);
    }

    /// Δ.
    pub fn direction(&self) -> &[Vector3<f64>] {
        &self.direction
    }

    /// About what `Δᵀ A Δ` of the next direction with the same matrix will be.
    pub fn left(&mut self) -> f64 {
        self.linear.block_energy(&self.force)
    }

    /// Starts from a part of the way to the state predicted by the velocities: none is staying, all of it coasting.
    fn start(&mut self, state: &State, dt: f64, part: f64) -> Result<Point, StepFailure> {
        let dofs = self.linear.system.dofs();
        for (p, v) in state.velocities.iter().enumerate() {
            for axis in dofs.free_axes(p).iter() {
                self.displacement[p][axis] = v[axis] * (part * dt);
            }
            self.direction[p].fill(0.0);
        }
        self.evaluate(state, dt, 0.0)
    }

    /// Sets the trial state and its extensions to `displacement + step·direction`.
    fn place(&mut self, state: &State, dt: f64, step: f64) -> Result<(), StepFailure> {
        let Self { linear, displacement, direction, trial, .. } = self;
        for p in 0..linear.system.particles() {
            let d = displacement[p] + direction[p] * step;
            trial.positions[p] = state.positions[p] + d;
            trial.velocities[p] = d / dt;
        }
        trial.time = state.time + dt;
        linear.statistics.work.force_evaluations += 1;
        linear.set_extensions(&*trial)
    }

    /// Evaluates r at `displacement + step·direction`, and its slope and work along the direction.
    fn evaluate(&mut self, state: &State, dt: f64, step: f64) -> Result<Point, StepFailure> {
        self.place(state, dt, step)?;
        let Self { linear, force, direction, trial, .. } = self;
        let system = linear.system;
        let own = system.own_particles();
        let (mut potential, mut noise, mut rounding) = (0.0, 0.0, 0.0);
        let mut add = |energy: f64| {
            potential += energy;
            noise += NOISE * energy.abs();
        };
        for (p, mass) in system.masses().iter().enumerate() {
            let change = trial.velocities[p] - state.velocities[p];
            force[p] = change * (-mass / dt);
            if p >= own {
                continue;
            }
            add(0.5 * mass * change.norm_squared());
            // The change is a small difference of rounded velocities.
            rounding += f64::EPSILON * mass * change.norm() * (state.velocities[p].norm() + trial.velocities[p].norm());
            add(-mass * system.gravity().dot(&trial.velocities[p]) * dt);
        }
        for ((number, [i, j], spring), at) in linear.extensions.springs(system) {
            if !system.owns_spring(number) {
                continue;
            }
            add(system.elastic_energy_with(linear.extensions.law(), number, at, trial.time));
            // Far from the origin a rounded position is a displacement, against which the spring does work.
            let reach = trial.positions[i].norm() + trial.positions[j].norm();
            rounding += f64::EPSILON * (spring.stiffness * spring.strain(at)).abs() * reach;
        }
        let [potential, noise, rounding] = system.total([potential, noise, rounding]);
        let noise = noise + rounding;
        add_elastic_force(system, &linear.extensions, force);
        add_weight(system, force);
        let conservative = -dot(system, force, direction);
        add_damping_force(system, &linear.extensions, &trial.velocities, force);
        add_external_forces(system, &trial.moment(), force);
        let residual = free_norm(system, force);
        if !(residual.is_finite() && noise.is_finite()) {
            return Err(StepFailure::NonFinite);
        }
        let slope = -dot(system, force, direction);
        Ok(Point { residual, potential, noise, slope, damping_slope: slope - conservative })
    }

    /// Prepares the matrix and sets the direction; see [`set_direction`](Self::set_direction).
    fn direct(&mut self, filter: &mut Filter, step: Combination, forcing: f64) -> Result<[f64; 2], SolveFailure> {
        filter.relax();
        loop {
            let prepared = match filter.matrix() {
                Matrix::Filtered(policy) => self.linear.prepare(policy, step),
                Matrix::Shifted(shift) => {
                    self.linear.prepare_whole(Combination { mass: step.mass * (1.0 + shift), ..step })
                }
            };
            match prepared.and_then(|()| self.set_direction(forcing)) {
                Err(SolveFailure::Indefinite(_)) if filter.raise() => {}
                outcome => return outcome,
            }
        }
    }

    /// Solves `J Δ = −r` to `‖J Δ + r‖ ≤ η ‖r‖` with the prepared matrix; returns the slopes along Δ at the current point.
    fn set_direction(&mut self, forcing: f64) -> Result<[f64; 2], SolveFailure> {
        let Self { linear, force, direction, part, defect, trial, .. } = self;
        let system = linear.system;
        linear.set_tolerance(forcing);
        direction.fill(Vector3::zeros());
        linear.solve(force, direction)?;
        let mut slope = -dot(system, force, direction);
        if !self.is_damped {
            return Ok([slope, 0.0]);
        }
        part.copy_from_slice(direction);
        let target = forcing * free_norm(system, force);
        let mut last = f64::INFINITY;
        for _ in 0..REFINEMENTS {
            defect.fill(Vector3::zeros());
            add_damping_differential(system, &linear.extensions, &trial.velocities, part, defect);
            let size = free_norm(system, defect);
            // Springs that turn so far that refinement does not contract are far from the solution: A alone will do.
            if size <= target || size > 0.5 * last {
                break;
            }
            last = size;
            part.fill(Vector3::zeros());
            linear.solve(defect, part)?;
            let change = -dot(system, force, part);
            if slope + change > 0.5 * slope {
                break;
            }
            slope += change;
            for (d, part) in direction.iter_mut().zip(&*part) {
                *d += part;
            }
        }
        defect.fill(Vector3::zeros());
        add_damping_force(system, &linear.extensions, &trial.velocities, defect);
        add_external_forces(system, &trial.moment(), defect);
        Ok([slope, -dot(system, defect, direction)])
    }

    /// Shortens the step along `direction` until φ falls enough, and takes it.
    fn line_search(&mut self, state: &State, dt: f64, from: Point) -> Option<(f64, Point)> {
        let mut step = 1.0;
        for _ in 0..SHORTENINGS {
            match self.evaluate(state, dt, step) {
                Ok(point) if point.is_lower(&from, step) => {
                    self.move_by(step);
                    return Some((step, point));
                }
                Ok(point) => step *= point.shortening(&from),
                // A trial that overflows or collapses a spring is only too long.
                Err(_) => step *= 0.5,
            }
        }
        None
    }

    fn move_by(&mut self, step: f64) {
        for (d, direction) in self.displacement.iter_mut().zip(&self.direction) {
            *d += direction * step;
        }
    }
}

/// Of all parts of a system together.
fn dot(system: &System, a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let [dot] = system.total([a.iter().zip(b).take(system.own_particles()).map(|(a, b)| a.dot(b)).sum()]);
    dot
}

/// The Euclidean norm over free coordinates.
fn free_norm(system: &System, v: &[Vector3<f64>]) -> f64 {
    let dofs = system.dofs();
    let own = v.iter().enumerate().take(system.own_particles());
    let squares = own.map(|(p, v)| dofs.free_axes(p).iter().map(|axis| v[axis] * v[axis]).sum::<f64>());
    let [square] = system.total([squares.sum()]);
    square.sqrt()
}

/// Whether another start may help: where there is no way on, not where matrices are refused or the way is too long.
fn has_no_way(failure: &StepFailure) -> bool {
    match failure {
        StepFailure::Newton { reason, .. } => *reason != NotSolved::IterationLimit,
        StepFailure::NonFinite | StepFailure::DegenerateSpring(_) => true,
        _ => false,
    }
}

#[cfg(test)]
mod tests;
