//! The accounts that the choice is made by.

use super::super::preconditioner_kind::PreconditionerKind;
use super::*;
use crate::force::Extensions;
use crate::linear::fixtures::{chain, operator, right_hand_side};
use crate::operator::Combination;
use crate::scene::builtin;
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;

/// Conjugate gradients with the preconditioner, watched by what factorizations are said to cost.
fn automatic(system: &System, preconditioner: PreconditionerKind, factor: f64, solve: f64) -> AutomaticSolver {
    let plan = CholeskyPlan::new(system, Par::Seq, &mut Work::default()).unwrap();
    let iterative = CgSolver::matrix_free(system, Some(preconditioner), 1e-10).unwrap();
    let solver = AutomaticSolver::new(system, iterative, Par::Seq);
    AutomaticSolver { direct: Direct::Seen(Box::new(plan)), cost: DirectCost { factor, solve }, ..solver }
}

fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() <= 1e-9, "{value}, expected {expected}");
}

/// A matrix adds what it costs less what factoring would have, a solve likewise; what is left over from cheap matrices does not
/// count.
#[test]
fn losses_are_added_up_until_they_exceed_one_factorization() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1000.0, 10.0);
    let costs = CostModel::of(&scene.0);
    let blocks = costs.preparation(PreconditionerKind::BlockJacobi);
    solver.lost = 5.0;
    solver.take(&a, &mut work).unwrap();
    assert_near(solver.lost, blocks - 995.0);
    solver.solve(Held(&a), &b, &mut x, &mut work).unwrap();
    let effort = costs.iteration(PreconditionerKind::BlockJacobi) * work.cg_iterations as f64 + costs.iterative_solve();
    assert!(effort > 20.0, "{effort}");
    assert_near(solver.lost, blocks + effort - 1005.0);
    assert_near(solver.mean_effort(), blocks + effort);
    solver.take(&a, &mut work).unwrap();
    assert_near(solver.lost, blocks - 1000.0);
    assert_near(solver.mean_effort(), blocks + 0.5 * effort);
    let choice = solver.choice().unwrap();
    assert_eq!(
        choice,
        format!(
            "cg: conjugate gradients took the work of {:.1} force evaluations a matrix, factoring and solving take that of 1010.0",
            blocks + 0.5 * effort
        )
    );

    assert_eq!(solver.preconditioner(), Some("block-jacobi"));
    solver.lost = 1010.0;
    solver.take(&a, &mut work).unwrap();
    assert_eq!((solver.name(), work.factorizations), ("cg", 0));
    solver.lost = 1010.1;
    solver.take(&a, &mut work).unwrap();
    assert_eq!((solver.name(), work.factorizations), ("llt", 1));
    assert_eq!((solver.preconditioner(), solver.factor().is_some()), (None, true));
}

/// What conjugate gradients find to be indefinite would have been refused by a factorization too, after a quarter of it: within a solve, and, by its blocks,
/// before.
#[test]
fn a_refused_matrix_costs_a_part_of_a_factorization() {
    let scene = chain(80);
    let extensions = Extensions::at(&scene.0, &scene.1.positions).unwrap();
    let negative = Combination { mass: 1.0, damping: 0.0, stiffness: 1.0 };
    let a = SystemOperator::new(&scene.0, &extensions, Stiffness::Axial, negative);
    let (b, mut x, mut work) = (right_hand_side(80), vec![0.0; 80], Work::default());
    let costs = CostModel::of(&scene.0);

    let mut plain = automatic(&scene.0, PreconditionerKind::None, 1000.0, 10.0);
    plain.lost = 300.0;
    plain.take(&a, &mut work).unwrap();
    assert_near(plain.lost, -700.0);
    let solved = plain.solve(Held(&a), &b, &mut x, &mut work);
    assert!(matches!(solved, Err(SolveFailure::Indefinite(_))), "{solved:?}");
    let iterations = work.cg_iterations as f64 * costs.iteration(PreconditionerKind::None);
    assert_near(plain.lost, 50.0 + iterations + costs.iterative_solve());

    let mut blocks = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1000.0, 10.0);
    blocks.lost = 300.0;
    assert!(matches!(blocks.take(&a, &mut work), Err(SolveFailure::Indefinite(_))));
    assert_near(blocks.lost, 50.0 + costs.preparation(PreconditionerKind::BlockJacobi));
}

/// Factoring costs 20 and solving 2, and 2.3 are lost already: a solve may cost 20 + 2 + 2 − 2.3 = 21.7. What that leaves for iterations
/// is done. Then the factorization takes over.
#[test]
fn a_solve_is_given_up_when_it_has_cost_too_much() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 20.0, 2.0);
    solver.take(&a, &mut work).unwrap();
    solver.lost = 2.3;
    let solution = solver.solve(Held(&a), &b, &mut x, &mut work).unwrap();
    assert!(solution.relative_residual < 1e-12);
    let costs = CostModel::of(&scene.0);
    let affordable = (21.7 - costs.iterative_solve()) / costs.iteration(PreconditionerKind::BlockJacobi);
    assert_eq!((work.cg_iterations, work.factorizations, solver.name()), (affordable as u64, 1, "llt"));
}

/// Nothing is looked at before conjugate gradients have cost more than the least that a factorization with a first ordering can.
#[test]
fn patterns_are_analysed_when_it_may_pay() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let iterative = CgSolver::matrix_free(&scene.0, Some(PreconditionerKind::BlockJacobi), 1e-10).unwrap();
    let mut solver = AutomaticSolver::new(&scene.0, iterative, Par::Seq);
    let costs = CostModel::of(&scene.0);
    let least = costs.least_factorization() + costs.least_direct_solve();
    assert_near(solver.patience(), least + costs.glance());
    let mut analysed_after = 0;
    while work.symbolic_factorizations == 0 {
        x.fill(0.0);
        assert!(solver.lost <= solver.patience());
        solver.take(&a, &mut work).unwrap();
        solver.solve(Held(&a), &b, &mut x, &mut work).unwrap();
        analysed_after += 1;
        assert!(analysed_after < 1000);
    }
    // They cost less than the iterations did, so they are chosen at once, and take their memory only then.
    assert!(solver.mean_effort() > solver.cost.step());
    assert!(matches!(solver.direct, Direct::Chosen(_)));
    assert_eq!((solver.name(), solver.patience(), work.symbolic_factorizations), ("llt", f64::INFINITY, 1));
}

/// Factoring a lattice would take more than a few iterations at first glance, so that it is not analysed; only what they cost more than the
/// least of an analysis and a factorization counts from then on.
#[test]
fn what_cannot_pay_is_not_analysed() {
    let scene = builtin::lattice(8).unwrap().build().unwrap();
    let (system, rows) = (&scene.0, scene.0.dofs().len());
    let (a, b) = (operator(&scene, 1e-3), right_hand_side(rows));
    let (mut x, mut work) = (vec![0.0; rows], Work::default());
    let iterative = CgSolver::matrix_free(system, Some(PreconditionerKind::BlockJacobi), 1e-4).unwrap();
    let mut solver = AutomaticSolver::new(system, iterative, Par::Seq);
    solver.take(&a, &mut work).unwrap();
    solver.solve(Held(&a), &b, &mut x, &mut work).unwrap();
    solver.lost = solver.patience() + 0.1;
    solver.take(&a, &mut work).unwrap();
    assert!(matches!(solver.direct, Direct::Glanced(_)));
    assert_eq!((work.symbolic_factorizations, work.factorizations), (1, 0));
    let costs = CostModel::of(system);
    let least = CholeskyGlance::new(system, &mut Work::default()).unwrap().least();
    assert_eq!(solver.cost, DirectCost::of(least, &costs));
    assert_near(solver.patience(), costs.analysis(least) + solver.cost.step());
    assert!(solver.mean_effort() < solver.cost.step());
    assert!(solver.choice().unwrap().ends_with(&format!("would take that of {:.1} at least", solver.cost.step())));
    assert!(solver.factor().is_none());
    // A single matrix that costs as much as that.
    solver.lost = solver.patience() + 0.1;
    solver.take(&a, &mut work).unwrap();
    assert_eq!((work.symbolic_factorizations, work.factorizations), (1, 0));
    assert!(matches!(solver.direct, Direct::Seen(_)) && solver.factor().is_some());
}

/// Conjugate gradients stop at the tolerance that the choice was given.
#[test]
fn the_tolerance_is_passed_on() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    let (mut x, mut work) = (vec![0.0; 80], Work::default());
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1000.0, 10.0);
    solver.set_tolerance(0.1);
    solver.take(&a, &mut work).unwrap();
    let residual = solver.solve(Held(&a), &b, &mut x, &mut work).unwrap().relative_residual;
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
        solver.take(&a, &mut work).unwrap();
        solver.solve(Held(&a), &b, &mut x, &mut work).unwrap();
        work.cg_iterations
    });
    assert!(iterations[1] < iterations[0], "{iterations:?}");
}

/// A factor may take half of what the process may hold.
#[test]
fn a_factor_fits_half_of_the_memory() {
    let half = memory::limit().map_or(u64::MAX, |limit| limit / 2);
    assert!(fits(0) && fits(half) && (half == u64::MAX || !fits(half + 1)));
}

/// What costs more than two thousand force evaluations is not considered, and what takes more than half of the memory neither.
#[test]
fn factors_are_affordable_by_their_work_and_their_memory() {
    let cost = |factor| DirectCost { factor, solve: 100.0 };
    assert!(cost(1900.0).is_affordable(1000) && !cost(1900.1).is_affordable(1000));
    assert_eq!(cost(1.0).is_affordable(u64::MAX), memory::limit().is_none());
}

/// A pattern just glanced at is analysed and factored at once if conjugate gradients have cost more than that in the mean, and otherwise kept in
/// mind.
#[test]
fn factorizations_are_chosen_where_they_would_have_cost_less() {
    let scene = chain(80);
    let (a, b) = (operator(&scene, 0.1), right_hand_side(80));
    for (matrices, is_chosen) in [(1, true), (1_000_000, false)] {
        let mut work = Work::default();
        let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 1e4, 1e4);
        solver.take(&a, &mut work).unwrap();
        solver.solve(Held(&a), &b, &mut [0.0; 80], &mut work).unwrap();
        (solver.direct, solver.tried) = (Direct::Unseen, matrices);
        solver.reconsider(&scene.0, &mut work);
        assert_eq!(solver.mean_effort() > solver.cost.step(), is_chosen);
        assert_eq!(matches!(solver.direct, Direct::Chosen(_)), is_chosen);
        assert_eq!(matches!(solver.direct, Direct::Glanced(_)), !is_chosen);
        assert_eq!(work.symbolic_factorizations, 1);
    }
}

/// A solve that runs out of its budget leads to a look at factorizations. When that does not pay it goes on from where it was: all in all it takes less than
/// half as many iterations more than one that nothing interrupts, where those of the beginning would be 0.7 as many.
#[test]
fn a_look_at_factorizations_does_not_throw_away_a_solve() {
    let scene = builtin::lattice(8).unwrap().build().unwrap();
    let a = operator(&scene, 0.1);
    let b = right_hand_side(scene.0.dofs().len());
    let iterative = || CgSolver::matrix_free(&scene.0, Some(PreconditionerKind::BlockJacobi), 1e-10).unwrap();
    let solve = |solver: &mut dyn LinearSolver, work: &mut Work| {
        let mut x = vec![0.0; b.len()];
        solver.solve(Held(&a), &b, &mut x, work).unwrap();
        work.cg_iterations
    };
    let (mut alone, mut work) = (iterative(), Work::default());
    alone.take(&a, &mut work).unwrap();
    let uninterrupted = solve(&mut alone, &mut work);
    assert!(uninterrupted > 40, "{uninterrupted}");

    let mut solver = AutomaticSolver::new(&scene.0, iterative(), Par::Seq);
    let mut work = Work::default();
    solver.take(&a, &mut work).unwrap();
    let affordable = 0.7 * uninterrupted as f64 * solver.costs.iteration(PreconditionerKind::BlockJacobi);
    solver.lost = solver.patience() + solver.cost.solve - solver.costs.iterative_solve() - affordable;
    let interrupted = solve(&mut solver, &mut work);
    assert!(matches!(solver.direct, Direct::Glanced(_)) && work.iterative_solves == 2);
    assert!(interrupted as f64 <= 1.5 * uninterrupted as f64, "{interrupted} {uninterrupted}");
}

/// Of many matrices, all alike, those that are left to conjugate gradients where factorizations have been chosen: numbers, and what is counted in the end.
fn tried_again(scene: &(System, State), a: &SystemOperator, matrices: u64) -> (AutomaticSolver, Vec<u64>, Work) {
    let mut solver = automatic(&scene.0, PreconditionerKind::BlockJacobi, 20.0, 2.0);
    let (mut tried, mut work) = (Vec::new(), Work::default());
    solver.lost = f64::MAX;
    // Each with a right-hand side that has nothing to do with those before: first guesses would be solutions otherwise.
    let loads: Vec<f64> = (0..80 * matrices).map(|n| ((n * n) as f64 * 0.7).sin()).collect();
    for (matrix, b) in (1..).zip(loads.chunks(80)) {
        let before = work.cg_iterations;
        solver.take(a, &mut work).unwrap();
        let solution = solver.solve(Held(a), b, &mut [0.0; 80], &mut work).unwrap();
        assert!(solution.relative_residual < 1e-9);
        if work.cg_iterations > before {
            tried.push(matrix);
        }
    }
    (solver, tried, work)
}

/// The seventeenth matrix is tried, and from then on all of them, as they take few iterations each. A factor that is needed again takes no analysis.
#[test]
fn conjugate_gradients_are_chosen_again_where_they_cost_less() {
    let scene = chain(80);
    let easy = operator(&scene, 1e-4);
    let (mut solver, tried, mut work) = tried_again(&scene, &easy, 40);
    assert_eq!(tried, Vec::from_iter(17..=40));
    assert_eq!((work.factorizations, solver.name(), solver.factor().is_some()), (16, "cg", true));
    // What the last matrix was cheaper by.
    let costs = CostModel::of(&scene.0);
    let [preparation, iteration] =
        [CostModel::preparation, CostModel::iteration].map(|cost| cost(&costs, PreconditionerKind::BlockJacobi));
    let most = preparation + 6.0 * iteration + costs.iterative_solve() + costs.warm_start() - 22.0;
    assert!(work.cg_iterations <= 24 * 6 && most < 0.0, "{} {most}", work.cg_iterations);
    assert!(solver.lost <= most + 1e-9, "{} {most}", solver.lost);
    solver.lost = 22.1;
    solver.take(&easy, &mut work).unwrap();
    assert_eq!((work.factorizations, work.symbolic_factorizations, solver.name()), (17, 0, "llt"));
}

/// A trial may cost 0.8 · (20 + 2) = 17.6; then the matrix is factored, and twice as many as before are until the next.
#[test]
fn trials_that_fail_become_rare() {
    let scene = chain(80);
    let (solver, tried, work) = tried_again(&scene, &operator(&scene, 0.1), 60);
    assert_eq!(tried, [17, 50]);
    assert_eq!((work.factorizations, solver.name()), (60, "llt"));
    let costs = CostModel::of(&scene.0);
    let [preparation, iteration] =
        [CostModel::preparation, CostModel::iteration].map(|cost| cost(&costs, PreconditionerKind::BlockJacobi));
    let affordable = (17.6 - preparation - costs.iterative_solve() - costs.warm_start()) / iteration;
    assert_eq!(work.cg_iterations, 2 * affordable as u64);
}

/// A trial goes on with the matrix that takes the place of one that was refused, and may cost a quarter of a factorization more.
#[test]
fn a_trial_goes_on_after_a_refused_matrix() {
    let scene = chain(80);
    let (mut solver, _, mut work) = tried_again(&scene, &operator(&scene, 0.1), 16);
    let extensions = Extensions::at(&scene.0, &scene.1.positions).unwrap();
    let negative = Combination { mass: 1.0, damping: 0.0, stiffness: 1.0 };
    let refused = SystemOperator::new(&scene.0, &extensions, Stiffness::Axial, negative);
    assert!(matches!(solver.take(&refused, &mut work), Err(SolveFailure::Indefinite(_))));
    let spent = solver.iterative.effort();
    assert_near(
        solver.trials.left(spent).unwrap(),
        17.6 + 5.0 - solver.costs.preparation(PreconditionerKind::BlockJacobi),
    );
    let easy = operator(&scene, 1e-4);
    solver.take(&easy, &mut work).unwrap();
    solver.solve(Held(&easy), &right_hand_side(80), &mut [0.0; 80], &mut work).unwrap();
    assert_eq!((work.factorizations, solver.name()), (16, "cg"));
}
