//! Both triangles of a symmetric matrix by compressed columns: what programs take that know nothing of symmetry.

use super::SymmetricMatrix;
use crate::error::{Error, Result};
use crate::memory;

/// Both triangles by compressed columns, rows ascending in each. All numbers are below 2³¹, so that they serve as signed ones too.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeColumns {
    /// Where each column begins among the entries, and where the last one ends.
    pub starts: Vec<u32>,
    /// The row of every entry.
    pub rows: Vec<u32>,
    /// The value of every entry.
    pub values: Vec<f64>,
}

impl SymmetricMatrix {
    /// Both triangles.
    ///
    /// Columns are gone through in order. An entry (r, c) below the diagonal goes to column c and, mirrored, to column r, whose own
    /// entries come later and lie below: so every column is filled from its top.
    ///
    /// # Errors
    /// [`Error::TooLarge`] for 2³¹ entries or more, or where the memory is too small.
    pub fn whole_columns(&self) -> Result<WholeColumns> {
        let (order, lower) = (self.dofs().len(), self.as_faer());
        let (column_starts, lower_rows, values) = (lower.col_ptr(), lower.row_idx(), lower.val());
        let mut counts = vec![0u64; order];
        for (column, ends) in column_starts.windows(2).enumerate() {
            let rows = &lower_rows[ends[0] as usize..ends[1] as usize];
            counts[column] += rows.len() as u64;
            rows.iter().filter(|&&row| row as usize != column).for_each(|&row| counts[row as usize] += 1);
        }
        let entries: u64 = counts.iter().sum();
        let what = "both triangles of a matrix";
        if entries > i32::MAX as u64 {
            return Err(Error::TooLarge { what, bytes: 12 * entries, room: 12 * i32::MAX as u64 });
        }
        memory::ensure(12 * entries + 8 * order as u64, what)?;
        let mut starts = Vec::with_capacity(order + 1);
        let mut end = 0u32;
        starts.push(end);
        starts.extend(counts.iter().map(|&count| {
            end += count as u32;
            end
        }));
        let mut next: Vec<u32> = starts[..order].to_vec();
        let mut whole = WholeColumns { starts, rows: vec![0; entries as usize], values: vec![0.0; entries as usize] };
        let mut put = |row: usize, column: usize, value: f64| {
            let at = next[column] as usize;
            next[column] += 1;
            whole.rows[at] = row as u32;
            whole.values[at] = value;
        };
        for (column, ends) in column_starts.windows(2).enumerate() {
            let range = ends[0] as usize..ends[1] as usize;
            for (&row, &value) in lower_rows[range.clone()].iter().zip(&values[range]) {
                put(row as usize, column, value);
                if row as usize != column {
                    put(column, row as usize, value);
                }
            }
        }
        Ok(whole)
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use crate::integrate::StepMatrices;
    use crate::scene::{Kind, builtin};
    use crate::spring::Stiffness;

    /// Entry by entry what nalgebra-sparse makes of all triplets, for scenes with held, planar and no particles.
    #[test]
    fn both_triangles_are_the_sum_of_all_triplets() {
        for kind in Kind::ALL {
            let (system, state) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
            let StepMatrices { a, m, g, k, .. } =
                StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01).unwrap();
            for matrix in [a, m, g, k] {
                let (whole, csc) = (matrix.whole_columns().unwrap(), matrix.to_csc());
                let wide = |list: &[u32]| list.iter().map(|&entry| entry as usize).collect::<Vec<_>>();
                assert_eq!(wide(&whole.starts), csc.col_offsets(), "{}", kind.name());
                assert_eq!(wide(&whole.rows), csc.row_indices(), "{}", kind.name());
                assert_eq!(whole.values, csc.values(), "{}", kind.name());
            }
        }
    }
}
