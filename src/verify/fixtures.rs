//! Systems that the tests of several checks work with by hand.

use super::TestCase;
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, SystemBuilder};
use nalgebra::Vector3;

/// A test case of what was built.
pub fn case(builder: SystemBuilder, dt: f64) -> TestCase {
    let (system, state) = builder.build().unwrap();
    TestCase { name: "case".into(), system, state, dt, loaded: None }
}

pub fn assert_close(value: f64, expected: f64) {
    assert!((value / expected - 1.0).abs() < 1e-14, "{value:e} is not {expected:e}");
}

/// Springs of k = 4 N, l0 = 2 m and of k = 12 N, l0 = 4 m between particles of 2, 1 and 5 kg at 1, 4 and 9 m.
pub fn line() -> SystemBuilder {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.gravity(-2.0, 0.0, 0.0);
    for (x, mass) in [(1.0, 2.0), (4.0, 1.0), (9.0, 5.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.spring(0, 1, Spring { stiffness: 4.0, rest_length: 2.0, damping: 0.5 });
    builder.spring(1, 2, Spring { stiffness: 12.0, rest_length: 4.0, damping: 1.0 });
    builder
}

/// A state of three particles along a line.
pub fn line_state(time: f64, positions: [f64; 3], velocities: [f64; 3]) -> State {
    let along = |numbers: [f64; 3]| numbers.map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
    State { time, positions: along(positions), velocities: along(velocities) }
}

/// A particle of 1 kg, 1 m from a held one, on a spring of k = 100 N along x.
pub fn pair(rest_length: f64, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
    builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length, damping: 0.0 });
    builder.hold(anchor);
    case(builder, dt)
}

/// A particle that is moved along x from 1 m.
pub fn moved(motion: Motion, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    case(builder, dt)
}

/// A path along which nothing moves, with corners at these times.
pub fn path(corners: &[f64]) -> Motion {
    Motion::Path { times: corners.to_vec(), offsets: vec![Vector3::zeros(); corners.len()] }
}

/// A chain in space that bends and swings, with unlike masses and springs, some stretched and some compressed; its first particle is held.
pub fn chain(particles: usize, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.5, -9.0, 0.25);
    for n in 0..particles {
        let t = n as f64;
        builder.particle([1.1 * t, (0.9 * t).sin(), (0.7 * t).cos()], 1.0 + 0.5 * (1.3 * t).sin());
        if n > 0 {
            let (stiffness, rest_length) = (40.0 + 10.0 * t.cos(), 1.2 + 0.3 * t.sin());
            builder.spring(n - 1, n, Spring { stiffness, rest_length, damping: 0.25 });
        }
    }
    builder.hold(0);
    case(builder, dt)
}
