//! Propagated errors of motions that magnify the errors of their steps, and of motions that do not, against runs at tolerances so small that errors stay small.

use sprung::accuracy::relative_position_error;
use sprung::integrate::{
    AdaptiveOptions, ErrorIndicators, ImplicitOptions, Method, Monitor, MonitorOptions, Schedule,
    run_adaptive_monitored, run_monitored,
};
use sprung::scene::builtin::{Kind, builtin};
use sprung::{State, System};
use std::ops::ControlFlow;

/// A run with a tolerance, or with steps of a part of the duration.
fn run(system: &System, start: &State, method: Method, duration: f64, rtol: Option<f64>) -> (State, ErrorIndicators) {
    let mut state = start.clone();
    let mut monitor = Monitor::new(system, &state, MonitorOptions::default()).unwrap();
    let observe = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = if let Some(rtol) = rtol {
        let mut stepper = method.adaptive_stepper(system, &state, &ImplicitOptions::default()).unwrap().unwrap();
        let how = AdaptiveOptions::new(duration, rtol).unwrap();
        run_adaptive_monitored(&mut *stepper, system, &mut state, &how, &mut monitor, observe)
    } else {
        let mut stepper = method.stepper(system, &state, &ImplicitOptions::default()).unwrap();
        let schedule = Schedule::steps(duration / 2000.0, 2000);
        run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, observe)
    };
    assert_eq!(outcome.status().name(), "completed");
    let indicators = monitor.indicators(&state);
    (state, indicators)
}

/// Ready scenes that fold, whip and buckle, and others that do not. Estimates are accurate to about a factor of ten, and twice that is allowed; all that is wrong by
/// more than the tolerance allows is told, and until when it was right.
#[test]
fn magnified_errors_are_told() {
    for (kind, size, duration, is_magnified) in [
        (Kind::Pendulum, 3, 1.0, false),
        (Kind::Column, 6, 1.0, true),
        (Kind::Chain, 6, 2.0, true),
        (Kind::Lattice, 3, 2.0, false),
        (Kind::Network, 30, 1.0, false),
    ] {
        let (system, start) = builtin(kind, size).unwrap().build().unwrap();
        let (exact, _) = run(&system, &start, Method::Dop853, duration, Some(1e-11));
        for (method, rtol) in [(Method::Rodas4, Some(1e-2)), (Method::Dop853, Some(1e-3)), (Method::Bdf2, None)] {
            let (state, indicators) = run(&system, &start, method, duration, rtol);
            let error = relative_position_error(&state.positions, &exact.positions, &start.positions);
            let estimate = indicators.estimate.unwrap();
            let what = format!("{} {size}, {}: {error:.1e} {indicators:?}", kind.name(), method.name());
            // Estimates far below what is asked for may be larger: those of DOP853 are of formulas of lower order.
            assert!(estimate > 0.05 * error && (estimate < 20.0 * error || estimate < 1e-3), "{what}");
            let magnified = estimate > 30.0 * indicators.local_errors;
            assert!(!magnified || is_magnified, "{what}");
            let warnings = indicators.warnings(rtol);
            assert!(error < 0.3 || !warnings.is_empty(), "{what}");
            assert_eq!(indicators.predictable_until.is_some_and(|until| until < duration), estimate > 0.02, "{what}");
        }
    }
}
