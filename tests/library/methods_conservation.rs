//! Conserved quantities of free bodies: linear momentum under every method, angular momentum under those that promise it.

use crate::motions::{after, build, case, policies, with};
use sprung::force::{Energy, angular_momentum, linear_momentum};
use sprung::integrate::{Equations, ImplicitMidpoint, Method, NewtonOptions, StiffnessPolicy, TimeStepper};
use sprung::{State, Stiffness, System};

fn tumbling(damped: bool) -> (System, State) {
    build(&case("trajectories", if damped { "damped tetrahedron" } else { "undamped tetrahedron" }))
}

#[test]
fn every_method_keeps_linear_momentum() {
    for damped in [false, true] {
        let (system, start) = tumbling(damped);
        let before = linear_momentum(&system, &start);
        for method in Method::ALL {
            for policy in policies() {
                let end = after(&system, &start, method, &with(policy), 2.0, 200);
                let change = (linear_momentum(&system, &end) - before).norm();
                // Rounding of 200 steps, and of the nonlinear methods the residual forces allowed, 1e-10 of a few N.
                let bound = if method.equations() == Equations::Nonlinear { 1e-9 } else { 1e-12 };
                assert!(change < bound, "{}, {}: {change:e}", method.name(), policy.name());
            }
        }
    }
}

#[test]
fn angular_momentum_is_kept_by_those_that_promise_it_and_by_no_other() {
    let (system, start) = tumbling(true);
    let before = angular_momentum(&system, &start);
    let change = |method: Method, policy: StiffnessPolicy| {
        let end = after(&system, &start, method, &with(policy), 2.0, 200);
        (angular_momentum(&system, &end) - before).norm()
    };
    let full = Stiffness::Full.into();
    assert!(change(Method::LinearBackwardEuler, Stiffness::Axial.into()) < 1e-12);
    for method in [Method::LinearBackwardEuler, Method::BackwardEuler, Method::ForwardEuler, Method::W2] {
        assert!(change(method, full) > 1e-6, "{} keeps angular momentum: the test shows nothing", method.name());
    }
    for policy in policies() {
        // The torque of residual forces of 1e-10 of about 5 N at 1 m, over 2 s.
        let change = change(Method::ImplicitMidpoint, policy);
        assert!(change < 5e-9, "{}: {change:e}", policy.name());
    }
    // Explicit damping acts along springs at their present directions, so symplectic Euler keeps it damped or not.
    // So does Verlet, in two halves.
    assert!(change(Method::SymplecticEuler, full) < 1e-12 && change(Method::Verlet, full) < 1e-12);
}

#[test]
fn implicit_midpoint_keeps_angular_momentum_as_exactly_as_it_is_solved() {
    let (system, start) = tumbling(false);
    let change = |tolerance| {
        let newton = NewtonOptions { tolerance, ..Default::default() };
        let mut stepper = ImplicitMidpoint::new(&system, &start, &with(Stiffness::Full), newton).unwrap();
        let mut state = start.clone();
        for _ in 0..40 {
            stepper.step(&mut state, 0.05).unwrap();
        }
        (angular_momentum(&system, &state) - angular_momentum(&system, &start)).norm()
    };
    assert!(change(1e-2) > 1e-7);
    assert!(change(1e-14) < 1e-13);
}

#[test]
fn implicit_midpoint_lets_energy_swing_but_not_drift() {
    let (system, start) = tumbling(false);
    let energy = |state: &State| Energy::of(&system, state).total();
    let drift = |duration: f64| {
        let end =
            after(&system, &start, Method::ImplicitMidpoint, &with(Stiffness::Full), duration, (duration / 0.1) as u64);
        (energy(&end) / energy(&start) - 1.0).abs()
    };
    let decayed = after(&system, &start, Method::BackwardEuler, &with(Stiffness::Full), 100.0, 1000);
    assert!(energy(&decayed) < 0.9 * energy(&start));
    assert!(drift(10.0) < 0.02 && drift(100.0) < 0.02, "{} {}", drift(10.0), drift(100.0));
}
