use super::*;
use crate::integrate::StepMatrices;
use crate::integrate::fixtures::scene;
use crate::linear::SolverChoice;
use crate::memory::watch::asked;
use crate::system::fixtures::row;
use std::sync::atomic::{AtomicBool, Ordering};

/// Two particles 1 m apart, the first held, on springs of 20 N, one at rest and one of this rest length.
fn pair(rest_length: f64) -> (System, State) {
    let springs = [rest_length, 1.0].map(|rest_length| (0, 1, [20.0, rest_length, 0.0]));
    scene(&[([0.0; 3], 1.0), ([1.0, 0.0, 0.0], 1.0)], &springs).hold(0).clone().build().unwrap()
}

fn with_solver(stiffness: Stiffness, solver: SolverChoice) -> ImplicitOptions {
    ImplicitOptions { stiffness: stiffness.into(), linear: SolverOptions { solver, ..SolverOptions::default() } }
}

/// The compressed spring takes 10 N/m across, which M/dt² must outweigh. Without the terms of compressed springs a matrix of stretched springs
/// is whole. Only what policies drop is counted.
#[test]
fn matrices_are_regularized_where_terms_are_dropped() {
    for (rest_length, policy, dt, terms) in [
        (2.0, StiffnessPolicy::Always(Stiffness::Full), 0.1, 0),
        (2.0, StiffnessPolicy::Always(Stiffness::Tension), 0.1, 1),
        (2.0, StiffnessPolicy::Always(Stiffness::Axial), 0.1, 0),
        (2.0, StiffnessPolicy::OnDemand, 0.1, 0),
        (2.0, StiffnessPolicy::OnDemand, 1.0, 1),
        (2.0, StiffnessPolicy::Progressive, 0.1, 0),
        (2.0, StiffnessPolicy::Progressive, 1.0, 1),
        (2.0, StiffnessPolicy::Always(Stiffness::Absolute), 0.1, 1),
        (0.5, StiffnessPolicy::Always(Stiffness::Tension), 0.1, 0),
    ] {
        let (system, state) = pair(rest_length);
        let options = ImplicitOptions { stiffness: policy, ..ImplicitOptions::default() };
        let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
        for solves in 1..=3 {
            let force = [Vector3::zeros(), Vector3::new(1.0, 2.0, 3.0)];
            linear.begin(&force, true);
            linear.prepare(linear.policy, Combination::step(dt)).unwrap();
            linear.solve(Some(1e-10), &force, &mut [Vector3::zeros(); 2]).unwrap();
            assert_eq!(linear.is_regularized(), terms > 0, "{policy:?} {dt}");
            let counted = if let StiffnessPolicy::Always(_) = policy { 0 } else { terms * solves };
            assert_eq!((linear.statistics.softened_solves, linear.statistics.dropped_terms), (counted, counted));
        }
    }
}

/// LDLᵀ under the full stiffness solves with an indefinite matrix, and counts that.
#[test]
fn solves_with_indefinite_matrices_are_counted() {
    let (system, state) = pair(2.0);
    let options = with_solver(Stiffness::Full, SolverChoice::Ldlt);
    let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
    for (dt, indefinite) in [(0.1, 0), (1.0, 1), (1.0, 2), (0.1, 2)] {
        linear.prepare(Stiffness::Full.into(), Combination::step(dt)).unwrap();
        linear.solve(Some(1e-10), &[Vector3::zeros(), Vector3::x()], &mut [Vector3::zeros(); 2]).unwrap();
        assert_eq!(linear.statistics.indefinite_solves, indefinite, "{dt}");
    }
}

/// `fᵀ D⁻¹ f` on free axes, and infinity where D is indefinite or singular along any of them, pulled or not.
#[test]
fn block_energies_are_those_of_free_axes() {
    let (system, state) = pair(2.0);
    let mut linear = LinearSystem::new(&system, &state, &ImplicitOptions::default()).unwrap();
    let force = [Vector3::repeat(9.0), Vector3::new(6.0, 2.0, 4.0)];
    // One across the springs of 20 N each, without transverse terms: M/dt² = 4, and 20/2 + 20/1 along.
    linear.prepare(Stiffness::Axial.into(), Combination::step(0.5)).unwrap();
    let energy = linear.block_energy(&force);
    assert!((energy - (36.0 / 34.0 + 4.0 / 4.0 + 16.0 / 4.0)).abs() < 1e-12, "{energy}");
    // M/dt² = 1 and then 0 and −10 across.
    for (mass, stiffness) in [(0.0, Stiffness::Axial), (1.0, Stiffness::Full)] {
        let options = with_solver(Stiffness::Full, SolverChoice::Ldlt);
        let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
        let combination = Combination { mass, ..Combination::step(1.0) };
        // The factorization of a singular matrix may fail; its blocks are known anyway.
        let _ = linear.prepare(stiffness.into(), combination);
        assert_eq!(linear.block_energy(&force), f64::INFINITY);
        assert_eq!(linear.block_energy(&[Vector3::zeros(), Vector3::x()]), f64::INFINITY);
    }
}

/// In place of an option: the axial block, and the given coefficients across it, by position.
#[test]
fn transverse_coefficients_can_be_given() {
    let (system, state) = pair(2.0);
    let mut linear = LinearSystem::new(&system, &state, &ImplicitOptions::default()).unwrap();
    linear.prepare_with(Combination::step(0.5), |position, _, _| [1.0, 3.0][position]).unwrap();
    let mut displacement = [Vector3::zeros(); 2];
    linear.solve(Some(1e-10), &[Vector3::zeros(), Vector3::new(34.0, 8.0, 16.0)], &mut displacement).unwrap();
    assert!((displacement[1] - Vector3::new(1.0, 1.0, 2.0)).norm() < 1e-14, "{displacement:?}");
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.softened_solves), (1, 0));
}

/// Every assembly and every solve begins with the interrupt.
#[test]
fn interrupts_end_assemblies_and_solves() {
    static FLAG: AtomicBool = AtomicBool::new(false);
    let (system, state) = pair(2.0);
    let linear = SolverOptions { interrupt: Interrupt::on(&FLAG), ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), linear };
    let mut linear = LinearSystem::new(&system, &state, &options).unwrap();
    let (force, mut displacement) = ([Vector3::zeros(), Vector3::x()], [Vector3::zeros(); 2]);
    let step = Combination::step(0.1);
    linear.prepare(Stiffness::Full.into(), step).unwrap();
    linear.solve(Some(1e-10), &force, &mut displacement).unwrap();
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.work.solves), (1, 1));
    // A direct solver has no tolerance.
    assert_eq!(linear.statistics.max_tolerance, 0.0);
    FLAG.store(true, Ordering::Relaxed);
    assert!(matches!(linear.solve(Some(1e-10), &force, &mut displacement), Err(SolveFailure::Interrupted)));
    assert!(matches!(linear.prepare(Stiffness::Full.into(), step), Err(SolveFailure::Interrupted)));
    assert_eq!((linear.statistics.work.assemblies, linear.statistics.work.solves), (1, 1));
}

/// Room is asked for before anything is allocated: for a method before its solver, and again with a solver.
#[test]
fn memory_is_asked_for_by_springs_and_particles() {
    let (system, state) = row(4);
    let (made, bytes) =
        asked("the state of the method", || LinearSystem::new(&system, &state, &ImplicitOptions::default()).is_ok());
    assert_eq!((made, bytes), (true, 2 * (3 * 200 + 4 * 1000)));
    let (made, bytes) =
        asked("the matrices of a system", || StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).is_ok());
    assert_eq!((made, bytes), (true, 7 * 800));
}
