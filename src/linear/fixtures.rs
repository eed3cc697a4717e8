//! Systems and matrices that several tests use.

use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::force::SpringGeometry;
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::{DofMap, State, System, SystemBuilder};
use nalgebra::Matrix3;
use std::sync::Arc;

/// The same number between −1 and 1 for (row, column) and (column, row).
pub fn noise(row: usize, column: usize) -> f64 {
    ((row.max(column) * 131 + row.min(column) * 31) as f64).sin()
}

/// A matrix of particle blocks from its entries; particles couple to those of number up to `reach` higher.
pub fn banded(particles: usize, reach: usize, entry: impl Fn(usize, usize) -> f64) -> SymmetricMatrix {
    let pairs: Vec<[usize; 2]> =
        (0..particles).flat_map(|i| (i + 1..particles.min(i + reach + 1)).map(move |j| [j, i])).collect();
    let pattern = BlockPattern::new(&DofMap::unconstrained(particles), pairs.iter().copied()).unwrap();
    let mut a = SymmetricMatrix::zeros(Arc::new(pattern));
    let block = |i: usize, j: usize| Matrix3::from_fn(|r, c| entry(3 * i + r, 3 * j + c));
    (0..particles).for_each(|p| a.add_diagonal_block(p, &block(p, p)));
    for [i, j] in pairs {
        let slot = a.pattern().slot(i, j).unwrap();
        a.add_block(slot, &block(i, j));
    }
    a
}

/// A chain of so many free particles, one end held: over long steps block Jacobi needs about as many iterations.
pub fn chain(particles: usize) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.dimension = 1;
    builder.particle([0.0; 3], 1.0);
    for particle in 1..=particles {
        builder.particle([particle as f64, 0.0, 0.0], 1.0);
        builder.spring(particle - 1, particle, Spring { stiffness: 1e6, rest_length: 1.0, damping: 0.0 });
    }
    builder.hold(0);
    builder.build().unwrap()
}

/// M/dt² − K: nearly a mass for short steps, nearly a stiffness for long ones.
pub fn operator<'s>((system, state): &'s (System, State), dt: f64) -> SystemOperator<'s> {
    let extensions = SpringGeometry::at(system, &state.positions).unwrap();
    SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(dt))
}

/// Numbers between −1 and 1 without a pattern.
pub fn right_hand_side(order: usize) -> Vec<f64> {
    (0..order).map(|row| (row as f64 * 12.9898).sin()).collect()
}
