//! Systems and matrices that several tests of this module use.

/// Only tests on ready scenes need these.
#[cfg(feature = "scene")]
mod chains;

#[cfg(feature = "scene")]
pub use chains::{chain, operator, right_hand_side};

use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::system::DofMap;
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
