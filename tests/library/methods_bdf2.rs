//! The second-order backward differentiation formula: what a step costs, when it is one of backward Euler, and how far it is from the truth.

use crate::motions::{build, case, distance, policies, state_at, with};
use nalgebra::Vector3;
use sprung::chart::dop853;
use sprung::integrate::*;
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::scene::{Kind, builtin};
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

fn scene(kind: Kind, size: usize) -> (System, State) {
    builtin(kind, size).unwrap().build().unwrap()
}

fn directly(stiffness: impl Into<StiffnessPolicy>) -> ImplicitOptions {
    let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
    ImplicitOptions { stiffness: stiffness.into(), linear }
}

/// The end of a run of fixed steps, and what it took.
fn after(
    (system, start): &(System, State),
    method: Method,
    options: &ImplicitOptions,
    [dt, duration]: [f64; 2],
) -> (State, Statistics) {
    let mut state = start.clone();
    let mut stepper = method.stepper(system, start, options).unwrap();
    let outcome = run(&mut *stepper, &mut state, &Schedule::duration(dt, duration), |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed, "{}: {outcome:?}", method.name());
    (state, *stepper.statistics())
}

/// The state that explicit steps of eighth order lead to.
fn truth((system, start): &(System, State), duration: f64) -> State {
    dop853(system, start, duration, 1e-9, Instant::now() + Duration::from_secs(600)).unwrap()
}

/// The distance of all positions from the true ones over their distance from their centre.
fn error(state: &State, truth: &State) -> f64 {
    let centre = truth.positions.iter().sum::<Vector3<f64>>() / truth.positions.len() as f64;
    let spread = truth.positions.iter().map(|x| (x - centre).norm_squared()).sum::<f64>().sqrt();
    distance(&state.positions, &truth.positions) / spread
}

/// Forces at the prediction and at the end, one matrix, one factorization, one solve.
#[test]
fn a_step_is_one_factorization_and_one_solve() {
    for (kind, size, dt, steps) in [
        (Kind::Cloth, 10, 0.01, 60),
        (Kind::Cloth, 12, 0.005, 60),
        (Kind::Chain, 20, 0.005, 100),
        (Kind::String, 40, 0.002, 100),
        (Kind::Lattice, 4, 0.01, 50),
        (Kind::Column, 12, 0.002, 100),
        (Kind::Network, 60, 0.01, 50),
        (Kind::Pendulum, 1, 0.01, 50),
    ] {
        let (_, statistics) =
            after(&scene(kind, size), Method::Bdf2, &directly(StiffnessPolicy::OnDemand), [dt, dt * steps as f64]);
        let expected = Work {
            force_evaluations: 2 * steps,
            assemblies: steps,
            symbolic_factorizations: 1,
            factorizations: steps,
            solves: steps,
            ..Work::default()
        };
        assert_eq!(statistics.work, expected, "{}", kind.name());
        assert!(statistics.max_relative_residual < 1e-12, "{}", kind.name());
    }
}

/// Motion that steps linearised at their start turn into drag: their cloth hangs on the wrong side, with errors of 0.8 and more.
#[test]
fn a_cloth_that_swings_down_ends_on_the_right_side() {
    let cloth = scene(Kind::Cloth, 6);
    let truth = truth(&cloth, 0.5);
    for dt in [1.0 / 60.0, 0.01] {
        let error = |method| {
            let (state, _) = after(&cloth, method, &directly(StiffnessPolicy::OnDemand), [dt, 0.5]);
            error(&state, &truth)
        };
        let (bdf2, notes) = (error(Method::Bdf2), error(Method::LinearBackwardEuler));
        println!("dt = {dt}: {bdf2} {notes}");
        assert!(bdf2 < 0.1 * notes, "dt = {dt}: {bdf2} against {notes}");
    }
}

/// On a taut string with long steps an iteration without transverse terms diverges, and steps would grow without end: it is
/// caught, and iterated. The default has the terms of tensions that last and need not be.
#[test]
fn iterations_that_diverge_are_caught() {
    let string = scene(Kind::String, 40);
    let truth = truth(&string, 0.4);
    let dt = 0.4 / 120.0;
    for (policy, is_enough) in [(StiffnessPolicy::OnDemand, true), (Stiffness::Axial.into(), false)] {
        let (state, statistics) = after(&string, Method::Bdf2, &directly(policy), [dt, 0.4]);
        assert_eq!(statistics.work.newton_iterations == 0, is_enough, "{}", policy.name());
        let error = error(&state, &truth);
        assert!(error < 0.003, "{}: {error}", policy.name());
    }
}

/// Steps of a pattern of lengths, each followed by one up to 2.3 times as long or as short.
#[test]
fn ratios_of_steps_keep_the_order() {
    const PATTERN: [f64; 6] = [1.0, 2.2, 1.0, 0.6, 1.38, 0.7];
    for name in ["damped tetrahedron", "undamped tetrahedron", "pendulum on a moving anchor"] {
        let case = case("trajectories", name);
        let (system, start) = build(&case);
        let end = state_at(&case, 0.5);
        for policy in policies() {
            let errors = [20, 40, 80].map(|patterns| {
                let unit = 0.5 / (patterns as f64 * PATTERN.iter().sum::<f64>());
                let mut state = start.clone();
                let mut stepper = Bdf2::new(&system, &state, &with(policy)).unwrap();
                for step in PATTERN.repeat(patterns) {
                    stepper.step(&mut state, step * unit).unwrap();
                }
                assert!((state.time - 0.5).abs() < 1e-12);
                distance(&state.positions, &end.positions).hypot(distance(&state.velocities, &end.velocities))
            });
            let orders = [0, 1].map(|k| (errors[k] / errors[k + 1]).log2());
            assert!((orders[1] - 2.0).abs() < 0.25, "{name}, {}: {orders:?}, {errors:?}", policy.name());
        }
    }
}

/// To the digit: the same step from the same state by a stepper that has come there and by one that has not, where the one has
/// been told another state; and another step where its past is its own.
#[test]
fn a_changed_state_has_no_past() {
    let case = case("trajectories", "damped tetrahedron");
    let (system, start) = build(&case);
    let options = with(StiffnessPolicy::OnDemand);
    let mut state = start.clone();
    let mut stepper = Bdf2::new(&system, &state, &options).unwrap();
    for _ in 0..3 {
        stepper.step(&mut state, 0.01).unwrap();
    }
    let fresh = |from: &State| {
        let mut state = from.clone();
        Bdf2::new(&system, from, &options).unwrap().step(&mut state, 0.01).unwrap();
        state
    };
    let from = state.clone();
    stepper.step(&mut state, 0.01).unwrap();
    assert_ne!(state, fresh(&from));
    state.velocities[1].x += 0.125;
    let from = state.clone();
    stepper.step(&mut state, 0.01).unwrap();
    assert_eq!(state, fresh(&from));
}

/// The first step is one of backward Euler: the same equations, one solved by one iteration from the same prediction and one to
/// the last digit. They differ by what the next iteration would change.
#[test]
fn the_first_step_is_one_of_backward_euler() {
    let case = case("trajectories", "damped tetrahedron");
    let (system, start) = build(&case);
    let step = |method: Method| {
        let mut state = start.clone();
        method.stepper(&system, &start, &with(Stiffness::Full)).unwrap().step(&mut state, 0.01).unwrap();
        state
    };
    let (bdf2, euler, notes) = (step(Method::Bdf2), step(Method::BackwardEuler), step(Method::LinearBackwardEuler));
    let apart = |other: &State| distance(&other.positions, &euler.positions);
    let coast = start.positions.iter().zip(&start.velocities).zip(&euler.positions);
    let corrected = coast.map(|((x, v), to)| (to - x - v * 0.01).norm_squared()).sum::<f64>().sqrt();
    assert!(apart(&bdf2) < 1e-3 * corrected, "{:e} of {corrected:e}", apart(&bdf2));
    assert!(apart(&notes) > 1e-3 * corrected);
}

/// A failed step leaves the state, and the past with it.
#[test]
fn failed_steps_leave_everything_as_it_was() {
    let (system, start) = scene(Kind::Column, 12);
    let options = directly(Stiffness::Full);
    let run = |fails: bool| {
        let mut state = start.clone();
        let mut stepper = Bdf2::new(&system, &state, &options).unwrap();
        for n in 0..5 {
            if fails && n == 3 {
                let before = state.clone();
                assert_eq!(stepper.step(&mut state, 0.02).unwrap_err().status(), Status::Indefinite);
                assert_eq!(state, before);
            }
            stepper.step(&mut state, 0.002).unwrap();
        }
        state
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn conjugate_gradients_lead_to_the_same_end() {
    let cloth = scene(Kind::Cloth, 8);
    let end = |solver| {
        let linear = SolverOptions { solver, ..SolverOptions::default() };
        after(&cloth, Method::Bdf2, &ImplicitOptions { linear, ..ImplicitOptions::default() }, [0.01, 0.3]).0
    };
    let apart = error(&end(SolverChoice::Cg), &end(SolverChoice::Llt));
    // A correction is solved for until its residual is 1e-7 of what it was.
    assert!(apart < 1e-5, "{apart:e}");
}
