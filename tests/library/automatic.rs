//! The automatic choice of a solver: the cheaper one in the end, and little wasted on finding out.

use nalgebra::Vector3;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StiffnessPolicy, TimeStepper};
use sprung::linear::{CholeskySolver, CostModel, PreconditionerKind, SolverChoice, SolverOptions};
use sprung::scene::builtin;
use sprung::work::Work;
use sprung::{State, Stiffness, System};

/// A cloth of n × n particles, every coordinate moved by up to 3 % of the spacing.
fn cloth(n: usize) -> (System, State) {
    let (system, mut state) = builtin::cloth(n).unwrap().build().unwrap();
    for (p, x) in state.positions.iter_mut().enumerate() {
        let noise = |axis: usize| ((3 * p + axis) as f64 * 12.9898).sin() * 43758.5453 % 1.0;
        *x += Vector3::new(noise(0), noise(1), noise(2)) * 0.0015;
    }
    state.prescribe(&system);
    (system, state)
}

fn stepper<'s>(
    (system, start): &'s (System, State),
    solver: SolverChoice,
    stiffness: impl Into<StiffnessPolicy>,
) -> LinearBackwardEuler<'s> {
    let linear = SolverOptions { solver, ..Default::default() };
    LinearBackwardEuler::new(system, start, &ImplicitOptions { stiffness: stiffness.into(), linear }).unwrap()
}

fn walk(stepper: &mut LinearBackwardEuler<'_>, start: &State, steps: usize, dt: f64) -> State {
    let mut state = start.clone();
    for _ in 0..steps {
        stepper.step(&mut state, dt).unwrap();
    }
    state
}

fn name(stepper: &LinearBackwardEuler<'_>) -> &'static str {
    stepper.linear_solver().unwrap().name()
}

#[test]
fn soft_steps_iterate_and_stiff_ones_factor() {
    let scene = cloth(24);
    for (dt, expected, factorizations) in [(1e-4, "cg", 0), (0.01, "llt", 10)] {
        let mut auto = stepper(&scene, SolverChoice::Auto, Stiffness::Tension);
        let end = walk(&mut auto, &scene.1, 10, dt);
        assert_eq!(name(&auto), expected, "dt = {dt}");
        let work = auto.statistics().work;
        assert_eq!(work.factorizations, factorizations, "dt = {dt}: {work:?}");
        let choice = auto.linear_solver().unwrap().choice().unwrap();
        assert!(choice.starts_with(expected) && choice.contains("force evaluations a matrix"), "{choice}");

        let mut direct = stepper(&scene, SolverChoice::Llt, Stiffness::Tension);
        let reference = walk(&mut direct, &scene.1, 10, dt);
        let apart = end.positions.iter().zip(&reference.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "dt = {dt}: {apart:e} m apart");
        assert_eq!(direct.linear_solver().unwrap().choice(), None);
    }
}

/// Trying must not cost more than an analysis and two factorizations, by the program's own count.
#[test]
fn finding_out_is_cheap() {
    let scene = cloth(24);
    let mut auto = stepper(&scene, SolverChoice::Auto, Stiffness::Tension);
    walk(&mut auto, &scene.1, 10, 0.01);
    let work = auto.statistics().work;
    let size = CholeskySolver::new(&scene.0, faer::Par::Seq, &mut Work::default()).unwrap().size();
    let costs = CostModel::of(&scene.0);
    let direct = costs.factorization(size) + costs.direct_solve(size);
    let iterated = costs.iteration(PreconditionerKind::BlockJacobi) * work.cg_iterations as f64;
    assert!(iterated > 0.0 && iterated <= 2.0 * direct + costs.analysis(size), "{work:?}, {direct}");
    assert_eq!((work.factorizations, work.solves - work.iterative_solves, work.symbolic_factorizations), (10, 10, 1));
}

/// Steps that become long on the way, and short again: conjugate gradients are given up when they no longer pay, and taken up again after sixteen
/// matrices more than the one in whose solve that was found out.
#[test]
fn the_choice_follows_the_scene() {
    let scene = cloth(24);
    let mut auto = stepper(&scene, SolverChoice::Auto, Stiffness::Tension);
    let state = walk(&mut auto, &scene.1, 5, 1e-4);
    assert_eq!((name(&auto), auto.statistics().work.factorizations), ("cg", 0));
    let mut direct = stepper(&scene, SolverChoice::Llt, Stiffness::Tension);
    walk(&mut direct, &state, 5, 0.02);
    let before = auto.statistics().work;
    let state = walk(&mut auto, &state, 5, 0.02);
    assert_eq!(name(&auto), "llt");
    let factorizations = auto.statistics().work.factorizations;
    assert!(factorizations >= 4, "{factorizations}");
    // Beside one analysis each: what may be lost before the particles are ordered, before the pattern is analysed, and before factorizations are chosen.
    let (costs, size) = (CostModel::of(&scene.0), direct.linear_solver().unwrap().factor().unwrap().size);
    let [after, before, least] =
        [auto.statistics().work, before, direct.statistics().work].map(|work| costs.cost(&work, Some(size)));
    let factored = costs.factorization(size) + costs.direct_solve(size);
    let most = least + costs.glance() + costs.analysis(size) + 3.0 * factored;
    assert!(after - before <= most, "{after} - {before}, {least}, {most}");
    let iterations = auto.statistics().work.cg_iterations;
    let state = walk(&mut auto, &state, 17 - factorizations as usize, 1e-4);
    let work = auto.statistics().work;
    assert_eq!((name(&auto), work.cg_iterations, work.factorizations), ("llt", iterations, 17));
    walk(&mut auto, &state, 10, 1e-4);
    let work = auto.statistics().work;
    assert_eq!((name(&auto), work.factorizations, work.symbolic_factorizations), ("cg", 17, 1));
    assert!(work.cg_iterations > iterations);
}

/// What is small is factored at once; so is, up to a size, what may be indefinite without anything to be done about it, because a
/// factorization finds out. Where softer matrices stand ready the cheaper solver is taken.
#[test]
fn proofs_are_preferred_where_nothing_else_finds_out() {
    let small = cloth(4);
    let medium = cloth(24);
    for (scene, policy, expected) in [
        (&small, Stiffness::Tension.into(), "llt"),
        (&medium, StiffnessPolicy::OnDemand, "cg"),
        (&medium, StiffnessPolicy::Always(Stiffness::Full), "llt"),
    ] {
        let mut auto = stepper(scene, SolverChoice::Auto, policy);
        walk(&mut auto, &scene.1, 3, 1e-4);
        let iterates = auto.statistics().work.cg_iterations > 0;
        assert_eq!((name(&auto), iterates), (expected, expected == "cg"), "{}", policy.name());
    }
    // Factorizations of many times the work of a solve by multigrid are not even kept.
    let lattice = builtin::lattice(30).unwrap().build().unwrap();
    let mut auto = stepper(&lattice, SolverChoice::Auto, StiffnessPolicy::OnDemand);
    walk(&mut auto, &lattice.1, 1, 1e-3);
    assert_eq!((name(&auto), auto.statistics().work.factorizations), ("cg", 0));
}

/// Scenes that the weights were not fitted to, within ten steps. On the first three one solver takes many times as long as the other.
#[test]
fn the_cheaper_solver_is_found_where_it_matters() {
    for (scene, dt, expected) in [
        (builtin::lattice(10).unwrap(), 1e-3, "cg"),
        (builtin::cloth(32).unwrap(), 1e-4, "cg"),
        (builtin::network(400, 0).unwrap(), 1e-3, "cg"),
        (builtin::chain(400).unwrap(), 1e-2, "llt"),
    ] {
        let scene = scene.build().unwrap();
        let mut auto = stepper(&scene, SolverChoice::Auto, StiffnessPolicy::OnDemand);
        walk(&mut auto, &scene.1, 10, dt);
        assert_eq!(name(&auto), expected, "{:?}", auto.linear_solver().unwrap().choice());
    }
}
