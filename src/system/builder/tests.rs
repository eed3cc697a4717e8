//! The limits of what is accepted, on both sides.

use super::{State, SystemBuilder, check_count};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion};
use nalgebra::Vector3;

#[test]
fn particles_and_springs_are_numbered_as_they_come() {
    let mut builder = SystemBuilder::new();
    assert_eq!([0.0, 1.0, 2.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0)), [0, 1, 2]);
    let spring = Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 };
    assert_eq!([0, 1].map(|i| builder.spring(i, i + 1, spring)), [0, 1]);
}

/// 2³² − 1 is three times 1 431 655 765.
#[test]
fn three_rows_of_every_particle_can_be_numbered() {
    assert!(check_count(1_431_655_765).is_ok());
    assert!(check_count(1_431_655_766).is_err() && check_count(usize::MAX).is_err());
}

/// What is said of a particle at x₀ = 0 on a path.
fn on_path(times: &[f64], offsets: &[f64]) -> Option<String> {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    let offsets = offsets.iter().map(|&x| Vector3::new(x, 0.0, 0.0)).collect();
    let motion = Motion::Path { times: times.to_vec(), offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    builder.build().err().map(|error| error.to_string())
}

/// The speed of a segment is the difference of its offsets over that of its times: 10¹⁵⁵ m/s is too much, 10¹⁴⁵ is not.
#[test]
fn paths_are_slower_than_the_largest_velocity() {
    let soon = 1.0 + 2.0_f64.powi(-34);
    assert_eq!(on_path(&[1.0, soon], &[0.0, 1e135]), None);
    let message = on_path(&[1.0, soon], &[0.0, 1e145]).unwrap();
    assert!(message.starts_with("constraints[0].path.times[1]") && message.ends_with("entry before"), "{message}");
    assert!(on_path(&[1.0, soon], &[1e145, 0.0]).is_some());
    // Two far places that are the same take no speed.
    assert_eq!(on_path(&[1.0, soon], &[1e149, 1e149]), None);
    // As far away as a state may be.
    assert_eq!(on_path(&[0.0], &[State::LARGEST]), None);
}

#[test]
fn starts_are_within_what_states_may_have() {
    let build = |x: f64, offset: f64| {
        let mut builder = SystemBuilder::new();
        builder.particle([x, 0.0, 0.0], 1.0);
        let motion = Motion::Path { times: vec![0.0], offsets: vec![Vector3::new(offset, 0.0, 0.0)] };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
        builder.build().err().map(|error| error.to_string())
    };
    assert_eq!(build(State::LARGEST, 0.0), None);
    for sign in [1.0, -1.0] {
        let message = build(sign * State::LARGEST, sign * 1e140).unwrap();
        assert!(message.starts_with("constraints[0].path.offsets = "), "{message}");
    }
}

/// What is said of a system with a moving, a high and two joined particles that have so much kinetic, gravitational and elastic
/// energy, in 10³⁰⁰ J; the largest number is 1.797 · 10³⁰⁸. With v = g = 10¹⁵⁰ and x = −10¹⁵⁰ the energies of a mass m are
/// ½ m 10³⁰⁰ and m 10³⁰⁰; that of a spring of rest length 2 that is twice as long is k.
fn with_energies([kinetic, gravitational, elastic]: [f64; 3]) -> Option<String> {
    const LITTLE: f64 = 1e-300;
    let mut builder = SystemBuilder::new();
    builder.gravity(State::LARGEST, 0.0, 0.0);
    let moving = builder.particle([0.0; 3], (2.0 * kinetic).max(LITTLE));
    builder.velocities[moving].y = State::LARGEST;
    builder.particle([-State::LARGEST, 0.0, 0.0], gravitational.max(LITTLE));
    builder.particle([0.0, 2.0, 0.0], LITTLE);
    builder.particle([0.0, 6.0, 0.0], LITTLE);
    builder.spring(2, 3, Spring { stiffness: (elastic * 1e300).max(LITTLE), rest_length: 2.0, damping: 0.0 });
    builder.build().err().map(|error| error.to_string())
}

#[test]
fn energies_and_their_sum_are_numbers() {
    for energies in [[1.7e8, 0.0, 0.0], [0.0, 1.7e8, 0.0], [0.0, 0.0, 1.7e8], [0.5e8; 3]] {
        assert_eq!(with_energies(energies), None, "{energies:?}");
    }
    for (energies, key) in [
        ([1.9e8, 0.0, 0.0], "particles.masses[0]"),
        ([0.0, 1.9e8, 0.0], "particles.masses[1]"),
        ([1e8, 1e8, 0.0], "particles.masses[1]"),
        ([0.9e8, 0.0, 1e8], "springs.stiffness[0]"),
        ([0.0, 0.9e8, 1e8], "springs.stiffness[0]"),
    ] {
        let message = with_energies(energies).unwrap();
        assert!(message.starts_with(key) && message.ends_with("beyond the largest number"), "{message}");
    }
}

/// Two particles and a spring, changed.
fn changed(change: impl FnOnce(&mut SystemBuilder)) -> Option<String> {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    change(&mut builder);
    builder.build().err().map(|error| error.to_string())
}

#[test]
fn lists_have_an_entry_for_everything() {
    assert_eq!(changed(|_| {}), None);
    for (message, key) in [
        (changed(|builder| _ = builder.masses.pop()), "particles.masses"),
        (changed(|builder| builder.velocities.push(Vector3::zeros())), "particles.velocities"),
        (changed(|builder| _ = builder.springs.pop()), "springs"),
    ] {
        let message = message.unwrap();
        assert!(message.starts_with(key) && message.contains("must have one entry for each of the "), "{message}");
    }
}

#[test]
fn masses_and_parameters_are_finite_and_positive() {
    for value in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        let messages =
            [changed(|builder| builder.masses[1] = value), changed(|builder| builder.springs[0].stiffness = value)];
        for (message, key) in messages.iter().zip(["particles.masses[1]", "springs.stiffness[0]"]) {
            let message = message.as_deref().unwrap_or_default();
            assert!(message.starts_with(key) && message.ends_with("must be finite and positive"), "{value}: {message}");
        }
    }
    assert_eq!(changed(|builder| builder.masses[1] = f64::MIN_POSITIVE), None);
    for value in [-1.0, f64::INFINITY, f64::NAN] {
        let message = changed(|builder| builder.springs[0].rest_length = value).unwrap();
        assert!(message.starts_with("springs.rest_lengths[0]") && message.ends_with("not negative"), "{message}");
    }
    assert_eq!(changed(|builder| builder.springs[0].rest_length = 0.0), None);
}
