//! Runs under gravity and rest lengths that change in time: where steps are divided, and what energies and errors are known.

use super::fixtures::{actuated, monitored, particles, scene, stepper};
use super::*;
use crate::system::{Curve, ExternalForce, Loads, StateView};
use std::ops::ControlFlow;

/// A free particle of 2 kg under gravity along y.
fn falling(times: &[f64], values: &[f64]) -> (System, State) {
    let (system, start) = scene(&[([0.0; 3], 2.0)], &[]).build().unwrap();
    let values = values.iter().map(|&y| Vector3::new(0.0, y, 0.0)).collect();
    let gravity = Some(Curve { times: times.to_vec(), values });
    (system.with_loads(Loads { gravity, ..Loads::default() }).unwrap(), start)
}

/// Two particles of 2 kg in a row on springs of 100 N and 1 m behind one that is held; the first spring becomes half as long.
fn muscle(times: [f64; 2]) -> (System, State) {
    actuated(3, [100.0, 1.0, 0.0], times, 0.5)
}

fn run_of(scene: &(System, State), method: Method, [dt, duration]: [f64; 2]) -> (Outcome, State, Monitor<'_>) {
    let mut stepper = stepper(method, &scene.0, &scene.1);
    monitored(scene, &mut *stepper, MonitorOptions::default(), Schedule::duration(dt, duration))
}

/// A pulse that is over within a step gives a velocity of 1 m/s, which only bdf2 misses, as it keeps a past over the peak. No run takes its
/// energy for energy from nowhere.
#[test]
fn no_pulse_passes_unnoticed() {
    let scene = falling(&[0.4, 0.41, 0.42], &[0.0, 100.0, 0.0]);
    for method in Method::ALL {
        let (outcome, state, monitor) = run_of(&scene, method, [0.1, 2.0]);
        assert_eq!((outcome.status(), outcome.steps), (Status::Completed, 20), "{}", method.name());
        let error = (state.velocities[0].y - 1.0).abs();
        let most = if method == Method::Bdf2 { 0.34 } else { 1e-9 };
        assert!(error < most, "{}: {error}", method.name());
        // What is not right is not called right.
        let known = monitor.error().unwrap().norm(&scene.0);
        let error = (state.positions[0].y - 1.59).abs();
        assert!(known > 0.1 * error - 1e-12, "{}: {error} {known}", method.name());
    }
}

/// Loads and rest lengths that begin to change while a scene is at rest do work: no method gains energy from nowhere, however short the
/// change is beside its steps.
#[test]
fn changes_from_rest_are_no_energy_from_nowhere() {
    for method in Method::ALL {
        for length in [1e-3, 0.02, 1.0] {
            let falling = falling(&[0.2, 0.2 + length], &[0.0, -10.0]);
            let muscle = muscle([0.2, 0.2 + length]);
            for (scene, name) in [(&falling, "gravity"), (&muscle, "rest length")] {
                for dt in [0.005, 0.02] {
                    // Forward Euler itself gains energy from springs.
                    let duration = if method == Method::ForwardEuler { 0.4 } else { 1.0 };
                    let status = run_of(scene, method, [dt, duration]).0.status();
                    assert_eq!(status, Status::Completed, "{} {name} {length} {dt}", method.name());
                }
            }
        }
    }
}

/// A force of the caller's that begins to grow.
#[derive(Debug)]
struct Wind;

impl ExternalForce for Wind {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().for_each(|f| f.x += (at.time - 0.2).max(0.0));
    }
}

#[test]
fn forces_that_grow_from_rest_are_no_energy_from_nowhere() {
    let (system, start) = particles(&[0.0]);
    let scene = (system.with_external_force(Wind), start);
    for method in [Method::Verlet, Method::SymplecticEuler, Method::ForwardEuler, Method::Bdf2] {
        assert_eq!(run_of(&scene, method, [0.01, 1.0]).0.status(), Status::Completed, "{}", method.name());
    }
}

/// After kinks the error of methods that resolve linear forces is that of their positions, `c h³ j` of each ramp, and known.
#[test]
fn errors_are_known_after_kinks() {
    let scene = falling(&[0.31, 0.62, 0.93], &[-9.0, 4.0, 1.0]);
    // ∫ (2 − t) a dt.
    let exact = {
        let curve = &scene.0.loads().gravity.as_ref().unwrap();
        (0..200_000).map(|k| (f64::from(k) + 0.5) * 1e-5).map(|t| (2.0 - t) * curve.at(t).y * 1e-5).sum::<f64>()
    };
    for method in [Method::Verlet, Method::ImplicitMidpoint, Method::W2] {
        let (_, state, monitor) = run_of(&scene, method, [0.1, 2.0]);
        let (error, known) = ((state.positions[0].y - exact).abs(), monitor.error().unwrap().norm(&scene.0));
        assert!(error > 1e-5 && (0.9..2.2).contains(&(known / error)), "{}: {error} {known}", method.name());
    }
}

/// A run, and single steps, are divided at kinks: as steps that end there, and no kink within rounding of an end of a step makes a sliver.
#[test]
fn steps_are_divided_at_kinks() {
    let (system, start) = falling(&[0.25, 0.5 - 1e-12, 0.7, 0.7 + 1e-13], &[1.0, 3.0, -2.0, -2.0]);
    let stepper = || stepper(Method::LinearBackwardEuler, &system, &start);
    let mut state = start.clone();
    let mut times = Vec::new();
    let mut whole = stepper();
    let outcome = run(&mut *whole, &mut state, &Schedule::steps(0.5, 2), |steps, state| {
        times.push((steps, state.time));
        ControlFlow::Continue(())
    });
    assert_eq!((outcome.steps, times), (2, vec![(1, 0.5), (2, 1.0)]));
    assert_eq!(whole.statistics().work.solves, 4);
    let mut parts = start.clone();
    let mut by_hand = stepper();
    for length in [0.25, 0.25, 0.7 - 0.5, 1.0 - 0.7] {
        by_hand.step(&mut parts, length).unwrap();
    }
    assert!((state.positions[0].y - parts.positions[0].y).abs() < 1e-12);
    let (mut single, mut advanced) = (stepper(), start.clone());
    (0..2).for_each(|_| advance(&mut *single, &mut advanced, 0.5).unwrap());
    assert_eq!(advanced, state);
    // A step that is refused changes nothing.
    for dt in [0.0, -1.0, f64::NAN] {
        assert!(advance(&mut *single, &mut advanced, dt).is_err() && advanced == state);
    }
}

/// Other loads replace the kinks of the old ones, and keep those of rest lengths.
#[test]
fn kinks_are_those_of_the_loads_that_apply() {
    let (system, _) = muscle([0.5, 1.0]);
    let gravity = |times: &[f64]| {
        Some(Curve { times: times.to_vec(), values: times.iter().map(|&t| Vector3::x() * t).collect() })
    };
    let with = |system: System, times: &[f64]| {
        system.with_loads(Loads { gravity: gravity(times), ..Loads::default() }).unwrap()
    };
    let system = with(with(system, &[0.25, 0.75]), &[1.0, 3.0]);
    assert_eq!(system.prescribed().load_kinks(), [0.5, 1.0, 3.0]);
    assert_eq!(system.with_loads(Loads::default()).unwrap().prescribed().load_kinks(), [0.5, 1.0]);
}
