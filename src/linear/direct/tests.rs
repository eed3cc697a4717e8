use super::*;
use crate::force::SpringGeometry;
use crate::linear::Prepare;
use crate::operator::Combination;
use crate::spring::{Spring, Stiffness};
use crate::system::SystemBuilder;

/// Two free particles and a spring: six rows, and a factor that has all entries of its triangle at least.
#[test]
fn both_factorizations_report_their_factor() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    let (system, _) = builder.build().unwrap();
    let work = &mut Work::default();
    let solvers: [Box<dyn LinearSolver>; 2] = [
        Box::new(CholeskySolver::new(&system, Par::Seq, work).unwrap()),
        Box::new(LdltSolver::new(&system, Par::Seq, work).unwrap()),
    ];
    for solver in solvers {
        let entries = solver.factor().unwrap().size.entries;
        assert!((21..=36).contains(&entries), "{}: {entries}", solver.name());
    }
    // The matrix has the 21 numbers of its triangle, of eight bytes each.
    let plan = CholeskyPlan::new(&system, Par::Seq, work).unwrap();
    assert_eq!(plan.bytes() - plan.factorization.bytes(), 168);
}

/// A particle on a spring from a wall, pressed to half its length, and the matrix of a long step: negative across the spring, twice.
fn pressed(stiffness: f64) -> (System, SpringGeometry) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([0.5, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness, rest_length: 1.0, damping: 0.0 });
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    (system, extensions)
}

#[test]
fn negative_pivots_are_counted() {
    let (system, extensions) = pressed(100.0);
    let work = &mut Work::default();
    let mut solver = LdltSolver::new(&system, Par::Seq, work).unwrap();
    for (dt, expected) in [(0.01, None), (1.0, Some(2))] {
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
        let negative = match solver.take(&a, work).unwrap() {
            Definiteness::Indefinite { negative, .. } => Some(negative),
            _ => None,
        };
        assert_eq!((negative, solver.name()), (expected, "ldlt"));
    }
    assert_eq!(work.factorizations, 2);
}

/// Two particles of just above 1 kg, pressed to half the rest length of their spring: across it A is (ε 1; 1 ε) with ε = 10⁻⁷ times
/// 100 N/m. Either order of elimination begins with that ε and loses seven digits, which refinement gives back.
#[test]
fn refinement_gives_back_what_small_pivots_lose() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0 + 1e-7);
    builder.particle([0.5, 0.0, 0.0], 1.0 + 1e-7);
    builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
    let work = &mut Work::default();
    let mut solver = LdltSolver::new(&system, Par::Seq, work).unwrap();
    let (b, mut x) = ([0.0, 3.0, 0.7, 0.0, 0.2, -0.9], [0.0; 6]);
    let mut prepared = solver.prepare(&a, work).unwrap();
    assert!(prepared.solve(&b, &mut x, work).unwrap().relative_residual < 1e-12);
    // ε x + y = b/100 and x + ε y = c/100.
    for (axis, [b, c]) in [(1, [0.03, 0.002]), (2, [0.007, -0.009])] {
        let (found, expected) = ([x[axis], x[axis + 3]], [c - 1e-7 * b, b - 1e-7 * c]);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-10 * b.abs()), "{found:?} {expected:?}");
    }
}

/// However small or large it is, a right-hand side has its solution: the same digits.
#[test]
fn solutions_have_the_size_of_their_right_hand_side() {
    let (system, extensions) = pressed(100.0);
    let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.01));
    let work = &mut Work::default();
    let solvers: [Box<dyn LinearSolver>; 2] = [
        Box::new(CholeskySolver::new(&system, Par::Seq, work).unwrap()),
        Box::new(LdltSolver::new(&system, Par::Seq, work).unwrap()),
    ];
    for mut solver in solvers {
        let mut solved = |size: f64| {
            let (b, mut x) = ([3.0, -2.0, 0.7].map(|b| b * size), [0.0; 3]);
            let solution = solver.prepare(&a, work).unwrap().solve(&b, &mut x, work).unwrap();
            assert!(solution.relative_residual < 1e-15, "{solution:?}");
            x.map(|x| x / size)
        };
        let plain = solved(1.0);
        for size in [-500.0f64, 500.0].map(f64::exp2) {
            assert_eq!(solved(size), plain);
        }
    }
    assert_eq!(work.solves, 6);
}
