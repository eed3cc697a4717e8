//! The steps at which a pushed spring buckles, by hand.

use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;

/// A particle of 1 kg, 1 m from a held one, on a spring of k = 100 N that is 4 m long at rest: A is 1/dt² + 25 N/m along it, and twice
/// 1/dt² − 75 N/m across.
fn pushed(dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
    builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 4.0, damping: 0.0 });
    builder.hold(anchor);
    let (system, state) = builder.build().unwrap();
    TestCase { name: "pushed".into(), system, state, dt }
}

/// Positive at 0.1 s, −50 N/m at twice that. A value a little above or below zero, for the largest, is not clearly negative.
#[test]
fn the_first_step_that_is_clearly_indefinite_is_found() {
    assert_eq!(indefinite_step(&pushed(0.1)), Some((0.2, 2)));
    assert_eq!(indefinite_step(&pushed(0.2)), Some((0.2, 2)));
    for across in [0.05_f64, -0.05] {
        let dt = 1.0 / (75.0 + across).sqrt();
        assert_eq!(indefinite_step(&pushed(dt)), Some((2.0 * dt, 2)));
    }
    let relaxed = pushed(0.1).relaxed().unwrap();
    assert_eq!(indefinite_step(&relaxed), None);
    assert!(applies(&pushed(0.1)) && indefinite(&pushed(0.1)).unwrap().iter().all(Check::passed));
}

#[test]
fn silence_counts_as_one() {
    assert_eq!([silent(true), silent(false)], [0.0, 1.0]);
}

/// Of a system with one coordinate, or without springs, nothing is solved.
#[test]
fn a_system_has_several_coordinates_and_a_spring() {
    let system = |dimension: usize, joined: bool| {
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
        if joined {
            builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 4.0, damping: 0.0 });
        }
        builder.hold(anchor);
        let (system, state) = builder.build().unwrap();
        has_system(&TestCase { name: "pair".into(), system, state, dt: 0.1 })
    };
    assert_eq!([system(1, true), system(2, true), system(3, true), system(3, false)], [false, true, true, false]);
}

/// `b − 2x = (1, 2)` for b = (3, 4).
#[test]
fn the_residual_is_relative_to_the_right_hand_side() {
    struct Twice;
    impl LinearOperator for Twice {
        fn order(&self) -> usize {
            2
        }
        fn apply(&self, w: &[f64], y: &mut [f64]) {
            y.iter_mut().zip(w).for_each(|(y, w)| *y = 2.0 * w);
        }
    }
    assert_eq!(true_residual(&Twice, &[3.0, 4.0], &[1.0, 1.0]), 5f64.sqrt() / 5.0);
}

/// Whatever the solver, a state that is no number fails as one, and a collapsed spring is named.
#[test]
fn broken_states_of_a_pendulum_are_reported() {
    let subject = TestCase { dt: 0.01, ..pushed(0.01) };
    let checks = broken_states(&subject).unwrap();
    assert_eq!(checks.len(), 4 * 2 + 1);
    assert!(checks.iter().all(Check::passed));
    assert!(conjugate_gradients(&subject).unwrap().iter().all(Check::passed));
}

/// Across one spring A is 10⁻¹² N/m at 0.1 s, which is nothing beside 133 N/m along it; across the other it is negative.
#[test]
fn steps_at_which_an_eigenvalue_is_lost_in_rounding_are_passed_over() {
    let mut builder = SystemBuilder::new();
    for (y, stiffness) in [(0.0, (100.0 - 1e-12) / 0.75), (9.0, 200.0)] {
        let (anchor, bob) = (builder.particle([0.0, y, 0.0], 1.0), builder.particle([1.0, y, 0.0], 1.0));
        builder.spring(anchor, bob, Spring { stiffness, rest_length: 4.0, damping: 0.0 });
        builder.hold(anchor);
    }
    let (system, state) = builder.build().unwrap();
    assert_eq!(indefinite_step(&TestCase { name: "pushed".into(), system, state, dt: 0.1 }), Some((0.2, 4)));
}

/// Every solver has its turn, on a particle that can move.
#[test]
fn states_are_broken_for_the_solver_that_is_asked_for() {
    let subject = pushed(0.1);
    for (solver, name) in [(SolverChoice::Llt, "llt"), (SolverChoice::Ldlt, "ldlt"), (SolverChoice::Cg, "cg")] {
        let stepper = stepper(&subject, solver).unwrap();
        assert_eq!(stepper.linear_solver().map(|solver| solver.name()), Some(name));
    }
    assert_eq!(seen(&subject.system), Some(1));
    let mut builder = SystemBuilder::new();
    (0..3).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
    assert_eq!(seen(&builder.clone().build().unwrap().0), None);
    builder.spring(1, 2, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(1);
    assert_eq!(seen(&builder.build().unwrap().0), Some(2));
}
