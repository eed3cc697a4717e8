//! Which solvers are compared on which systems, and what can be asked of iterations.

use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;

/// A chain that bends, the springs so much longer at rest than they are.
fn chain(particles: usize, squeeze: f64) -> Subject {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.5, -9.0, 0.25);
    for n in 0..particles {
        let t = n as f64;
        builder.particle([1.1 * t, (0.9 * t).sin(), (0.7 * t).cos()], 1.0 + 0.5 * (1.3 * t).sin());
        if n > 0 {
            let stiffness = 40.0 + 10.0 * t.cos();
            builder.spring(n - 1, n, Spring { stiffness, rest_length: squeeze * (1.2 + 0.1 * t.sin()), damping: 0.25 });
        }
    }
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    Subject { name: "chain".into(), system, state, dt: 0.2 }
}

fn names(checks: &[Check]) -> Vec<&str> {
    checks.iter().map(|check| check.name.as_str()).collect()
}

/// Three direct solvers and two iterations; these leave what they were asked for, thousands of times what those leave.
#[test]
fn every_solver_solves_a_definite_system() {
    let checks = solvers(&chain(30, 1.0)).unwrap();
    assert!(checks.iter().all(Check::passed), "{:?}", checks.iter().find(|check| !check.passed()));
    let errors = |method: &str| ["normwise", "componentwise"].map(|kind| format!("{kind} backward error of {method}"));
    let mut expected = errors("Cholesky").to_vec();
    for method in ["LDLᵀ", "nalgebra-sparse's Cholesky", "dense Cholesky"] {
        expected.extend(errors(method));
        expected.push(format!("{method} against Cholesky"));
    }
    for method in ["CG, matrix-free", "CG, assembled"] {
        expected.extend([format!("relative residual of {method}"), format!("{method} against Cholesky")]);
    }
    expected.push("condition estimate against the dense inverse".into());
    assert_eq!(names(&checks), expected);
    let left = |name: &str| checks.iter().find(|check| check.name.contains(name)).map(|check| check.value).unwrap();
    assert!(left("residual of CG, matrix-free") > 1e-13 && left("residual of CG, assembled") > 1e-13);
}

#[test]
fn iterations_stop_at_the_tolerance_that_they_are_given() {
    let Subject { system, state, dt, .. } = chain(30, 1.0);
    let (option, matrix, b, _) = definite(&system, &state, dt).unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let operator = SystemOperator::new(&system, &extensions, option, Combination::step(dt));
    for (tolerance, least) in [(1e-2, 1e-6), (1e-6, 1e-9)] {
        let x = solve_with(&system, &operator, &b, SolverChoice::Cg, tolerance).unwrap();
        let check = tolerance_is_met(&matrix.to_csc(), &b, &x, tolerance, "CG", "chain");
        assert!(check.passed() && check.value > least, "{tolerance}: {:e}", check.value);
    }
}

/// Springs that are pushed to half of their length make A indefinite: all solvers then solve it without the terms of those springs, and
/// LDLᵀ alone with them.
#[test]
fn an_indefinite_system_is_one_for_ldlt() {
    let subject = Subject { dt: 2.0, ..chain(10, 2.0) };
    let checks = solvers(&subject).unwrap();
    let indefinite: Vec<_> = checks.iter().filter(|check| check.name.ends_with("A indefinite")).collect();
    assert_eq!(indefinite.len(), 1);
    assert!(indefinite[0].passed() && indefinite[0].scene == "chain, full");
    assert!(checks.iter().all(|check| check.scene == "chain, full" || check.scene == "chain, tension"));
}

/// Of matrices with more rows than that a dense solver, and a solver without blocks, would take long.
#[test]
fn slow_solvers_are_left_to_small_systems() {
    let identity = |n: usize| CscMatrix::<f64>::identity(n);
    let solved = |attempt: Attempt| attempt.map(|x| x.unwrap());
    assert_eq!(solved(dense(&identity(DENSE_LIMIT), &[3.0; DENSE_LIMIT])), Some(vec![3.0; DENSE_LIMIT]));
    assert_eq!(solved(sparse(&identity(SPARSE_LIMIT), &[3.0; SPARSE_LIMIT])), Some(vec![3.0; SPARSE_LIMIT]));
    assert!(dense(&identity(DENSE_LIMIT + 1), &[3.0; DENSE_LIMIT + 1]).is_none());
    assert!(sparse(&identity(SPARSE_LIMIT + 1), &[3.0; SPARSE_LIMIT + 1]).is_none());
}

/// A hundred units of rounding of `|A||x| + |b|`, of which the norm is 5 · (10⁶ + 1) where that of b is 5, and 1e-10 at least.
#[test]
fn no_more_is_asked_of_iterations_than_rounding_allows() {
    let a = CscMatrix::identity(2);
    let asked = attainable(&a, &[3.0, 4.0], &[3e6, -4e6]);
    assert!((asked / (100.0 * U * (1e6 + 1.0)) - 1.0).abs() < 1e-14, "{asked:e}");
    assert_eq!([attainable(&a, &[3.0, 4.0], &[3.0, 4.0]), attainable(&a, &[0.0; 2], &[1.0; 2])], [1e-10; 2]);
}

/// Blocks are what every system can be preconditioned with in the same way.
#[test]
fn iterations_are_preconditioned_by_blocks() {
    let SolverOptions { solver, preconditioner, tolerance, .. } = options(SolverChoice::CgAssembled, 1e-7);
    assert_eq!((solver, tolerance), (SolverChoice::CgAssembled, Tolerance::Fixed(1e-7)));
    assert_eq!(preconditioner, Some(PreconditionerKind::BlockJacobi));
}
