//! What conjugate gradients count as effort, when they lose patience, and what they do then.

use super::super::reuse::ReusedMultigrid;
use super::*;
use crate::SystemBuilder;
use crate::force::Extensions;
use crate::linear::fixtures::{chain, operator, right_hand_side};
use crate::operator::Combination;
use crate::scene::builtin;
use crate::spring::{Spring, Stiffness};

fn matrix_free(system: &System, kind: Option<PreconditionerKind>) -> CgSolver {
    CgSolver::matrix_free(system, kind, 1e-10).unwrap()
}

fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{value}, expected {expected}");
}

/// Iterations are paid for one by one, over all solves, and every solve for its residuals; 21.7 more pay for so many and a part of one.
#[test]
fn iterations_are_paid_for() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 1.0), right_hand_side(80));
    let mut work = Work::default();
    let mut solver = matrix_free(&scene.0, Some(PreconditionerKind::BlockJacobi));
    let costs = CostModel::of(&scene.0);
    let (iteration, residuals) = (costs.iteration(PreconditionerKind::BlockJacobi), costs.iterative_solve());
    let blocks = costs.preparation(PreconditionerKind::BlockJacobi);
    solver.take(&a, &mut work).unwrap();
    assert_eq!(solver.effort(), blocks);
    for solves in [1.0, 2.0] {
        solver.solve(Held(&a), &b, &mut vec![0.5; 80], &mut work).unwrap();
        assert!(work.cg_iterations > 40);
        assert_near(solver.effort(), blocks + iteration * work.cg_iterations as f64 + residuals * solves);
    }
    solver.allow(21.7);
    let failure = solver.solve(Held(&a), &b, &mut vec![0.5; 80], &mut work).unwrap_err();
    let SolveFailure::NotConverged { iterations, reason, .. } = failure else { panic!("{failure}") };
    assert_eq!((iterations, reason), (((21.7 - residuals) / iteration) as u64, NotConverged::IterationLimit));
}

/// Without multigrid the chain needs as many iterations as it has particles. After 50 without a preconditioner multigrid takes over in the same
/// solve: blocks, which were looked at, are all alike.
#[test]
fn solves_that_take_long_go_on_with_better_preconditioners() {
    let scene = chain(500);
    let (a, b) = (operator(&scene, 1.0), vec![1.0; 500]);
    let mut work = Work::default();
    let mut solver = matrix_free(&scene.0, None);
    solver.take(&a, &mut work).unwrap();
    assert_eq!(solver.preconditioner(), Some("none"));
    solver.solve(Held(&a), &b, &mut [0.0; 500], &mut work).unwrap();
    assert_eq!((solver.preconditioner(), work.multigrid_setups), (Some("multigrid"), 1));
    assert_eq!((work.iterative_solves, work.plain_iterations), (1, 50));
    assert_eq!(work.multigrid_iterations, work.cg_iterations - 50);
    let costs = CostModel::of(&scene.0);
    let [none, blocks, multigrid] =
        [PreconditionerKind::None, PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid]
            .map(|kind| (costs.iteration(kind), costs.preparation(kind)));
    let iterations = 50.0 * none.0 + multigrid.0 * work.multigrid_iterations as f64;
    assert_near(
        solver.effort(),
        iterations + blocks.1 + multigrid.1 + solver.budget.costs.multigrid_setup() + costs.iterative_solve(),
    );
}

/// Conjugate gradients along a spring do not come across what makes a pressed one's matrix indefinite. Its block, which is made where nothing is
/// preconditioned, shows it, in a later matrix too; where masses make sure that it is definite there is none after the first, and who asks for no
/// preconditioner gets none.
#[test]
fn blocks_watch_over_what_may_be_indefinite() {
    let is_refused = |kind, dt| {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0, 0.0, 0.0], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 4.0, damping: 0.0 });
        builder.hold(0);
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
        let mut work = Work::default();
        let mut solver = matrix_free(&system, kind);
        let blocks = solver.budget.costs.preparation(PreconditionerKind::BlockJacobi);
        let taken = solver.take(&a, &mut work);
        assert_eq!(solver.effort(), if kind.is_none() { blocks } else { 0.0 }, "{kind:?} {dt}");
        assert_eq!(solver.preconditioner(), Some("none"));
        match taken {
            Err(failure) => {
                assert!(matches!(failure, SolveFailure::Indefinite(Evidence::DiagonalBlock(_))), "{failure}");
                true
            }
            Ok(_) => {
                solver.solve(Held(&a), &[1.0, 0.0, 0.0], &mut [0.0; 3], &mut work).unwrap();
                assert_eq!((work.cg_iterations, work.plain_iterations), (1, 1));
                let before = solver.effort();
                solver.take(&a, &mut work).unwrap();
                assert_eq!(solver.effort(), before, "{kind:?} {dt}");
                let later = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(1.0));
                assert_eq!(solver.take(&later, &mut work).is_err(), kind.is_none(), "{dt}");
                false
            }
        }
    };
    assert!(is_refused(None, 1.0));
    assert!(!is_refused(None, 0.01));
    assert!(!is_refused(Some(PreconditionerKind::None), 1.0));
}

/// After a matrix that was refused, for its block or for a direction of negative curvature, those that may be indefinite are preconditioned.
#[test]
fn matrices_after_one_that_was_refused_have_blocks() {
    // Across the pressed spring blocks are 20 − 15, and the matrix is 20 − 30 for ends that part; or blocks are 1 − 15.
    for (dt, is_taken) in [(1.0 / 20.0_f64.sqrt(), true), (1.0, false)] {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0, 0.0, 0.0], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 4.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
        let (mut solver, mut work) = (matrix_free(&system, None), Work::default());
        assert_eq!(solver.take(&a, &mut work).is_ok(), is_taken, "{dt}");
        assert_eq!(solver.preconditioner(), Some("none"));
        if is_taken {
            let apart = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0];
            let failure = solver.solve(Held(&a), &apart, &mut [0.0; 6], &mut work).unwrap_err();
            assert!(matches!(failure, SolveFailure::Indefinite(Evidence::NegativeCurvature { .. })), "{failure}");
        }
        assert_eq!(solver.take(&a, &mut work).is_ok(), is_taken, "{dt}");
        assert_eq!(solver.preconditioner(), Some("block-jacobi"));
    }
}

/// With a limit that leaves too little for blocks or multigrid a solve goes on as it is, up to that limit.
#[test]
fn solves_end_at_their_limit() {
    let scene = chain(500);
    let (a, b) = (operator(&scene, 1.0), right_hand_side(500));
    let mut work = Work::default();
    let mut solver = matrix_free(&scene.0, None);
    let costs = CostModel::of(&scene.0);
    solver.take(&a, &mut work).unwrap();
    solver.allow(80.0 * costs.iteration(PreconditionerKind::None));
    assert!(solver.solve(Held(&a), &b, &mut [0.0; 500], &mut work).is_err());
    assert_eq!((solver.preconditioner(), work.multigrid_setups), (Some("none"), 0));
    assert!((75..80).contains(&work.cg_iterations), "{}", work.cg_iterations);
}

/// The multigrid that takes over knows the places that the particles had.
#[test]
fn multigrid_after_the_trial_is_the_one_at_the_places_given() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let (system, state) = &scene;
    let (a, r) = (operator(&scene, 0.1), right_hand_side(system.dofs().len()));
    let mut work = Work::default();
    let applied = |preconditioner: &mut dyn FnMut(&[f64], &mut [f64])| {
        let mut z = vec![0.0; r.len()];
        preconditioner(&r, &mut z);
        z
    };
    let [anywhere, placed] = [false, true].map(|placed| {
        let mut multigrid = ReusedMultigrid::new(system).unwrap();
        if placed {
            multigrid.place(&state.positions);
        }
        multigrid.update(&a, &mut Work::default()).unwrap();
        applied(&mut |r, z| multigrid.apply(r, z))
    });
    assert_ne!(anywhere, placed);
    let mut solver = matrix_free(system, None);
    solver.place(&state.positions);
    solver.take(&a, &mut work).unwrap();
    assert!(solver.change(PreconditionerKind::Multigrid, system));
    solver.prepare_for(&a, &mut work).unwrap();
    assert_eq!(applied(&mut |r, z| _ = solver.preconditioner.apply(r, z)), placed);
}

/// The coarse levels are made once and judged by the digits that they gain: the same matrix again needs no new ones, and the
/// second solve starts from the first solution.
#[test]
fn coarse_levels_are_paid_for_once_and_kept() {
    let scene = chain(200);
    let (a, b) = (operator(&scene, 1.0), right_hand_side(200));
    let mut work = Work { multigrid_setups: 3, ..Work::default() };
    let mut solver = matrix_free(&scene.0, Some(PreconditionerKind::Multigrid));
    solver.take(&a, &mut work).unwrap();
    let costs = CostModel::of(&scene.0);
    let taken = costs.preparation(PreconditionerKind::Multigrid);
    assert_eq!((solver.effort(), work.multigrid_setups), (taken + solver.budget.costs.multigrid_setup(), 4));
    solver.solve(Held(&a), &b, &mut [0.0; 200], &mut work).unwrap();
    assert_eq!(work.warm_starts, 0);
    solver.take(&a, &mut work).unwrap();
    assert_eq!((solver.patience(), solver.coarse().is_some()), (Some(5), true));
    solver.solve(Held(&a), &b, &mut [0.0; 200], &mut work).unwrap();
    assert_eq!((work.multigrid_setups, work.warm_starts), (4, 1));
    let iterations = costs.iteration(PreconditionerKind::Multigrid) * work.cg_iterations as f64;
    let solves = 2.0 * costs.iterative_solve() + costs.warm_start();
    assert_near(solver.effort(), 2.0 * taken + solver.budget.costs.multigrid_setup() + iterations + solves);
}

/// Coarse levels made for a matrix that is nearly diagonal are of no use for a stiff one: they are replaced while it is solved with.
#[test]
fn useless_coarse_levels_are_replaced_in_the_middle_of_a_solve() {
    let scene = chain(1000);
    let (soft, stiff, b) = (operator(&scene, 1e-4), operator(&scene, 1.0), right_hand_side(1000));
    let mut work = Work::default();
    let mut solver = matrix_free(&scene.0, Some(PreconditionerKind::Multigrid));
    for (a, setups) in [(&soft, 1), (&stiff, 2)] {
        solver.take(a, &mut work).unwrap();
        assert_eq!(work.multigrid_setups, 1);
        solver.solve(Held(a), &b, &mut [0.0; 1000], &mut work).unwrap();
        assert_eq!(work.multigrid_setups, setups);
    }
    let costs = CostModel::of(&scene.0);
    let iterations = costs.iteration(PreconditionerKind::Multigrid) * work.cg_iterations as f64;
    let solves = 2.0 * costs.iterative_solve() + costs.warm_start();
    let taken = 2.0 * costs.preparation(PreconditionerKind::Multigrid);
    assert_near(solver.effort(), taken + 2.0 * solver.budget.costs.multigrid_setup() + iterations + solves);
}

/// Where new ones cannot be afforded, useless ones are gone on with as long as there is anything to go on with.
#[test]
fn useless_coarse_levels_are_kept_where_new_ones_cost_too_much() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let rows = scene.0.dofs().len();
    let (soft, stiff, b) = (operator(&scene, 1e-5), operator(&scene, 0.1), right_hand_side(rows));
    let mut work = Work::default();
    let mut solver = matrix_free(&scene.0, Some(PreconditionerKind::Multigrid));
    solver.take(&soft, &mut work).unwrap();
    solver.solve(Held(&soft), &b, &mut vec![0.0; rows], &mut work).unwrap();
    solver.take(&stiff, &mut work).unwrap();
    let before = work.cg_iterations;
    let guess = solver.budget.costs.iterative_solve() + solver.budget.costs.warm_start();
    solver.allow(guess + 7.5 * solver.budget.costs.iteration(PreconditionerKind::Multigrid));
    assert!(solver.solve(Held(&stiff), &b, &mut vec![0.0; rows], &mut work).is_err());
    assert_eq!((work.multigrid_setups, work.cg_iterations - before), (1, 7));
}

/// Coarse matrices are made from some ten thousand rows at a time. With several times as many the coarse levels are as good.
#[test]
fn coarse_levels_of_long_chains_are_as_good() {
    let iterations = [10_000, 40_000].map(|particles| {
        let scene = chain(particles);
        let (a, b) = (operator(&scene, 1.0), right_hand_side(particles));
        let mut work = Work::default();
        let mut solver = matrix_free(&scene.0, Some(PreconditionerKind::Multigrid));
        solver.take(&a, &mut work).unwrap();
        solver.solve(Held(&a), &b, &mut vec![0.0; particles], &mut work).unwrap();
        work.cg_iterations
    });
    assert!(iterations[0] < 100 && iterations[1] < 2 * iterations[0], "{iterations:?}");
}

/// A cloth whose solve takes a few more than the fifty iterations after which it is time for blocks: little is left, so it goes on as it is,
/// as far as that can be afforded.
#[test]
fn solves_that_are_nearly_done_keep_their_preconditioner() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let rows = scene.0.dofs().len();
    let b = right_hand_side(rows);
    let solve = |kind, dt: f64, more: Option<f64>| {
        let a = operator(&scene, dt);
        let mut work = Work::default();
        let mut solver = matrix_free(&scene.0, kind);
        solver.take(&a, &mut work).unwrap();
        more.into_iter().for_each(|more| solver.allow(more));
        let is_done = solver.solve(Held(&a), &b, &mut vec![0.0; rows], &mut work).is_ok();
        (is_done, work.cg_iterations, solver.preconditioner())
    };
    let alone = |dt| solve(Some(PreconditionerKind::None), dt, None).1;
    let mut steps = (0..600).map(|k| 1e-4 * 1.02f64.powi(k)).map(|dt| (dt, alone(dt)));
    let (dt, iterations) = steps.find(|(_, count)| (53..=58).contains(count)).unwrap();
    assert_eq!(solve(None, dt, None), (true, iterations, Some("none")));
    let costs = CostModel::of(&scene.0);
    let price = |iterations: f64| costs.iterative_solve() + iterations * costs.iteration(PreconditionerKind::None);
    for affordable in [51, 52] {
        let (is_done, done, kind) = solve(None, dt, Some(price(affordable as f64 + 0.5)));
        assert_eq!((is_done, done, kind), (false, affordable, Some("none")));
    }
}

/// A cloth whose solve takes hundreds of iterations without a preconditioner leaves room for multigrid where a solve with it can be afforded; no coarse levels
/// are made for a solve that they cannot finish.
#[test]
fn multigrid_is_made_where_it_can_finish_a_solve() {
    let scene = builtin::cloth(48).unwrap().build().unwrap();
    let rows = scene.0.dofs().len();
    let b = right_hand_side(rows);
    let costs = CostModel::of(&scene.0);
    let [none, blocks] = [PreconditionerKind::None, PreconditionerKind::BlockJacobi].map(|kind| costs.iteration(kind));
    let setup = costs.multigrid_setup();
    let solve = |room: f64| {
        let a = operator(&scene, 1e-2);
        let mut work = Work::default();
        let mut solver = matrix_free(&scene.0, None);
        solver.take(&a, &mut work).unwrap();
        solver.allow(costs.iterative_solve() + 50.0 * none + 102.0 * blocks + room * setup);
        let is_done = solver.solve(Held(&a), &b, &mut vec![0.0; rows], &mut work).is_ok();
        (work.multigrid_setups, is_done)
    };
    let outcomes: Vec<_> = (1..16).map(|parts| solve(0.5 * f64::from(parts))).collect();
    assert!(outcomes.first() == Some(&(0, false)) && outcomes.last() == Some(&(1, true)), "{outcomes:?}");
    assert!(!outcomes.contains(&(1, false)), "{outcomes:?}");
}

/// The coarse levels at hand are priced by their multiplications.
#[test]
fn coarse_levels_are_priced_as_they_are() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let sizes = CostModel::of(&scene.0);
    let known = sizes.with_coarse_levels(crate::multigrid::Multigrid::new(&scene.0).unwrap().multiplications());
    assert!(known.multigrid_setup() > 0.0 && known != sizes);
    for (kind, expected) in [(PreconditionerKind::BlockJacobi, sizes), (PreconditionerKind::Multigrid, known)] {
        assert_eq!(matrix_free(&scene.0, Some(kind)).budget.costs, expected);
        let mut solver = matrix_free(&scene.0, None);
        solver.change(kind, &scene.0);
        assert_eq!(solver.budget.costs, expected);
    }
}
