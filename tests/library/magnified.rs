//! What a run with error control says of motions that magnify its errors, against runs at tolerances so small that they stay small.

use sprung::accuracy::relative_position_error;
use sprung::integrate::{
    Adaptivity, Figures, ImplicitOptions, Method, Monitor, MonitorOptions, StiffnessPolicy, Warning,
    run_adaptive_monitored,
};
use sprung::scene::builtin::{Kind, builtin};
use sprung::{State, System};
use std::ops::ControlFlow;

fn run(system: &System, start: &State, method: Method, duration: f64, rtol: f64) -> (State, Figures) {
    let mut state = start.clone();
    let options = MonitorOptions::of(method, StiffnessPolicy::OnDemand);
    let mut monitor = Monitor::new(system, &state, options).unwrap();
    let mut stepper = method.adaptive_stepper(system, &state, &ImplicitOptions::default()).unwrap().unwrap();
    let how = Adaptivity::new(duration, rtol).unwrap();
    let observe = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = run_adaptive_monitored(&mut *stepper, system, &mut state, &how, &mut monitor, observe);
    assert_eq!(outcome.status().name(), "completed");
    let figures = monitor.figures(&state);
    (state, figures)
}

/// Ready scenes that fold, whip and buckle, and others that do not. Of the first the errors of steps grow by a hundred times and more, and most are wrong
/// by ten tolerances; all of them are told. Estimates are right to about ten times: the pendulum's is a tenth of the truth, twice that is allowed.
#[test]
fn what_the_motion_magnifies_is_told() {
    const RTOL: f64 = 1e-2;
    for (kind, size, duration, is_magnified) in [
        (Kind::Pendulum, 3, 1.0, false),
        (Kind::Pendulum, 3, 10.0, true),
        (Kind::Column, 6, 1.0, true),
        (Kind::Chain, 6, 1.0, false),
        (Kind::Chain, 6, 2.0, true),
        (Kind::Lattice, 3, 2.0, false),
        (Kind::Network, 30, 1.0, false),
        (Kind::Network, 30, 6.0, true),
        (Kind::Cloth, 8, 1.0, true),
    ] {
        let (system, start) = builtin(kind, size).unwrap().build().unwrap();
        let (state, figures) = run(&system, &start, Method::Rodas4, duration, RTOL);
        let (exact, _) = run(&system, &start, Method::Dop853, duration, 1e-10);
        let error = relative_position_error(&state.positions, &exact.positions, &start.positions);
        let estimate = figures.estimate(Method::Rodas4).unwrap();
        let warnings = figures.warnings(Method::Rodas4, Some(RTOL));
        let what = format!("{} {size}, {duration} s: {error:.1e} {estimate:.1e} {figures:?}", kind.name());
        assert!((0.05..20.0).contains(&(estimate / error)), "{what}");
        assert_eq!(figures.carried > 30.0 * figures.embedded, is_magnified, "{what}");
        assert!(error < 3.0 * RTOL || warnings.iter().any(|w| matches!(w, Warning::Magnified(_))), "{what}");
        assert!(error > RTOL || warnings.is_empty(), "{what}");
    }
}
