//! Every method towards prescribed motions that the library's forces have no part in making.

use crate::collect::{Collector, slug};
use crate::manufactured::{Approach, Variant, scenes};
use libtest_mimic::Trial;
use sprung::verify::{Check, Claim, ErrorCurve, order_checks};
use std::sync::Arc;

/// Halvings of the step: of these the order, and with the full stiffness eight digits of the limit.
const HALVINGS: [u32; 2] = [3, 6];

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let test = |scene: Arc<scenes::Scene>| {
        let name = format!("convergence::manufactured::{}", slug(scene.name));
        collector.trial(Claim::Convergence, name, move || checks(&scene))
    };
    scenes::all().into_iter().map(test).collect()
}

fn checks(scene: &Arc<scenes::Scene>) -> Vec<Check> {
    let (mut places, mut velocities, mut limits) = (Vec::new(), Vec::new(), Vec::new());
    for variant in Variant::all() {
        let name = variant.name();
        let found = match Approach::of(scene, variant, HALVINGS[usize::from(variant.is_smooth())]) {
            Ok(found) => found,
            Err(why) => return vec![Check::new(Claim::Convergence, name, scene.name, f64::NAN, 0.0, why)],
        };
        let order = variant.method.order();
        if order > 4 {
            let why = "distance of the observed order from theory: errors of this order reach rounding before the leading term is alone";
            let off = found.observed().map(|observed| (observed - f64::from(order)).abs());
            let check = |value| Check::new(Claim::Convergence, format!("order, {name}"), scene.name, value, 1.0, why);
            limits.extend(off.map(check));
        }
        for (part, curves) in [&mut places, &mut velocities].into_iter().enumerate().filter(|_| order <= 4) {
            let points = found.errors.iter().map(|&(step, errors)| (step, errors[part])).collect();
            curves.push(ErrorCurve { method: name.clone(), order, points });
        }
        if variant.is_smooth() {
            let why = "eight digits of the motion by Richardson's extrapolation of the errors' powers of the step";
            let value = found.limit[0].max(found.limit[1]);
            limits.push(Check::new(Claim::Convergence, format!("limit, {name}"), scene.name, value, 1e-8, why));
        }
    }
    let mut checks = order_checks("order of positions", scene.name, "error, m", places);
    checks.extend(order_checks("order of velocities", scene.name, "error, m/s", velocities));
    checks.extend(limits);
    checks
}
