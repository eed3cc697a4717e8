//! Motions that are followed by hand.

use super::*;
use crate::integrate::{Method, StiffnessPolicy};
use crate::system::{Axes, Constraint, SystemBuilder};
use nalgebra::Vector3;

/// From 0 by 300 m in the first hundred seconds, back by 200 m in the two hundred that follow.
fn path() -> Motion {
    let offsets = [0.0, 300.0, 100.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
    Motion::Path { times: vec![100.0, 200.0, 400.0], offsets }
}

#[test]
fn the_velocity_on_a_path_is_that_after_its_corner() {
    let velocity = |t: f64| velocity_after(&path(), t, 0);
    assert_eq!([50.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0].map(velocity), [0.0, 3.0, 3.0, -1.0, -1.0, 0.0, 0.0]);
    // Within 1e-12 of the corner is at the corner.
    assert_eq!([200.0 * (1.0 - 5e-13), 200.0 * (1.0 - 2e-12), 400.0 * (1.0 - 5e-13)].map(velocity), [-1.0, 3.0, 0.0]);
}

#[test]
fn the_reach_of_a_motion_by_hand() {
    let ahead = Motion::Velocity(Vector3::new(3.0, 0.0, 0.0));
    assert_eq!([reach(&Motion::Held, 2.0, 0), reach(&ahead, -2.0, 0)], [0.0, 6.0]);
    assert_eq!(reach(&path(), 50.0, 0), 300.0 + 50.0 * 3.0);
}

fn led(motion: Motion) -> TestCase {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    let (system, state) = builder.build().unwrap();
    TestCase { name: "led".into(), system, state, dt: 0.5 }
}

/// A particle that is led at 2 m/s has gone 3 m in ½ s and says that it has 7 m/s: 1 m/s more than it had on the way, 5 m/s more than
/// its motion.
#[test]
fn velocities_are_those_of_the_way_or_of_the_motion() {
    let subject = led(Motion::Velocity(Vector3::new(2.0, 0.0, 0.0)));
    let state = |time, x, v| State {
        time,
        positions: vec![Vector3::new(x, 0.0, 0.0)],
        velocities: vec![Vector3::new(v, 0.0, 0.0)],
    };
    let error = |method, v| {
        let way = Way { method, stiffness: StiffnessPolicy::OnDemand };
        speed_error(&subject, way, 0.5, &state(3.5, 4.0, 0.0), &state(4.0, 7.0, v)) * U
    };
    let of_the_way = 1.0 / ((1.0 + 8.0) / 0.5);
    for method in [Method::BackwardEuler, Method::LinearBackwardEuler] {
        assert!((error(method, 7.0) - of_the_way).abs() < 1e-15);
        assert_eq!(error(method, 6.0), 0.0);
    }
    for method in [Method::ImplicitMidpoint, Method::SymplecticEuler, Method::W2] {
        assert_eq!([error(method, 7.0), error(method, 2.0)], [2.5, 0.0]);
    }
}

#[test]
fn paths_are_looked_at_around_all_their_corners() {
    let subject = led(Motion::Path { times: vec![1.0, 3.0], offsets: vec![Vector3::zeros(); 2] });
    let expected = [0.0, 0.5, 1.0, 1000.0, 1.0, 3.0, 1.74, 0.1, 1.9, 2.1, 3.9];
    let times = many_times(&subject);
    assert_eq!(times.len(), expected.len());
    assert!(times.iter().zip(expected).all(|(t, expected)| (t - expected).abs() < 1e-12), "{times:?}");
    let check = at_many_times(&led(path()));
    assert!(check.passed() && check.name == "prescribed positions at many times");
}
