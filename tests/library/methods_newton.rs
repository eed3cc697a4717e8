//! Newton's method of the nonlinear steppers: its speed near the solution, and its reach.

use crate::motions::{build, case, distance, policies, with};
use nalgebra::Vector3;
use sprung::integrate::{
    BackwardEuler, ImplicitMidpoint, ImplicitOptions, LinearBackwardEuler, NewtonOptions, NotSolved, Status,
    StepFailure, StiffnessPolicy, TimeStepper,
};
use sprung::linear::{SolverChoice, SolverOptions, Tolerance};
use sprung::scene::{Kind, builtin};
use sprung::{Spring, State, Stiffness, System, SystemBuilder};

/// The relative residual after 0, 1, 2, … iterations of one step, until the tolerance is met.
fn residuals(system: &System, start: &State, options: &ImplicitOptions, dt: f64, tolerance: f64) -> Vec<f64> {
    let mut residuals = Vec::new();
    for iteration_limit in 0..60 {
        let newton = NewtonOptions { tolerance, iteration_limit };
        let mut stepper = BackwardEuler::new(system, start, options, newton).unwrap();
        match stepper.step(&mut start.clone(), dt) {
            Ok(()) => {
                residuals.push(stepper.statistics().max_relative_residual);
                return residuals;
            }
            Err(StepFailure::Newton { relative_residual, iterations, reason: NotSolved::IterationLimit }) => {
                assert_eq!(iterations, iteration_limit);
                residuals.push(relative_residual);
            }
            Err(other) => panic!("{other}"),
        }
    }
    panic!("not converged: {residuals:?}")
}

/// Pairs of residuals in a row of which the first is small enough for the last phase and the second above rounding.
fn last_phase(residuals: &[f64]) -> Vec<(f64, f64)> {
    residuals.windows(2).map(|r| (r[0], r[1])).filter(|(a, b)| *a < 1e-2 && *b > 1e-13).collect()
}

#[test]
fn the_full_stiffness_converges_quadratically_with_and_without_damping() {
    for name in
        ["undamped tetrahedron", "damped tetrahedron", "pendulum on a moving anchor", "stiffer spherical pendulum"]
    {
        let (system, start) = build(&case("trajectories", name));
        for dt in [0.02, 0.1, 0.5] {
            let residuals = residuals(&system, &start, &with(Stiffness::Full), dt, 1e-13);
            println!("{name}, dt = {dt}: {residuals:?}");
            // Quadratic: the number of digits at least doubles, less a constant.
            for (before, after) in last_phase(&residuals) {
                let digits = |residual: f64| -residual.log10();
                assert!(digits(after) > 2.0 * digits(before) - 2.5, "{name}, dt = {dt}: {residuals:?}");
            }
            assert!(residuals.len() <= 14, "{name}, dt = {dt}: {residuals:?}");
        }
    }
}

#[test]
fn filters_converge_to_the_same_motion() {
    for name in ["undamped tetrahedron", "damped tetrahedron", "pendulum on a moving anchor"] {
        let (system, start) = build(&case("trajectories", name));
        let newton = NewtonOptions { tolerance: 1e-12, ..Default::default() };
        for dt in [0.02, 0.1, 0.5] {
            let end = |policy: StiffnessPolicy| {
                let mut state = start.clone();
                BackwardEuler::new(&system, &start, &with(policy), newton).unwrap().step(&mut state, dt).unwrap();
                state
            };
            let full = end(Stiffness::Full.into());
            for policy in policies() {
                let difference = distance(&end(policy).positions, &full.positions);
                assert!(difference < 1e-10, "{name}, {}, dt = {dt}: {difference:e}", policy.name());
            }
        }
    }
}

/// A cloth with every particle moved at random.
fn crumpled_cloth(size: usize, by: f64) -> (System, State) {
    let (system, mut state) = builtin(Kind::Cloth, size).unwrap().build().unwrap();
    for (p, x) in state.positions.iter_mut().enumerate() {
        let noise = |k: usize| ((p * 3 + k) as f64 * 12.9898).sin() * 43758.5453 % 1.0;
        *x += Vector3::new(noise(0), noise(1), noise(2)) * by;
    }
    state.prescribe(&system);
    (system, state)
}

/// Every policy that filters the matrix, by factorization and by conjugate gradients.
fn filters() -> Vec<ImplicitOptions> {
    let policies = [StiffnessPolicy::OnDemand, Stiffness::Tension.into(), Stiffness::Axial.into()];
    let solvers = [SolverChoice::Llt, SolverChoice::Cg];
    let options =
        |stiffness, solver| ImplicitOptions { stiffness, linear: SolverOptions { solver, ..Default::default() } };
    policies.iter().flat_map(|&policy| solvers.map(|solver| options(policy, solver))).collect()
}

#[test]
fn crumpled_cloths_are_solved_under_every_filter() {
    // 3 % and 40 % of the distance of neighbours; at dt = 0.01 the axial stiffness is 5000 times M/dt².
    for (by, dt) in [(0.0015, 0.01), (0.0015, 0.1), (0.02, 0.01), (0.02, 0.1)] {
        let (system, start) = crumpled_cloth(12, by);
        for options in filters() {
            let newton = NewtonOptions { iteration_limit: 300, ..Default::default() };
            let mut stepper = BackwardEuler::new(&system, &start, &options, newton).unwrap();
            let mut state = start.clone();
            for _ in 0..3 {
                let step = stepper.step(&mut state, dt);
                assert_eq!(step, Ok(()), "noise {by} m, dt = {dt} s, {options:?}");
            }
            println!(
                "{by} {dt} {} {:?}: {:?}",
                options.stiffness.name(),
                options.linear.solver,
                stepper.statistics().work
            );
        }
    }
}

#[test]
fn conjugate_gradients_solve_no_more_exactly_than_the_step_needs() {
    let (system, start) = crumpled_cloth(12, 0.0015);
    let options = |tolerance| ImplicitOptions {
        stiffness: StiffnessPolicy::OnDemand,
        linear: SolverOptions {
            solver: SolverChoice::Cg,
            tolerance: Tolerance::Fixed(tolerance),
            ..Default::default()
        },
    };
    let work = |tolerance, newton| {
        let mut stepper = BackwardEuler::new(&system, &start, &options(tolerance), newton).unwrap();
        stepper.step(&mut start.clone(), 0.01).unwrap();
        stepper.statistics().work
    };
    let work = work(1e-10, NewtonOptions::default());
    // As many iterations of Newton's method as with Cholesky, within two, at a fraction of what exact solves would take.
    let direct =
        ImplicitOptions { linear: SolverOptions { solver: SolverChoice::Llt, ..Default::default() }, ..options(1e-10) };
    let mut exact = BackwardEuler::new(&system, &start, &direct, NewtonOptions::default()).unwrap();
    exact.step(&mut start.clone(), 0.01).unwrap();
    assert!(work.newton_iterations <= exact.statistics().work.newton_iterations + 2);
    let mut linear = LinearBackwardEuler::new(&system, &start, &options(1e-10)).unwrap();
    linear.step(&mut start.clone(), 0.01).unwrap();
    let one_exact_solve = linear.statistics().work.cg_iterations;
    println!("{work:?}, one exact solve {one_exact_solve}");
    assert!(work.cg_iterations < work.solves * one_exact_solve / 2);
}

#[test]
fn giving_up_says_why_and_leaves_the_state() {
    let (system, start) = crumpled_cloth(8, 0.05);
    let newton = NewtonOptions { iteration_limit: 2, ..Default::default() };
    for midpoint in [false, true] {
        let options = with(StiffnessPolicy::OnDemand);
        let mut stepper: Box<dyn TimeStepper> = match midpoint {
            false => Box::new(BackwardEuler::new(&system, &start, &options, newton).unwrap()),
            true => Box::new(ImplicitMidpoint::new(&system, &start, &options, newton).unwrap()),
        };
        let mut state = start.clone();
        let failure = stepper.step(&mut state, 1.0).unwrap_err();
        assert!(
            matches!(failure, StepFailure::Newton { iterations: 2, reason: NotSolved::IterationLimit, relative_residual } if relative_residual > 0.0)
        );
        assert_eq!(failure.status(), Status::NotConverged);
        assert_eq!(state, start);
    }
}

#[test]
fn an_indefinite_matrix_is_refused_by_cholesky() {
    // A compressed spring far beyond its critical step.
    let mut builder = SystemBuilder::new();
    let a = builder.particle([0.0, 0.0, 0.0], 1.0);
    let b = builder.particle([0.4, 0.0, 0.0], 0.5);
    builder.spring(a, b, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(a);
    let (system, start) = builder.build().unwrap();
    let step = |stiffness: StiffnessPolicy| {
        let options =
            ImplicitOptions { stiffness, linear: SolverOptions { solver: SolverChoice::Llt, ..Default::default() } };
        let mut stepper = BackwardEuler::new(&system, &start, &options, NewtonOptions::default()).unwrap();
        stepper.step(&mut start.clone(), 0.5)
    };
    assert_eq!(step(Stiffness::Full.into()).unwrap_err().status(), Status::Indefinite);
    assert_eq!(step(StiffnessPolicy::OnDemand), Ok(()));
}

/// A particle between two springs along x, moved off the middle.
fn between_springs(wall: f64, mass: f64, rest_length: f64, offset: [f64; 2]) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let particle = builder.particle([offset[0], offset[1], 0.0], mass);
    for wall in [-wall, wall] {
        let wall = builder.particle([wall, 0.0, 0.0], 1.0);
        builder.spring(particle, wall, Spring { stiffness: 0.5, rest_length, damping: 0.0 });
        builder.hold(wall);
    }
    builder.build().unwrap()
}

#[test]
fn no_tolerance_asks_for_digits_that_rounding_takes() {
    // At their rest lengths springs give no force across to first order: motions slow down to where all is rounding.
    for i in 0..200 {
        let (offset, dt) = (1e-4 * (1.0 + 0.05 * f64::from(i)), 0.05 * 1.02f64.powi(i));
        let (system, start) = between_springs(1.2, 2.0, 1.2, [offset; 2]);
        for policy in policies() {
            let newton = NewtonOptions { tolerance: 0.0, iteration_limit: 20 };
            let mut stepper = BackwardEuler::new(&system, &start, &with(policy), newton).unwrap();
            let mut state = start.clone();
            for step in 0..60 {
                let outcome = stepper.step(&mut state, dt);
                assert_eq!(outcome, Ok(()), "{offset}, dt = {dt}, {}, step {step}", policy.name());
            }
        }
    }
}

#[test]
fn a_shallow_saddle_is_left() {
    // Compressed to 0.9: `c = k (1/l − 1/l0)` of both springs, and the critical step sqrt(m / 2c) = 3.
    let (system, start) = between_springs(0.9, 1.0, 1.0, [0.0, 1e-6]);
    for policy in [StiffnessPolicy::OnDemand, Stiffness::Tension.into(), Stiffness::Axial.into()] {
        for beyond in [1e-3, 1e-2, 1e-1] {
            let newton = NewtonOptions { iteration_limit: 60, ..Default::default() };
            let mut stepper = BackwardEuler::new(&system, &start, &with(policy), newton).unwrap();
            let mut state = start.clone();
            let step = stepper.step(&mut state, 3.0 * (1.0 + beyond));
            assert_eq!(step, Ok(()), "{}, {beyond}", policy.name());
            assert!(state.positions[0].y > 1e-3, "{}, {beyond}: {}", policy.name(), state.positions[0]);
        }
    }
}

#[test]
fn an_indefinite_matrix_taken_as_it_is_may_not_descend() {
    let (system, start) = between_springs(0.5, 1.0, 1.0, [0.0, 1e-3]);
    let linear = SolverOptions { solver: SolverChoice::Ldlt, ..Default::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), linear };
    let mut stepper = BackwardEuler::new(&system, &start, &options, NewtonOptions::default()).unwrap();
    let mut state = start.clone();
    let failure = stepper.step(&mut state, 3.0).unwrap_err();
    assert!(matches!(failure, StepFailure::Newton { reason: NotSolved::Ascent, .. }), "{failure}");
    assert!(failure.to_string().contains("does not descend"));
    assert_eq!(state, start);
}
