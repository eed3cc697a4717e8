//! Both triangles of a symmetric matrix by compressed columns: what programs take that know nothing of symmetry.
//!
//! In the whole matrix column c of particle p has the blocks of p with the particles below it, the diagonal block, and the blocks with
//! those above it. The last ones, and the diagonal block from its diagonal on, are column c of the stored triangle as it is. The
//! others are stored transposed, in the columns of the particles below: block (p, q), q < p, starts at one distance behind the diagonal
//! part in each of q's columns, see [`BlockPattern`]. So values are read block by block and written in order, and nothing is searched.

use super::fill::middle;
use super::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result};
use crate::memory;
use crate::parallel::{for_parts, parts};
use std::ops::Range;

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

/// Entries that are not worth a second thread.
const LEAST: usize = 16_384;

/// Where the entries of both triangles are: the same for all matrices on a pattern.
#[derive(Debug, Clone)]
pub struct WholePattern {
    /// As in [`WholeColumns`].
    pub starts: Vec<u32>,
    /// As in [`WholeColumns`].
    pub rows: Vec<u32>,
    /// Of particle p the coupled particles below it, `lower[first[p]..first[p + 1]]`, ascending, each with the distance of the block
    /// in its columns.
    first: Vec<u32>,
    lower: Vec<(u32, u32)>,
}

impl WholePattern {
    /// Of a pattern.
    ///
    /// # Errors
    /// [`Error::TooLarge`] for 2³¹ entries or more, or where the memory is too small.
    pub fn of(pattern: &BlockPattern) -> Result<Self> {
        let (dofs, order) = (pattern.dofs(), pattern.order());
        let entries = 2 * pattern.entries() as u64 - order as u64;
        indexable(entries)?;
        memory::ensure(12 * entries + 8 * order as u64 + 16 * pattern.blocks_below() as u64, WHAT)?;
        let (first, lower) = lower_neighbours(pattern);
        let mut starts = Vec::with_capacity(order + 1);
        let mut rows: Vec<u32> = Vec::with_capacity(entries as usize);
        starts.push(0);
        for particle in 0..dofs.particles() {
            let own = dofs.rows(particle);
            let begin = rows.len();
            let mut extend = |particle: usize| {
                let of = dofs.rows(particle);
                rows.extend(of.start as u32..of.end as u32);
            };
            if !own.is_empty() {
                lower[first[particle] as usize..first[particle + 1] as usize]
                    .iter()
                    .for_each(|&(q, _)| extend(q as usize));
                extend(particle);
                pattern.neighbours_above(particle).for_each(extend);
                starts.push(rows.len() as u32);
            }
            let column = begin..rows.len();
            for _ in own.skip(1) {
                rows.extend_from_within(column.clone());
                starts.push(rows.len() as u32);
            }
        }
        Ok(Self { starts, rows, first, lower })
    }

    /// The values of a matrix on the pattern.
    pub fn values(&self, matrix: &SymmetricMatrix) -> Vec<f64> {
        let mut values = vec![0.0; self.rows.len()];
        self.fill(matrix, &mut values);
        values
    }

    /// Writes the values of a matrix on the pattern to memory of the caller's, one for each entry; in parallel.
    pub fn fill(&self, matrix: &SymmetricMatrix, values: &mut [f64]) {
        let start = |particle: usize| self.starts[matrix.dofs().first_row(particle)] as usize;
        let cut = |particles: &Range<usize>, parts| {
            let middle = middle(matrix.pattern(), particles, parts);
            (middle, start(middle) - start(particles.start))
        };
        let particles = 0..self.first.len() - 1;
        let fill = |particles, values: &mut [f64]| self.fill_particles(matrix, particles, values);
        for_parts(particles, parts(values.len(), LEAST), values, &cut, &fill);
    }

    /// The columns of some particles, whose values begin at the first one.
    fn fill_particles(&self, matrix: &SymmetricMatrix, particles: Range<usize>, values: &mut [f64]) {
        let dofs = matrix.dofs();
        let (pattern, stored) = (matrix.pattern(), matrix.values());
        let mut rest = values;
        for particle in particles {
            let lower = &self.lower[self.first[particle] as usize..self.first[particle + 1] as usize];
            for column in 0..dofs.rows(particle).len() {
                let own = &stored[pattern.column(particle, column)];
                let above = lower.iter().map(|&(q, _)| dofs.rows(q as usize).len()).sum::<usize>() + column;
                let (mine, others) = rest.split_at_mut(above + own.len());
                let (above, below) = mine.split_at_mut(above);
                let blocks = lower.iter().flat_map(|&(q, distance)| {
                    let count = dofs.rows(q as usize).len();
                    let behind = distance as usize + column;
                    (0..count).map(move |r| pattern.column(q as usize, r).start + count - r + behind)
                });
                let diagonal = (0..column).map(|r| pattern.column(particle, r).start + column - r);
                above.iter_mut().zip(blocks.chain(diagonal)).for_each(|(value, at)| *value = stored[at]);
                below.copy_from_slice(own);
                rest = others;
            }
        }
    }
}

/// What memory is asked for.
const WHAT: &str = "both triangles of a matrix";

/// Whether so many entries, each with an index of four bytes and a value of eight, can be counted by such indices.
fn indexable(entries: u64) -> Result<()> {
    const MOST: u64 = i32::MAX as u64;
    if entries <= MOST { Ok(()) } else { Err(Error::TooLarge { what: WHAT, bytes: 12 * entries, room: 12 * MOST }) }
}

/// For every particle the coupled particles below it, with the distances of the blocks.
fn lower_neighbours(pattern: &BlockPattern) -> (Vec<u32>, Vec<(u32, u32)>) {
    let particles = pattern.dofs().particles();
    let mut first = vec![0u32; particles + 1];
    for q in 0..particles {
        pattern.blocks_above(q).iter().for_each(|&(p, _)| first[p as usize + 1] += 1);
    }
    for p in 0..particles {
        first[p + 1] += first[p];
    }
    let mut next = first.clone();
    let mut lower = vec![(0, 0); pattern.blocks_below()];
    for q in 0..particles {
        for &(p, distance) in pattern.blocks_above(q) {
            lower[next[p as usize] as usize] = (q as u32, distance);
            next[p as usize] += 1;
        }
    }
    (first, lower)
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

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::{SymmetricMatrix, WHAT, WholePattern, indexable};
    use crate::assembly::{SpringPattern, SystemMatrix};
    use crate::error::Error;
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
        assert!(indexable(0).is_ok() && indexable((1 << 31) - 1).is_ok());
        let Err(Error::TooLarge { bytes, room, .. }) = indexable(1 << 31) else { panic!("too many") };
        assert_eq!((bytes, room), (12 << 31, (12 << 31) - 12));
        assert!(indexable(1 << 32).is_err());
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

    /// What is asked for is what is held, and no more than a quarter beside it: of a matrix whose diagonal is most of it, and of one
    /// whose neighbours are.
    #[test]
    fn memory_is_asked_for_as_it_is_taken() {
        for pattern in [row(3, false), row(1, true), row(3, true)].map(Arc::new) {
            let (matrix, bytes) = asked("the matrix", || SystemMatrix::try_zeros(pattern.clone()).unwrap());
            let matrix: &SymmetricMatrix = matrix.matrix();
            assert_eq!(bytes as usize, size_of_val(matrix.values()));
            let (whole, bytes) = asked(WHAT, || WholePattern::of(pattern.pattern()).unwrap());
            let values = whole.values(matrix);
            let lists = [&whole.starts, &whole.rows, &whole.first].map(|list| size_of_val(&list[..]));
            let held = lists.iter().sum::<usize>() + size_of_val(&whole.lower[..]) + size_of_val(&values[..]);
            assert!((held..held + held / 4).contains(&(bytes as usize)), "{bytes} {held}");
        }
    }
}
