//! Both triangles of a symmetric matrix by compressed columns, for programs that know nothing of symmetry.

use super::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result};
use crate::memory;
use crate::operator::group;
use rayon::prelude::*;

/// Both triangles by compressed columns, rows ascending in each. All numbers are below 2³¹, so that they are valid as signed ones too.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeColumns {
    /// The first entry of each column, and the number of entries.
    pub starts: Vec<u32>,
    /// The row of every entry.
    pub rows: Vec<u32>,
    /// The value of every entry.
    pub values: Vec<f64>,
}

/// The positions of the entries of both triangles, for all matrices on a pattern.
#[derive(Debug, Clone)]
pub struct WholePattern {
    /// As in [`WholeColumns`].
    pub starts: Vec<u32>,
    /// As in [`WholeColumns`].
    pub rows: Vec<u32>,
    /// The stored value of every entry.
    stored: Vec<u32>,
}

impl WholePattern {
    /// Completes a pattern.
    ///
    /// # Errors
    /// [`Error::TooLarge`] for 2³¹ entries or more, or where the memory is too small.
    pub fn of(pattern: &BlockPattern) -> Result<Self> {
        let (symbolic, order) = (pattern.symbolic(), pattern.order());
        let entries = 2 * pattern.entries() as u64 - order as u64;
        ensure_indexable(entries)?;
        memory::ensure(16 * entries + 8 * order as u64, WHAT)?;
        let column = |c| symbolic.col_range(c).map(move |at| (c, symbolic.row_idx()[at] as usize, at as u32));
        let lower = || (0..order).flat_map(column);
        // Column c is row c of the lower triangle up to the diagonal, then its column c: rows ascend.
        let above = || lower().filter(|(column, row, _)| column != row);
        let rows = || above().map(|(c, r, _)| (r, c as u32)).chain(lower().map(|(c, r, _)| (c, r as u32)));
        let stored = || above().map(|(_, r, at)| (r, at)).chain(lower().map(|(c, _, at)| (c, at)));
        let (starts, rows) = group(order, rows);
        let (_, stored) = group(order, stored);
        Ok(Self { starts: starts.into_iter().map(|start| start as u32).collect(), rows, stored })
    }

    /// The values of a matrix on the pattern.
    pub fn values(&self, matrix: &SymmetricMatrix) -> Vec<f64> {
        let mut values = vec![0.0; self.rows.len()];
        self.fill(matrix, &mut values);
        values
    }

    /// Writes the values of a matrix on the pattern, one for each entry; in parallel.
    pub fn fill(&self, matrix: &SymmetricMatrix, values: &mut [f64]) {
        let stored = self.stored.par_iter().with_min_len(16_384);
        values.par_iter_mut().zip(stored).for_each(|(value, &at)| *value = matrix.values()[at as usize]);
    }
}

const WHAT: &str = "both triangles of a matrix";

/// Checks that indices of 31 bits can count the entries, each with an index of four bytes and a value of eight.
fn ensure_indexable(entries: u64) -> Result<()> {
    const MOST: u64 = i32::MAX as u64;
    if entries <= MOST { Ok(()) } else { Err(Error::TooLarge { what: WHAT, bytes: 12 * entries, room: 12 * MOST }) }
}

impl SymmetricMatrix {
    /// Both triangles.
    ///
    /// # Errors
    /// As for [`WholePattern::of`].
    pub fn whole_columns(&self) -> Result<WholeColumns> {
        let pattern = WholePattern::of(self.pattern())?;
        let values = pattern.values(self);
        Ok(WholeColumns { starts: pattern.starts, rows: pattern.rows, values })
    }
}

#[cfg(feature = "scene")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::{SpringPattern, SystemMatrix};
    use crate::integrate::StepMatrices;
    use crate::memory::watch::asked;
    use crate::scene::{Kind, builtin};
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;
    use std::sync::Arc;

    /// Entry by entry what nalgebra-sparse makes of all triplets, for scenes with held, planar and no particles.
    #[test]
    fn both_triangles_are_the_sum_of_all_triplets() {
        for kind in Kind::ALL {
            let (system, state) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
            let StepMatrices { a, g, k, .. } = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01).unwrap();
            for matrix in [a, g, k] {
                let (whole, csc) = (matrix.whole_columns().unwrap(), matrix.to_csc());
                let wide = |list: &[u32]| list.iter().map(|&entry| entry as usize).collect::<Vec<_>>();
                assert_eq!(wide(&whole.starts), csc.col_offsets(), "{}", kind.name());
                assert_eq!(wide(&whole.rows), csc.row_indices(), "{}", kind.name());
                assert_eq!(whole.values, csc.values(), "{}", kind.name());
                assert_eq!(whole.rows.len(), whole.rows.capacity(), "{}: memory is taken once", kind.name());
            }
        }
    }
    /// Indices of 32 bits with a sign count 2³¹ − 1 entries; one more takes 12 · 2³¹ bytes.
    #[test]
    fn entries_are_as_many_as_indices_count() {
        assert!(ensure_indexable(0).is_ok() && ensure_indexable((1 << 31) - 1).is_ok());
        let Err(Error::TooLarge { bytes, room, .. }) = ensure_indexable(1 << 31) else { panic!("too many") };
        assert_eq!((bytes, room), (12 << 31, (12 << 31) - 12));
        assert!(ensure_indexable(1 << 32).is_err());
    }

    /// Particles along some axes, those next to each other joined by a spring or not.
    fn row(axes: usize, with_springs: bool) -> SpringPattern {
        let mut builder = SystemBuilder { dimension: axes, ..SystemBuilder::new() };
        for p in 0..500 {
            builder.particle([f64::from(p), 0.0, 0.0], 1.0);
        }
        for p in (1..500).filter(|_| with_springs) {
            builder.spring(p - 1, p, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        SpringPattern::of_stiffness(&builder.build().unwrap().0).unwrap()
    }

    /// What is asked for is what is held, and no more than a quarter beside it: of a matrix whose diagonal is most of it, and of one whose neighbours
    /// are.
    #[test]
    fn memory_is_asked_for_as_it_is_taken() {
        for pattern in [row(3, false), row(1, true), row(3, true)].map(Arc::new) {
            let (matrix, bytes) = asked("the matrix", || SystemMatrix::try_zeros(pattern.clone()).unwrap());
            let matrix: &SymmetricMatrix = matrix.matrix();
            assert_eq!(bytes as usize, size_of_val(matrix.values()));
            let (whole, bytes) = asked(WHAT, || WholePattern::of(pattern.pattern()).unwrap());
            let values = whole.values(matrix);
            let lists = [&whole.starts, &whole.rows, &whole.stored].map(|list| size_of_val(&list[..]));
            let held = lists.iter().sum::<usize>() + size_of_val(&values[..]);
            assert!((held..held + held / 4).contains(&(bytes as usize)), "{bytes} {held}");
        }
    }
}
