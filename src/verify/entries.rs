//! Entries of sparse matrices, stored or not.

use nalgebra_sparse::CscMatrix;

/// An entry of a sparse matrix, zero where it stores none.
pub(super) fn entry_of(matrix: &CscMatrix<f64>, row: usize, column: usize) -> f64 {
    matrix.get_entry(row, column).map_or(0.0, |entry| entry.into_value())
}

/// Visits the rows that springs couple to a column, stored or not, and those that only the matrix has:
/// (row, stored value or zero, coupled).
pub(super) fn for_each_entry(
    matrix: &CscMatrix<f64>,
    column: usize,
    coupled: &[u32],
    mut visit: impl FnMut(usize, f64, bool),
) {
    let stored = matrix.col(column);
    let mut stored = stored.row_indices().iter().copied().zip(stored.values().iter().copied()).peekable();
    for &row in coupled {
        let row = row as usize;
        while let Some((extra, value)) = stored.next_if(|&(other, _)| other < row) {
            visit(extra, value, false);
        }
        let value = stored.next_if(|&(other, _)| other == row).map_or(0.0, |(_, value)| value);
        visit(row, value, true);
    }
    for (extra, value) in stored {
        visit(extra, value, false);
    }
}

#[cfg(test)]
mod tests {
    use super::entry_of;
    use nalgebra::DMatrix;
    use nalgebra_sparse::CscMatrix;

    #[test]
    fn entries_that_are_not_stored_are_zero() {
        let matrix = CscMatrix::from(&DMatrix::from_row_slice(2, 2, &[3.0, 0.0, -4.0, 5.0]));
        assert_eq!([(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| entry_of(&matrix, r, c)), [3.0, 0.0, -4.0, 5.0]);
    }
}
