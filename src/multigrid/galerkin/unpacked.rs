//! Rows of P in single precision: a section of A P takes each of them many times, and unpacking costs as much as a product.

use super::super::block::{Block, zero};
use super::super::packed::Packed;
use super::super::parallel::{Values, for_each_row_of};
use super::super::sparse::{Pattern, Sparse};
use super::GRAIN;
use std::ops::Range;

/// If sections would have rows unpacked more often than this in the mean, all rows are unpacked at once.
const OFTEN: usize = 3;

/// Which rows each section is to find, of so many, given which it takes.
pub fn windows(taken: Vec<Range<usize>>, rows: usize) -> Vec<Range<usize>> {
    let unpacked: usize = taken.iter().map(Range::len).sum();
    if unpacked <= OFTEN * rows { taken } else { vec![0..rows; taken.len()] }
}

/// Consecutive rows of P.
#[derive(Debug, Clone)]
pub struct Unpacked<const N: usize, const M: usize> {
    rows: Range<usize>,
    blocks: Vec<Block<N, M, f32>>,
}

impl<const N: usize, const M: usize> Unpacked<N, M> {
    /// None yet; with room for any of these rows.
    pub fn new<'w>(p: &Pattern, windows: impl Iterator<Item = &'w Range<usize>>) -> Self {
        let most = windows.map(|rows| p.positions(rows).len()).max().unwrap_or(0);
        Self { rows: 0..0, blocks: vec![zero(); most] }
    }

    /// Forgets what is unpacked: P is another one.
    pub fn forget(&mut self) {
        self.rows = 0..0;
    }

    /// Unpacks these rows, unless they are.
    pub fn unpack(&mut self, p: &Sparse<Packed<N, M>>, rows: &Range<usize>) {
        if self.rows == *rows {
            return;
        }
        self.rows = rows.clone();
        let blocks = &mut self.blocks[..p.pattern.positions(rows).len()];
        for_each_row_of(
            rows.clone(),
            GRAIN,
            Values(&*p.pattern, blocks),
            #[inline(always)]
            |row, blocks| blocks.iter_mut().zip(p.row(row)).for_each(|(block, (_, packed))| *block = packed.unpacked()),
        );
    }

    /// Columns and blocks of one of these rows.
    #[inline(always)]
    pub fn row(&self, p: &Pattern, row: usize) -> impl Iterator<Item = (usize, &Block<N, M, f32>)> {
        let (places, before) = (p.row(row), p.row(self.rows.start).start);
        let blocks = &self.blocks[places.start - before..places.end - before];
        p.columns(row).iter().map(|&column| column as usize).zip(blocks)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.blocks[..])
    }
}

#[cfg(test)]
mod tests {
    use super::{Unpacked, windows};
    use crate::multigrid::packed::Packed;
    use crate::multigrid::sparse::{Pattern, Sparse};
    use std::sync::Arc;

    #[test]
    fn windows_that_overlap_too_much_are_all_rows() {
        let little = vec![0..40, 10..80, 60..100];
        assert_eq!(windows(little.clone(), 100), little);
        assert_eq!(windows(vec![0..90, 5..100, 0..100, 0..20], 100), vec![0..100; 4]);
    }

    #[test]
    fn rows_of_a_window_are_those_of_the_matrix() {
        let pattern = Arc::new(Pattern::build(30, |row, columns| columns.extend(0..row as u32 % 4)).unwrap());
        let mut p = Sparse::filled(pattern.clone(), Packed::<1, 2>::ZERO);
        let mut fill = |factor: f32| {
            for (place, block) in p.values.iter_mut().enumerate() {
                *block = Packed::of(&[[factor * place as f32, 1.0]]);
            }
            p.clone()
        };
        let (first, second) = (fill(1.0), fill(-2.0));
        let mut unpacked = Unpacked::new(&pattern, [0..10, 7..30].iter());
        assert_eq!(unpacked.bytes(), 8 * pattern.positions(&(7..30)).len());
        let mut check = |p: &Sparse<Packed<1, 2>>, rows: std::ops::Range<usize>| {
            unpacked.unpack(p, &rows);
            for row in rows {
                let expected: Vec<_> = p.row(row).map(|(column, block)| (column, block.unpacked())).collect();
                let found: Vec<_> = unpacked.row(&pattern, row).map(|(column, block)| (column, *block)).collect();
                assert_eq!(found, expected, "{row}");
            }
        };
        check(&first, 0..10);
        check(&first, 7..30);
        // Of another matrix once the first is forgotten.
        unpacked.forget();
        unpacked.unpack(&second, &(7..30));
        assert!(second.row(29).map(|(_, block)| block.unpacked()).eq(unpacked.row(&pattern, 29).map(|(_, b)| *b)));
    }
}
