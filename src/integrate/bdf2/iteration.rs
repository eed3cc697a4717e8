//! The quasi-Newton iteration of a step: from a prediction, with the exact residual, and as often as the residual asks for.
//!
//! **Enough.** After the correction d = −A⁻¹ r(y) the residual at y + d is evaluated. It says what the next correction would be:
//! with D the 3×3 diagonal blocks of A, `√(r' D⁻¹ r')` is about its norm in A. One correction is enough as long as this is
//! less than the norm `√(dᵀ A d)` of the one just made, and r' has not turned against it,
//!
//! ```text
//! r'ᵀ D⁻¹ r' < dᵀ A d      and      −r'ᵀ d > −½ dᵀ A d.
//! ```
//!
//! The second says that the incremental potential has fallen, see [`Newton`]. On motions that the steps resolve both hold by far:
//! the quotient falls with the square of the step. A step that fails them is one that would grow, and grow further in the
//! next step: the iteration diverges.
//!
//! **More.** Then the iteration goes on as Newton's method with line search does, with `tension` at each point that it reaches, until a
//! full step is enough in this sense. It is not driven on to convergence: what one more iteration changes is then less than what the step's
//! own prediction was off by, and the equations of a step that resolves nothing have solutions that no motion has. (A cloth swings
//! down with steps of a 60th of a second to 6 % of its extent with one iteration a step, and to 130 % with equations solved to the last
//! digit.)

use super::tension::Tensions;
use crate::force::set_accelerations;
use crate::integrate::implicit::LinearSystem;
use crate::integrate::linear_tolerance::mass_norm;
use crate::integrate::newton::{Newton, NewtonOptions};
use crate::integrate::{PropagatedError, Statistics, StepFailure, StiffnessPolicy};
use crate::linear::{LinearSolver, SolveFailure};
use crate::operator::Combination;
use crate::system::{State, System};
use nalgebra::Vector3;

/// How exactly iterative solvers solve at most for a correction, which is of the size of a step's error: without a preconditioner errors may be
/// a hundred times what residuals show.
const CORRECTION: f64 = 1e-7;

/// The equations of a step and what solves them.
pub(super) struct Iteration<'s> {
    newton: Newton<'s>,
    tensions: Tensions,
}

impl<'s> Iteration<'s> {
    pub fn new(mut linear: LinearSystem<'s>, state: &State) -> Self {
        linear.exactness.never_below(CORRECTION);
        let tensions = Tensions::new(linear.system);
        Self { newton: Newton::of(linear, state, NewtonOptions::default()), tensions }
    }

    pub fn system(&self) -> &'s System {
        self.newton.linear.system
    }

    pub fn solver(&self) -> &dyn LinearSolver {
        self.newton.linear.solver()
    }

    pub fn statistics(&self) -> &Statistics {
        &self.newton.linear.statistics
    }

    /// Says that the next step has no past: its springs have the tensions at its start.
    pub fn forget(&mut self, state: &State) {
        self.tensions.set(self.newton.linear.system, state);
    }

    /// To count what belongs to the stepper.
    pub fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.newton.linear.statistics
    }

    /// Sets `accelerations` to M⁻¹f at a state, and to zero where coordinates are prescribed.
    pub fn accelerations(&mut self, state: &State, accelerations: &mut [Vector3<f64>]) -> Result<(), StepFailure> {
        let linear = &mut self.newton.linear;
        let system = linear.system;
        linear.statistics.work.force_evaluations += 1;
        linear.set_extensions(state)?;
        set_accelerations(system, &linear.extensions, &state.moment(), accelerations);
        Ok(())
    }

    /// Applies the resolvent of the matrix at hand to an error.
    pub fn resolve(&mut self, tau: f64, error: &mut PropagatedError) {
        self.newton.resolve(tau, error);
    }

    /// Solves for `next`, which is the prediction on entry, of velocities too, by a backward Euler step over τ seconds from `base`; the step itself
    /// starts at `state`.
    pub fn solve(&mut self, state: &State, base: &State, next: &mut State, tau: f64) -> Result<(), StepFailure> {
        let Self { newton, tensions } = self;
        for (p, d) in newton.displacement.iter_mut().enumerate() {
            *d = next.positions[p] - base.positions[p];
        }
        newton.residual(base, tau)?;
        prepare(newton, tensions, state, next, tau)?;
        // A correction that overshoots, or that leads where there are no forces, is taken back.
        // The formula's local error in positions, by differences of velocities: ⅓ τ (v' − v_predicted), see `estimate`.
        let system = newton.linear.system;
        let error = |y: &[Vector3<f64>], d: &[Vector3<f64>]| {
            mass_norm(system, |p| ((y[p] + d[p]) / tau - next.velocities[p]) * (tau / 3.0))
        };
        let Corrected { energy, slope, left } = correct(newton, tensions, base, tau, error)?;
        if slope >= 0.5 * energy {
            newton.take_back();
        }
        if slope >= 0.5 * energy || left >= energy {
            newton.refine(base, tau)?;
        }
        for (p, d) in newton.displacement.iter().enumerate() {
            next.positions[p] = base.positions[p] + d;
            next.velocities[p] = d / tau;
        }
        Ok(())
    }
}

/// What a correction d did.
struct Corrected {
    /// dᵀ A d.
    energy: f64,
    /// −r'ᵀ d after it.
    slope: f64,
    /// r'ᵀ D⁻¹ r'.
    left: f64,
}

/// Corrects once with the matrix at hand, from where the residual was evaluated last, as exactly as a step is worth that has this error
/// with a displacement and its correction.
fn correct(
    newton: &mut Newton,
    tensions: &mut Tensions,
    base: &State,
    tau: f64,
    error: impl Fn(&[Vector3<f64>], &[Vector3<f64>]) -> f64,
) -> Result<Corrected, StepFailure> {
    let energy = newton.correct(error)?;
    tensions.learn(newton.linear.system, &newton.linear.extensions, newton.direction());
    Ok(match newton.residual(base, tau) {
        Ok(slope) => Corrected { energy, slope, left: newton.left() },
        Err(_) => Corrected { energy, slope: f64::INFINITY, left: f64::INFINITY },
    })
}

/// Takes over the matrix at the prediction `next` of a step from `state`.
fn prepare(
    newton: &mut Newton,
    tensions: &Tensions,
    state: &State,
    next: &State,
    tau: f64,
) -> Result<(), SolveFailure> {
    let linear = &mut newton.linear;
    let step = Combination::step(tau);
    let StiffnessPolicy::OnDemand = linear.policy else {
        return linear.prepare(linear.policy, step);
    };
    let system = linear.system;
    linear.prepare_with(step, |position, spring, at| {
        let [i, j] = system.pair(system.active_springs()[position] as usize);
        let moved = |p: usize| next.positions[p] - state.positions[p];
        tensions.transverse(position, spring, at, &(moved(i) - moved(j)))
    })
}
