use super::{ImplicitOptions, LinearSystem, StiffnessPolicy, inverse_energy};
use crate::integrate::StepMatrices;
use crate::interrupt::Interrupt;
use crate::linear::{SolveFailure, SolverChoice, SolverOptions};
use crate::memory::watch::asked;
use crate::operator::Combination;
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};
use nalgebra::{Matrix3, Vector3};
use std::sync::atomic::{AtomicBool, Ordering};

/// Two particles 1 m apart, the first held, on two springs of which one is compressed and one at rest.
fn pair() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.hold(0);
    for rest_length in [2.0, 1.0] {
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length, damping: 0.0 });
    }
    builder.build().unwrap()
}

/// The compressed spring takes 10 N/m across, and M/dt² is to outweigh that.
#[test]
fn matrices_are_softened_where_terms_are_dropped() {
    let (system, state) = pair();
    let force = [Vector3::zeros(), Vector3::new(1.0, 2.0, 3.0)];
    for (policy, dt, terms) in [
        (StiffnessPolicy::Always(Stiffness::Full), 0.1, 0),
        (StiffnessPolicy::Always(Stiffness::Tension), 0.1, 1),
        (StiffnessPolicy::Always(Stiffness::Axial), 0.1, 0),
        (StiffnessPolicy::OnDemand, 0.1, 0),
        (StiffnessPolicy::OnDemand, 1.0, 1),
    ] {
        let options = ImplicitOptions { stiffness: policy, ..ImplicitOptions::default() };
        let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
        for solves in 1..=3 {
            let mut displacement = [Vector3::zeros(); 2];
            linear.prepare(linear.policy, Combination::step(dt)).unwrap();
            linear.solve(&force, &mut displacement).unwrap();
            assert_eq!(linear.is_softened(), terms > 0, "{policy:?} {dt}");
            // Only what the on-demand policy drops is counted.
            let counted = if policy == StiffnessPolicy::OnDemand { terms * solves } else { 0 };
            assert_eq!((linear.statistics.softened_solves, linear.statistics.dropped_terms), (counted, counted));
        }
    }
}

/// Newton's method asks for little at first.
#[test]
fn conjugate_gradients_go_as_far_as_is_asked() {
    let mut builder = SystemBuilder::new();
    for p in 0..20 {
        builder.particle([f64::from(p), 0.0, 0.0], 1.0);
    }
    for p in 1..20 {
        builder.spring(p - 1, p, Spring { stiffness: 1e3, rest_length: 0.9, damping: 0.0 });
    }
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    let linear = SolverOptions { solver: SolverChoice::Cg, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), linear };
    let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
    linear.prepare(Stiffness::Full.into(), Combination::step(1.0)).unwrap();
    let mut residual = |tolerance| {
        linear.set_tolerance(tolerance);
        let force = vec![Vector3::new(1.0, 2.0, 3.0); 20];
        linear.solve(&force, &mut vec![Vector3::zeros(); 20]).unwrap().relative_residual
    };
    let [coarse, fine] = [residual(0.3), residual(1e-12)];
    assert_eq!(linear.statistics.max_tolerance, 0.3);
    assert!((1e-6..0.3).contains(&coarse) && fine < 1e-12, "{coarse:e} {fine:e}");
}

/// LDLᵀ under the full stiffness solves with an indefinite matrix, and says so; not with a definite one.
#[test]
fn solves_with_indefinite_matrices_are_counted() {
    let (system, state) = pair();
    let linear = SolverOptions { solver: SolverChoice::Ldlt, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), linear };
    let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
    for (dt, indefinite) in [(0.1, 0), (1.0, 1), (1.0, 2), (0.1, 2)] {
        linear.prepare(Stiffness::Full.into(), Combination::step(dt)).unwrap();
        linear.solve(&[Vector3::zeros(), Vector3::x()], &mut [Vector3::zeros(); 2]).unwrap();
        assert_eq!(linear.statistics.indefinite_solves, indefinite, "{dt}");
    }
}

#[test]
fn inverses_of_blocks_are_those_of_matrices() {
    let root = Matrix3::new(2.0, 0.5, -1.0, 0.25, 3.0, 0.75, -0.5, 1.0, 1.5);
    let (d, f) = (root * root.transpose(), Vector3::new(1.0, -2.0, 3.0));
    let expected = f.dot(&(d.try_inverse().unwrap() * f));
    assert!((inverse_energy(&d, &f) - expected).abs() < 1e-12 * expected);
    for sign in [Vector3::new(-1.0, 1.0, 1.0), Vector3::new(1.0, -1.0, 1.0), Vector3::new(1.0, 1.0, -1.0)] {
        assert_eq!(inverse_energy(&Matrix3::from_diagonal(&sign), &f), f64::INFINITY);
    }
}

/// The held particle's force, and every force along an axis that is held, does not count.
#[test]
fn what_is_left_counts_on_free_axes() {
    let (system, state) = pair();
    let mut linear = LinearSystem::new(&system, &state, &ImplicitOptions::default()).unwrap();
    // One across the springs of 20 N each, without transverse terms: M/dt² = 4, and 20/2 + 20/1 along.
    linear.prepare(Stiffness::Axial.into(), Combination::step(0.5)).unwrap();
    let energy = linear.block_energy(&[Vector3::repeat(9.0), Vector3::new(6.0, 2.0, 4.0)]);
    assert!((energy - (36.0 / 34.0 + 4.0 / 4.0 + 16.0 / 4.0)).abs() < 1e-12, "{energy}");
}

/// In place of an option: the axial block, and across it what is given, by position.
#[test]
fn transverse_coefficients_can_be_given() {
    let (system, state) = pair();
    let mut linear = LinearSystem::new(&system, &state, &ImplicitOptions::default()).unwrap();
    linear.prepare_with(Combination::step(0.5), |position, _, _| [1.0, 3.0][position]).unwrap();
    let mut displacement = [Vector3::zeros(); 2];
    linear.solve(&[Vector3::zeros(), Vector3::new(34.0, 8.0, 16.0)], &mut displacement).unwrap();
    assert!((displacement[1] - Vector3::new(1.0, 1.0, 2.0)).norm() < 1e-14, "{displacement:?}");
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.softened_solves), (1, 0));
}

/// What is changed is changed, and all else stays.
#[test]
fn options_are_changed_one_by_one() {
    let linear = SolverOptions { solver: SolverChoice::Ldlt, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
    assert_eq!(
        options.with_stiffness(Stiffness::Axial),
        ImplicitOptions { stiffness: Stiffness::Axial.into(), linear }
    );
    let other = SolverOptions { solver: SolverChoice::Cg, ..linear };
    assert_eq!(options.with_linear(other), ImplicitOptions { linear: other, ..options });
}

/// A block without room along one axis has no energy.
#[test]
fn singular_blocks_have_no_inverse() {
    for axis in 0..3 {
        let mut diagonal = Vector3::repeat(2.0);
        diagonal[axis] = 0.0;
        assert_eq!(inverse_energy(&Matrix3::from_diagonal(&diagonal), &Vector3::repeat(1.0)), f64::INFINITY, "{axis}");
    }
    // Not even where nothing pulls along it.
    let singular = Matrix3::from_diagonal(&Vector3::new(2.0, 2.0, 0.0));
    assert_eq!(inverse_energy(&singular, &Vector3::new(1.0, 1.0, 0.0)), f64::INFINITY);
}

/// Without terms of compressed springs only those of compressed springs are missing: where all are stretched the matrix is whole.
#[test]
fn stretched_springs_keep_their_terms() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 0.5, damping: 0.0 });
    let (system, state) = builder.build().unwrap();
    let mut linear = LinearSystem::new(&system, &state, &ImplicitOptions::default()).unwrap();
    linear.prepare(Stiffness::Tension.into(), Combination::step(0.1)).unwrap();
    assert!(!linear.is_softened());
}

/// A request to stop is looked at before every matrix and every solve.
#[test]
fn requests_to_stop_are_heard() {
    static FLAG: AtomicBool = AtomicBool::new(false);
    let (system, state) = pair();
    let linear = SolverOptions { interrupt: Interrupt::on(&FLAG), ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), linear };
    let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
    let (force, mut displacement) = ([Vector3::zeros(), Vector3::x()], [Vector3::zeros(); 2]);
    let step = Combination::step(0.1);
    linear.prepare(Stiffness::Full.into(), step).unwrap();
    linear.solve(&force, &mut displacement).unwrap();
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.work.solves), (1, 1));
    // A direct solver has no tolerance.
    assert_eq!(linear.statistics.max_tolerance, 0.0);
    FLAG.store(true, Ordering::Relaxed);
    assert!(matches!(linear.solve(&force, &mut displacement), Err(SolveFailure::Interrupted)));
    assert!(matches!(linear.prepare(Stiffness::Full.into(), step), Err(SolveFailure::Interrupted)));
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.work.solves), (1, 1));
}

/// Room is asked for before anything is made: for a method 200 bytes a spring and 1000 a particle, before its solver and for one of the
/// caller's own alike; for the matrices of a step 800 bytes of each.
#[test]
fn memory_is_asked_for_by_springs_and_particles() {
    let mut builder = SystemBuilder::new();
    for x in 0..5 {
        builder.particle([f64::from(x), 0.0, 0.0], 1.0);
    }
    for p in 1..4 {
        builder.spring(p - 1, p, Spring { stiffness: 20.0, rest_length: 1.0, damping: 0.0 });
    }
    let (system, state) = builder.build().unwrap();
    let (made, bytes) =
        asked("the state of the method", || LinearSystem::new(&system, &state, &ImplicitOptions::default()).is_ok());
    assert_eq!((made, bytes), (true, 2 * (3 * 200 + 5 * 1000)));
    let (made, bytes) =
        asked("the matrices of a system", || StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).is_ok());
    assert_eq!((made, bytes), (true, 8 * 800));
}
