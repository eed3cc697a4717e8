//! Systems cut in parts give the steps and accounts of the whole. Each part is on a thread of its own.

use super::*;
use crate::error::DegenerateSpring;
use crate::force::SpringGeometry;
use crate::operator::Combination;
use crate::spring::Spring;
use crate::system::fixtures::{Cut, in_parts};
use crate::system::{Axes, Constraint, Motion, SystemBuilder};

/// A ladder of damped rungs that swings, one end on a path with a kink; ten rungs are repeated.
fn ladder(rungs: usize) -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for rung in 0..rungs {
        let of_ten = (rung % 10) as f64;
        for side in [0.0, 1.0] {
            let p = builder.particle([rung as f64, 0.1 * (of_ten * side), side], 1.0 + 0.1 * of_ten);
            builder.velocities[p] = Vector3::new(0.0, 0.3 * of_ten, 0.1);
        }
    }
    let spring = |rest_length, damping| Spring { stiffness: 200.0, rest_length, damping };
    for p in 0..2 * rungs - 2 {
        builder.spring(p + 2, p, spring(1.02, 0.3));
        builder.spring(p, p + 1, spring(1.1, 0.0));
    }
    builder.hold(0);
    let motion = Motion::Path { times: vec![0.0, 0.013, 0.03], offsets: [0.0, 0.02, 0.01].map(Vector3::repeat).into() };
    builder.constrain(Constraint { particles: vec![1, 19], axes: Axes::of(&[0, 1]), motion });
    builder
}

/// Positions in parts are those of the whole to the bit, and indicators to the rounding of sums in another order.
#[test]
fn verlet_and_its_account_in_parts_are_those_of_the_whole() {
    let options = MonitorOptions::default();
    let dt = 2e-3;
    // So long that every part has several batches of springs.
    let ladder = ladder(60);
    let (system, start) = ladder.clone().build().unwrap();
    let account = |system: &System, state: &mut State| {
        let mut stepper = Verlet::new(system, state).unwrap();
        let mut monitor = Monitor::new(system, state, options).unwrap();
        for step in 1..=20 {
            stepper.step(state, dt).unwrap();
            monitor.enter(step, state, dt).unwrap();
        }
        (monitor.indicators(state), monitor.balance())
    };
    let mut state = start;
    let (indicators, balance) = account(&system, &mut state);
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * (1.0 + a.abs());
    for parts in 2..5 {
        in_parts(
            &ladder,
            parts,
            |p| p * 7 % parts,
            |Cut { particles, system, state: mut part, .. }| {
                let (found, of_part) = account(&system, &mut part);
                for (here, &p) in particles.iter().enumerate() {
                    assert_eq!(
                        (part.positions[here], part.velocities[here]),
                        (state.positions[p], state.velocities[p])
                    );
                }
                for (found, expected) in [
                    (found.extent, indicators.extent),
                    (found.exchanged, indicators.exchanged),
                    (of_part.imbalance, balance.imbalance),
                    (of_part.work, balance.work),
                    (of_part.dissipated, balance.dissipated),
                ] {
                    assert!(near(expected, found), "{parts} parts: {found} instead of {expected}");
                }
            },
        );
    }
    assert!(balance.work.abs() > 1e-3 && balance.dissipated > 1e-6);
}

/// A failure of one part is one of all, with the numbers of the whole scene; of several the one of the lowest spring. Particles 18 and 16 are the
/// ends of spring 32, 2 and 0 those of spring 0.
#[test]
fn failures_of_parts_are_those_of_all() {
    for (coincident, spring, pair) in [(&[(18, 16)][..], 32, [18, 16]), (&[(2, 0), (18, 16)], 0, [2, 0])] {
        let failures = in_parts(
            &ladder(10),
            3,
            |p| p * 3 / 20,
            |Cut { particles, system, state: mut part, .. }| {
                let mut stepper = Verlet::new(&system, &part).unwrap();
                let here = |number: usize| particles.iter().position(|&p| p == number);
                for &(moved, to) in coincident {
                    if let (Some(moved), Some(to)) = (here(moved), here(to)) {
                        part.positions[moved] = part.positions[to];
                    }
                }
                stepper.step(&mut part, 1e-3).unwrap_err()
            },
        );
        assert_eq!(failures, [StepFailure::DegenerateSpring(DegenerateSpring { spring, pair }); 3]);
    }
}

/// Compressed springs of many sizes on light and heavy particles: parts drop the terms of the whole.
#[test]
fn parts_drop_the_terms_of_the_whole() {
    let mut builder = SystemBuilder::new();
    for p in 0..40 {
        let x = f64::from(p);
        builder.particle([x, (0.7 * x).sin(), (1.3 * x).cos()], 1.0 + f64::from(p % 7));
    }
    for p in 0..40usize {
        for distance in [1, 2, 5, 11] {
            let (i, j) = (p, (p + distance) % 40);
            let rest_length = 1.5 * (builder.positions[i] - builder.positions[j]).norm();
            let stiffness = 10.0 * (1.0 + ((p * distance) % 13) as f64) * rest_length;
            let pair = if p % 2 == 0 { (i, j) } else { (j, i) };
            builder.spring(pair.0, pair.1, Spring { stiffness, rest_length, damping: 0.0 });
        }
    }
    builder.hold(3);
    let combination = |mass| Combination { mass, damping: 0.0, stiffness: -1.0 };
    let (system, state) = builder.clone().build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    for mass in [5.0, 15.0, 25.0] {
        let mut whole = Regularization::new(&system);
        let dropped = whole.choose(&system, &extensions, combination(mass)).unwrap();
        assert!(dropped > 0 && dropped < system.springs().len());
        for parts in 2..5 {
            in_parts(
                &builder,
                parts,
                |p| p * 13 % parts,
                |Cut { system, state, springs, .. }| {
                    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
                    let mut regularization = Regularization::new(&system);
                    assert_eq!(regularization.choose(&system, &extensions, combination(mass)).unwrap(), dropped);
                    for (option, &spring) in regularization.options().iter().zip(&springs) {
                        assert_eq!(*option, whole.options()[spring], "spring {spring} in {parts} parts");
                    }
                },
            );
        }
    }
}
