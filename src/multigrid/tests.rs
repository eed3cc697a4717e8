//! What is said of matrices for which there is no preconditioner.

use super::level::NotPositiveDefinite;
use super::{Dof, Hierarchy, Multigrid, SetupFailure};
use crate::force::SpringGeometry;
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::fixtures::row;
use crate::system::{Axes, Constraint, Motion, SystemBuilder};

/// A particle between two that are held, on springs along x of this stiffness and rest length, held along some axes itself; with levels down to one
/// of so many unknowns.
fn failure(stiffness: f64, rest_length: f64, held: &[usize], largest_dense: usize) -> Option<SetupFailure> {
    let mut builder = SystemBuilder::new();
    for x in [0.0, 1.0, 2.0] {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    for end in [0, 2] {
        builder.spring(end, 1, Spring { stiffness, rest_length, damping: 0.0 });
        builder.hold(end);
    }
    builder.constrain(Constraint { particles: vec![1], axes: Axes::of(held), motion: Motion::Held });
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(1.0));
    let mut multigrid = Multigrid::down_to(&system, largest_dense).unwrap();
    multigrid.set_positions(&state.positions);
    multigrid.refill(&a).and_then(|()| multigrid.rebuild(&a)).err()
}

/// Compressed to half its length a spring pushes sideways with k (1/2 − 1) each, against a mass term of 1: y is the first axis that gives way, or z
/// if y is held. Of a factorization the row is known, but not which axis.
#[test]
fn the_coordinate_that_gives_way_is_named() {
    let dof = |axis| Dof { particle: 1, axis };
    for (held, largest_dense, expected) in [
        (&[][..], 0, SetupFailure::DiagonalBlock(dof(1))),
        (&[1], 0, SetupFailure::DiagonalBlock(dof(2))),
        (&[], 400, SetupFailure::Pivot(dof(0))),
        (&[0], 400, SetupFailure::Pivot(dof(1))),
    ] {
        assert_eq!(failure(100.0, 2.0, held, largest_dense), Some(expected), "{held:?} {largest_dense}");
    }
    for largest_dense in [0, 400] {
        assert_eq!(failure(100.0, 0.5, &[], largest_dense), None);
        assert_eq!(failure(0.5, 2.0, &[], largest_dense), None);
    }
}

/// Every block is finite, and their sum is not.
#[test]
fn a_sum_beyond_the_largest_number_is_not_finite() {
    assert_eq!(failure(1.7e308, 1.0, &[], 0), Some(SetupFailure::NonFinite));
}

/// A strip along x of 600 particles whose short springs are in tension and whose springs to the second neighbour push: sideways the energy of a wave
/// of s = 2 − 2 cos θ is `−c s + s²`, so that only waves with s < c are unstable, and no node shorter than they are sees it. The longer they are, the
/// deeper the level that is refused.
#[test]
fn long_waves_are_refused_on_the_level_that_sees_them() {
    let level = |c: f64| {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        (0..600).for_each(|x| {
            builder.particle([f64::from(x), 0.0, 0.0], 1e-9);
        });
        let stiff = 100.0;
        // Sideways a spring is worth k (1/l0 − 1/l).
        let mut join = |i: usize, reach: usize, worth: f64| {
            let rest_length = 1.0 / (1.0 / reach as f64 + worth / stiff);
            builder.spring(i, i + reach, Spring { stiffness: stiff, rest_length, damping: 0.0 });
        };
        (0..599).for_each(|i| join(i, 1, 4.0 - c));
        (0..598).for_each(|i| join(i, 2, -1.0));
        for p in [0, 1, 598, 599] {
            builder.hold(p);
        }
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(1.0));
        let mut multigrid = Multigrid::down_to(&system, 12).unwrap();
        multigrid.set_positions(&state.positions);
        match multigrid.refill(&a).and_then(|()| multigrid.rebuild(&a)) {
            Err(SetupFailure::CoarseLevel { level, .. }) => level,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!([2.5, 1.2, 0.5].map(level), [1, 2, 3]);
}

/// A factorization that refuses is that of the whole matrix where there is no other level, and of a coarse level below one.
#[test]
fn refusals_are_of_their_level() {
    let (system, state) = row(50);
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(1.0));
    let hierarchy = Hierarchy::<3, 6>::new(&system, 10).unwrap();
    let refused = |level| hierarchy.failure(&a, NotPositiveDefinite { level, node: 0, pivot: None });
    assert!(matches!(refused(0), SetupFailure::Pivot(_)), "{:?}", refused(0));
    assert!(matches!(refused(1), SetupFailure::CoarseLevel { level: 1, .. }), "{:?}", refused(1));
}

/// Made anew for a softer matrix it gives, to the bit, what one gives that is made for that matrix alone.
#[test]
fn nothing_of_a_matrix_is_left_in_the_next() {
    let side = 20;
    let mut builder = SystemBuilder::new();
    for node in 0..side * side {
        let (x, y) = (node % side, node / side);
        builder.particle([x as f64, y as f64, 0.2 * (node as f64).sin()], 1.0);
        let before =
            [(x > 0).then(|| node - 1), (y > 0).then(|| node - side), (x > 0 && y > 0).then(|| node - side - 1)];
        for other in before.into_iter().flatten() {
            builder.spring(other, node, Spring { stiffness: 100.0, rest_length: 0.9, damping: 0.0 });
        }
    }
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let [stiff, soft] =
        [0.1, 0.01].map(|dt| SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(dt)));
    let applied = |matrices: &[&SystemOperator]| {
        let mut multigrid = Multigrid::new(&system).unwrap();
        multigrid.set_positions(&state.positions);
        for a in matrices {
            multigrid.refill(a).and_then(|()| multigrid.rebuild(a)).unwrap();
        }
        assert!(multigrid.levels().len() > 1);
        let r: Vec<f64> = (0..system.dofs().len()).map(|row| (row as f64).sin()).collect();
        let mut z = vec![0.0; r.len()];
        multigrid.apply(&r, &mut z);
        z
    };
    assert_eq!(applied(&[&stiff, &soft]), applied(&[&soft]));
    assert_ne!(applied(&[&stiff]), applied(&[&soft]));
}
