//! The simple path: block triplets to scalar triplets, sorted, repeats added up in the order given.

use crate::system::{Dof, DofMap};
use nalgebra::Matrix3;

/// A 3×3 block at the rows of one particle and the columns of another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockTriplet {
    /// The particle whose rows the block has.
    pub row: usize,
    /// The particle whose columns the block has.
    pub column: usize,
    /// The block; rows and columns of axes that are not free are dropped.
    pub block: Matrix3<f64>,
}

/// An entry of an assembled matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatrixEntry {
    /// Row.
    pub row: usize,
    /// Column.
    pub column: usize,
    /// Value.
    pub value: f64,
}

/// The entries of the whole matrix (both triangles) by columns, rows ascending, one for every (row, column).
pub fn assemble(dofs: &DofMap, triplets: &[BlockTriplet]) -> Vec<MatrixEntry> {
    let mut entries = Vec::with_capacity(9 * triplets.len());
    for triplet in triplets {
        for c in dofs.free_axes(triplet.column).iter() {
            for r in dofs.free_axes(triplet.row).iter() {
                let row = dofs.row(Dof { particle: triplet.row, axis: r });
                let column = dofs.row(Dof { particle: triplet.column, axis: c });
                if let (Some(row), Some(column)) = (row, column) {
                    entries.push(MatrixEntry { row, column, value: triplet.block[(r, c)] });
                }
            }
        }
    }
    // A stable sort keeps repeats in the order given, which is the order of their sum.
    entries.sort_by_key(|entry| (entry.column, entry.row));
    let mut sums: Vec<MatrixEntry> = Vec::new();
    for entry in entries {
        match sums.last_mut() {
            Some(last) if (last.row, last.column) == (entry.row, entry.column) => last.value += entry.value,
            // Starting from zero, as a refill does, keeps a negative zero from making a difference.
            _ => sums.push(MatrixEntry { value: 0.0 + entry.value, ..entry }),
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::{BlockTriplet, assemble};
    use crate::system::DofMap;
    use nalgebra::Matrix3;

    /// A refill adds to zeros, which makes a negative zero a positive one.
    #[test]
    fn a_negative_zero_is_a_zero() {
        let block = BlockTriplet { row: 0, column: 0, block: Matrix3::repeat(-0.0) };
        let entries = assemble(&DofMap::unconstrained(1), &[block]);
        assert!(entries.len() == 9 && entries.iter().all(|entry| entry.value.to_bits() == 0));
    }
}
