//! Sparse matrices of equal blocks, by rows.

use super::block::{Block, Real, zero};
use crate::error::{Invalid, Result};
use std::ops::Range;
use std::sync::Arc;

/// How many rows ahead of their use blocks of a kind are asked for: 16 of 3 × 3 numbers, fewer of larger ones, which would not stay in the nearest cache.
/// From 10⁵ particles on blocks do not come from there: a sweep of Gauss–Seidel takes 0.7 of the time that it takes with what the processor guesses alone,
/// a restriction or prolongation 0.8. From 8 to 64 rows of 3 × 3 numbers hardly differ.
pub(super) const fn ahead<T>() -> usize {
    576 / size_of::<T>() + 1
}

/// Which blocks of a sparse matrix are there: columns ascending within each row.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    starts: Vec<usize>,
    columns: Vec<u32>,
}

impl Pattern {
    /// Row by row: `row(i, columns)` appends the columns of row i, in any order, without repeats.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
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

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.columns.len()
    }

    /// Positions of a row's blocks; for the row after the last, where it would start.
    #[inline(always)]
    pub fn row(&self, row: usize) -> Range<usize> {
        let start = self.starts[row];
        start..self.starts.get(row + 1).copied().unwrap_or(start)
    }

    /// The values of a row among all; none where there is no such row.
    #[inline(always)]
    pub fn values_of<'v, T>(&self, values: &'v [T], row: usize) -> &'v [T] {
        if row < self.rows() { &values[self.row(row)] } else { &[] }
    }

    /// Positions of the blocks of consecutive rows.
    pub fn positions(&self, rows: &Range<usize>) -> Range<usize> {
        self.starts[rows.start]..self.starts[rows.end]
    }

    /// The columns of a row.
    #[inline(always)]
    pub fn columns(&self, row: usize) -> &[u32] {
        &self.columns[self.row(row)]
    }

    /// Rows and positions of the blocks of every column: the transpose, by reference.
    pub fn transpose(&self, columns: usize) -> Transpose {
        let mut starts = vec![0usize; columns + 1];
        for &column in &self.columns {
            starts[column as usize + 1] += 1;
        }
        for column in 0..columns {
            starts[column + 1] += starts[column];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); self.blocks()];
        for row in 0..self.rows() {
            for position in self.row(row) {
                let at = &mut next[self.columns[position] as usize];
                entries[*at] = (row as u32, position as u32);
                *at += 1;
            }
        }
        Transpose { starts, entries }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.columns[..])
    }
}

/// For every column of a [`Pattern`] its blocks as (row, position), rows ascending.
#[derive(Debug, Clone)]
pub(super) struct Transpose {
    starts: Vec<usize>,
    entries: Vec<(u32, u32)>,
}

impl Transpose {
    /// Places of a column's blocks.
    #[inline(always)]
    pub fn column(&self, column: usize) -> Range<usize> {
        self.starts[column]..self.starts[column + 1]
    }

    /// Places of a column's blocks in some rows.
    #[inline(always)]
    pub fn column_within(&self, column: usize, rows: Range<usize>) -> Range<usize> {
        let Range { start, end } = self.column(column);
        let entries = &self.entries[start..end];
        let before = |row: usize| entries.partition_point(|&(r, _)| (r as usize) < row);
        start + before(rows.start)..start + before(rows.end)
    }

    /// Rows and positions of the blocks at some places.
    #[inline(always)]
    pub fn entries(&self, places: Range<usize>) -> &[(u32, u32)] {
        &self.entries[places]
    }

    /// Row and position of the block at a place.
    #[inline(always)]
    pub fn entry(&self, place: usize) -> (u32, u32) {
        self.entries[place]
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.entries[..])
    }
}

/// A symmetric matrix that tells its blocks row by row, in double precision.
pub(super) trait Rows<const N: usize>: Sync {
    /// Which blocks there are.
    fn pattern(&self) -> &Pattern;

    /// Calls `visit(column, block)` for every block of a row: the diagonal one at any time, the others by ascending columns.
    fn visit(&self, row: usize, visit: impl FnMut(usize, &Block<N, N>));
}

/// A sparse matrix of blocks that are kept in some way.
#[derive(Debug, Clone)]
pub(super) struct Sparse<B> {
    pub pattern: Arc<Pattern>,
    pub values: Vec<B>,
}

/// A sparse matrix of R × C blocks.
pub(super) type BlockMatrix<const R: usize, const C: usize, T = f64> = Sparse<Block<R, C, T>>;

impl<const R: usize, const C: usize, T: Real> BlockMatrix<R, C, T> {
    /// The zero matrix on a pattern.
    pub fn zeros(pattern: Arc<Pattern>) -> Self {
        Self::filled(pattern, zero())
    }
}

impl<B: Copy> Sparse<B> {
    /// One block everywhere.
    pub fn filled(pattern: Arc<Pattern>, block: B) -> Self {
        let values = vec![block; pattern.blocks()];
        Self { pattern, values }
    }

    /// Columns and blocks of a row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &B)> {
        let range = self.pattern.row(row);
        let columns = &self.pattern.columns[range.clone()];
        columns.iter().map(|&column| column as usize).zip(&self.values[range])
    }

    /// Bytes held, without the pattern.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.values[..])
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
        let entries = [0, 1, 2, 3].map(|column| transpose.entries(transpose.column(column)).to_vec());
        assert_eq!(entries, [vec![(2, 2)], vec![(0, 0), (2, 3)], vec![(0, 1)], vec![]]);
        assert_eq!(transpose.entry(2), (2, 3));
        let within = [0..3, 1..3, 0..2, 1..2].map(|rows| transpose.column_within(1, rows));
        assert_eq!(within, [1..3, 2..3, 1..2, 2..2]);
        // Offsets are usize, columns u32, entries of the transpose pairs of u32.
        assert_eq!((pattern.bytes(), transpose.bytes()), (4 * 8 + 4 * 4, 5 * 8 + 4 * 8));
    }
}
