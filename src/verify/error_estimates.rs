//! The error estimates and warnings of a run against its true error.
//!
//! Every method runs the same time with long, medium and short steps: z = ω h of 2, ½ and ⅛ for the fastest vibration. The true end is that of DOP853
//! with z = 1/32, whose steps are wrong by `7·10⁻⁸ z⁹ = 2·10⁻²¹` of an amplitude: by rounding. Estimates are sums of truncation errors without regard
//! to sign, and motions amplify and cancel: four of five are to be within a factor of ten. A method whose errors do not fall with its order from the
//! medium to the short steps is left out: there the motion decides them. Runs that are wrong by 30 % must warn.

use super::convergence::{coarsest, is_soft};
use super::{Check, Claim, Measured, MethodVariant, TestCase, direct, reference};
use crate::accuracy::{distance, extent};
use crate::integrate::{
    ErrorIndicators, ImplicitOptions, Method, Monitor, MonitorOptions, Schedule, Status, run_monitored,
};
use crate::system::State;
use std::ops::ControlFlow;

/// Length of the run in steps that resolve every vibration (z = 1/8), and the lengths of the long, medium and short steps in these.
const LENGTH: u64 = 64;
const STEPS: [u64; 3] = [16, 4, 1];

/// Steps of the reference in the shortest.
const PARTS: u64 = 4;

/// Errors below this are rounding and the remainders of iterative solvers.
const SMALLEST: f64 = 1e-9;

/// Where the reference is affordable, and not where a spring is all but collapsed: its direction changes beyond any indicator of a motion.
pub(super) fn applies(case: &TestCase) -> bool {
    let links = reference::links(&case.system, &case.state.positions);
    case.system.dofs().len() <= 100 && !links.iter().any(|link| link.is_collapsed()) && is_soft(case)
}

pub(super) fn measure(case: &TestCase) -> Measured {
    let h = coarsest(case);
    let states = MethodVariant::dop853().run(case, direct(), h / PARTS as f64, (LENGTH * PARTS) as usize)?;
    let Some(exact) = states.and_then(|states| states.last().cloned()) else { return Ok(Vec::new()) };
    // Positions far from the origin are rounded to that much more of the extent.
    let farthest = exact.positions.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let far = (farthest / extent(&exact.positions, &case.state.positions)).max(1.0);
    let (mut deviations, mut largest_mean) = (Vec::new(), 0.0_f64);
    let (mut silent, mut runs) = (0.0, 0.0);
    for method in Method::ALL {
        // Digits by which estimates miss, those of the steps that resolve the motion, and the errors with these.
        let (mut all, mut resolved, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for length in STEPS {
            let Some((end, figures)) = monitored(case, method, h * length as f64, LENGTH / length)? else { continue };
            // The largest estimate is twice the size of the motion: a larger error is one of another motion, however large.
            let error = (distance(&end.positions, &exact.positions) / figures.extent).min(2.0);
            runs += 1.0;
            if error > 0.3 && figures.warnings(None).is_empty() {
                silent += 1.0;
            }
            let resolves = length < STEPS[0];
            if resolves {
                errors.push(error);
            }
            if error > SMALLEST {
                let deviation = (figures.estimate.unwrap_or(f64::INFINITY) / error).log10().abs();
                all.push(deviation);
                if resolves && error > SMALLEST * far {
                    resolved.push(deviation);
                }
            }
        }
        // Errors of steps that are four times as long are larger as the order says, to half a power.
        let falls = match errors[..] {
            [medium, short] if short > SMALLEST => {
                ((medium / short).ln() / 4f64.ln() - f64::from(method.order())).abs() <= 0.5
            }
            _ => true,
        };
        if falls {
            deviations.extend(all);
            let mean = resolved.iter().sum::<f64>() / resolved.len().max(1) as f64;
            largest_mean = largest_mean.max(mean);
        }
    }
    deviations.sort_by(f64::total_cmp);
    // Four of five are within the bound.
    let at = (0.8 * deviations.len() as f64).ceil() as usize;
    let deviation = at.checked_sub(1).and_then(|at| deviations.get(at)).copied().unwrap_or(0.0);
    let check = |name: &str, value, bound, why: &str| Check::new(Claim::Failure, name, &case.name, value, bound, why);
    let estimates_why = "decimal digits by which the estimate of the error misses it, the best four of five: sums of truncation \
                         errors know nothing of amplification and cancellation in a motion";
    let methods_why = "decimal digits by which the estimates of the worst method miss the error in the mean, with steps that resolve \
                       the motion: a formula of another order misses more";
    let silent_why =
        "runs that are wrong by 30 % and have no warning: in nine of ten estimates are within ten times of the truth";
    let checks = [
        check("estimates of errors", deviation, 1.0, estimates_why),
        check("estimates of every method", largest_mean, 1.0, methods_why),
        check("silent runs", silent, 0.1 * runs, silent_why),
    ];
    let passing = || case.passing(LENGTH as f64 * h);
    Ok(checks.into_iter().map(|check| unless_by_chance(check).unless(passing)).collect())
}

/// Error estimates hold as a rule, not on every scene: where they miss by more than a factor of ten, but not by a thousand, the check is not judged.
fn unless_by_chance(check: Check) -> Check {
    let (value, bound) = (check.value, check.bound);
    check.unless(|| {
        (bound != 0.0 && value <= 3.0).then(|| {
            format!(
                "estimates miss errors by {value:.1} digits here, and are within one as a rule: this motion amplifies or cancels errors more than \
                 they can know"
            )
        })
    })
}

/// The end and the error indicators of a run with a method; `None` where the run reported a failure.
fn monitored(case: &TestCase, method: Method, dt: f64, steps: u64) -> Measured<Option<(State, ErrorIndicators)>> {
    let TestCase { system, state, .. } = case;
    let mut state = state.clone();
    let mut monitor = Monitor::new(system, &state, MonitorOptions::default())?;
    let mut stepper = method.stepper(system, &state, &ImplicitOptions::default())?;
    let go_on = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = run_monitored(&mut *stepper, &mut state, &Schedule::steps(dt, steps), &mut monitor, go_on);
    let indicators = monitor.indicators(&state);
    Ok((outcome.status() == Status::Completed).then_some((state, indicators)))
}
