use super::External;
use crate::system::{Axes, Constraint, ExternalForce, StateView, SystemBuilder};
use nalgebra::Vector3;

/// Grows with time, and differs from particle to particle and from axis to axis.
#[derive(Debug)]
struct Hand;

impl ExternalForce for Hand {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        for (p, f) in force.iter_mut().enumerate() {
            *f += Vector3::new(3.0, 5.0, -4.0) * (at.time + p as f64);
        }
    }
}

/// `Σ ½ (f + f')·(x' − x)` over the free coordinates: of two particles, one of which can move along z alone.
#[test]
fn work_is_the_mean_force_times_the_way() {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 2.0, 3.0], 1.0);
    builder.particle([7.0, 0.0, 0.0], 1.0);
    builder.constrain(Constraint { axes: Axes::of(&[0, 1]), ..Constraint::hold([1]) });
    let (system, mut state) = builder.build().unwrap();
    assert!(External::new(&system, &state).is_none());
    let system = system.with_external_force(Hand);
    state.time = 1.0;
    let mut external = External::new(&system, &state).unwrap();
    // From 1 s to 3 s: the first particle is pulled by twice (3, 5, −4) in the mean, the second by three times that.
    state.time = 3.0;
    state.positions[0] += Vector3::new(0.5, 0.25, -2.0);
    state.positions[1] += Vector3::new(9.0, 9.0, 0.125);
    assert_eq!(external.pass(&system, &state), 2.0 * (1.5 + 1.25 + 8.0) + 3.0 * -4.0 * 0.125);
    // From there to 5 s, back by half of that.
    state.time = 5.0;
    state.positions[0] -= Vector3::new(0.25, 0.125, -1.0);
    assert_eq!(external.pass(&system, &state), -4.0 * (0.75 + 0.625 + 4.0));
}
