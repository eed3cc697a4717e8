//! Errors shrink with the step at the order of the method.
//!
//! The same time is run with steps h, h/2, h/4, …; with `x_h = x + C hᵖ + …` the distance of neighbours is
//! `x_h − x_{h/2} = (1 − 2⁻ᵖ) C hᵖ + …`, so its logarithm falls with slope p, whatever the true solution is. The steps are
//! short enough to resolve every vibration: stiff scenes show less than the order until they are.
//!
//! This shows orders of up to two. Where errors of higher orders are asymptotic they are soon below rounding; such methods are
//! held to known motions.

use super::measured::Measured;
use super::reference;
use super::runs::{Way, direct};
use super::{Check, Claim, ErrorCurve, TestCase, U, order_checks};
use crate::linear::norm;
use crate::system::State;

/// Steps of the coarsest run, and how often they are halved.
const STEPS: usize = 8;
const HALVINGS: usize = 4;

/// Degrees of freedom up to which the many short runs are affordable.
const AFFORDABLE: usize = 2000;

/// The coarsest step: z = ω h ≤ 1/8 for every vibration.
pub(super) fn coarsest(subject: &TestCase) -> f64 {
    subject.dt.min(subject.resolving_step() / 4.0)
}

/// Where the vibrations are not much faster than the scene's step, and something is moving: the first-order error
/// `½ a T h` of the finest run must have digits.
pub(super) fn is_soft(subject: &TestCase) -> bool {
    let h = coarsest(subject);
    let dofs = subject.system.dofs().len();
    if !(1..=AFFORDABLE).contains(&dofs) || h < subject.dt / 20.0 {
        return false;
    }
    first_order_error(subject, h) > 100.0 * rounding(subject)
}

/// `½ a T h` of the finest run, of which h is the step of the coarsest.
fn first_order_error(subject: &TestCase, h: f64) -> f64 {
    let largest = norm(&reference::free(&subject.system, &subject.accelerations()));
    0.5 * largest * (STEPS as f64 * h) * h / (1 << HALVINGS) as f64
}

/// What rounding does to the end of the longest run: u a step.
fn rounding(subject: &TestCase) -> f64 {
    U * (subject.extent() + subject.centre().norm()) * (STEPS << HALVINGS) as f64
}

pub(super) fn measure(subject: &TestCase) -> Measured {
    let h = coarsest(subject).min(0.9 * subject.time_to_kink() / STEPS as f64);
    let mut curves = Vec::new();
    let mut unclear = Vec::new();
    for way in Way::of(subject).filter(|way| way.method.order() <= 2) {
        let mut ends = Vec::new();
        for halving in 0..=HALVINGS {
            let parts = 1 << halving;
            let states = way.run(subject, direct(), h / parts as f64, STEPS * parts)?;
            ends.extend(states.and_then(|states| states.last().cloned()));
        }
        if ends.len() <= HALVINGS {
            continue;
        }
        let distances: Vec<f64> = ends.windows(2).map(|pair| distance(&pair[0], &pair[1])).collect();
        // Below a hundred roundings a distance has no two digits.
        if distances.iter().any(|&distance| distance < 100.0 * rounding(subject)) {
            continue;
        }
        let step = |halving: usize| h / (1 << halving) as f64;
        let points = distances.into_iter().enumerate().map(|(halving, distance)| (step(halving), distance)).collect();
        let curve = ErrorCurve { method: way.name(), order: way.method.order(), points };
        match curve.unclear().or_else(|| if curve.is_off() { subject.passing(STEPS as f64 * h) } else { None }) {
            Some(reason) => {
                let name = format!("observed order, {}", curve.method);
                unclear.push(Check::not_judged(Claim::Convergence, name, &subject.name, reason));
            }
            None => curves.push(curve),
        }
    }
    if curves.is_empty() && unclear.is_empty() {
        let reason = "no method makes errors of a hundred roundings at steps that resolve every vibration";
        return Ok(vec![Check::not_judged(Claim::Convergence, "observed order", &subject.name, reason)]);
    }
    let mut checks = order_checks("observed order", &subject.name, "‖x(h) − x(h/2)‖, m", curves);
    checks.extend(unclear);
    Ok(checks)
}

fn distance(a: &State, b: &State) -> f64 {
    a.positions.iter().zip(&b.positions).map(|(x, y)| (x - y).norm_squared()).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// 2 kg on a spring of k = 8 N that is 3 m long, 2 m at rest: `ω² ≤ 2 (8/2)/2`, so that steps of 1/4 s resolve it.
    fn pulled(dt: f64) -> TestCase {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.gravity(-3.0, 0.0, 0.0);
        let (bob, anchor) = (builder.particle([1.0, 0.0, 0.0], 2.0), builder.particle([4.0, 0.0, 0.0], 2.0));
        builder.spring(bob, anchor, Spring { stiffness: 8.0, rest_length: 2.0, damping: 0.5 });
        builder.velocities[bob].x = 1.0;
        builder.hold(anchor);
        let (system, state) = builder.build().unwrap();
        TestCase { name: "pulled".into(), system, state, dt }
    }

    /// The acceleration is `(4 − 1/2)/2 − 3 = −5/4` m/s²; eight steps of 1/4 s are two seconds, and the finest ones sixteen times shorter.
    #[test]
    fn the_error_of_the_first_order_by_hand() {
        assert_eq!(first_order_error(&pulled(1.0), 0.25), 0.5 * 1.25 * 2.0 * 0.25 / 16.0);
    }

    /// A quarter of the step that resolves all motion, which may be a twentieth of the scene's and no less.
    #[test]
    fn scenes_are_soft_down_to_a_twentieth_of_their_step() {
        assert_eq!([coarsest(&pulled(1.0)), coarsest(&pulled(0.01))], [0.0625, 0.01]);
        assert_eq!([1.0, 1.25, 1.2500001].map(|dt| is_soft(&pulled(dt))), [true, true, false]);
        let mut still = pulled(1.0).relaxed().unwrap();
        assert!(!is_soft(&still));
        still.state.velocities[0].x = 1.0;
        assert!(is_soft(&still));
    }
}
