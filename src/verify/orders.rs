//! Observed orders of convergence as checks, with the curves of methods of one order in one plot.

use super::check::Check;
use super::claim::Claim;
use crate::figure::{Guide, Plot, Series};

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

/// How far an observed order may be from theory: what the next order leaves over two halvings once errors are asymptotic.
const TOLERANCE: f64 = 0.2;

impl ErrorCurve {
    /// The slope between the two shortest steps; NaN with fewer than two.
    pub fn observed(&self) -> f64 {
        match *self.points.as_slice() {
            [.., (h, coarse), (half, fine)] => (coarse / fine).ln() / (h / half).ln(),
            _ => f64::NAN,
        }
    }
}

impl ErrorCurve {
    /// Whether the observed order is not that of theory.
    pub(super) fn is_off(&self) -> bool {
        let off = (self.observed() - f64::from(self.order)).abs();
        off.is_nan() || off > TOLERANCE
    }

    /// Why the curve says nothing of the order: errors do not fall with one power yet, or with a higher one than the leading term has,
    /// which then vanishes. `None` where the last two slopes agree.
    pub(super) fn unclear(&self) -> Option<String> {
        let slopes: Vec<f64> =
            self.points.windows(2).map(|pair| (pair[0].1 / pair[1].1).ln() / (pair[0].0 / pair[1].0).ln()).collect();
        let [.., before, last] = slopes[..] else { return None };
        let order = f64::from(self.order);
        if (last - order).abs() <= TOLERANCE {
            return None;
        }
        if last > order {
            return Some(format!(
                "errors fall with the power {last:.1} of the step: the leading term, of order {order}, vanishes"
            ));
        }
        ((last - before).abs() > 0.5 * TOLERANCE)
            .then(|| format!("errors do not fall with one power of the step yet: slopes of {before:.2} and {last:.2}"))
    }
}

/// One check a curve: the distance of the observed order from theory. For each order the plot of all its curves goes with
/// the check that is farthest off.
pub fn order_checks(name: &str, scene: &str, error: &str, curves: Vec<ErrorCurve>) -> Vec<Check> {
    let why = "distance of the observed order from theory; what is left of the next order at these steps is below 0.2";
    let off = |curve: &ErrorCurve| (curve.observed() - f64::from(curve.order)).abs();
    let check = |curve: &ErrorCurve| {
        let name = format!("{name}, {}", curve.method);
        Check::new(Claim::Convergence, name, scene, off(curve), TOLERANCE, why)
    };
    let mut checks: Vec<Check> = curves.iter().map(check).collect();
    let mut orders: Vec<u32> = curves.iter().map(|curve| curve.order).collect();
    orders.sort_unstable();
    orders.dedup();
    for order in orders {
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
        let farthest = of_order().max_by(|(_, a), (_, b)| off(a).total_cmp(&off(b)));
        if let Some(check) = farthest.and_then(|(index, _)| checks.get_mut(index)) {
            check.curves.push(plot);
        }
    }
    checks
}
