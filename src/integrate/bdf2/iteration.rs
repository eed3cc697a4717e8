//! The quasi-Newton iteration of a step: from a prediction, with the exact residual, as often as the residual requires.
//!
//! **One correction is enough** as long as the next is estimated to be smaller. With the residual r' after the correction d = −A⁻¹ r(y), and D
//! the 3×3 diagonal blocks of A, `√(r'ᵀ D⁻¹ r')` is about the norm in A of the next correction. The criterion is
//!
//! ```text
//! r'ᵀ D⁻¹ r' < dᵀ A d      and      −r'ᵀ d > −½ dᵀ A d.
//! ```
//!
//! The second says that the incremental potential has fallen, see [`Newton`]. Otherwise the iteration goes on as Newton's method with line search,
//! with `tension` at each point, until a full step is enough in this sense. It does not converge further: the equations of a step that resolves
//! nothing have solutions that no motion has.
//!
//! **The default transverse stiffness** is that of the tension that lasts. Without the transverse term T/l of a spring under the tension T the
//! iteration does not converge on a taut string with long steps; with the tension at the prediction y it converges badly where springs turn, as one
//! that turns by u across itself is stretched by u²/(2 l) at y, which the step takes away again. So the matrix has
//!
//! ```text
//! T = min(T_y, T_last) − C (k/l0) u²/(2 l),      the transverse term T/l where T > 0, none elsewhere,
//! ```
//!
//! with the tension T_y at y, and T_last of the last solve by its own, linear account, `k (l/l0 − 1 + nᵀ(d_i − d_j)/l0)`; without a past it is the
//! tension at the step's start. With T ≥ 0 the matrix is positive definite.

use crate::force::SpringGeometry;
use crate::integrate::linear_tolerance::mass_norm;
use crate::integrate::newton::Newton;
use crate::integrate::{StepFailure, StiffnessPolicy};
use crate::linear::SolveFailure;
use crate::operator::Combination;
use crate::spring::{Extension, Spring};
use crate::system::{State, System};
use nalgebra::Vector3;

/// Solves for `next`, on entry the prediction, by a backward Euler step over τ seconds from `base`; the step itself starts at `state`.
pub(super) fn solve(
    newton: &mut Newton,
    tensions: &mut Tensions,
    state: &State,
    base: &State,
    next: &mut State,
    tau: f64,
) -> Result<(), StepFailure> {
    let system = newton.linear.system;
    for (p, d) in newton.displacement.iter_mut().enumerate() {
        *d = next.positions[p] - base.positions[p];
    }
    newton.residual(base, tau)?;
    prepare(newton, tensions, state, next, tau)?;
    // The formula's local error in positions, by differences of velocities: ⅓ τ (v' − v_predicted), see `history`.
    let error = |y: &[Vector3<f64>], d: &[Vector3<f64>]| {
        mass_norm(system, |p| ((y[p] + d[p]) / tau - next.velocities[p]) * (tau / 3.0))
    };
    // dᵀ A d, then −r'ᵀ d and r'ᵀ D⁻¹ r'.
    let energy = newton.correct(error)?;
    tensions.record(system, &newton.linear.extensions, &newton.direction);
    let (slope, left) = match newton.residual(base, tau) {
        Ok(slope) => (slope, newton.residual_energy()),
        Err(_) => (f64::INFINITY, f64::INFINITY),
    };
    let overshoots = slope >= 0.5 * energy;
    if overshoots {
        newton.move_by(-1.0);
    }
    if overshoots || left >= energy {
        newton.refine(base, tau)?;
    }
    for (p, d) in newton.displacement.iter().enumerate() {
        next.positions[p] = base.positions[p] + d;
        next.velocities[p] = d / tau;
    }
    Ok(())
}
fn prepare(
    newton: &mut Newton,
    tensions: &Tensions,
    state: &State,
    next: &State,
    tau: f64,
) -> Result<(), SolveFailure> {
    let linear = &mut newton.linear;
    let step = Combination::step(tau);
    if linear.policy != StiffnessPolicy::OnDemand {
        linear.begin(&newton.force, true);
        return linear.prepare(linear.policy, step);
    }
    let system = linear.system;
    linear.prepare_with(step, |position, spring, at| {
        let [i, j] = system.pair(system.active_springs()[position] as usize);
        let moved = |p: usize| next.positions[p] - state.positions[p];
        tensions.transverse(position, spring, at, &(moved(i) - moved(j)))
    })
}

/// C. For cloths that swing down with steps of 5 to 17 ms the error is the same for C from 4 to 50, and up to ten times larger for 0.
const TURNING: f64 = 8.0;

/// T_last of every active spring, in N.
pub(super) struct Tensions(Vec<f64>);

impl Tensions {
    pub fn new(system: &System) -> Self {
        Self(vec![0.0; system.active_springs().len()])
    }

    /// Sets the tensions to those at a state.
    pub fn set(&mut self, system: &System, state: &State) {
        let law = system.law_values(&state.positions, state.time);
        for (last, (number, [i, j], _)) in self.0.iter_mut().zip(system.active()) {
            // Coincident ends have no tension that lasts, and a step from there fails for its own reasons.
            let extension = Extension::between(&state.positions[i], &state.positions[j]);
            let spring = |length| system.spring_with(&law, number, length, state.time);
            *last = extension.map_or(0.0, |at| tension(&spring(at.length), &at));
        }
    }

    /// Sets the tensions to those of a solve, with the correction `displacement` of the positions that have these extensions.
    pub fn record(&mut self, system: &System, extensions: &SpringGeometry, displacement: &[Vector3<f64>]) {
        for (last, ((_, [i, j], spring), at)) in self.0.iter_mut().zip(extensions.springs(system)) {
            let stretch = at.direction.dot(&(displacement[i] - displacement[j]));
            *last = tension(spring, at) + spring.axial_stiffness() * stretch;
        }
    }

    /// The transverse coefficient of the spring at a position among the active ones, in N/m, whose ends have moved relative to each other by `moved`.
    fn transverse(&self, position: usize, spring: &Spring, at: &Extension, moved: &Vector3<f64>) -> f64 {
        // Without a rest length all directions are alike.
        if spring.rest_length == 0.0 {
            return spring.axial_stiffness();
        }
        let across = moved.norm_squared() - at.direction.dot(moved).powi(2);
        let turning = TURNING * spring.axial_stiffness() * across / (2.0 * at.length);
        let lasting = tension(spring, at).min(self.0[position]) - turning;
        lasting.max(0.0) / at.length
    }
}

/// `k (l/l0 − 1)`, in N.
fn tension(spring: &Spring, at: &Extension) -> f64 {
    spring.stiffness * spring.strain(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::fixtures::tethered;

    /// A spring of 2 m at rest with k = 30 N, 3 m long: T = 15 N, T/l = 5 N/m.
    #[test]
    fn lasting_tension_is_reduced_by_turning() {
        let (system, state) = tethered(3.0, 1.0, Spring { stiffness: 30.0, rest_length: 2.0, damping: 0.0 });
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let (spring, at) = (system.springs()[0], extensions.as_slice()[0]);
        let mut tensions = Tensions::new(&system);
        let still = Vector3::zeros();
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 0.0);
        tensions.set(&system, &state);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 5.0);
        // Moving along the spring is no turning; 0.2 m across stretch by 0.04/6 m, of 15 N/m.
        assert_eq!(tensions.transverse(0, &spring, &at, &Vector3::new(0.5, 0.0, 0.0)), 5.0);
        let turned = tensions.transverse(0, &spring, &at, &Vector3::new(0.5, 0.2, 0.0));
        assert!((turned - (15.0 - TURNING * 0.1) / 3.0).abs() < 1e-12, "{turned}");
        assert_eq!(tensions.transverse(0, &spring, &at, &Vector3::new(0.0, 2.0, 0.0)), 0.0);
        // A solve that takes 0.6 m of the metre away leaves 6 N, one that adds to it no more than there is.
        tensions.record(&system, &extensions, &[Vector3::new(0.25, 9.0, 0.0), Vector3::new(-0.35, 0.0, 0.0)]);
        let left = tensions.transverse(0, &spring, &at, &still);
        assert!((left - 2.0).abs() < 1e-12, "{left}");
        tensions.record(&system, &extensions, &[Vector3::new(-0.25, 0.0, 0.0), Vector3::zeros()]);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 5.0);
        tensions.record(&system, &extensions, &[Vector3::new(1.1, 0.0, 0.0), Vector3::zeros()]);
        assert_eq!(tensions.transverse(0, &spring, &at, &still), 0.0);
    }
}
