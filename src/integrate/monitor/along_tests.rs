//! The pass over the springs that is made along with the forces, beside one that is made alone.

use super::springs::Springs;
use super::tests::{disturb, pair};
use super::{Monitor, MonitorOptions};
use crate::integrate::watch::Watch;
use crate::integrate::{ImplicitOptions, Method, Schedule, run_monitored};
use crate::system::{Axes, State, System};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// A pass along with the forces is a pass of its own, and the forces are those of one, to the bit; not all batches are full.
#[test]
fn a_pass_along_with_forces_is_one_of_its_own() {
    let (system, mut state) = crate::scene::builtin::cloth(40).unwrap().build().unwrap();
    assert!(system.springs().len() > 2 * 4096 && !system.springs().len().is_multiple_of(32));
    disturb(&mut state);
    assert!(same_along_and_alone(&system, &state));
    let mut later = state.clone();
    later.positions[41] = later.positions[42];
    let mut along = Springs::new(&system, &state, std::iter::empty(), true);
    let failure = along.set_force(&later.moment(), 1e-5, &mut vec![Vector3::zeros(); system.particles()]).unwrap_err();
    assert_eq!(failure.pair, [41, 42]);
}

/// So it is where springs stand between fixed particles, and where these have come to lie at one place, which is no error.
#[test]
fn springs_between_fixed_particles_are_seen_along_with_forces() {
    let scene = crate::scene::builtin::lattice(5).unwrap();
    let (system, mut state) = scene.build().unwrap();
    let fixed: Vec<usize> = system.prescribed().iter().map(|(dof, ..)| dof.particle).collect();
    assert!(system.active_springs().len() < system.springs().len());
    disturb(&mut state);
    // What springs do to fixed ends is added along the way.
    assert!(!same_along_and_alone(&system, &state));
    let joined = |&number: &usize| system.pair(number).iter().all(|end| fixed.contains(end));
    let [i, j] = system.pair((0..system.springs().len()).find(joined).unwrap());
    state.positions[i] = state.positions[j];
    state.velocities[i] = state.velocities[j];
    assert!(same_along_and_alone(&system, &state));
    // The square of this distance is none either.
    (state.velocities[i], state.velocities[j]) = (Vector3::zeros(), Vector3::zeros());
    (state.positions[i], state.positions[j]) = (Vector3::new(1e-170, 0.0, 0.0), Vector3::zeros());
    assert!(same_along_and_alone(&system, &state));
}

/// A pass along with the forces and one after the other, at a state and a little later; returns whether the forces on fixed particles are the
/// same too.
fn same_along_and_alone(system: &System, state: &State) -> bool {
    let mut later = state.clone();
    later.positions.iter_mut().zip(&state.velocities).for_each(|(x, v)| *x += v * 1e-5);
    let [mut along, mut alone] = [(); 2].map(|()| Springs::new(system, state, [3].into_iter(), true));
    assert!(along.takes_forces(system) && !along.takes_forces(&system.clone()));
    let mut forces = [(); 2].map(|()| vec![Vector3::repeat(7.0); system.particles()]);
    for state in [state, &later] {
        along.set_force(&state.moment(), 1e-5, &mut forces[0]).unwrap();
        crate::force::set_total_force(system, &state.moment(), &mut forces[1]).unwrap();
        let moves = |p: &usize| system.dofs().free_axes(*p) != Axes::NONE;
        assert!((0..system.particles()).filter(moves).all(|p| forces[0][p] == forces[1][p]));
        let sums = along.enter(state, 1e-5);
        assert_eq!(sums, alone.pass(&state.moment(), 1e-5));
        assert!(sums.elastic > 0.0 && sums.dissipated > 0.0 && sums.lifted > 0.0 && sums.reach > 0.0);
    }
    forces[0] == forces[1]
}

/// What steps of Verlet's method let a monitor see on the way differs from what it sees after them by the fourth order of the step.
#[test]
fn predicted_rates_dissipate_to_the_fourth_order() {
    // It vibrates and turns.
    let (system, mut start) = pair(0.7);
    start.velocities = vec![Vector3::new(0.0, -0.3, 0.0), Vector3::new(0.1, 0.4, 0.2)];
    let difference = |dt: f64| {
        let [mut seen, mut after] = [(); 2].map(|()| Monitor::new(&system, &start, MonitorOptions::default()).unwrap());
        let mut steppers =
            [(); 2].map(|()| Method::Verlet.stepper(&system, &start, &ImplicitOptions::default()).unwrap());
        let mut states = [start.clone(), start.clone()];
        for step in 1..=(1.0 / dt).round() as u64 {
            steppers[0].step_seen(&mut states[0], dt, seen.springs()).unwrap();
            steppers[1].step(&mut states[1], dt).unwrap();
            assert!(states[0] == states[1]);
            seen.enter(step, &states[0], dt, None).unwrap();
            after.enter(step, &states[1], dt, None).unwrap();
        }
        let [seen, after] = [seen, after].map(|monitor| monitor.balance().dissipated);
        assert!(after > 0.1);
        (seen / after - 1.0).abs()
    };
    let [coarse, fine] = [0.05, 0.025].map(difference);
    let order = (coarse / fine).log2();
    assert!(coarse < 1e-3 && order > 3.8, "{coarse:.1e} {fine:.1e}: order {order}");
}

/// One thread makes one pass where several make two.
#[test]
fn verlet_is_seen_the_same_by_any_number_of_threads() {
    let (system, start) = crate::scene::builtin::cloth(60).unwrap().build().unwrap();
    let figures = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
            assert_eq!(monitor.springs().takes_forces(&system), threads == 1);
            let mut stepper = Method::Verlet.stepper(&system, &start, &ImplicitOptions::default()).unwrap();
            let mut state = start.clone();
            let schedule = Schedule::steps(1e-5, 5);
            run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
            (state.clone(), monitor.figures(&state), monitor.balance())
        })
    };
    assert_eq!(figures(1), figures(3));
}
