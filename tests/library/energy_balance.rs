//! The energy balance: E(t) − E(0) = work of moving constraints − dissipation + imbalance.

use nalgebra::Vector3;
use sprung::integrate::{
    ImplicitOptions, Method, Monitor, MonitorOptions, Schedule, Status, StepFailure, run_monitored,
};
use sprung::{Constraint, Motion, Spring, State, System, SystemBuilder};
use std::ops::ControlFlow;

/// A monitor after a run, with the state that it ended in.
fn monitored<'s>(system: &'s System, start: &State, method: Method, dt: f64, duration: f64) -> (Monitor<'s>, State) {
    let mut state = start.clone();
    let mut monitor = Monitor::new(system, &state, MonitorOptions::default()).unwrap();
    let mut stepper = method.stepper(system, &state, &ImplicitOptions::default()).unwrap();
    let schedule = Schedule::duration(dt, duration);
    let outcome =
        run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed, "{outcome:?}");
    (monitor, state)
}

/// Two unequal masses on a damped spring, far from each other's rest, free in space.
fn dumbbell(damping: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.2, 0.1, -0.3], 0.7);
    builder.particle([1.3, 0.4, 0.1], 1.9);
    builder.velocities[0] = Vector3::new(0.3, -0.2, 0.5);
    builder.spring(0, 1, Spring { stiffness: 11.0, rest_length: 0.8, damping });
    builder.build().unwrap()
}

/// The damped single spring of one free mass: x'' = −(k/l0)(x − l0)/m − (b/m) x' has its solution in closed form, and with it
/// what damping takes, `E(0) − E(t)`.
#[test]
fn damping_takes_what_the_energy_loses() {
    let (mass, stiffness, rest_length, damping) = (0.7, 11.0, 0.8, 0.4);
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.1, 0.0, 0.0], mass);
    builder.hold(0);
    builder.spring(0, 1, Spring { stiffness, rest_length, damping });
    let (system, start) = builder.build().unwrap();
    let (kappa, zeta) = (stiffness / rest_length, damping / (2.0 * mass));
    let omega = (kappa / mass - zeta * zeta).sqrt();
    let energy = |t: f64| {
        let (decay, (s, c)) = ((-zeta * t).exp() * 0.3, (omega * t).sin_cos());
        let x = decay * (c + zeta / omega * s);
        let v = -decay * (omega + zeta * zeta / omega) * s;
        0.5 * mass * v * v + 0.5 * kappa * x * x
    };
    let lost = energy(0.0) - energy(2.0);
    let errors: Vec<[f64; 2]> = [0.02, 0.01]
        .into_iter()
        .map(|dt| {
            let balance = monitored(&system, &start, Method::ImplicitMidpoint, dt, 2.0).0.balance();
            [(balance.dissipated - lost).abs(), balance.imbalance.abs()]
        })
        .collect();
    // Dissipation is off by the method's own error, of second order; the imbalance is the energy that the method adds.
    for [dissipated, imbalance] in &errors {
        assert!(*dissipated < 2e-3 * lost && *imbalance < 2e-3 * lost, "{errors:?}");
    }
    for kind in [0, 1] {
        let order = (errors[0][kind] / errors[1][kind]).log2();
        assert!((1.7..4.5).contains(&order), "{order} {errors:?}");
    }
}

/// A particle that is pulled through a viscous spring at constant speed, without anything free: the work is all dissipated.
#[test]
fn a_spring_between_constraints_takes_their_work() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    builder.particle([0.0; 3], 3.0);
    builder.particle([1.5, 0.0, 0.0], 5.0);
    builder.particle([9.0, 0.0, 0.0], 1.0);
    builder.hold(0);
    builder.constrain(Constraint {
        particles: vec![1],
        axes: sprung::system::Axes::ALL,
        motion: Motion::Velocity(Vector3::new(0.5, 2.0, 0.0)),
    });
    builder.spring(0, 1, Spring { stiffness: 7.0, rest_length: 1.2, damping: 0.6 });
    let (system, mut start) = builder.build().unwrap();
    start.prescribe(&system);
    let errors: Vec<f64> = [0.1, 0.05]
        .into_iter()
        .map(|dt| {
            let (monitor, end) = monitored(&system, &start, Method::SymplecticEuler, dt, 1.0);
            let (balance, d) = (monitor.balance(), |state: &State| (state.positions[1] - state.positions[0]).norm());
            let elastic = |l: f64| 0.5 * 7.0 / 1.2 * (l - 1.2) * (l - 1.2);
            // The free particle falls on its own; its energy error is the method's.
            let lift = 5.0 * 9.81 * 2.0;
            let stored = elastic(d(&end)) - elastic(d(&start));
            (balance.work - balance.dissipated - lift - stored).abs() / balance.work
        })
        .collect();
    // Both integrals are of fourth order.
    assert!(errors[0] < 1e-4 && errors[0] / errors[1] > 12.0, "{errors:?}");
}

/// Up, around a corner and back down within the run, with kinks on steps and between them; the sum is right to second order.
#[test]
fn constraints_that_move_on_paths_with_kinks_do_work() {
    for dt in [0.01, 0.0123] {
        let imbalances: Vec<f64> = [dt, dt / 2.0, dt / 4.0]
            .into_iter()
            .map(|dt| {
                let mut builder = SystemBuilder::new();
                builder.gravity(0.0, -9.81, 0.0);
                builder.particle([0.0; 3], 1.7);
                builder.particle([0.9, 0.1, 0.0], 0.6);
                builder.particle([1.8, -0.1, 0.3], 0.4);
                for (i, j, damping) in [(0, 1, 0.2), (1, 2, 0.1)] {
                    builder.spring(i, j, Spring { stiffness: 40.0, rest_length: 0.8, damping });
                }
                let offsets = [[0.0; 3], [0.4, 0.5, 0.0], [-0.2, 0.6, 0.1], [0.0, -0.3, 0.0]];
                builder.constrain(Constraint {
                    particles: vec![0],
                    axes: sprung::system::Axes::ALL,
                    motion: Motion::Path {
                        times: vec![0.0, 0.3, 0.6, 0.9],
                        offsets: offsets.map(Vector3::from).to_vec(),
                    },
                });
                let (system, mut start) = builder.build().unwrap();
                start.prescribe(&system);
                let balance = monitored(&system, &start, Method::W2, dt, 1.0).0.balance();
                assert!(balance.work.abs() > 1.0 && balance.dissipated > 0.05, "{balance:?}");
                balance.imbalance.abs() / balance.work.abs()
            })
            .collect();
        // The bound is W2's own error at the longest step; kinks fall on other parts of the steps each time.
        assert!(imbalances.iter().all(|imbalance| *imbalance < 2e-4), "{imbalances:?}");
    }
}

/// Held along one axis and led along another, free along the third.
#[test]
fn partly_prescribed_particles_have_an_energy_balance_too() {
    let mut builder = SystemBuilder::new();
    builder.gravity(1.0, -9.81, 0.5);
    builder.particle([0.0; 3], 1.7);
    builder.particle([0.9, 0.1, 0.4], 0.6);
    builder.spring(0, 1, Spring { stiffness: 40.0, rest_length: 0.8, damping: 0.3 });
    for (axis, motion) in [(0, Motion::Held), (1, Motion::Velocity(Vector3::new(9.0, 0.7, 9.0)))] {
        let axes = sprung::system::Axes::of(&[axis]);
        builder.constrain(Constraint { particles: vec![0], axes, motion });
    }
    let (system, mut start) = builder.build().unwrap();
    start.prescribe(&system);
    let imbalances = [0.02, 0.005].map(|dt| monitored(&system, &start, Method::ImplicitMidpoint, dt, 1.0).0.balance());
    let [coarse, fine] = imbalances.map(|balance| balance.imbalance.abs() / balance.work.abs());
    assert!(fine < 1e-4 && coarse / fine > 8.0, "{imbalances:?}");
}

/// Backward Euler loses energy and forward Euler gains some; nothing else changes the energy of an undamped free body.
#[test]
fn the_imbalance_is_what_the_method_adds() {
    let (system, start) = dumbbell(0.0);
    let imbalance = |method, dt| {
        let monitor = monitored(&system, &start, method, dt, 2.0).0;
        let balance = monitor.balance();
        assert_eq!((balance.work, balance.dissipated), (0.0, 0.0));
        assert_eq!(balance.imbalance, monitor.energy().total() - monitor.initial().total());
        balance.imbalance / monitor.initial().total()
    };
    assert!(imbalance(Method::BackwardEuler, 0.02) < -0.05);
    assert!(imbalance(Method::ForwardEuler, 0.02) > 0.05);
    assert!(imbalance(Method::ImplicitMidpoint, 0.02).abs() < 1e-3);
}

/// A mass on a spring past the limit of explicit steps.
#[test]
fn energy_from_nowhere_ends_a_run_at_a_state_from_before() {
    let mut builder = SystemBuilder::new();
    for x in [0.0, 1.0, 2.1] {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    builder.hold(0);
    for i in 0..2 {
        builder.spring(i, i + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
    }
    let (system, start) = builder.build().unwrap();
    let mut state = start.clone();
    state.velocities[1].x = 1.0;
    let before = sprung::force::Energy::of(&system, &state).total();
    let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
    let mut stepper = Method::SymplecticEuler.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
    // ω of the fast mode is 16 rad/s: the limit is 0.124 s.
    let schedule = Schedule::steps(0.126, 100_000);
    let outcome =
        run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Unstable);
    let failure = outcome.end.unwrap_err();
    let StepFailure::Unstable { gained, exchanged } = failure.failure else { panic!("{failure:?}") };
    assert!(gained > 4.0 * exchanged && exchanged > 0.4, "{gained} {exchanged}");
    assert!(outcome.steps < failure.step, "{outcome:?}");
    assert_eq!(state.time, outcome.steps as f64 * 0.126);
    let energy = |state: &State| sprung::force::Energy::of(&system, state).total();
    assert!(energy(&state) < 2.0 * before);
    assert_eq!(monitor.energy().total(), energy(&state));
}

/// Within their limits explicit methods swing about the energy, and midpoint keeps it on average.
#[test]
fn methods_within_their_limits_raise_no_alarm() {
    let (system, start) = dumbbell(0.0);
    // ω = sqrt(k/(l0 μ)) = 5.2 rad/s.
    for (method, dt) in [
        (Method::SymplecticEuler, 0.25),
        (Method::ImplicitMidpoint, 0.5),
        (Method::W2, 0.5),
        (Method::LinearBackwardEuler, 2.0),
        (Method::BackwardEuler, 2.0),
        (Method::ForwardEuler, 0.001),
    ] {
        monitored(&system, &start, method, dt, 100.0 * dt);
    }
}

/// Random networks, held, damped and with all values unequal: what moves accurately has a balanced account, under every method
/// that is accurate.
#[test]
fn accurate_motions_of_random_networks_balance() {
    for seed in 0..8 {
        let (system, start) = sprung::scene::builtin::network(14, seed).unwrap().build().unwrap();
        // ω is below 2 sqrt(k/(l0 m)) times the root of the springs at a particle: about 600 rad/s.
        for (method, dt) in [(Method::ImplicitMidpoint, 1e-4), (Method::Bdf2, 2e-5), (Method::W2, 5e-5)] {
            let (monitor, end) = monitored(&system, &start, method, dt, 0.05);
            let (balance, figures) = (monitor.balance(), monitor.indicators(&end));
            let share = balance.imbalance.abs() / (figures.exchanged + balance.dissipated);
            assert!(figures.exchanged > 1e-3 && balance.dissipated > 0.0, "{seed} {figures:?}");
            assert!(share < 5e-3, "{seed} {}: {share} {balance:?}", method.name());
        }
    }
}

/// Explicit steps three times too long, on scenes that start with energy: not one may complete.
#[test]
fn no_instability_of_random_networks_is_missed() {
    for seed in 0..20 {
        let (system, start) = sprung::scene::builtin::network(14, seed).unwrap().build().unwrap();
        let stiffest = system.active().map(|(.., spring)| spring.stiffness / spring.rest_length).fold(0.0, f64::max);
        // No mode is slower than the fastest of one spring alone, at the heaviest mass there is.
        let dt = 3.0 * 2.0 / (stiffest / 0.015f64).sqrt();
        for method in [Method::SymplecticEuler, Method::ForwardEuler] {
            let mut state = start.clone();
            let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
            let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
            let schedule = Schedule::steps(dt, 400);
            let outcome =
                run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
            assert_eq!(outcome.status(), Status::Unstable, "{seed} {}", method.name());
            assert!(state.is_finite() && outcome.steps < 20, "{seed} {outcome:?}");
        }
    }
}
