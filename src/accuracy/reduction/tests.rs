//! What is left out, and what is not.

use super::*;
use crate::spring::{Spring, SpringLaw, Tension};
use crate::system::{Constraint, ExternalForce, Moment, Motion, SystemBuilder};
use nalgebra::Vector3;

fn spring(stiffness: f64, rest_length: f64) -> Spring {
    Spring { stiffness, rest_length, damping: 0.1 }
}

/// On the x axis hang two particles, in a scene that has a part of its own before them.
fn on_an_axis(anchor: Motion) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for x in [[0.0, 5.0, 0.0], [1.0, 6.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0], [2.1, 0.0, 0.0]] {
        builder.particle(x, 1.0);
    }
    for [i, j] in [[0, 1], [2, 3], [3, 4]] {
        builder.spring(i, j, spring(1.0, 1.0));
    }
    builder.constrain(Constraint { particles: vec![2], axes: Axes::ALL, motion: anchor });
    builder.build().unwrap()
}

#[test]
fn axes_without_force_are_left_out_part_by_part() {
    let axis = |axis| Reduction::Axis { axis, coordinates: 2 };
    let along = |x: f64, y: f64| Vector3::new(x, y, 0.0);
    let path = |to| Motion::Path { times: vec![0.0, 1.0], offsets: vec![Vector3::zeros(), to] };
    for (motion, expected) in [
        (Motion::Held, vec![axis('y'), axis('z')]),
        (Motion::Velocity(along(1.0, 0.0)), vec![axis('y'), axis('z')]),
        (Motion::Velocity(along(0.0, 1.0)), vec![axis('z')]),
        (path(along(1.0, 0.0)), vec![axis('y'), axis('z')]),
        (path(along(0.0, 1.0)), vec![axis('z')]),
    ] {
        let (system, mut state) = on_an_axis(motion.clone());
        assert_eq!(reduce(&system, &state).reductions, expected, "{motion:?}");
        state.velocities[4].z = 1.0;
        let expected: Vec<_> = expected.into_iter().filter(|of| *of != axis('z')).collect();
        assert_eq!(reduce(&system, &state).reductions, expected, "{motion:?}");
    }
}

/// A heavy particle between two walls, off the middle by a part of what rounding allows: 16 ε of `2 (F + κ (|x| + 5 m))` with the κ of 200 N/m and
/// the F of 900 N of either spring, or, where these are compressed, by nothing.
#[test]
fn particles_rest_where_forces_balance_to_rounding() {
    let is_left_out = |part: f64, rest_length: f64, wall: Motion| {
        let allowed = 16.0 * f64::EPSILON * 2.0 * (900.0 + 1000.0);
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        for x in [part * allowed / 400.0, -5.0, 5.0] {
            builder.particle([x, 0.0, 0.0], 1e5);
        }
        builder.spring(0, 1, spring(200.0 * rest_length, rest_length));
        builder.spring(0, 2, spring(200.0 * rest_length, rest_length));
        builder.hold(1);
        builder.constrain(Constraint { particles: vec![2], axes: Axes::ALL, motion: wall });
        let (system, state) = builder.build().unwrap();
        reduce(&system, &state).reductions.contains(&Reduction::AtRest { particles: 1, coordinates: 1 })
    };
    for (part, rest_length, expected) in
        [(0.0, 0.5, true), (0.7, 0.5, true), (1.5, 0.5, false), (0.0, 6.0, true), (0.4, 6.0, false)]
    {
        assert_eq!(is_left_out(part, rest_length, Motion::Held), expected, "{part} {rest_length}");
    }
    assert!(!is_left_out(0.0, 0.5, Motion::Velocity(Vector3::new(1.0, 0.0, 0.0))));
}

/// A square with its diagonals in space, of springs at rest, from a corner whose coordinates are not to be represented exactly.
fn square() -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    for [x, y] in [[0.1, 0.2], [0.4, 0.2], [0.1, 0.6], [0.4, 0.6]] {
        builder.particle([x, y, 0.3], 1.0);
    }
    for ([i, j], length) in
        [[0, 1], [2, 3], [0, 2], [1, 3], [0, 3], [1, 2]].into_iter().zip([0.3, 0.3, 0.4, 0.4, 0.5, 0.5])
    {
        builder.spring(i, j, spring(100.0, length));
    }
    builder
}

fn leads(builder: &mut SystemBuilder, particle: usize, axes: Axes, motion: Motion) {
    builder.constrain(Constraint { particles: vec![particle], axes, motion });
}

fn slack(builder: SystemBuilder) -> Option<usize> {
    let (system, state) = builder.build().unwrap();
    let reduced = reduce(&system, &state);
    let slack = reduced.reductions.iter().find_map(|reduction| match reduction {
        Reduction::Slack { springs } => Some(*springs),
        _ => None,
    });
    assert_eq!(reduced.system.active_springs().len() + slack.unwrap_or(0), system.active_springs().len());
    assert_eq!(reduced.system.dofs().len(), system.dofs().len() - held(&reduced));
    slack
}

/// Coordinates that were left out.
fn held(reduced: &Reduced) -> usize {
    let coordinates = reduced.reductions.iter().map(|reduction| match reduction {
        Reduction::Axis { coordinates, .. } | Reduction::AtRest { coordinates, .. } => *coordinates,
        _ => 0,
    });
    coordinates.sum()
}

/// Springs that are compressed by rounding alone do not keep a body from resting; by more than that they do, even without a force.
#[test]
fn bodies_rest_whose_lengths_are_rounded() {
    let (system, state) = square().build().unwrap();
    let strains: Vec<f64> = Extensions::at(&system, &state.positions)
        .unwrap()
        .springs(&system)
        .map(|((_, _, spring), at)| at.length - spring.rest_length)
        .collect();
    assert!(strains.iter().any(|strain| *strain < 0.0), "{strains:?}");
    assert!(reduce(&system, &state).reductions.contains(&Reduction::AtRest { particles: 4, coordinates: 12 }));
    // Pressed between its neighbours, and balanced exactly.
    for (length, expected) in [(1.0, true), (1.0 + 1e-15, true), (1.0 + 1e-13, false)] {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        for p in 0..3 {
            builder.particle([f64::from(p) - 1.0, 0.0, 0.0], 1.0 + 1e-9);
        }
        builder.spring(0, 1, spring(3.0, length));
        builder.spring(1, 2, spring(3.0, length * (1.0 + f64::EPSILON)));
        [0, 2].into_iter().for_each(|end| leads(&mut builder, end, Axes::ALL, Motion::Held));
        let (system, state) = builder.build().unwrap();
        let rests = reduce(&system, &state).reductions.contains(&Reduction::AtRest { particles: 1, coordinates: 1 });
        assert_eq!(rests, expected, "{length}");
    }
}

/// A body that falls, or drifts with what leads it: its springs never pull.
#[test]
fn springs_of_what_moves_as_one_are_left_out() {
    let velocity = Vector3::new(1.0, -2.0, 0.5);
    let falling = |gravity: f64, odd: f64| {
        let mut builder = square();
        builder.gravity(0.0, gravity, 0.0);
        builder.velocities.iter_mut().for_each(|v| *v = velocity);
        builder.velocities[3].x += odd;
        builder
    };
    assert_eq!(slack(falling(-9.81, 0.0)), Some(6));
    assert_eq!(slack(falling(-9.81, 1e-12)), None);
    // A spring that is longer than it should be.
    let mut strained = falling(-9.81, 0.0);
    strained.springs[0].rest_length *= 1.0 + 1e-12;
    assert_eq!(slack(strained), None);
    let path = Motion::Path { times: vec![0.0, 1.0], offsets: vec![Vector3::zeros(), velocity] };
    let x = Axes::of(&[0]);
    let across = Motion::Velocity(Vector3::new(1.0, 0.0, 0.0));
    for (axes, motion, gravity, expected) in [
        (Axes::ALL, Motion::Velocity(velocity), 0.0, Some(6)),
        (Axes::ALL, Motion::Velocity(velocity), -9.81, None),
        (Axes::ALL, Motion::Velocity(2.0 * velocity), 0.0, None),
        (Axes::ALL, Motion::Held, 0.0, None),
        (Axes::ALL, path, 0.0, None),
        (x, across.clone(), -9.81, Some(6)),
        (x, Motion::Velocity(2.0 * velocity), -9.81, None),
    ] {
        let mut builder = falling(gravity, 0.0);
        leads(&mut builder, 1, axes, motion.clone());
        assert_eq!(slack(builder), expected, "{axes:?} {motion:?} {gravity}");
    }
    // Only the part that falls.
    let mut builder = falling(-9.81, 0.0);
    let beside = [5.0, 6.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
    builder.spring(beside[0], beside[1], spring(1.0, 0.9));
    assert_eq!(slack(builder), Some(6));
}

/// A force that the state does not show.
#[derive(Debug)]
struct Wind;

impl ExternalForce for Wind {
    fn add(&self, _: &Moment<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().for_each(|f| f.z += 1.0);
    }
}

/// Tension that falls as the spring grows longer.
#[derive(Debug)]
struct Tiring;

impl SpringLaw for Tiring {
    fn energy(&self, _: usize, spring: &Spring, length: f64) -> f64 {
        -0.5 * spring.stiffness * (length - spring.rest_length).powi(2)
    }

    fn tension(&self, _: usize, spring: &Spring, length: f64) -> Tension {
        Tension { force: spring.stiffness * (spring.rest_length - length), slope: -spring.stiffness }
    }
}

#[test]
fn forces_and_laws_of_the_callers_own_are_not_trusted_to_rest() {
    let (system, state) = square().build().unwrap();
    let found = |system: System| reduce(&system, &state).reductions;
    assert_eq!(found(system.clone()).len(), 1);
    assert_eq!(found(system.clone().with_external_force(Wind)), []);
    assert_eq!(found(system.with_spring_law(Tiring)), [Reduction::Axis { axis: 'z', coordinates: 4 }]);
}

/// Lengths are zero to 16 roundings of the sum of what they are the difference of and of the rest length, which is neither of their products.
#[test]
fn lengths_are_rounded_like_coordinates_and_rest_lengths() {
    for (at, rest_length) in [(0.0, 0.1), (0.5, 2.0), (7.0, 0.25)] {
        let allowed = 16.0 * f64::EPSILON * (2.0 * at + 2.0 * rest_length);
        for (part, expected) in [(0.8, true), (1.2, false), (-0.8, true), (-1.2, false)] {
            let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
            let ends = [at, at + rest_length].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
            builder.spring(ends[0], ends[1], spring(1.0, rest_length + part * allowed));
            let (system, state) = builder.build().unwrap();
            let extensions = Extensions::at(&system, &state.positions).unwrap();
            let strains = Strains::of(&system, &state, &extensions, &Parts::of(&system));
            assert_eq!(strains.unstrained[0], expected, "{at} {rest_length} {part}");
        }
    }
}

/// A particle on a rail that goes along with what it hangs on, but will stop there.
#[test]
fn what_is_led_otherwise_later_does_not_move_as_one() {
    let along = Vector3::new(1.0, 0.0, 0.0);
    let stops = Motion::Path { times: vec![0.0, 1.0, 2.0], offsets: vec![Vector3::zeros(), along, along] };
    for (motion, expected) in [(stops, None), (Motion::Velocity(along), Some(1))] {
        let mut builder = SystemBuilder::new();
        let ends = [[0.0; 3], [0.6, 0.8, 0.0]].map(|x| builder.particle(x, 1.0));
        builder.spring(ends[0], ends[1], spring(1.0, 1.0));
        leads(&mut builder, ends[0], Axes::ALL, Motion::Velocity(along));
        leads(&mut builder, ends[1], Axes::of(&[0]), motion.clone());
        assert_eq!(slack(builder), expected, "{motion:?}");
    }
}
