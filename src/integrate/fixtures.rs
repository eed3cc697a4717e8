//! A motion with kinks for tests.

use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;

/// A damped particle on a spring to another that starts, turns and stops suddenly, a quarter of a second each.
pub(super) fn pulled_with_kinks() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.1, 0.0, 0.0], 1.0);
    let offsets = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.25, 0.0, 0.0]].map(Vector3::from).to_vec();
    let motion = Motion::Path { times: vec![0.25, 0.5, 0.75], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.spring(0, 1, Spring { stiffness: 30.0, rest_length: 2.0, damping: 3.0 });
    builder.build().unwrap()
}
