//! What the tests share: proptest strategies for random systems.
#![allow(dead_code, reason = "each program of tests uses its own part")]

use nalgebra::Vector3;
use proptest::prelude::*;
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, State, System, SystemBuilder};

/// A number whose logarithm is uniform.
pub fn log_uniform(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

fn vector(dimension: usize) -> impl Strategy<Value = Vector3<f64>> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(move |mut v: [f64; 3]| {
        v[dimension..].fill(0.0);
        Vector3::from(v)
    })
}

fn spring() -> impl Strategy<Value = Spring> {
    (log_uniform(1.0, 1e4), log_uniform(0.2, 3.0), prop_oneof![Just(0.0), log_uniform(0.01, 10.0)])
        .prop_map(|(stiffness, rest_length, damping)| Spring { stiffness, rest_length, damping })
}

fn motion(dimension: usize) -> impl Strategy<Value = Motion> {
    let path = (vector(dimension), vector(dimension))
        .prop_map(|(a, b)| Motion::Path { times: vec![0.0, 0.01, 0.5], offsets: vec![Vector3::zeros(), a, b] });
    prop_oneof![Just(Motion::Held), vector(dimension).prop_map(Motion::Velocity), path]
}

fn constraint(particles: usize, dimension: usize) -> impl Strategy<Value = Constraint> {
    let axes = prop::collection::vec(0usize..3, 0..3);
    (prop::collection::vec(0..particles, 1..3), axes, motion(dimension)).prop_map(|(particles, axes, motion)| {
        Constraint { particles, axes: if axes.is_empty() { Axes::ALL } else { Axes::of(&axes) }, motion }
    })
}

/// Systems as in [`descriptions`], built.
pub fn systems() -> impl Strategy<Value = (System, State)> {
    descriptions().prop_map(|builder| builder.build().expect("a valid description"))
}

/// Systems in which no spring is shorter than at rest.
pub fn stretched_systems() -> impl Strategy<Value = (System, State)> {
    descriptions().prop_map(|mut builder| {
        // Before the build: it puts moving particles where their motion starts, which these motions leave in place.
        for (spring, &[i, j]) in builder.springs.iter_mut().zip(&builder.pairs) {
            let length = (builder.positions[i as usize] - builder.positions[j as usize]).norm();
            spring.rest_length = spring.rest_length.min(length);
        }
        builder.build().expect("a valid description")
    })
}

/// Random descriptions of up to 14 particles in one to three dimensions: springs of either orientation, repeated springs,
/// disconnected parts, isolated particles, damping or none, prescribed particles and single axes, moving or held.
pub fn descriptions() -> impl Strategy<Value = SystemBuilder> {
    (1usize..=3, 1usize..=14).prop_flat_map(|(dimension, particles)| {
        let rows = || prop::collection::vec(vector(dimension), particles);
        let pair = (0..particles as u32, 0..particles as u32);
        (
            (rows(), rows(), prop::collection::vec(log_uniform(0.1, 10.0), particles), vector(dimension)),
            prop::collection::vec((pair, spring()), 0..40),
            prop::collection::vec(constraint(particles, dimension), 0..4),
        )
            .prop_map(move |((positions, velocities, masses, gravity), springs, constraints)| {
                let long_enough = |&([i, j], _): &([u32; 2], Spring)| {
                    i != j && (positions[i as usize] - positions[j as usize]).norm() > 1e-3
                };
                let springs = springs.into_iter().map(|((i, j), spring)| ([i, j], spring));
                let (pairs, springs) = springs.filter(long_enough).unzip();
                SystemBuilder { dimension, gravity, positions, velocities, masses, pairs, springs, constraints }
            })
    })
}

/// A reduced vector for a system, from a seed: reproducible, of mixed signs and sizes.
pub fn test_vector(length: usize, seed: u64) -> Vec<f64> {
    (0..length)
        .map(|i| ((i as f64 + 1.0) * (seed as f64 + 0.5) * 0.754_877_666).sin() * (1.0 + (i % 7) as f64))
        .collect()
}
