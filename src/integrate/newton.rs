//! Newton's method for the equations of a backward Euler step; implicit midpoint solves the same ones over half a step.
//!
//! The displacement δ over dt seconds solves, on the free coordinates,
//!
//! ```text
//! r(δ) = M (δ/dt − v)/dt − f_el(x + δ) − f_d(x + δ, δ/dt) − g = 0.
//! ```
//!
//! **Direction.** The Jacobian of r is `J = A − D` with `A = M/dt² − G/dt − K` at x + δ, and D the change of the damping force when springs turn
//! ([`Spring::damping_differential`](crate::Spring::damping_differential)), which is not symmetric but small. So `J Δ = −r` is solved by refinement,
//! `A Δ₀ = −r`, `A Δ_{i+1} = D Δ_i`, `Δ = Σ Δ_i`, to `‖J Δ + r‖ ≤ η ‖r‖` with a [`Forcing`] term η, which is the tolerance of conjugate gradients
//! too.
//!
//! **Globalisation.** Without damping r is the gradient of the incremental potential
//!
//! ```text
//! Φ(δ) = ½ (δ/dt − v)ᵀ M (δ/dt − v) + U(x + δ) − gᵀδ,
//! ```
//!
//! to which the work of the damping forces along the line searched is added, `−∫ f_dᵀ dδ` by the trapezoidal rule. Their sum φ has the slope
//! `φ' = rᵀΔ`, and a step s must bring the decrease `φ(s) ≤ φ(0) + c s φ'(0)` (Armijo). Near the solution φ is all rounding; then its slope must have
//! fallen, `φ'(s) ≤ (1 − 2c)|φ'(0)|`, which for a quadratic φ says the same (the "approximate Wolfe" condition of Hager and Zhang, 2005). Without
//! damping φ(0) is the largest Φ of the last ten iterations (Grippo, Lampariello and Lucidi, SIAM J. Numer. Anal. 23, 1986): a long step that turns
//! springs stretches them to second order, which the next step undoes. The iteration starts from the predicted state, δ = dt v, and where it fails
//! from there, again from rest, δ = 0.
//!
//! **The matrix** is that of the stiffness option as long as it serves, and otherwise one that does, see [`MatrixChoice`].

mod control;

pub(super) use control::Forcing;

use super::implicit::LinearSystem;
use super::{NotSolved, PropagatedError, StepFailure, StiffnessPolicy, free_square, sum_of_all};
use crate::error::{Invalid, Result};
use crate::force::{add_damping_differential, add_damping_force, add_elastic_force, add_external_forces, add_weight};
use crate::linear::SolveFailure;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{State, System};
use control::{ForceBalance, MatrixChoice, NewtonMatrix, Point};
use nalgebra::Vector3;

/// The convergence criterion and iteration limit of Newton's method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonOptions {
    /// Converged at `‖r‖ ≤ tolerance·s`, s the norm of the magnitudes of the forces that balance in r (and never
    /// below the change of r by rounding of the positions).
    pub tolerance: f64,
    /// The most iterations a step may take.
    pub iteration_limit: u64,
}

impl NewtonOptions {
    /// Checks that the tolerance is finite and not negative, as every stepper does.
    ///
    /// # Errors
    /// [`Invalid`] with the tolerance.
    pub fn check(&self) -> Result<(), Invalid> {
        if self.tolerance.is_finite() && self.tolerance >= 0.0 {
            return Ok(());
        }
        Err(Invalid::new("newton.tolerance", self.tolerance, "must be finite and not negative"))
    }
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { tolerance: 1e-10, iteration_limit: 200 }
    }
}

/// Digits of φ lost by rounding, relative to the magnitudes of its terms.
const NOISE: f64 = 1e-13;

/// The nonlinear equations of a step: linear system, options and buffers, all full-length.
pub(super) struct Newton<'s> {
    pub linear: LinearSystem<'s>,
    options: NewtonOptions,
    /// True if an option stays where another matrix would do better, for comparisons.
    pub keeps_option: bool,
    /// True if there are forces without a potential: of damping, or external.
    is_damped: bool,
    /// δ; its prescribed entries are given, its free ones the solution.
    pub displacement: Vec<Vector3<f64>>,
    /// −r at the last point evaluated.
    pub force: Vec<Vector3<f64>>,
    /// Δ, its last term, and the right-hand side for that.
    pub direction: Vec<Vector3<f64>>,
    term: Vec<Vector3<f64>>,
    defect: Vec<Vector3<f64>>,
    trial: State,
}

impl<'s> Newton<'s> {
    pub fn new(linear: LinearSystem<'s>, state: &State, options: NewtonOptions) -> Result<Self> {
        options.check()?;
        let system = linear.system;
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Ok(Self {
            linear,
            options,
            keeps_option: false,
            is_damped: system.is_damped() || system.has_external_forces(),
            displacement: zeros(),
            force: zeros(),
            direction: zeros(),
            term: zeros(),
            defect: zeros(),
            trial: state.clone(),
        })
    }

    /// Solves for the free entries of `displacement` over dt seconds from a state.
    pub fn solve(&mut self, state: &State, dt: f64) -> Result<(), StepFailure> {
        let predicted = self.start(state, dt, 1.0);
        match predicted.and_then(|point| self.iterate(point, state, dt, self.linear.policy, false)) {
            Err(failure) if may_start_again(&failure) => {
                let rest = self.start(state, dt, 0.0)?;
                self.iterate(rest, state, dt, self.linear.policy, false)
            }
            solved => solved,
        }
    }

    /// As [`solve`](Self::solve) from the current `displacement`, and only until a whole step leaves a smaller correction than its own.
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
        ends_early: bool,
    ) -> Result<(), StepFailure> {
        let mut choice = MatrixChoice::new(policy);
        let mut forcing = Forcing::new(self.linear.adaptive_tolerance.strictest);
        let mut iterations = 0;
        let mut recent = [f64::NEG_INFINITY; 10];
        loop {
            let Self { linear, trial, term, .. } = self;
            let balance = ForceBalance::new(linear.system, &linear.extensions, [state, trial], dt, term);
            let target = self.options.tolerance * balance.forces + balance.rounding;
            let failed = move |reason| {
                let relative_residual = point.residual / balance.forces;
                Err(StepFailure::Newton { iterations, relative_residual, reason })
            };
            if point.residual <= target {
                self.linear.statistics.record_residual(point.residual / balance.forces.max(f64::MIN_POSITIVE));
                return Ok(());
            }
            if iterations >= self.options.iteration_limit {
                return failed(NotSolved::IterationLimit);
            }
            iterations += 1;
            self.linear.statistics.work.newton_iterations += 1;
            self.linear.begin(&self.force, iterations == 1);
            let eta = forcing.next(point.residual, target);
            [point.slope, point.damping_slope] = self.prepare_direction(&mut choice, Combination::step(dt), eta)?;
            if point.slope >= 0.0 {
                return failed(NotSolved::Ascent);
            }
            recent[iterations as usize % recent.len()] = point.potential;
            let is_monotone = self.is_damped || ends_early;
            let highest =
                if is_monotone { point.potential } else { recent.into_iter().fold(point.potential, f64::max) };
            let Some((step, next)) = self.line_search(state, dt, point, highest) else {
                return failed(NotSolved::LineSearch);
            };
            if !self.keeps_option {
                choice.record(step, next.residual / point.residual, self.linear.is_regularized());
            }
            // Along the direction the matrix has the norm −rᵀΔ.
            if ends_early && step == 1.0 && self.residual_energy() < -point.slope {
                return Ok(());
            }
            point = next;
        }
    }

    /// Starts from this part of the displacement predicted by the velocities: all of it, or none, which is rest.
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
    fn set_trial(&mut self, state: &State, dt: f64, step: f64) -> Result<(), StepFailure> {
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

    /// Evaluates r at `displacement + step·direction`, its potential, and its slope and work along the direction.
    fn evaluate(&mut self, state: &State, dt: f64, step: f64) -> Result<Point, StepFailure> {
        self.set_trial(state, dt, step)?;
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
            // Rounding of a position is a displacement, against which the spring does work.
            let magnitude = trial.positions[i].norm() + trial.positions[j].norm();
            rounding += f64::EPSILON * (spring.stiffness * spring.strain(at)).abs() * magnitude;
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

    /// Evaluates r at `displacement`, without the potential; returns its slope along Δ.
    pub fn residual(&mut self, state: &State, dt: f64) -> Result<f64, StepFailure> {
        self.set_trial(state, dt, 0.0)?;
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

    /// Moves by `Δ = A⁻¹(−r)` with the prepared matrix; returns `Δᵀ A Δ`. Prescribed coordinates must be in place already.
    /// `error` is ‖E‖_M of the step with a displacement and Δ, in m √kg.
    pub fn correct(&mut self, error: impl Fn(&[Vector3<f64>], &[Vector3<f64>]) -> f64) -> Result<f64, SolveFailure> {
        let Self { linear, force, direction, displacement, .. } = self;
        direction.fill(Vector3::zeros());
        let solution = linear.solve_within(force, direction, |d| error(displacement, d))?;
        linear.statistics.record_residual(solution.relative_residual);
        let energy = dot(linear.system, force, direction);
        self.move_by(1.0);
        Ok(energy)
    }

    pub fn move_by(&mut self, step: f64) {
        for (d, direction) in self.displacement.iter_mut().zip(&self.direction) {
            *d += direction * step;
        }
    }

    /// An estimate of `Δᵀ A Δ` for the next direction with the same matrix.
    pub fn residual_energy(&mut self) -> f64 {
        self.linear.block_energy(&self.force)
    }

    /// Prepares the matrix and sets the direction; see [`set_direction`](Self::set_direction).
    fn prepare_direction(
        &mut self,
        choice: &mut MatrixChoice,
        step: Combination,
        forcing: f64,
    ) -> Result<[f64; 2], SolveFailure> {
        choice.lower_shift();
        loop {
            let prepared = match choice.matrix {
                NewtonMatrix::Policy(policy) => self.linear.prepare(policy, step),
                NewtonMatrix::Shifted(shift) => {
                    self.linear.prepare_whole(Combination { mass: step.mass * (1.0 + shift), ..step })
                }
            };
            match prepared.and_then(|()| self.set_direction(forcing)) {
                Err(SolveFailure::Indefinite(_)) if choice.raise_shift() => {}
                outcome => return outcome,
            }
        }
    }

    /// Solves `J Δ = −r` to `‖J Δ + r‖ ≤ η ‖r‖` with the prepared matrix; returns the slopes along Δ at the current point.
    fn set_direction(&mut self, forcing: f64) -> Result<[f64; 2], SolveFailure> {
        let Self { linear, force, direction, term, defect, trial, .. } = self;
        let system = linear.system;
        direction.fill(Vector3::zeros());
        linear.solve(Some(forcing), force, direction)?;
        let mut slope = -dot(system, force, direction);
        if !self.is_damped {
            return Ok([slope, 0.0]);
        }
        term.copy_from_slice(direction);
        let target = forcing * free_norm(system, force);
        let mut last = f64::INFINITY;
        for _ in 0..8 {
            defect.fill(Vector3::zeros());
            add_damping_differential(system, &linear.extensions, &trial.velocities, term, defect);
            let size = free_norm(system, defect);
            // Where springs turn so far that refinement does not contract, the solution is far off, and A alone will do.
            if size <= target || size > 0.5 * last {
                break;
            }
            last = size;
            term.fill(Vector3::zeros());
            linear.solve(Some(forcing), defect, term)?;
            let change = -dot(system, force, term);
            if slope + change > 0.5 * slope {
                break;
            }
            slope += change;
            for (d, term) in direction.iter_mut().zip(&*term) {
                *d += term;
            }
        }
        defect.fill(Vector3::zeros());
        add_damping_force(system, &linear.extensions, &trial.velocities, defect);
        add_external_forces(system, &trial.moment(), defect);
        Ok([slope, -dot(system, defect, direction)])
    }

    /// Shortens the step along `direction` until φ is low enough below `highest`, and takes it.
    fn line_search(&mut self, state: &State, dt: f64, from: Point, highest: f64) -> Option<(f64, Point)> {
        let reference = Point { potential: highest, ..from };
        let mut step = 1.0;
        for _ in 0..40 {
            match self.evaluate(state, dt, step) {
                Ok(point) if point.is_lower(&reference, step) => {
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

    /// Applies the resolvent of the prepared matrix to an error, see [`LinearSystem::resolve`].
    pub fn resolve(&mut self, tau: f64, error: &mut PropagatedError) {
        self.defect.fill(Vector3::zeros());
        let e = [&mut error.positions[..], &mut error.velocities[..]];
        self.linear.resolve(tau, e, &mut self.defect, &mut self.term);
    }
}

fn dot(system: &System, a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    sum_of_all(system, |p| a[p].dot(&b[p]))
}

fn free_norm(system: &System, v: &[Vector3<f64>]) -> f64 {
    sum_of_all(system, |p| free_square(system, p, &v[p])).sqrt()
}

/// True if another start may help: where the iteration is stuck, but not where it takes too long or a matrix is refused.
fn may_start_again(failure: &StepFailure) -> bool {
    match failure {
        StepFailure::Newton { reason, .. } => *reason != NotSolved::IterationLimit,
        StepFailure::NonFinite | StepFailure::DegenerateSpring(_) => true,
        _ => false,
    }
}

#[cfg(test)]
mod tests;
