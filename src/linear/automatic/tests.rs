//! The accounts that the choice is made by.

use super::super::ordering::OrderingMethod;
use super::super::preconditioner_kind::PreconditionerKind;
use super::*;
use crate::linear::fixtures::{chain, operator, right_hand_side};
use crate::scene::builtin;
use crate::system::System;
use faer::Par;

/// Conjugate gradients with the preconditioner, watched by what factorizations are said to cost.
fn automatic(system: &System, preconditioner: PreconditionerKind, factor: f64, solve: f64) -> AutomaticSolver {
    let direct = CholeskySolver::new(system, Par::Seq, &mut Work::default()).unwrap();
    let iterative = CgSolver::matrix_free(system, Some(preconditioner), 1e-10).unwrap();
    let cost = DirectCost { factor, solve };
    AutomaticSolver { direct: Some(direct), iterative, cost, is_direct: false, lost: 0.0, tried: 0 }
}

fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() <= 1e-9, "{value}, expected {expected}");
}

/// 700 entries and 1.2e6 operations for 100 springs: 7 entries and 12 000 operations a spring. A factorization is
/// 12 000/200 + 1.2 · 7 products, a solve 0.4 · 7.
#[test]
fn costs_follow_from_the_size_of_the_factor() {
    let size = FactorSize { entries: 700, flops: 1.2e6, ordering: OrderingMethod::MinimumDegree };
    let cost = DirectCost::of(size, 100.0);
    assert_near(cost.factor, 68.4);
    assert_near(cost.solve, 2.8);
    assert_near(cost.step(), 71.2);
}

/// An iteration with block Jacobi is 1.4 products. A matrix adds what it costs less what factoring would have, a solve likewise;
/// what is left over from cheap matrices does not count.
#[test]
fn losses_are_added_up_until_they_exceed_one_factorization() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1000.0, 10.0);
    solver.lost = 5.0;
    solver.prepare(&a, &mut work).unwrap();
    assert_near(solver.lost, -995.0);
    solver.solve(&a, &b, &mut x, &mut work).unwrap();
    let effort = 1.4 * work.cg_iterations as f64;
    assert!(effort > 50.0, "{effort}");
    assert_near(solver.lost, effort - 1005.0);
    assert_near(solver.mean_effort(), effort);
    solver.prepare(&a, &mut work).unwrap();
    assert_near(solver.lost, -1000.0);
    assert_near(solver.mean_effort(), 0.5 * effort);
    let choice = solver.choice().unwrap();
    assert_eq!(
        choice,
        format!(
            "cg: conjugate gradients took the work of {:.0} products with A a matrix, factoring and solving take that of 1010",
            0.5 * effort
        )
    );

    assert_eq!((solver.preconditioner(), solver.factor()), (Some("block-jacobi"), None));
    solver.lost = 1010.0;
    solver.prepare(&a, &mut work).unwrap();
    assert_eq!((solver.name(), work.factorizations), ("cg", 0));
    solver.lost = 1010.1;
    solver.prepare(&a, &mut work).unwrap();
    assert_eq!((solver.name(), work.factorizations), ("llt", 1));
    assert_eq!((solver.preconditioner(), solver.factor().unwrap().size), (None, solver.direct.unwrap().size()));
}

/// Factoring costs 20 and solving 2, and 2.3 are lost already: a solve may cost 20 + 2 + 2 − 2.3 = 21.7, which is 15
/// iterations and a half. Then the factorization takes over.
#[test]
fn a_solve_is_given_up_when_it_has_cost_too_much() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 20.0, 2.0);
    solver.prepare(&a, &mut work).unwrap();
    solver.lost = 2.3;
    let solution = solver.solve(&a, &b, &mut x, &mut work).unwrap();
    assert!(solution.relative_residual < 1e-12);
    assert_eq!((work.cg_iterations, work.factorizations, solver.name()), (15, 1, "llt"));
}

/// Conjugate gradients stop at the tolerance that the choice was given.
#[test]
fn the_tolerance_is_passed_on() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1000.0, 10.0);
    solver.set_tolerance(0.1);
    solver.prepare(&a, &mut work).unwrap();
    let residual = solver.solve(&a, &b, &mut x, &mut work).unwrap().relative_residual;
    assert!(residual > 1e-4 && residual <= 0.1, "{residual}");
}

/// Multigrid that knows where the particles are knows rotations, and needs fewer iterations.
#[test]
fn places_are_passed_on_to_multigrid() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let (system, state) = &scene;
    let (a, b) = (operator(&scene, 0.1), right_hand_side(system.dofs().len()));
    let iterations = [false, true].map(|placed| {
        let (mut x, mut work) = (vec![0.0; b.len()], Work::default());
        let mut solver = automatic(system, PreconditionerKind::Multigrid, 1e4, 1e4);
        if placed {
            solver.place(&state.positions);
        }
        solver.prepare(&a, &mut work).unwrap();
        solver.solve(&a, &b, &mut x, &mut work).unwrap();
        work.cg_iterations
    });
    assert!(iterations[1] < iterations[0], "{iterations:?}");
}
