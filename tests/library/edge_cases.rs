//! Systems with nothing in them, or nothing that moves, work with every method and solver.

use nalgebra::Vector3;
use sprung::integrate::*;
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::system::{Axes, Constraint, Motion};
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::ops::ControlFlow;

const SOLVERS: [SolverChoice; 5] =
    [SolverChoice::Auto, SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled];

const SPRING: Spring = Spring { stiffness: 50.0, rest_length: 0.8, damping: 0.1 };

/// Runs every implicit method with every solver and option; returns the end states.
fn run_all((system, start): &(System, State)) -> Vec<State> {
    let policies = Stiffness::ALL.map(StiffnessPolicy::Always).into_iter().chain([StiffnessPolicy::OnDemand]);
    let mut ends = Vec::new();
    for stiffness in policies {
        for solver in SOLVERS {
            let options = ImplicitOptions { stiffness, linear: SolverOptions { solver, ..Default::default() } };
            let linear = LinearBackwardEuler::new(system, start, &options).unwrap();
            let nonlinear = BackwardEuler::new(system, start, &options, NewtonOptions::default()).unwrap();
            let steppers: [Box<dyn TimeStepper>; 2] = [Box::new(linear), Box::new(nonlinear)];
            for mut stepper in steppers {
                let mut state = start.clone();
                let schedule = Schedule::steps(0.01, 3);
                let outcome = run(stepper.as_mut(), &mut state, &schedule, |_, _| ControlFlow::Continue(()));
                assert_eq!((outcome.status(), outcome.steps), (Status::Completed, 3), "{stiffness:?} {solver:?}");
                ends.push(state);
            }
        }
    }
    StepMatrices::assemble(system, start, Stiffness::Full, 0.01).unwrap();
    ends
}

#[test]
fn no_particles() {
    assert!(run_all(&SystemBuilder::new().build().unwrap()).iter().all(|state| state.positions.is_empty()));
}

#[test]
fn one_particle_falls_as_backward_euler_has_it() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -10.0, 0.0).particle([1.0, 2.0, 3.0], 4.0);
    for end in run_all(&builder.build().unwrap()) {
        // After n steps v = n dt g, x = dt² g (1 + 2 + … + n).
        approx::assert_relative_eq!(end.positions[0].y, 2.0 - 10.0 * 1e-4 * 6.0, max_relative = 1e-14);
        approx::assert_relative_eq!(end.velocities[0].y, -0.3, max_relative = 1e-9);
    }
}

#[test]
fn everything_held_does_not_move() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -10.0, 0.0);
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, SPRING);
    builder.hold(0).hold(1);
    let (system, start) = builder.build().unwrap();
    assert_eq!((system.dofs().len(), system.active_springs().len()), (0, 0));
    for end in run_all(&(system, start.clone())) {
        assert_eq!(end.positions, start.positions);
    }
}

#[test]
fn disconnected_parts_move_as_if_alone() {
    let part = |builder: &mut SystemBuilder, x: f64| {
        let a = builder.particle([x, 0.0, 0.0], 1.5);
        let b = builder.particle([x + 1.0, 0.3, 0.0], 0.7);
        builder.spring(a, b, SPRING);
    };
    let mut alone = SystemBuilder::new();
    part(&mut alone, 0.0);
    let mut both = SystemBuilder::new();
    part(&mut both, 0.0);
    both.particle([5.0, 5.0, 5.0], 2.0);
    part(&mut both, 10.0);
    for (alone, both) in run_all(&alone.build().unwrap()).iter().zip(run_all(&both.build().unwrap())) {
        for p in 0..2 {
            approx::assert_relative_eq!(alone.positions[p], both.positions[p], max_relative = 1e-9);
        }
        assert_eq!(both.positions[2], nalgebra::Vector3::new(5.0, 5.0, 5.0));
    }
}

#[test]
fn a_run_that_collapses_a_spring_names_it_and_keeps_the_last_state() {
    let mut builder = SystemBuilder::new();
    builder.dimension = 1;
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1e-30, rest_length: 1.0, damping: 0.0 });
    builder.velocities[0].x = 1.0;
    builder.velocities[1].x = -1.0;
    let (system, mut state) = builder.build().unwrap();
    let mut stepper = LinearBackwardEuler::new(&system, &state, &ImplicitOptions::default()).unwrap();
    let outcome = run(&mut stepper, &mut state, &Schedule::steps(0.25, 10), |_, _| ControlFlow::Continue(()));
    assert_eq!((outcome.status(), outcome.steps), (Status::DegenerateSpring, 2));
    let message = outcome.end.unwrap_err().failure.to_string();
    assert_eq!(message, "spring 0 has length zero: its ends, particles 0 and 1, coincide");
    assert_eq!((state.time, state.positions[0].x, state.positions[1].x), (0.5, 0.5, 0.5));
}

/// A place and an offset that may each be so large add up to one that no state may have: the squares of its distances are no numbers.
#[test]
fn offsets_that_lead_out_of_the_range_of_numbers_are_refused() {
    let built = |x: f64, offset: f64| {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([x, 0.0, 0.0], 1.0);
        let offsets = vec![Vector3::new(offset, 0.0, 0.0), Vector3::zeros()];
        let motion = Motion::Path { times: vec![0.0, 1.0], offsets };
        builder.constrain(Constraint { particles: vec![1], axes: Axes::ALL, motion });
        builder.build().map(|(_, state)| state).map_err(|error| error.to_string())
    };
    let error = built(6e149, 8e149).unwrap_err();
    assert!(error.starts_with("constraints[0].path.offsets = 1.4") && error.contains("particle 1 axis x"), "{error}");
    assert!(built(-9e149, 9e149).is_ok_and(|state| state.is_finite()));
}
