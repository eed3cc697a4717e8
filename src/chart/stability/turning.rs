//! The nonlinear tile: one particle that circles a fixed point on a spring.
//!
//! It starts at the rest length, moving across the spring so that a step turns it by the angle θ. The exact motion keeps the angular momentum; its
//! largest stretch λ follows from that and the energy: `(θ/z)² (λ + 1)/λ² = λ − 1`. After a turn by about one radian, 1/θ steps, a run has failed
//! whose angular momentum has fallen by more than a tenth (*braked*), or which has stretched the spring by one per cent more than the exact motion.
//!
//! **The limit of linearised backward Euler with the transverse term.** A step from the stretch λ turns the spring by `δ⊥ = v⊥ dt/(1 + z² (1 − 1/λ))`
//! and leaves the part `1/(1 + z² (1 − 1/λ))` of the angular momentum, exactly. On a steady circle `λ − 1 ≈ θ²/z²`, and the straight step adds
//! `½ θ²`: a step loses `θ² + ½ (zθ)²`, a radian `θ (1 + ½ z²)`, and the limit is
//!
//! ```text
//! θ (1 + ½ z²) = −ln 0.9      for small θ.
//! ```
//!
//! The first part is backward Euler's damping of every rotation, the second comes from linearising at the start of the step. Methods that keep
//! angular momentum (symplectic Euler, implicit midpoint, `axial`) are not braked; symplectic Euler and `axial` stretch the spring to `√(1 + θ²)`
//! in the first step.

use super::experiment::{TileVerdict, step};
use super::limits::{Limit, Prediction};
use crate::accuracy::Configuration;
use crate::error::Result;
use crate::force::Energy;
use crate::inspect::{MOST_BRAKED, MOST_STRETCHED};
use crate::integrate::{Method, StiffnessPolicy};
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};

fn model(angle: f64, z: f64) -> Result<(System, State)> {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let centre = builder.particle([0.0; 3], 1.0);
    let particle = builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(particle, centre, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(centre);
    let (system, mut state) = builder.build()?;
    state.velocities[particle].y = angle / z;
    Ok((system, state))
}

fn largest_stretch(angle: f64, z: f64) -> f64 {
    let ratio = (angle / z) * (angle / z);
    let pull = |stretch: f64| ratio * (stretch + 1.0) / (stretch * stretch) - (stretch - 1.0);
    // It falls with the stretch, from 2 (θ/z)² at 1, and is negative at 1 + 2 (θ/z)².
    let (mut low, mut high) = (1.0, 1.0 + 2.0 * ratio);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if pull(middle) > 0.0 { low = middle } else { high = middle }
    }
    high
}

/// Runs the model for a turn by one radian with steps `dt = z/ω` and says what fails first.
pub(super) fn experiment(configuration: &Configuration, z: f64, angle: f64) -> Result<TileVerdict> {
    let (system, mut state) = model(angle, z)?;
    let mut stepper = configuration.method.stepper(&system, &state, &configuration.options)?;
    let momentum = |state: &State| state.positions[1].cross(&state.velocities[1]).z;
    let energy = |state: &State| Energy::of(&system, state).total();
    let (before, most) = (momentum(&state), 2.0 * energy(&state));
    let limit = (1.0 + MOST_STRETCHED) * largest_stretch(angle, z);
    let mut stretched = false;
    for _ in 0..(1.0 / angle).ceil() as usize {
        let arm = state.positions[1].norm();
        if let Err(verdict) = step(&mut *stepper, &mut state, z, energy, (1, arm), most) {
            return Ok(verdict);
        }
        stretched |= state.positions[1].norm() > limit;
    }
    Ok(match momentum(&state) < (1.0 - MOST_BRAKED) * before {
        true => TileVerdict::Braked,
        false if stretched => TileVerdict::Stretched,
        false => TileVerdict::Stable,
    })
}

/// True where a method linearises at the start of the step, with the transverse term of stretched springs.
fn is_braked(method: Method, policy: StiffnessPolicy) -> bool {
    method == Method::LinearBackwardEuler && policy != StiffnessPolicy::Always(Stiffness::Axial)
}

fn goes_straight(method: Method, policy: StiffnessPolicy) -> bool {
    method == Method::SymplecticEuler || (method == Method::LinearBackwardEuler && !is_braked(method, policy))
}

/// The limits in closed form at a turning angle per step; none where there is none.
pub(super) fn limits(method: Method, policy: StiffnessPolicy, angle: f64) -> Vec<Limit> {
    let mut limits = Vec::new();
    let squared = 2.0 * (-(-MOST_BRAKED).ln_1p() / angle - 1.0);
    if is_braked(method, policy) && squared > 0.0 {
        limits.push(Limit { formula: "θ(1 + z²/2) = 0.105", z: squared.sqrt() });
    }
    // For large z the exact motion stretches the spring by 2θ²/z² at most.
    let excess = angle.hypot(1.0) / (1.0 + MOST_STRETCHED) - 1.0;
    if goes_straight(method, policy) && excess > 0.0 {
        limits.push(Limit { formula: "√(1 + θ²) = 1.01 (1 + 2θ²/z²)", z: angle * (2.0 / excess).sqrt() });
    }
    limits
}

/// The prediction of theory; `Silent` within a factor of a limit, and where it has none.
pub(super) fn prediction(method: Method, policy: StiffnessPolicy, z: f64, angle: f64, margin: f64) -> Prediction {
    // The limit is one for small angles: below 0.05 it holds to a third.
    let margin = margin.max(1.35);
    let Some(limit) = limits(method, policy, angle).first().copied() else { return Prediction::Silent };
    match is_braked(method, policy) {
        _ if z > margin * limit.z => Prediction::Unstable,
        true if angle < 0.05 && z < limit.z / margin => Prediction::Stable,
        _ => Prediction::Silent,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::ImplicitOptions;

    #[test]
    fn the_limit_is_where_runs_are_braked() {
        let options = |option: Stiffness| ImplicitOptions { stiffness: option.into(), ..ImplicitOptions::default() };
        let at = |method, option, z, angle| {
            experiment(&Configuration { method, options: options(option) }, z, angle).unwrap()
        };
        for angle in [0.003, 0.01, 0.03] {
            for option in [Stiffness::Full, Stiffness::Tension] {
                let limit = limits(Method::LinearBackwardEuler, option.into(), angle)[0].z;
                assert_eq!(at(Method::LinearBackwardEuler, option, limit / 1.2, angle), TileVerdict::Stable);
                assert_eq!(at(Method::LinearBackwardEuler, option, 1.2 * limit, angle), TileVerdict::Braked);
            }
            // Nothing but linearising with the transverse term at the start of the step is wrong there.
            for method in [Method::BackwardEuler, Method::ImplicitMidpoint] {
                assert_eq!(at(method, Stiffness::Full, 10.0, angle), TileVerdict::Stable, "{}", method.name());
            }
            assert_eq!(at(Method::LinearBackwardEuler, Stiffness::Axial, 10.0, angle), TileVerdict::Stable);
        }
        assert_eq!(at(Method::LinearBackwardEuler, Stiffness::Axial, 10.0, 0.2), TileVerdict::Stretched);
    }

    /// At an angle of 0.01 the limit is `√(2 (10.536 − 1)) = 4.367`: it holds to a factor of 1.35, or of a column where those are wider
    /// apart, and for angles below 0.05. Under `axial` all that is known is that steps beyond the limit stretch the spring.
    #[test]
    fn predictions_keep_away_from_the_limit() {
        use Prediction::{Silent, Stable, Unstable};
        let of = |option: Stiffness, z: f64, angle: f64, margin: f64| {
            prediction(Method::LinearBackwardEuler, option.into(), z, angle, margin)
        };
        let limit = limits(Method::LinearBackwardEuler, Stiffness::Full.into(), 0.01)[0].z;
        assert!((limit - 4.367).abs() < 5e-4);
        let full = |z: f64| of(Stiffness::Full, z, 0.01, 1.0);
        assert_eq!([0.01, 3.2, 3.3, 5.8, 6.0].map(full), [Stable, Stable, Silent, Silent, Unstable]);
        assert_eq!([full(limit / 1.35), full(1.35 * limit)], [Silent; 2]);
        assert_eq!([2.1, 2.3, 8.6, 8.8].map(|z| of(Stiffness::Full, z, 0.01, 2.0)), [Stable, Silent, Silent, Unstable]);
        assert_eq!([0.049, 0.05, 0.06].map(|angle| of(Stiffness::Full, 1e-3, angle, 1.0)), [Stable, Silent, Silent]);
        let axial = limits(Method::LinearBackwardEuler, Stiffness::Axial.into(), 0.2)[0].z;
        let axial = [0.1, 1.3, 1.4].map(|factor| of(Stiffness::Axial, factor * axial, 0.2, 1.0));
        assert_eq!(axial, [Silent, Silent, Unstable]);
        // A turn of −ln 0.9 is braked by damping alone, at any step.
        let most = -(-MOST_BRAKED).ln_1p();
        assert!(limits(Method::LinearBackwardEuler, Stiffness::Full.into(), most).is_empty());
        assert_eq!(of(Stiffness::Full, 10.0, most, 1.0), Silent);
    }

    #[test]
    fn the_exact_motion_turns_back_at_its_largest_stretch() {
        for (angle, z) in [(0.01, 3.0), (0.3, 1.0), (1.0, 0.1)] {
            let stretch = largest_stretch(angle, z);
            let speed: f64 = angle / z;
            // All energy is in the spring and in the motion across that the angular momentum demands.
            let energy = 0.5 * (speed / stretch).powi(2) + 0.5 * (stretch - 1.0).powi(2);
            assert!((energy / (0.5 * speed * speed) - 1.0).abs() < 1e-9, "{energy}");
            assert!(stretch > 1.0);
        }
    }
}
