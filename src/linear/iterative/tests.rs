//! What conjugate gradients count, and what is kept from one solve to the next.

use super::*;
use crate::linear::Prepare;
use crate::linear::fixtures::{chain, operator, right_hand_side};

fn solver(system: &System, kind: PreconditionerKind) -> CgSolver {
    CgSolver::matrix_free(system, kind, 1e-10).unwrap()
}

/// Iterations are counted by their preconditioner, and a second solve starts from the first solution.
#[test]
fn work_is_counted() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 1.0), right_hand_side(80));
    for kind in PreconditionerKind::ALL {
        let (mut work, mut solver) = (Work::default(), solver(&scene.0, kind));
        let mut prepared = solver.prepare(&a, &mut work).unwrap();
        prepared.solve(&b, &mut [0.0; 80], &mut work).unwrap();
        let first = work;
        assert!(first.cg_iterations > 0 && (first.solves, first.iterative_solves, first.warm_starts) == (1, 1, 0));
        prepared.solve(&b, &mut [0.0; 80], &mut work).unwrap();
        assert_eq!((work.cg_iterations, work.solves, work.warm_starts), (first.cg_iterations, 2, 1), "{kind:?}");
        let plain = if kind == PreconditionerKind::None { work.cg_iterations } else { 0 };
        let multigrid = if kind == PreconditionerKind::Multigrid { work.cg_iterations } else { 0 };
        assert_eq!((work.plain_iterations, work.multigrid_iterations), (plain, multigrid), "{kind:?}");
        assert_eq!(work.multigrid_setups, u64::from(kind == PreconditionerKind::Multigrid));
    }
}

/// At the limit a solve ends and says so; what it has found serves as a first guess.
#[test]
fn solves_end_at_their_limit() {
    let scene = chain(500);
    let (a, b) = (operator(&scene, 1.0), right_hand_side(500));
    let (mut work, mut solver) = (Work::default(), solver(&scene.0, PreconditionerKind::BlockJacobi));
    let mut prepared = solver.prepare(&a, &mut work).unwrap();
    let own = std::mem::replace(&mut prepared.method().iteration_limit, 400);
    let mut x = [0.0; 500];
    let failure = prepared.solve(&b, &mut x, &mut work).unwrap_err();
    let SolveFailure::NotConverged { iterations, reason, .. } = failure else { panic!("{failure}") };
    assert_eq!((iterations, reason), (400, NotConverged::IterationLimit));
    prepared.method().iteration_limit = own;
    prepared.solve(&b, &mut x, &mut work).unwrap();
}

/// Coarse matrices are made from some ten thousand rows at a time. With several times as many the coarse levels are as good.
#[test]
fn coarse_levels_of_long_chains_are_as_good() {
    let iterations = [10_000, 40_000].map(|particles| {
        let scene = chain(particles);
        let (a, b) = (operator(&scene, 1.0), right_hand_side(particles));
        let (mut work, mut solver) = (Work::default(), solver(&scene.0, PreconditionerKind::Multigrid));
        solver.prepare(&a, &mut work).unwrap().solve(&b, &mut vec![0.0; particles], &mut work).unwrap();
        work.cg_iterations
    });
    assert!(iterations[0] < 100 && iterations[1] < 2 * iterations[0], "{iterations:?}");
}
