//! Which solver is chosen, and what finding out may cost.

use super::*;
use crate::force::SpringGeometry;
use crate::linear::fixtures::{chain, operator, right_hand_side};
use crate::linear::outcome::Evidence;
use crate::operator::Combination;
use crate::scene::builtin;
use crate::spring::{Spring, Stiffness};
use crate::system::SystemBuilder;

fn automatic(system: &System, factors: bool) -> AutomaticSolver {
    AutomaticSolver::new(system, &SolverOptions::default(), Application::MatrixFree, factors).unwrap()
}

fn solve(solver: &mut AutomaticSolver, a: &SystemOperator, work: &mut Work) -> Result<Solution, SolveFailure> {
    solver.take(a, work)?;
    let rows = a.system().dofs().len();
    solver.solve(Held(a), &right_hand_side(rows), &mut vec![0.0; rows], work)
}

/// Where masses dominate, block Jacobi needs few iterations and nothing else is looked at.
#[test]
fn easy_matrices_are_left_to_block_jacobi() {
    let scene = chain(500);
    let (a, mut work, mut solver) = (operator(&scene, 1e-4), Work::default(), automatic(&scene.0, true));
    solve(&mut solver, &a, &mut work).unwrap();
    assert_eq!((solver.name(), solver.preconditioner()), ("cg", Some("block-jacobi")));
    assert_eq!((work.symbolic_factorizations, work.multigrid_setups), (0, 0));
    assert!(solver.choice().unwrap().contains("not been considered"));
}

/// Block Jacobi needs as many iterations as the chain has particles. It may spend what multigrid would; then the pattern is analysed, and a chain
/// is cheap to factor. The next matrix is factored at once.
#[test]
fn stiff_matrices_are_factored_where_that_is_cheap() {
    let scene = chain(2000);
    let (a, mut work, mut solver) = (operator(&scene, 1.0), Work::default(), automatic(&scene.0, true));
    let allowed = solver.multigrid_price.of(1.0) / solver.costs.iteration(PreconditionerKind::BlockJacobi);
    let solution = solve(&mut solver, &a, &mut work).unwrap();
    assert!(solution.relative_residual < 1e-9, "{solution:?}");
    assert_eq!((work.cg_iterations, work.factorizations, solver.name()), (allowed as u64, 1, "llt"));
    assert!(solver.factor().is_some() && solver.preconditioner().is_none());
    solve(&mut solver, &a, &mut work).unwrap();
    assert_eq!((work.cg_iterations, work.factorizations, work.symbolic_factorizations), (allowed as u64, 2, 1));
}

/// Without factorizations multigrid takes over, at the places that the particles have.
#[test]
fn stiff_matrices_have_multigrid_where_nothing_is_factored() {
    let scene = builtin::cloth(16).unwrap().build().unwrap();
    let a = operator(&scene, 0.1);
    let iterations = [false, true].map(|is_placed| {
        let (mut work, mut solver) = (Work::default(), automatic(&scene.0, false));
        if is_placed {
            solver.place(&scene.1.positions);
        }
        solver.multigrid_price.solve = 0.0;
        solve(&mut solver, &a, &mut work).unwrap();
        assert_eq!((solver.name(), solver.preconditioner()), ("cg", Some("multigrid")));
        assert_eq!((work.multigrid_setups, work.symbolic_factorizations), (1, 0));
        work.multigrid_iterations
    });
    assert!(iterations[1] > 0 && iterations[1] < iterations[0], "{iterations:?}");
}

/// Steps that become short again are left to block Jacobi after twice sixteen matrices, because the first attempt was in vain.
#[test]
fn block_jacobi_is_tried_again() {
    let scene = chain(500);
    let [stiff, easy] = [1.0, 1e-4].map(|dt| operator(&scene, dt));
    let (mut work, mut solver) = (Work::default(), automatic(&scene.0, true));
    solve(&mut solver, &stiff, &mut work).unwrap();
    for _ in 0..2 * FIRST_TRIAL {
        solve(&mut solver, &easy, &mut work).unwrap();
        assert_eq!(solver.name(), "llt");
    }
    solve(&mut solver, &easy, &mut work).unwrap();
    assert_eq!(solver.name(), "cg");
    let iterations = work.cg_iterations;
    // A trial in vain ends in a factorization, and the next one comes later.
    solve(&mut solver, &stiff, &mut work).unwrap();
    assert_eq!((solver.name(), solver.until_trial), ("llt", 4 * FIRST_TRIAL));
    assert!(work.cg_iterations > iterations);
}

/// What cannot be had is not considered again, and block Jacobi goes on to its own limit.
#[test]
fn block_jacobi_goes_on_where_there_is_nothing_else() {
    let scene = chain(500);
    let (a, mut work, mut solver) = (operator(&scene, 1.0), Work::default(), automatic(&scene.0, false));
    solver.multigrid_price = Price::UNAFFORDABLE;
    solve(&mut solver, &a, &mut work).unwrap();
    assert!(solver.preconditioner() == Some("block-jacobi") && work.cg_iterations >= 490, "{work:?}");
}

/// Two pressed particles: their blocks are 20 − 15 across the spring and the matrix is 20 − 30 for ends that part, or the blocks are 1 − 15. Either way
/// the matrix is refused, by conjugate gradients and by a factorization.
#[test]
fn indefinite_matrices_are_refused() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0, 0.0, 0.0], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 4.0, damping: 0.0 });
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let refusal = |dt: f64, method| {
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
        let (mut solver, mut work) = (automatic(&system, true), Work::default());
        if method == Method::Cholesky {
            solver.direct = Direct::Ready(Box::new(CholeskySolver::new(&system, Par::Seq, &mut work).unwrap()));
            solver.method = method;
        }
        let apart = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0];
        let taken = solver.take(&a, &mut work);
        taken.and_then(|_| solver.solve(Held(&a), &apart, &mut [0.0; 6], &mut work)).unwrap_err()
    };
    let [curvature, block] = [1.0 / 20.0_f64.sqrt(), 1.0].map(|dt| refusal(dt, Method::BlockJacobi));
    assert!(matches!(curvature, SolveFailure::Indefinite(Evidence::NegativeCurvature { .. })), "{curvature}");
    assert!(matches!(block, SolveFailure::Indefinite(Evidence::DiagonalBlock(_))), "{block}");
    let pivot = refusal(1.0, Method::Cholesky);
    assert!(matches!(pivot, SolveFailure::Indefinite(Evidence::Pivot(_))), "{pivot}");
}
