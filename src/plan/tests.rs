use super::*;
use crate::integrate::Dop853;
use crate::spring::Spring;
use crate::system::fixtures::{row, tethered};

/// Method and tolerance without a step, of run_options for a method, an accuracy, a tolerance.
#[test]
fn what_is_not_asked_for_is_decided() {
    let (verlet, bdf2) = (MethodChoice::Named(Method::Verlet), MethodChoice::Named(Method::Bdf2));
    let auto = Some(MethodChoice::Auto);
    for (method, accuracy, rtol, expected) in [
        (None, None, None, (Some(Method::LinearBackwardEuler), Some(1e-2))),
        (None, None, Some(1e-5), (None, Some(1e-5))),
        (None, Some(1e-3), None, (None, Some(1e-2))),
        (None, Some(1e-3), Some(1e-5), (None, Some(1e-5))),
        (auto, None, None, (None, Some(1e-2))),
        (auto, None, Some(1e-5), (None, Some(1e-5))),
        (Some(verlet), None, None, (Some(Method::Verlet), None)),
        (Some(verlet), Some(1e-3), Some(1e-5), (Some(Method::Verlet), Some(1e-5))),
        (Some(bdf2), None, None, (Some(Method::Bdf2), Some(1e-2))),
    ] {
        let run_options = RunOptions { method, accuracy, rtol, ..RunOptions::default() };
        assert_eq!((run_options.method(), run_options.rtol_without_step()), expected, "{run_options:?}");
    }
}

/// Without a method the stiffness of the scene decides: the oscillator of ω = √10/s is soft for a second and stiff for a million. A step of 0.1 s
/// resolves it, one of 1 s does not.
#[test]
fn stiffness_decides_where_no_method_is_asked_for() {
    let (system, state) = swing();
    let method = |run_options: RunOptions, lengths: [f64; 2], rtol| {
        let plan = run_options.plan(&system, &state, lengths, rtol).unwrap();
        assert!(plan.reason.is_some());
        plan.configuration.method
    };
    assert_eq!(method(RunOptions::default(), [0.1, 1.0], Some(1e-2)), Method::Dop853);
    assert_eq!(method(RunOptions::default(), [0.1, 1e6], Some(1e-2)), Method::Rodas4);
    let auto = RunOptions { method: Some(MethodChoice::Auto), ..RunOptions::default() };
    assert_eq!([0.1, 1.0].map(|dt| method(auto, [dt, 10.0], None)), [Method::Verlet, Method::Bdf2]);
}

/// Each method by its name, and the choice between them last; as many records of a year as of a microsecond.
#[test]
fn there_is_a_choice_for_every_method() {
    let named = Method::ALL.into_iter().map(MethodChoice::Named);
    assert!(named.chain([MethodChoice::Auto]).eq(MethodChoice::ALL));
    for duration in [1e-6, 0.1, 30.0, 3.2e7] {
        assert_eq!(Schedule::duration(records_every(duration), duration).len(), 300, "{duration}");
    }
}

/// Tolerances are as the motion needs where nothing is said, else as is said; solvers that are named are compared to all digits. A stiffness that is
/// asked for is used.
#[test]
fn tolerances_follow_the_motion_where_nothing_is_said() {
    let (system, state) = swing();
    let axial = StiffnessPolicy::Always(Stiffness::Axial);
    for (stiffness, expected) in [(None, ImplicitOptions::default().stiffness), (Some(axial), axial)] {
        let plan = RunOptions { stiffness, ..RunOptions::default() }.plan(&system, &state, [0.1, 1.0], None).unwrap();
        assert_eq!(plan.configuration.options.stiffness, expected);
    }
    let cg = Some(SolverChoice::Cg);
    for (tolerance, solver, expected) in [
        (None, None, Tolerance::Adaptive),
        (None, Some(SolverChoice::Auto), Tolerance::Adaptive),
        (None, cg, Tolerance::default()),
        (Some(1e-3), None, Tolerance::Fixed(1e-3)),
        (Some(1e-3), cg, Tolerance::Fixed(1e-3)),
    ] {
        let run_options = RunOptions { tolerance, solver, ..RunOptions::default() };
        let linear = run_options.plan(&system, &state, [0.01, 1.0], None).unwrap().configuration.options.linear;
        assert_eq!(linear.tolerance, expected, "{tolerance:?} {solver:?}");
    }
}

/// A particle on a spring, held at the other end, swinging about its rest length with a period of 2π/√10 s.
fn swing() -> (System, State) {
    tethered(1.0, 1.0, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 })
}

#[test]
fn monitors_propagate_errors_and_stop_as_they_are_told() {
    let (system, state) = swing();
    let plan = RunOptions::default().plan(&system, &state, [0.01, 1.0], None).unwrap();
    for stops_unstable in [false, true] {
        assert_eq!(plan.monitor(stops_unstable, false), MonitorOptions { threshold: None, stops_unstable });
        assert!(plan.monitor(stops_unstable, true).threshold.is_some());
    }
}

/// Samples of parts have the numbers and times of the whole; the first part begins with a step of dt, later ones with a step that the forces suggest.
#[test]
fn adaptive_runs_go_on_in_parts() {
    let (system, mut state) = swing();
    let plan = RunOptions::default().plan(&system, &state, [0.25, 1.5], Some(1e-3)).unwrap();
    let schedule = Schedule::duration(0.25, 1.5);
    let mut samples = Vec::new();
    for (part, duration, first_step) in [(schedule.part(0, 2), 0.5, Some(0.25)), (schedule.part(2, 100), 1.0, None)] {
        let mut alone = state.clone();
        let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
        let mut stepper = plan.stepper(&system, &state).unwrap();
        let observe = |count, state: &State, _: &Monitor| {
            samples.push((count, state.time));
            ControlFlow::Continue(())
        };
        stepper.run(&system, &mut state, &part, &mut monitor, observe);

        let part_of = Some(1.5);
        let how = AdaptiveOptions { duration, rtol: 1e-3, first_step, sampling: OutputTimes::Every(0.25), part_of };
        let mut monitor = Monitor::new(&system, &alone, MonitorOptions::default()).unwrap();
        let mut stepper = Dop853::new(&system, &alone).unwrap();
        let observe = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
        run_adaptive_monitored(&mut stepper, &system, &mut alone, &how, &mut monitor, observe);
        assert_eq!(state, alone);
    }
    assert_eq!(samples, [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0), (5, 1.25), (6, 1.5)]);
}

/// Threads decide nothing, the number of unknowns does.
#[test]
fn large_factorizations_are_split() {
    for (particles, is_split) in [(10, false), (9_999, false), (10_000, true)] {
        let (system, _) = row(particles);
        assert_eq!(matches!(parallelism(&system), Par::Rayon(_)), is_split, "{particles}");
    }
}
