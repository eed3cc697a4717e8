//! Counts of work: a change that makes a step do more shows here, on every machine alike.

use sprung::integrate::*;
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
use sprung::work::Work;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::ops::ControlFlow;

/// A hanging net of n × n particles, stretched a little everywhere, so that A is definite under every option.
fn net(n: usize) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, 0.0, -9.81);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        builder.particle([i as f64, j as f64, 0.0], 1.0 + 0.1 * (i + 2 * j) as f64);
    }
    let spring = Spring { stiffness: 400.0, rest_length: 0.95, damping: 0.2 };
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        if i + 1 < n {
            builder.spring(i * n + j, (i + 1) * n + j, spring);
        }
        if j + 1 < n {
            builder.spring(i * n + j, i * n + j + 1, spring);
        }
    }
    builder.hold(0).hold(n - 1).hold(n * (n - 1)).hold(n * n - 1);
    builder.build().unwrap()
}

/// Twenty steps; asserts that the run completed.
fn statistics((system, start): &(System, State), dt: f64, options: &ImplicitOptions) -> Statistics {
    let mut state = start.clone();
    let mut stepper = LinearBackwardEuler::new(system, start, options).unwrap();
    let outcome = run(&mut stepper, &mut state, &Schedule::steps(dt, 20), |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed);
    *stepper.statistics()
}

fn options(solver: SolverChoice, stiffness: impl Into<StiffnessPolicy>) -> ImplicitOptions {
    ImplicitOptions { stiffness: stiffness.into(), linear: SolverOptions { solver, ..Default::default() } }
}

#[test]
fn direct_solvers_analyse_once_and_factor_once_a_step() {
    for solver in [SolverChoice::Auto, SolverChoice::Llt, SolverChoice::Ldlt] {
        let statistics = statistics(&net(6), 0.01, &options(solver, Stiffness::Full));
        let expected = Work {
            force_evaluations: 20,
            assemblies: 20,
            symbolic_factorizations: 1,
            factorizations: 20,
            solves: 20,
            ..Work::default()
        };
        assert_eq!(statistics.work, expected, "{solver:?}");
        assert!(statistics.max_relative_residual < 1e-14);
    }
}

#[test]
fn conjugate_gradients_factor_nothing_and_better_preconditioners_take_fewer_iterations() {
    let counts = [PreconditionerKind::None, PreconditionerKind::Jacobi, PreconditionerKind::BlockJacobi].map(|kind| {
        let mut options = options(SolverChoice::Cg, Stiffness::Full);
        options.linear.preconditioner = Some(kind);
        let free = statistics(&net(6), 0.1, &options);
        options.linear.solver = SolverChoice::CgAssembled;
        let assembled = statistics(&net(6), 0.1, &options);
        assert_eq!((free.work.factorizations, free.work.symbolic_factorizations, free.work.solves), (0, 0, 20));
        assert!(free.max_relative_residual <= 1e-10 && free.max_relative_residual > 0.0);
        // Both apply the same A: rounding may move an iteration count by one now and then.
        assert!(free.work.cg_iterations.abs_diff(assembled.work.cg_iterations) <= 4);
        free.work.cg_iterations
    });
    // Twenty steps of 96 unknowns: without rounding a solve takes at most as many iterations.
    assert!(counts[0] > counts[1] && counts[1] > counts[2] && counts[0] <= 20 * 96, "{counts:?}");
}

#[test]
fn on_demand_drops_transverse_terms_only_where_a_is_indefinite() {
    let mut builder = SystemBuilder::new();
    for p in 0..4 {
        builder.particle([p as f64 * 0.5, 0.01 * (p % 2) as f64, 0.0], 1.0);
    }
    for p in 0..3 {
        builder.spring(p, p + 1, Spring { stiffness: 10.0, rest_length: 1.0, damping: 0.0 });
    }
    let chain = builder.build().unwrap();
    for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg] {
        let tame = statistics(&chain, 0.01, &options(solver, StiffnessPolicy::OnDemand));
        assert_eq!(tame.softened_solves, 0, "{solver:?}");
        let wild = statistics(&chain, 1.0, &options(solver, StiffnessPolicy::OnDemand));
        assert!(wild.softened_solves > 0 && wild.softened_solves < 20, "{solver:?}: {}", wild.softened_solves);
        assert_eq!(wild.work.assemblies, 20 + wild.softened_solves, "{solver:?}");
    }
}
