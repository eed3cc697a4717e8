//! Errors shrink with the step at the order of the method.
//!
//! The same time is run with steps h, h/2, h/4, …: with `x_h = x + C hᵖ + …` neighbours differ by `(1 − 2⁻ᵖ) C hᵖ + …`, whose logarithm falls with
//! slope p, whatever the true solution is. The steps are short enough to resolve every vibration: stiff scenes show less than the order until they
//! are.
//!
//! This shows orders of up to two. Errors of higher orders are soon below rounding: such methods are compared with known motions.

use super::{AFFORDABLE, Check, Claim, Measured, MethodVariant, TestCase, U, direct, reduce};
use crate::accuracy::distance;
use crate::figure::{Guide, Plot, Series};
use crate::linear::norm;
use std::collections::BTreeSet;

/// Steps of the coarsest run, and how often they are halved.
const STEPS: usize = 8;
const HALVINGS: usize = 4;

/// The largest distance of an observed order from theory: the next order's part over two halvings once errors are asymptotic.
const TOLERANCE: f64 = 0.2;

/// Errors of one method over the step, coarsest step first.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorCurve {
    /// The method's name.
    pub method: String,
    /// The order that theory gives.
    pub order: u32,
    /// Step, in s, and error, in m.
    pub points: Vec<(f64, f64)>,
}

impl ErrorCurve {
    fn slopes(&self) -> Vec<f64> {
        let slope = |pair: &[(f64, f64)]| (pair[0].1 / pair[1].1).ln() / (pair[0].0 / pair[1].0).ln();
        self.points.windows(2).map(slope).collect()
    }

    /// The slope between the two shortest steps; NaN with fewer than two.
    pub fn observed(&self) -> f64 {
        self.slopes().last().copied().unwrap_or(f64::NAN)
    }

    fn deviation(&self) -> f64 {
        (self.observed() - f64::from(self.order)).abs()
    }

    /// The slopes are still on their way to the order.
    pub(super) fn approaches(&self) -> bool {
        let [.., before, last] = self.slopes()[..] else { return false };
        let order = f64::from(self.order);
        (last - order).abs() < (before - order).abs()
    }

    /// The reason why the curve says nothing of the order, if there is one.
    pub(super) fn unclear(&self) -> Option<String> {
        let [.., before, last] = self.slopes()[..] else { return None };
        let order = f64::from(self.order);
        if (last - order).abs() <= TOLERANCE {
            None
        } else if last > order {
            Some(format!(
                "errors fall with the power {last:.1} of the step: the leading term, of order {order}, vanishes"
            ))
        } else {
            ((last - before).abs() > 0.5 * TOLERANCE).then(|| {
                format!("errors do not fall with one power of the step yet: slopes of {before:.2} and {last:.2}")
            })
        }
    }
}

/// One check a curve: the distance of the observed order from theory. The plot of all curves of an order goes with the one that is farthest off.
pub fn order_checks(name: &str, scene: &str, error: &str, curves: Vec<ErrorCurve>) -> Vec<Check> {
    let why = "distance of the observed order from theory; the part of the next order at these steps is below 0.2";
    let check = |curve: &ErrorCurve| {
        let name = format!("{name}, {}", curve.method);
        Check::new(Claim::Convergence, name, scene, curve.deviation(), TOLERANCE, why)
    };
    let mut checks: Vec<Check> = curves.iter().map(check).collect();
    for order in curves.iter().map(|curve| curve.order).collect::<BTreeSet<u32>>() {
        let of_order = || curves.iter().enumerate().filter(move |(_, curve)| curve.order == order);
        let through = of_order().find_map(|(_, curve)| curve.points.first().copied());
        let mut plot = Plot::log_log(format!("{name}, {scene}"), "step, s", error);
        let observed = || of_order().map(|(_, curve)| curve.observed());
        let (least, most) = (observed().fold(f64::INFINITY, f64::min), observed().fold(f64::NEG_INFINITY, f64::max));
        plot.conclusion = format!("Observed orders lie between {least:.2} and {most:.2}; theory gives {order}.");
        plot.guides.extend(through.map(|through| Guide::Slope { slope: f64::from(order), through }));
        plot.series.extend(
            of_order().map(|(_, curve)| Series::line(&curve.method, curve.points.clone()).with_slope(curve.observed())),
        );
        // NaN counts as farthest.
        let farthest = of_order().max_by(|(_, a), (_, b)| a.deviation().total_cmp(&b.deviation()));
        if let Some(check) = farthest.and_then(|(index, _)| checks.get_mut(index)) {
            check.curves.push(plot);
        }
    }
    checks
}

/// The coarsest step: z = ω h ≤ 1/8 for every vibration.
pub(super) fn coarsest(case: &TestCase) -> f64 {
    case.dt.min(case.resolving_step() / 4.0)
}

/// Where vibrations are not much faster than the scene's step, and the first-order error `½ a T h` of the finest run has digits.
pub(super) fn is_soft(case: &TestCase) -> bool {
    let h = coarsest(case);
    let dofs = case.system.dofs().len();
    if !(1..=AFFORDABLE).contains(&dofs) || h < case.dt / 20.0 {
        return false;
    }
    first_order_error(case, h) > 100.0 * rounding(case)
}

/// `½ a T h` of the finest run, of which h is the step of the coarsest.
fn first_order_error(case: &TestCase, h: f64) -> f64 {
    let largest = norm(&reduce(&case.system, &case.accelerations()));
    0.5 * largest * (STEPS as f64 * h) * h / (1 << HALVINGS) as f64
}

/// The rounding of the end of the longest run: u a step.
fn rounding(case: &TestCase) -> f64 {
    U * (case.extent() + case.centre().norm()) * (STEPS << HALVINGS) as f64
}

pub(super) fn measure(case: &TestCase) -> Measured {
    let h = coarsest(case).min(0.9 * case.time_to_kink() / STEPS as f64);
    let not_judged = |name: String, reason: String| Check::not_judged(Claim::Convergence, name, &case.name, reason);
    let (mut curves, mut unclear) = (Vec::new(), Vec::new());
    for variant in MethodVariant::of(case).filter(|variant| variant.method.order() <= 2) {
        let step = |halving: usize| h / (1 << halving) as f64;
        let mut ends = Vec::new();
        for halving in 0..=HALVINGS {
            let states = variant.run(case, direct(), step(halving), STEPS << halving)?;
            ends.extend(states.and_then(|states| states.last().cloned()));
        }
        if ends.len() <= HALVINGS {
            continue;
        }
        let distances = ends.windows(2).map(|pair| distance(&pair[0].positions, &pair[1].positions));
        let points: Vec<_> = distances.enumerate().map(|(halving, distance)| (step(halving), distance)).collect();
        // Below a hundred roundings a distance has no two digits.
        if points.iter().any(|&(_, distance)| distance < 100.0 * rounding(case)) {
            continue;
        }
        let curve = ErrorCurve { method: variant.name(), order: variant.method.order(), points };
        let is_right = curve.deviation() <= TOLERANCE;
        let passing = || if is_right { None } else { case.passing(STEPS as f64 * h) };
        match curve.unclear().or_else(passing) {
            Some(reason) => unclear.push(not_judged(format!("observed order, {}", curve.method), reason)),
            None => curves.push(curve),
        }
    }
    if curves.is_empty() && unclear.is_empty() {
        let reason = "no method makes errors of a hundred roundings at steps that resolve every vibration";
        return Ok(vec![not_judged("observed order".into(), reason.into())]);
    }
    let mut checks = order_checks("observed order", &case.name, "‖x(h) − x(h/2)‖, m", curves);
    checks.extend(unclear);
    Ok(checks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::{case, line};

    /// 2 kg on a spring of k = 8 N that is 3 m long, 2 m at rest: `ω² ≤ 2 (8/2)/2`, so that steps of 1/4 s resolve it.
    fn pulled(dt: f64) -> TestCase {
        let mut builder = line();
        (builder.springs[0].stiffness, builder.masses[1]) = (8.0, 2.0);
        builder.velocities[0].x = 1.0;
        builder.hold(1).hold(2);
        case(builder, dt)
    }

    /// Errors of ½ h² + h³ and of a wrong gradient, h² + h/64: slopes come nearer to 2, and depart from it.
    #[test]
    fn slopes_approach_an_order_or_depart_from_it() {
        let curve = |error: fn(f64) -> f64| {
            let points = [1.0, 0.5, 0.25, 0.125].map(|h| (h, error(h))).to_vec();
            ErrorCurve { method: String::new(), order: 2, points }
        };
        assert!(curve(|h| 0.5 * h * h + h * h * h).approaches() && !curve(|h| h * h + h / 64.0).approaches());
    }

    /// The acceleration is `(4 − 1/2)/2 − 2 = −1/4` m/s²; eight steps of 1/4 s are two seconds, and the finest ones sixteen times shorter.
    #[test]
    fn the_error_of_the_first_order_by_hand() {
        assert_eq!(first_order_error(&pulled(1.0), 0.25), 0.5 * 0.25 * 2.0 * 0.25 / 16.0);
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
