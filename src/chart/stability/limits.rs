//! The limits of stability in closed form, on the model of this module.
//!
//! With `z = ω dt`, the stretch λ and the axial damping ratio ζ; γ = 1 − 1/√2 is the W-method's.
//!
//! | method | stretched, λ > 1 | compressed, λ < 1 |
//! |---|---|---|
//! | linearised and Newton backward Euler, implicit midpoint, W-method; exact stiffness | stable for all z | |
//! | linearised backward Euler, transverse term dropped (`axial`) | `z ≤ 2/√(1 − 1/λ)`: symplectic Euler across | A definite for all z |
//! | W-method, transverse term dropped | `z ≤ 2.26448/√(1 − 1/λ)` | A definite for all z |
//! | linearised backward Euler, `full` | | A definite for `z < 1/√(1/λ − 1)` |
//! | W-method, `full` | | A definite for `z < 1/(γ √(1/λ − 1))` |
//! | symplectic Euler, damping explicit | `z ≤ 2 (√(1 + ζ²) − ζ)` along, `z ≤ 2/√(1 − 1/λ)` across | |
//! | Verlet, damping by predicted velocities | `z ≤ 2 (√(1 + 4ζ²) − 2ζ)` along, `z ≤ 2/√(1 − 1/λ)` across | |
//! | RODAS4 | stable for all z | steps with an indefinite A are cut |
//! | DOP853 | `|R(z(−ζ ± i√(1 − ζ²)))| ≤ 1` along, `z ≤ 5.96/√(1 − 1/λ)` across | |
//! | forward Euler | unstable for all z: nothing damps the motion across | |
//!
//! *Dropped term.* Without stiffness in the matrix linearised backward Euler is `v' = v − dt ω_t² x`, `x' = x + dt v'` with the characteristic
//! polynomial `g² − (2 − z_t²) g + 1`: both roots lie on the unit circle up to z_t = 2. The W-method's stages together have determinant 1 too and
//! the trace `2 − z_t² + ½γ² z_t⁴`, of magnitude at most 2 up to `z_t² = (1 − √(1 − 8γ²))/γ²`, and on an island from `(1 + √(1 − 8γ²))/γ²` to
//! `2/γ²`, z_t = 4.265 … 4.828.
//! *Explicit damping.* `g² − (2 − z² − 2ζz) g + 1 − 2ζz`: the Jury condition at g = −1 is `z² + 4ζz ≤ 4`, with Verlet's predicted velocities
//! `z² + 8ζz ≤ 4`.
//! *DOP853.* R is a polynomial of degree twelve, up to z⁸ that of the exponential; |R| = 1 at 5.96 on the imaginary axis.

use crate::integrate::{Method, StiffnessPolicy};
use crate::spring::Stiffness;
use nalgebra::Complex;
use serde::Serialize;
use std::f64::consts::FRAC_1_SQRT_2;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Prediction {
    Stable,
    Unstable,
    Refused,
    /// No factorization is refused; nothing else is predicted.
    Definite,
    Silent,
}

/// A limit in z with its formula.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limit {
    /// The formula, with λ and ζ.
    pub formula: &'static str,
    /// The largest z.
    pub z: f64,
}

const GAMMA: f64 = 1.0 - FRAC_1_SQRT_2;

/// z_t at which the W-method without transverse stiffness becomes unstable, stable again, and unstable for good.
fn dropped_term_limits() -> [f64; 3] {
    let g = GAMMA * GAMMA;
    let root = (1.0 - 8.0 * g).sqrt();
    [(1.0 - root) / g, (1.0 + root) / g, 2.0 / g].map(f64::sqrt)
}

/// The z at which DOP853 becomes unstable on a mode. Of an overdamped one the faster decay decides.
fn dop853_limit(ratio: f64) -> f64 {
    const HIGHEST: [f64; 4] =
        [2.6916922001690827e-6, 2.3413451082097813e-7, 1.494736485459155e-8, 3.613324578128244e-10];
    if ratio > 1.0 {
        return dop853_limit(1.0) / (ratio + (ratio * ratio - 1.0).sqrt());
    }
    let ray = Complex::new(-ratio, (1.0 - ratio * ratio).sqrt());
    let grows = |z: f64| {
        let (mut power, mut sum, mut factor) = (Complex::new(1.0, 0.0), Complex::new(0.0, 0.0), 1.0);
        for k in 0..=12 {
            let coefficient = if k <= 8 { factor } else { HIGHEST.get(k - 9).copied().unwrap_or(0.0) };
            sum += power * coefficient;
            power *= ray * z;
            factor /= (k + 1) as f64;
        }
        sum.norm() > 1.0 + 1e-9
    };
    // From the first grid point that grows the limit is less than one spacing away.
    (1..2000).map(|i| 0.005 * f64::from(i)).find(|&z| grows(z)).unwrap_or(f64::INFINITY)
}

fn keeps_transverse(policy: StiffnessPolicy) -> bool {
    policy != StiffnessPolicy::Always(Stiffness::Axial)
}

/// The limits of a method under a stiffness policy at a stretch and a damping ratio; none where it has none.
pub(super) fn limits(method: Method, policy: StiffnessPolicy, stretch: f64, ratio: f64) -> Vec<Limit> {
    let across = (1.0 - 1.0 / stretch).max(0.0).sqrt();
    let buckling = (1.0 / stretch - 1.0).max(0.0).sqrt();
    let full = policy == StiffnessPolicy::Always(Stiffness::Full);
    let mut limits = Vec::new();
    let mut push = |formula, z: f64| {
        if z.is_finite() {
            limits.push(Limit { formula, z });
        }
    };
    match method {
        Method::LinearBackwardEuler if !keeps_transverse(policy) => push("2/√(1 − 1/λ)", 2.0 / across),
        Method::W2 if !keeps_transverse(policy) => {
            let [limit, island, end] = dropped_term_limits();
            push("2.26448/√(1 − 1/λ)", limit / across);
            push("island from 4.265/√(1 − 1/λ)", island / across);
            push("island to 4.828/√(1 − 1/λ)", end / across);
        }
        Method::LinearBackwardEuler if full => push("1/√(1/λ − 1)", 1.0 / buckling),
        Method::W2 if full => push("1/(γ√(1/λ − 1))", 1.0 / (GAMMA * buckling)),
        Method::Verlet if stretch >= 1.0 => {
            push("2(√(1 + 4ζ²) − 2ζ)", 2.0 * ((1.0 + 4.0 * ratio * ratio).sqrt() - 2.0 * ratio));
            push("2/√(1 − 1/λ)", 2.0 / across);
        }
        Method::Dop853 if stretch >= 1.0 => {
            push("|R(z)| = 1", dop853_limit(ratio));
            push("5.96/√(1 − 1/λ)", dop853_limit(0.0) / across);
        }
        Method::SymplecticEuler if stretch >= 1.0 => {
            push("2(√(1 + ζ²) − ζ)", 2.0 * ((1.0 + ratio * ratio).sqrt() - ratio));
            push("2/√(1 − 1/λ)", 2.0 / across);
        }
        _ => {}
    }
    limits
}

/// The prediction of theory; `Silent` within a factor `margin` of a limit, where rounding and the finite number of steps decide.
pub(super) fn prediction(
    method: Method,
    policy: StiffnessPolicy,
    z: f64,
    [stretch, ratio]: [f64; 2],
    margin: f64,
) -> Prediction {
    // At λ = 1 the motion across has no frequency, and what the linear theory leaves out decides.
    if (stretch - 1.0).abs() < 1e-9 {
        return Prediction::Silent;
    }
    let limits = limits(method, policy, stretch, ratio);
    if limits.iter().any(|limit| z < margin * limit.z && limit.z < margin * z) {
        return Prediction::Silent;
    }
    // Every limit that is crossed turns stable into unstable and back; but two that bound two modes do so together.
    let crossed = limits.iter().filter(|limit| z > limit.z).count();
    let inside = if method == Method::W2 { crossed % 2 == 0 } else { crossed == 0 };
    match method {
        // An explicit method refuses nothing, and RODAS4 cuts its steps.
        _ if stretch < 1.0 && !method.takes_stiffness() => Prediction::Silent,
        Method::ForwardEuler => Prediction::Unstable,
        // Its matrix is the one at the predicted state, and how often it iterates decides too.
        Method::Bdf2 => Prediction::Silent,
        _ if stretch < 1.0 && inside => Prediction::Definite,
        _ if stretch < 1.0 => Prediction::Refused,
        _ if inside => Prediction::Stable,
        _ => Prediction::Unstable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The stages of the W-method on `x'' = −z² x` with h = 1 and a matrix without stiffness, as two columns.
    fn step(z: f64, x: f64, v: f64) -> [f64; 2] {
        let force = |x: f64| -z * z * x;
        let k_v = force(x);
        let k_x = v + GAMMA * k_v;
        let w_v = force(x + 0.5 * k_x) - k_v;
        let w_x = v + 0.5 * k_v - k_x + GAMMA * w_v;
        [x + k_x + w_x, v + k_v + w_v]
    }

    #[test]
    fn the_w_method_without_stiffness_is_stable_where_its_trace_says() {
        assert!((dropped_term_limits()[0] - 2.26448).abs() < 5e-6);
        for z in (1..600).map(|i| 0.01 * f64::from(i)) {
            let ([a, c], [b, d]) = (step(z, 1.0, 0.0), step(z, 0.0, 1.0));
            assert!((a * d - b * c - 1.0).abs() < 1e-12 * (1.0 + (a * d).abs()));
            let crossed = dropped_term_limits().iter().filter(|limit| z > **limit).count();
            assert_eq!((a + d).abs() <= 2.0, crossed % 2 == 0, "{z}");
        }
    }

    const AXIAL: StiffnessPolicy = StiffnessPolicy::Always(Stiffness::Axial);
    const FULL: StiffnessPolicy = StiffnessPolicy::Always(Stiffness::Full);
    const TENSION: StiffnessPolicy = StiffnessPolicy::Always(Stiffness::Tension);

    fn z(method: Method, policy: StiffnessPolicy, stretch: f64, ratio: f64) -> Vec<f64> {
        limits(method, policy, stretch, ratio).iter().map(|limit| limit.z).collect()
    }

    /// Every limit solves the equation it comes from: that of the Jury condition, of a trace of two, of an A that is singular across. Of DOP853 limits
    /// are known on the imaginary axis, on the real one, and in between.
    #[test]
    fn limits_solve_their_equations() {
        for (ratio, limit) in [(0.0, 5.96), (0.1, 6.285), (0.5, 6.765), (1.0, 6.39), (1.25, 3.195)] {
            assert!((dop853_limit(ratio) - limit).abs() < 0.011, "{ratio}: {}", dop853_limit(ratio));
        }
        let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
        for (stretch, ratio) in [(1.25, 0.0), (2.0, 0.2), (4.0, 1.5)] {
            // z_t²/z², and z along the springs.
            let across = 1.0 - 1.0 / stretch;
            for (method, of_damping) in [(Method::SymplecticEuler, 4.0), (Method::Verlet, 8.0)] {
                let [along, beside] = z(method, AXIAL, stretch, ratio)[..] else { panic!("two limits") };
                near(along * along + of_damping * ratio * along, 4.0);
                near(beside * beside * across, 4.0);
            }
            let [dropped] = z(Method::LinearBackwardEuler, AXIAL, stretch, ratio)[..] else { panic!("a limit") };
            near(dropped * dropped * across, 4.0);
            let of_w2 = z(Method::W2, AXIAL, stretch, ratio);
            assert_eq!(of_w2.len(), 3);
            for (limit, dropped) in of_w2.iter().zip(dropped_term_limits()) {
                near(limit * across.sqrt(), dropped);
            }
            let [along, beside] = z(Method::Dop853, TENSION, stretch, ratio)[..] else { panic!("two limits") };
            assert!((along - dop853_limit(ratio)).abs() < 1e-12 && (beside * across.sqrt() - 5.96).abs() < 0.011);
            // With the whole stiffness, or what of it is positive, nothing limits implicit methods.
            for policy in [FULL, TENSION, StiffnessPolicy::OnDemand] {
                let of = |method| z(method, policy, stretch, ratio);
                assert!([Method::LinearBackwardEuler, Method::W2].map(of).concat().is_empty());
            }
        }
        for stretch in [0.5, 0.8] {
            let pressed = 1.0 / stretch - 1.0;
            let [euler] = z(Method::LinearBackwardEuler, FULL, stretch, 0.0)[..] else { panic!("a limit") };
            near(euler * euler * pressed, 1.0);
            let [w2] = z(Method::W2, FULL, stretch, 0.0)[..] else { panic!("a limit") };
            near(w2 * w2 * GAMMA * GAMMA * pressed, 1.0);
            for method in [Method::Verlet, Method::SymplecticEuler, Method::Dop853] {
                assert!(z(method, TENSION, stretch, 0.0).is_empty(), "{}", method.name());
            }
        }
        // The motion across has no frequency at rest: what is left is that along.
        assert_eq!(z(Method::Verlet, TENSION, 1.0, 0.0), [2.0]);
        assert_eq!(z(Method::SymplecticEuler, TENSION, 1.0, 0.0), [2.0]);
    }

    /// On both sides of limits, and so near that nothing is said.
    #[test]
    fn predictions_change_at_limits() {
        use Method::{Bdf2, ForwardEuler, LinearBackwardEuler, SymplecticEuler, Verlet, W2};
        use Prediction::{Definite, Refused, Silent, Stable, Unstable};
        let of = |method, policy, z, stretch| prediction(method, policy, z, [stretch, 0.0], 1.1);
        // At λ = 4/3 the motion across has half the frequency: limits of 4, and of 2 along.
        let stretch = 4.0 / 3.0;
        for (method, policy, steps, expected) in [
            (LinearBackwardEuler, AXIAL, vec![3.5, 3.7, 4.3, 4.5], vec![Stable, Silent, Silent, Unstable]),
            (LinearBackwardEuler, FULL, vec![1e3], vec![Stable]),
            (LinearBackwardEuler, TENSION, vec![1e3], vec![Stable]),
            (SymplecticEuler, TENSION, vec![1.7, 2.3], vec![Stable, Unstable]),
            (Verlet, TENSION, vec![4.5], vec![Unstable]),
            (W2, AXIAL, vec![4.0, 6.0, 9.0, 12.0], vec![Stable, Unstable, Silent, Unstable]),
            (ForwardEuler, TENSION, vec![0.01], vec![Unstable]),
            (Bdf2, TENSION, vec![0.01], vec![Silent]),
        ] {
            let found: Vec<_> = steps.into_iter().map(|z| of(method, policy, z, stretch)).collect();
            assert_eq!(found, expected, "{}", method.name());
        }
        // Between the narrow island's ends, 8.53 and 9.66, looked at closely.
        assert_eq!(prediction(W2, AXIAL, 9.0, [stretch, 0.0], 1.01), Stable);
        // At λ = 1/2 the motion across buckles as fast as that along is: A is singular at z = 1, and 1/γ = 3.41.
        for (method, policy, steps, expected) in [
            (LinearBackwardEuler, FULL, vec![0.8, 0.95, 1.2], vec![Definite, Silent, Refused]),
            (LinearBackwardEuler, TENSION, vec![1.2], vec![Definite]),
            (W2, FULL, vec![3.0, 4.0], vec![Definite, Refused]),
            (W2, AXIAL, vec![4.0], vec![Definite]),
            (W2, TENSION, vec![4.0], vec![Definite]),
            (Verlet, TENSION, vec![0.1], vec![Silent]),
            (ForwardEuler, TENSION, vec![0.1], vec![Silent]),
        ] {
            let found: Vec<_> = steps.into_iter().map(|z| of(method, policy, z, 0.5)).collect();
            assert_eq!(found, expected, "{}", method.name());
        }
        assert_eq!(of(LinearBackwardEuler, TENSION, 0.1, 1.0), Silent);
        assert_eq!(of(LinearBackwardEuler, TENSION, 0.1, 1.0 + 1e-8), Stable);
    }
}
