//! Small systems that several rooms are tested on.

use super::{State, System, SystemBuilder};
use crate::spring::Spring;

/// A particle of 1 kg in one dimension, on a spring of 1 N/m that is held at the origin and drawn out by 0.3 m from its length of 1 m: it is at
/// `1 + 0.3 cos t`.
pub fn oscillator() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.3, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(0);
    builder.build().unwrap()
}

/// Particles of 1 kg in a row along x, each joined to the next by a spring at rest, 1 N and 1 m.
pub fn row(particles: usize) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for p in 0..particles {
        builder.particle([p as f64, 0.0, 0.0], 1.0);
    }
    for p in 1..particles {
        builder.spring(p - 1, p, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    }
    builder.build().unwrap()
}
