//! Exact reductions: that they are found, and change nothing.

use sprung::accuracy::{Reduction, reduce, relative_position_error};
use sprung::integrate::{Equations, ImplicitOptions, Method, Schedule, Status, StiffnessPolicy, run};
use sprung::linear::SolverOptions;
use sprung::{Spring, State, System, SystemBuilder};
use std::ops::ControlFlow;

/// Two chains that share a held particle: one swings in the plane z = 0.3, the other hangs at rest, exactly at its length.
fn two_parts() -> (System, State) {
    let mut builder = SystemBuilder::new();
    let spring = |rest_length| Spring { stiffness: 30.0, rest_length, damping: 0.1 };
    let anchor = builder.particle([0.0, 0.0, 0.3], 1.0);
    let a = builder.particle([1.0, 0.25, 0.3], 0.5);
    let b = builder.particle([2.0, 0.0, 0.3], 0.7);
    let c = builder.particle([0.0, -1.0, 0.3], 0.4);
    let d = builder.particle([0.5, -1.0, 1.3], 0.4);
    builder.spring(anchor, a, spring(0.9));
    builder.spring(a, b, spring(1.2));
    builder.spring(anchor, c, spring(1.0));
    builder.spring(c, d, spring((0.25f64 + 1.0).sqrt()));
    builder.hold(anchor);
    builder.velocities[b] = nalgebra::Vector3::new(0.3, -0.2, 0.0);
    builder.build().unwrap()
}

#[test]
fn reductions_are_found() {
    let (system, state) = two_parts();
    let reduced = reduce(&system, &state);
    assert!(reduced.reductions.contains(&Reduction::Axis { axis: 'z', coordinates: 2 }), "{:?}", reduced.reductions);
    assert!(
        reduced.reductions.contains(&Reduction::AtRest { particles: 2, coordinates: 6 }),
        "{:?}",
        reduced.reductions
    );
    assert_eq!((system.dofs().len(), reduced.system.dofs().len()), (12, 4));
}

#[test]
fn reductions_do_not_change_the_motion() {
    let (system, start) = two_parts();
    let reduced = reduce(&system, &start).system;
    for method in Method::ALL {
        // The full stiffness: a policy that looks at definiteness would look at different matrices.
        let options = ImplicitOptions {
            stiffness: StiffnessPolicy::Always(sprung::Stiffness::Tension),
            linear: SolverOptions::default(),
        };
        let motion = |system: &System| {
            let mut state = start.clone();
            let mut stepper = method.stepper(system, &start, &options).unwrap();
            let outcome =
                run(stepper.as_mut(), &mut state, &Schedule::steps(0.01, 200), |_, _| ControlFlow::Continue(()));
            assert_eq!(outcome.status(), Status::Completed, "{}", method.name());
            state
        };
        let (full, less) = (motion(&system), motion(&reduced));
        if method.is_implicit() {
            // Another elimination order rounds differently; Newton's methods stop at a relative residual of 1e-10.
            let newton = method.equations() == Equations::Nonlinear;
            let error = relative_position_error(&less.positions, &full.positions, &start.positions);
            assert!(error <= if newton { 1e-8 } else { 1e-12 }, "{}: {error:e}", method.name());
        } else {
            assert_eq!(full, less, "{}", method.name());
        }
    }
}

#[test]
fn nothing_is_reduced_where_something_moves() {
    let (system, state) = two_parts();
    // A velocity out of the plane, and a force on the part at rest.
    let mut tilted = state.clone();
    tilted.velocities[2].z = 1e-9;
    assert!(!reduce(&system, &tilted).reductions.iter().any(|r| matches!(r, Reduction::Axis { .. })));
    let mut pulled = state.clone();
    pulled.positions[3].y = -1.01;
    assert!(!reduce(&system, &pulled).reductions.iter().any(|r| matches!(r, Reduction::AtRest { .. })));
}
