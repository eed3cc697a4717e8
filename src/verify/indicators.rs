//! What a run says of its own error is about true.
//!
//! Every method runs the same time with long, medium and short steps: z = ω h of 2, ½ and ⅛ for the fastest vibration. The truth is the end of a
//! run of DOP853 with z = 1/32, where a step of it is wrong by `7·10⁻⁸ z⁹ = 2·10⁻²¹` of an amplitude: by rounding. Estimates are made of
//! truncation errors without regard to sign, and motions amplify and cancel: four of five are to be within a factor of ten. A method whose errors do
//! not fall with its order from the medium to the short steps is left out: there they are what the motion makes of them. No run
//! that is wrong by 30 % may be silent.

use super::measured::Measured;
use super::{Check, Claim, TestCase, Unfinished, convergence, reference};
use crate::accuracy::extent;
use crate::integrate::{
    ErrorIndicators, ImplicitOptions, Method, Monitor, MonitorOptions, Outcome, Schedule, Status, run, run_monitored,
};
use crate::system::State;
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// Length of the run in the steps that resolve every vibration (z = 1/8), and the steps that are tried, in these.
const LENGTH: u64 = 64;
const STEPS: [u64; 3] = [16, 4, 1];

/// Steps of the reference in the shortest.
const PARTS: u64 = 4;

/// Errors below this are rounding and what iterative solvers leave.
const SMALLEST: f64 = 1e-9;

/// The largest estimate: a larger error is one of another motion, however large.
const SATURATED: f64 = 2.0;

/// The share of estimates within a factor of ten.
const SHARE: f64 = 0.8;

/// The share of runs that may be silent.
const SILENT: f64 = 0.1;

/// Strain plus one below which a spring is all but collapsed.
const COLLAPSED: f64 = 0.01;

/// Degrees of freedom up to which the reference is affordable.
const AFFORDABLE: usize = 100;

/// Not where a spring is all but collapsed: its direction changes beyond what any figure of a motion says.
pub(super) fn applies(subject: &TestCase) -> bool {
    let links = reference::links(&subject.system, &subject.state.positions);
    let collapsed = links.iter().any(|link| link.length < COLLAPSED * link.rest_length);
    subject.system.dofs().len() <= AFFORDABLE && !collapsed && convergence::is_soft(subject)
}

pub(super) fn measure(subject: &TestCase) -> Measured {
    let h = convergence::coarsest(subject);
    let mut exact = subject.state.clone();
    let mut stepper = Method::Dop853.stepper(&subject.system, &exact, &ImplicitOptions::default())?;
    let schedule = Schedule::steps(h / PARTS as f64, LENGTH * PARTS);
    let outcome = run(&mut *stepper, &mut exact, &schedule, |_, _| ControlFlow::Continue(()));
    completed(&outcome)?;
    // Positions far from the origin are rounded to that much more of the extent.
    let reach = exact.positions.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let far = (reach / extent(&exact.positions, &subject.state.positions)).max(1.0);
    let (mut deviations, mut farthest) = (Vec::new(), 0.0_f64);
    let [mut silent, mut runs] = [0.0; 2];
    for method in Method::ALL {
        let (mut resolved, mut found, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for parts in STEPS {
            let Some((end, figures)) = monitored(subject, method, h * parts as f64, LENGTH / parts)? else { continue };
            // Estimates saturate at the size of the motion.
            let error = (distance(&end, &exact) / figures.extent).min(SATURATED);
            runs += 1.0;
            if error > 0.3 && figures.warnings(None).is_empty() {
                silent += 1.0;
            }
            if parts < STEPS[0] {
                errors.push(error);
            }
            if error > SMALLEST {
                let estimate = figures.estimate.unwrap_or(f64::INFINITY);
                let deviation = (estimate / error).log10().abs();
                found.push(deviation);
                if parts < STEPS[0] && error > SMALLEST * far {
                    resolved.push(deviation);
                }
            }
        }
        let falls = match errors[..] {
            [medium, short] if short > SMALLEST => falls_with(method.order(), medium / short),
            _ => true,
        };
        if !falls {
            continue;
        }
        deviations.extend(found);
        if !resolved.is_empty() {
            farthest = farthest.max(resolved.iter().sum::<f64>() / resolved.len() as f64);
        }
    }
    deviations.sort_by(f64::total_cmp);
    let at = (SHARE * deviations.len() as f64).ceil() as usize;
    let deviation = at.checked_sub(1).and_then(|at| deviations.get(at)).copied().unwrap_or(0.0);
    let why = "decimal digits by which the estimate of the error misses it, the best four of five: sums of truncation errors know \
               nothing of what a motion amplifies and cancels";
    let checks = vec![
        Check::new(Claim::Failure, "estimates of errors", &subject.name, deviation, 1.0, why),
        Check::new(
            Claim::Failure,
            "estimates of every method",
            &subject.name,
            farthest,
            1.0,
            "decimal digits by which the estimates of the worst method miss the error in the mean, with steps that resolve the motion: a \
             formula of another order misses more",
        ),
        Check::new(
            Claim::Failure,
            "silent runs",
            &subject.name,
            silent,
            SILENT * runs,
            "of all runs those that are wrong by 30 % and go without a warning: estimates are within ten times of the truth in nine of ten",
        ),
    ];
    let passing = || subject.passing(LENGTH as f64 * h);
    Ok(checks.into_iter().map(|check| unless_by_chance(check).unless(passing)).collect())
}

/// Digits by which estimates are off where something is wrong with them, and not with what they cannot know.
const ASTRAY: f64 = 3.0;

/// What is said of errors holds as a rule, not on every scene: estimates that miss by more than a factor of ten, but not by a thousand, are no
/// contradiction of it.
fn unless_by_chance(check: Check) -> Check {
    if check.passed() || check.bound == 0.0 || check.value.is_nan() || check.value > ASTRAY {
        return check;
    }
    let reason = format!(
        "estimates miss errors by {:.1} digits here, and are within one as a rule: this motion amplifies or cancels errors more than \
         they can know",
        check.value
    );
    Check::not_judged(check.claim, check.name, check.scene, reason)
}

/// Whether errors of steps that are four times as long are larger as the order says, to half a power.
fn falls_with(order: u32, ratio: f64) -> bool {
    (ratio.ln() / 4f64.ln() - f64::from(order)).abs() <= 0.5
}

fn completed(outcome: &Outcome) -> Result<(), Unfinished> {
    outcome.end.map(|_| ()).map_err(|failed| failed.failure.into())
}

/// The end and the figures of a run with a method; `None` where it did not come to its end, which it says.
fn monitored(
    subject: &TestCase,
    method: Method,
    dt: f64,
    steps: u64,
) -> Result<Option<(State, ErrorIndicators)>, Unfinished> {
    let TestCase { system, state, .. } = subject;
    let mut state = state.clone();
    let options = ImplicitOptions::default();
    let mut monitor = Monitor::new(system, &state, MonitorOptions::default())?;
    let mut stepper = method.stepper(system, &state, &options)?;
    let go_on = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = run_monitored(&mut *stepper, &mut state, &Schedule::steps(dt, steps), &mut monitor, go_on);
    let figures = monitor.indicators(&state);
    Ok((outcome.status() == Status::Completed).then_some((state, figures)))
}

fn distance(a: &State, b: &State) -> f64 {
    let apart = |(x, y): (&Vector3<f64>, &Vector3<f64>)| (x - y).norm_squared();
    a.positions.iter().zip(&b.positions).map(apart).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::completed;
    use crate::integrate::{Outcome, RunFailure, StepFailure};
    use std::ops::ControlFlow;

    /// A reference that breaks down is none.
    #[test]
    fn only_what_has_come_to_its_end_is_compared_with() {
        let failure = RunFailure { step: 3, time: 0.5, failure: StepFailure::NonFinite };
        assert!(completed(&Outcome { steps: 2, end: Err(failure) }).is_err());
        assert!(completed(&Outcome { steps: 5, end: Ok(ControlFlow::Continue(())) }).is_ok());
    }
}
