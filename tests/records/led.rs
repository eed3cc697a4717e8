//! Every family of checks on systems that are led in ways that no step falls together with, in a line, in a plane and in space; and on some
//! that are not where they should be, so that checks fail by about as much.

use crate::record::{Row, beside, hold};
use sprung::system::{Axes, Constraint, Motion};
use sprung::verify::{FAMILIES, Subject};
use sprung::{Spring, SystemBuilder};

/// A crooked chain, led at one end, partly held at the other.
fn chain(name: &str, dimension: usize, motion: Motion, rest_length: f64) -> Subject {
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    let along = Axes::first(dimension);
    for p in 0..5 {
        let x = [0.31 * p as f64, 0.07 * ((p * p) % 4) as f64, 0.05 * ((3 * p) % 5) as f64];
        let x = [0, 1, 2].map(|axis| if axis < dimension { x[axis] } else { 0.0 });
        let at = builder.particle(x, 0.2 + 0.07 * p as f64);
        builder.velocities[at] =
            [0, 1, 2].map(|axis| if axis < dimension { 0.1 * (at * 2 + axis) as f64 - 0.3 } else { 0.0 }).into();
    }
    for p in 0..4 {
        let spring = Spring {
            stiffness: 12.0 + 1.7 * p as f64,
            rest_length: rest_length + 0.01 * p as f64,
            damping: 0.03 * p as f64,
        };
        builder.spring(p, p + 1, spring);
    }
    builder.gravity = [0.3, -1.1, 0.4].map(|g| g * 0.7).into();
    (dimension..3).for_each(|axis| builder.gravity[axis] = 0.0);
    builder.constrain(Constraint { particles: vec![0], axes: along, motion });
    builder.constrain(Constraint { particles: vec![4], axes: Axes::of(&[0]), motion: Motion::Held });
    builder.velocities[0] = [0.0; 3].into();
    builder.velocities[4][0] = 0.0;
    let (system, state) = builder.build().unwrap();
    Subject { name: name.into(), system, state, dt: 0.0137 }
}

/// Corners at no multiple of a step, and offsets that no sum of few digits gives.
fn path(dimension: usize) -> Motion {
    let times = vec![0.0, 0.0171, 0.0333, 0.0709, 0.143];
    let offset = |n: usize| {
        [0.0123 * (n as f64).sin(), 0.0077 * n as f64, if dimension < 3 { 0.0 } else { -0.0031 * (n * n) as f64 }]
            .into()
    };
    Motion::Path { times, offsets: (0..5).map(offset).collect() }
}

fn all(name: &str, subject: &Subject) {
    hold(name, |seed| {
        let subject = beside(subject, seed);
        let families = FAMILIES.iter().filter(|family| (family.applies)(&subject));
        let rows = families.flat_map(|family| {
            let checks = family.check(&subject).into_iter().enumerate();
            checks.map(|(number, check)| {
                Row::of(format!("{} {number}", family.name), &serde_json::to_value(check).unwrap())
            })
        });
        rows.collect()
    });
}

#[test]
fn in_space() {
    all("led_in_space", &chain("led in space", 3, path(3), 0.25));
}

#[test]
fn in_a_plane() {
    all("led_in_a_plane", &chain("led in a plane", 2, path(2), 0.45));
}

#[test]
fn at_a_speed() {
    all("led_at_a_speed", &chain("led at a speed", 3, Motion::Velocity([0.713, -0.211, 0.377].into()), 0.3));
}

/// From a third of a second on: no particle is at its start, no path at its first corner.
#[test]
fn on_the_way() {
    let mut subject = chain("led on the way", 2, path(2), 0.33);
    subject.state.time = 0.0217;
    subject.state.prescribe(&subject.system);
    all("led_on_the_way", &subject);
}

#[test]
fn beside_the_path() {
    let mut subject = chain("beside the path", 3, path(3), 0.3);
    subject.state.positions[0].x += 1e-3;
    subject.state.velocities[0].y -= 2e-3;
    all("led_beside", &subject);
}

#[test]
fn pressed_beyond_what_a_step_bears() {
    let pressed = chain("pressed", 3, Motion::Held, 1.7);
    all("led_pressed", &Subject { dt: 0.5, ..pressed.clone() });
    all("led_pressed_little", &Subject { dt: 0.15, ..pressed });
}
