//! The automatic choice of a solver: the cheaper one in the end, and little wasted on finding out.

use nalgebra::Vector3;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StiffnessPolicy, TimeStepper};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::scene::builtin;
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

fn chosen(stepper: &LinearBackwardEuler<'_>) -> (&'static str, Option<&'static str>) {
    let solver = stepper.linear_solver().unwrap();
    (solver.name(), solver.preconditioner())
}

/// Short steps are left to block Jacobi, the matrices of long ones are factored, which costs least at this size; the motion is that of Cholesky.
#[test]
fn soft_steps_iterate_and_stiff_ones_get_what_costs_least() {
    let chain = builtin::chain(400).unwrap().build().unwrap();
    for (scene, dt, expected) in [
        (&cloth(24), 1e-4, ("cg", Some("block-jacobi"))),
        (&cloth(24), 0.01, ("llt", None)),
        (&chain, 0.01, ("llt", None)),
    ] {
        let mut auto = stepper(scene, SolverChoice::Auto, Stiffness::Tension);
        let end = walk(&mut auto, &scene.1, 10, dt);
        assert_eq!(chosen(&auto), expected, "dt = {dt}: {:?}", auto.linear_solver().unwrap().choice());
        let mut direct = stepper(scene, SolverChoice::Llt, Stiffness::Tension);
        let reference = walk(&mut direct, &scene.1, 10, dt);
        let apart = end.positions.iter().zip(&reference.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "dt = {dt}: {apart:e} m apart");
        assert_eq!(direct.linear_solver().unwrap().choice(), None);
    }
}

/// Steps that become long on the way and short again: block Jacobi is given up within a step and taken up again after twice sixteen.
#[test]
fn the_choice_follows_the_scene() {
    let scene = cloth(24);
    let mut auto = stepper(&scene, SolverChoice::Auto, Stiffness::Tension);
    let state = walk(&mut auto, &scene.1, 5, 1e-4);
    assert_eq!(chosen(&auto).1, Some("block-jacobi"));
    let state = walk(&mut auto, &state, 5, 0.02);
    assert_eq!(chosen(&auto), ("llt", None));
    walk(&mut auto, &state, 40, 1e-4);
    assert_eq!(chosen(&auto).1, Some("block-jacobi"));
}

/// A small system is factored at once; so is, up to a size, one that may be indefinite without a remedy, because a
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
        assert_eq!((chosen(&auto).0, iterates), (expected, expected == "cg"), "{}", policy.name());
    }
}

/// A pressed column whose full matrix is indefinite: whatever solves, `on-demand` goes on with a softer one.
#[test]
fn refusals_reach_the_policy() {
    let (system, mut state) = builtin::column(40).unwrap().build().unwrap();
    state.positions.iter_mut().for_each(|x| x.y *= 0.7);
    for solver in [SolverChoice::Auto, SolverChoice::Llt, SolverChoice::Cg] {
        let scene = (system.clone(), state.clone());
        let mut refused = stepper(&scene, solver, StiffnessPolicy::Always(Stiffness::Full));
        let failure = refused.step(&mut state.clone(), 0.5).unwrap_err();
        assert!(failure.to_string().contains("not positive definite"), "{failure}");
        let mut softened = stepper(&scene, solver, StiffnessPolicy::OnDemand);
        softened.step(&mut state.clone(), 0.5).unwrap();
    }
}
