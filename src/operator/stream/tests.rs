//! Which springs are streamed, and products by hand-made shares.

use super::*;
use crate::force::Extensions;
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::{State, SystemBuilder};
use nalgebra::Vector3;

/// A free chain of springs of rest length 1 that have these lengths and dampings.
fn chain(springs: &[(f64, f64)]) -> (System, State) {
    let mut builder = SystemBuilder::new();
    let (mut x, mut last) = (0.0, builder.particle([0.0; 3], 1.0));
    for &(length, damping) in springs {
        x += length;
        let next = builder.particle([x, 0.0, 0.0], 1.0);
        builder.spring(last, next, Spring { stiffness: 100.0, rest_length: 1.0, damping });
        last = next;
    }
    builder.build().unwrap()
}

/// Consecutive particles, so many for every share.
fn shares(system: &System, particles: &[usize]) -> Vec<Share> {
    let mut start = 0;
    let mut share = |count: usize| {
        let particles = start..start + count;
        start += count;
        let ends_here = |position: &u32| system.pair(*position as usize).iter().any(|end| particles.contains(end));
        let springs = (0..system.springs().len() as u32).filter(ends_here).collect();
        Share { particles, springs }
    };
    particles.iter().map(|&count| share(count)).collect()
}

/// The positions of the springs that go through their matrix, for the blocks given.
fn by_matrix(system: &System, blocks: &[SpringBlock]) -> Vec<u32> {
    let mut stream = SpringStream::new(system, &shares(system, &[system.particles()]));
    stream.update(system, blocks);
    let records = stream.parts[0].records.iter();
    records.filter(|record| record.ends[0] == BY_MATRIX).map(|record| record.ends[1]).collect()
}

/// Springs longer than half their rest length are streamed, whatever sign the combination gives to the stiffness; a spring
/// that the combination leaves out, here one without damping, does not send the others through their matrix.
#[test]
fn only_short_springs_go_through_their_matrix() {
    let (system, state) = chain(&[(0.6, 0.0), (1.0, 3.0), (0.4, 0.0), (2.5, 1.0)]);
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let damping = |factor: f64| Combination { damping: factor, ..Combination::MASS };
    for (combination, expected) in [
        (Combination::STIFFNESS, vec![2]),
        (Combination::step(0.1), vec![2]),
        (damping(1.0), vec![]),
        (damping(-1.0), vec![]),
        (Combination::MASS, vec![]),
    ] {
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
        assert_eq!(by_matrix(&system, operator.blocks()), expected, "{combination:?}");
    }
}

/// 2 nnᵀ and −3 nnᵀ along x, in one operator: the product with (1, 0, 0), (0, 0, 0), (4, 0, 0) by hand.
#[test]
fn blocks_of_both_signs_may_be_mixed() {
    let (system, _) = chain(&[(1.0, 0.0), (1.0, 0.0)]);
    let block = |axial| SpringBlock { direction: Vector3::x(), transverse: 0.0, axial };
    let blocks = [block(2.0), block(-3.0)];
    assert_eq!(by_matrix(&system, &blocks), [0]);
    let mut stream = SpringStream::new(&system, &shares(&system, &[3]));
    stream.update(&system, &blocks);
    let mut w = [0.0; 9];
    (w[0], w[6]) = (1.0, 4.0);
    let mut y = [f64::NAN; 9];
    stream.multiply(&system, &blocks, &[0.0; 9], &w, &mut y);
    let along: Vec<f64> = y.iter().step_by(3).copied().collect();
    for (value, expected) in along.into_iter().zip([2.0, -2.0 + 12.0, -12.0]) {
        assert!((value - expected).abs() <= 1e-14, "{y:?}");
    }
}

/// The result does not depend on the number of shares, nor on their sizes.
#[test]
fn products_are_the_same_to_the_bit_for_any_shares() {
    let (system, state) = chain(&[(1.1, 0.2); 8]);
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
    let w: Vec<f64> = (0..27).map(|row| (row as f64 * 12.9898).sin()).collect();
    let product = |particles: &[usize]| {
        let mut stream = SpringStream::new(&system, &shares(&system, particles));
        stream.update(&system, operator.blocks());
        let mut y = vec![f64::NAN; 27];
        stream.multiply(&system, operator.blocks(), &[100.0; 27], &w, &mut y);
        y
    };
    let one = product(&[9]);
    for particles in [&[4, 5][..], &[2, 3, 4], &[2, 2, 3, 2], &[1, 3, 1, 2, 2]] {
        assert_eq!(product(particles), one, "{particles:?}");
    }
}
