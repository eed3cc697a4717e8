//! Particles that move along one axis each, so that every matrix is diagonal and all is known by hand.

use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};

/// A particle that moves across a spring to a wall, one metre away, and along a damper.
#[derive(Clone, Copy)]
pub struct Pin {
    pub mass: f64,
    /// Transverse stiffness taken from −K, in N/m, and added along the spring; below zero the spring is stretched, which adds as much across and
    /// twice that along.
    pub taken: f64,
    /// In N s/m.
    pub damping: f64,
}

/// Without a damper.
pub fn pin(mass: f64, taken: f64) -> Pin {
    Pin { mass, taken, damping: 0.0 }
}

/// In the plane, free along y only; the walls have a mass of 1 kg.
pub fn pinned(pins: &[Pin]) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for (row, pin) in pins.iter().enumerate() {
        let y = 3.0 * row as f64;
        let free = builder.particle([0.0, y, 0.0], pin.mass);
        builder.constrain(Constraint { particles: vec![free], axes: Axes::of(&[0]), motion: Motion::Held });
        let mut wall = |at: [f64; 3], spring: Spring| {
            let wall = builder.particle(at, 1.0);
            builder.hold(wall);
            builder.spring(free, wall, spring);
        };
        // k (1/l0 − 1/l) is −k/2 of the first and k of the second.
        let (stiffness, rest_length) = if pin.taken > 0.0 { (2.0 * pin.taken, 2.0) } else { (-pin.taken, 0.5) };
        if stiffness > 0.0 {
            wall([1.0, y, 0.0], Spring { stiffness, rest_length, damping: 0.0 });
        }
        if pin.damping > 0.0 {
            wall([0.0, y + 1.0, 0.0], Spring { stiffness: 1e-30, rest_length: 1.0, damping: pin.damping });
        }
    }
    builder.build().unwrap()
}
