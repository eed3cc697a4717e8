//! Sparse matrices of equal blocks, by rows.

use super::block::{Block, Real, zero};
use crate::error::{Invalid, Result};
use crate::operator::group;
use std::ops::Range;
use std::sync::Arc;

/// Rows between the use of a block and its prefetching: 16 of 3 × 3 numbers, fewer of larger blocks, which have to stay in the nearest cache. From
/// 10⁵ particles on a sweep takes 0.7 of its time by that; 8 to 64 rows hardly differ.
pub(super) const fn ahead<T>() -> usize {
    576 / size_of::<T>() + 1
}

/// The sparsity pattern: columns ascending within each row.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    starts: Vec<usize>,
    columns: Vec<u32>,
}

impl Pattern {
    /// Builds row by row: `row(i, columns)` appends the columns of row i, in any order, without repeats.
    pub fn build(rows: usize, mut row: impl FnMut(usize, &mut Vec<u32>)) -> Result<Self> {
        let mut starts = Vec::with_capacity(rows + 1);
        let mut columns = Vec::new();
        starts.push(0);
        for i in 0..rows {
            let from = columns.len();
            row(i, &mut columns);
            columns[from..].sort_unstable();
            starts.push(columns.len());
        }
        if columns.len() > u32::MAX as usize {
            let rule = "more matrix blocks than 32-bit indices can count";
            return Err(Invalid::new("pairs", format!("{} blocks", columns.len()), rule).into());
        }
        columns.shrink_to_fit();
        Ok(Self { starts, columns })
    }

    /// As [`build`](Self::build), with every column below `columns` that `listed` has for a row, once.
    pub fn union<L: Iterator<Item = u32>>(rows: usize, columns: usize, listed: impl Fn(usize) -> L) -> Result<Self> {
        let mut last_seen = vec![u32::MAX; columns];
        Self::build(rows, |row, united| {
            let is_new = |&column: &u32| std::mem::replace(&mut last_seen[column as usize], row as u32) != row as u32;
            united.extend(listed(row).filter(is_new));
        })
    }

    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn blocks(&self) -> usize {
        self.columns.len()
    }

    /// Positions of a row's blocks; an empty range at the end for the row after the last.
    #[inline(always)]
    pub fn row(&self, row: usize) -> Range<usize> {
        let start = self.starts[row];
        start..self.starts.get(row + 1).copied().unwrap_or(start)
    }

    /// The values of a row; none for rows out of range.
    #[inline(always)]
    pub fn values_of<'v, T>(&self, values: &'v [T], row: usize) -> &'v [T] {
        if row < self.rows() { &values[self.row(row)] } else { &[] }
    }

    pub fn positions(&self, rows: &Range<usize>) -> Range<usize> {
        self.starts[rows.start]..self.starts[rows.end]
    }

    #[inline(always)]
    pub fn columns(&self, row: usize) -> &[u32] {
        &self.columns[self.row(row)]
    }

    pub fn transpose(&self, columns: usize) -> Transpose {
        let of_row = |row| self.row(row).map(move |at| (self.columns[at] as usize, (row as u32, at as u32)));
        let (starts, entries) = group(columns, || (0..self.rows()).flat_map(of_row));
        Transpose { starts, entries }
    }
}

/// The blocks of every column of a [`Pattern`] as (row, position), rows ascending.
#[derive(Debug, Clone)]
pub(super) struct Transpose {
    starts: Vec<usize>,
    pub entries: Vec<(u32, u32)>,
}

impl Transpose {
    /// The range of a column's blocks among the entries.
    #[inline(always)]
    pub fn column(&self, column: usize) -> Range<usize> {
        self.starts[column]..self.starts[column + 1]
    }

    #[inline(always)]
    pub fn column_within(&self, column: usize, rows: Range<usize>) -> Range<usize> {
        let Range { start, end } = self.column(column);
        let entries = &self.entries[start..end];
        let before = |row: usize| entries.partition_point(|&(r, _)| (r as usize) < row);
        start + before(rows.start)..start + before(rows.end)
    }
}

/// A symmetric matrix whose blocks can be visited row by row, in double precision.
pub(super) trait Rows<const N: usize>: Sync {
    fn pattern(&self) -> &Pattern;

    /// Calls `visit(column, block)` for every block of a row, by ascending columns but for the diagonal block.
    fn visit(&self, row: usize, visit: impl FnMut(usize, &Block<N, N>));

    #[inline(always)]
    fn diagonal_block(&self, row: usize) -> Block<N, N> {
        let mut diagonal = zero();
        self.visit(
            row,
            #[inline(always)]
            |column, block| {
                if column == row {
                    diagonal = *block;
                }
            },
        );
        diagonal
    }
}

#[derive(Debug, Clone)]
pub(super) struct BlockMatrix<const R: usize, const C: usize, T = f64> {
    pub pattern: Arc<Pattern>,
    pub values: Vec<Block<R, C, T>>,
}

impl<const R: usize, const C: usize, T: Real> BlockMatrix<R, C, T> {
    pub fn zeros(pattern: Arc<Pattern>) -> Self {
        let values = vec![zero(); pattern.blocks()];
        Self { pattern, values }
    }

    #[inline(always)]
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &Block<R, C, T>)> {
        let range = self.pattern.row(row);
        let columns = &self.pattern.columns[range.clone()];
        columns.iter().map(|&column| column as usize).zip(&self.values[range])
    }
}

impl<const N: usize> Rows<N> for BlockMatrix<N, N> {
    fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    #[inline(always)]
    fn visit(&self, row: usize, mut visit: impl FnMut(usize, &Block<N, N>)) {
        for (column, block) in self.row(row) {
            visit(column, block);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Pattern;

    /// Rows [1, 2], none, [0, 1].
    #[test]
    fn transposes_have_the_rows_of_every_column() {
        let columns: [&[u32]; 3] = [&[2, 1], &[], &[0, 1]];
        let pattern = Pattern::build(3, |row, into| into.extend(columns[row])).unwrap();
        assert_eq!((pattern.rows(), pattern.blocks()), (3, 4));
        assert_eq!([0, 1, 2].map(|row| pattern.columns(row)), [&[1, 2][..], &[], &[0, 1]]);
        assert_eq!(([0, 1, 2, 3].map(|row| pattern.row(row))), [0..2, 2..2, 2..4, 4..4]);
        assert_eq!([0..1, 0..3, 1..3, 2..2].map(|rows| pattern.positions(&rows)), [0..2, 0..4, 2..4, 2..2]);
        let transpose = pattern.transpose(4);
        let entries = [0, 1, 2, 3].map(|column| transpose.entries[transpose.column(column)].to_vec());
        assert_eq!(entries, [vec![(2, 2)], vec![(0, 0), (2, 3)], vec![(0, 1)], vec![]]);
        assert_eq!(transpose.entries[2], (2, 3));
        let within = [0..3, 1..3, 0..2, 1..2].map(|rows| transpose.column_within(1, rows));
        assert_eq!(within, [1..3, 2..3, 1..2, 2..2]);
    }
}
