//! The sparsity pattern of a symmetric matrix of particle blocks, and the slots of its blocks.
//!
//! Rows are numbered by particle, then axis. In the columns of particle j the lower triangle holds first the diagonal block's part, then the blocks
//! of the coupled particles i > j in ascending order. Block (i, j) therefore starts at the same distance behind the diagonal part in each of j's
//! columns: this one number is its slot.

use crate::error::{Invalid, Result};
use crate::operator::group;
use crate::parallel::share;
use crate::system::DofMap;
use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};
use std::ops::Range;

/// The position of a pair's block in the values of a [`SymmetricMatrix`](super::SymmetricMatrix).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockSlot {
    pub(super) row: u32,
    pub(super) column: u32,
    pub(super) offset: u32,
    /// The pair was given as (column, row): its block is stored transposed.
    pub(super) transposed: bool,
}

/// Sparsity pattern (lower triangle, compressed columns) over the free degrees of freedom.
#[derive(Debug, Clone)]
pub struct BlockPattern {
    dofs: DofMap,
    symbolic: SymbolicSparseColMat<u32>,
    /// Coupled particles below the diagonal: neighbours[starts[j]..starts[j + 1]] is ascending and above j, each with its offset.
    starts: Vec<u32>,
    neighbours: Vec<(u32, u32)>,
}

impl BlockPattern {
    /// The pattern with every particle's diagonal block and the blocks of the given pairs, in any order and orientation, repeats allowed.
    ///
    /// # Errors
    /// A pair that names a particle out of range or joins one to itself; more entries than 32-bit indices can count.
    pub fn new(dofs: &DofMap, pairs: impl Iterator<Item = [usize; 2]> + Clone) -> Result<Self> {
        let particles = dofs.particles();
        for (index, [i, j]) in pairs.clone().enumerate() {
            if i.max(j) >= particles || i == j {
                let rule = format!("must join two different particles below {particles}");
                return Err(Invalid::new("pairs", format!("[{i}, {j}]"), rule).at(index).into());
            }
        }
        let (starts, mut neighbours) = adjacency_below(particles, pairs);
        let entries = set_offsets(dofs, &starts, &mut neighbours);
        if entries > u32::MAX as u64 {
            let rule = "more matrix entries than 32-bit indices can count";
            return Err(Invalid::new("pairs", format!("{entries} entries"), rule).into());
        }
        let symbolic = compressed_columns(dofs, &starts, &neighbours, entries as usize);
        Ok(Self { dofs: dofs.clone(), symbolic, starts, neighbours })
    }

    /// The map between (particle, axis) and rows.
    pub fn dofs(&self) -> &DofMap {
        &self.dofs
    }

    /// The pattern as faer's type.
    pub fn symbolic(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.symbolic.as_ref()
    }

    /// The order of the matrix.
    pub fn order(&self) -> usize {
        self.symbolic.nrows()
    }

    /// Number of stored entries.
    pub fn entries(&self) -> usize {
        self.symbolic.row_idx().len()
    }

    /// The slot of block (i, j); `None` when the pair is not in the pattern.
    pub fn slot(&self, i: usize, j: usize) -> Option<BlockSlot> {
        let (row, column) = (i.max(j) as u32, i.min(j));
        let above = self.neighbours.get(*self.starts.get(column)? as usize..*self.starts.get(column + 1)? as usize)?;
        let (_, offset) = above[above.binary_search_by_key(&row, |&(particle, _)| particle).ok()?];
        Some(BlockSlot { row, column: column as u32, offset, transposed: i < j })
    }

    /// The particles of higher number that a particle is coupled to, ascending.
    pub fn neighbours_above(&self, particle: usize) -> impl Iterator<Item = usize> + '_ {
        let range = self.starts[particle] as usize..self.starts[particle + 1] as usize;
        self.neighbours[range].iter().map(|&(neighbour, _)| neighbour as usize)
    }

    /// Number of values in the columns of the particles before this one.
    #[inline]
    pub(super) fn values_before(&self, particle: usize) -> usize {
        self.symbolic.col_ptr()[self.dofs.first_row(particle)] as usize
    }

    /// The cut of some particles that gives each of so many parts as many values.
    pub(super) fn middle(&self, particles: &Range<usize>, parts: usize) -> usize {
        let [first, last] = [particles.start, particles.end].map(|particle| self.values_before(particle));
        let wanted = first + share(last - first, parts / 2, parts);
        let (mut low, mut high) = (particles.start, particles.end);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.values_before(middle) >= wanted { high = middle } else { low = middle + 1 }
        }
        low
    }

    /// Positions of the values in column `local` of a particle.
    #[inline]
    pub(super) fn column(&self, particle: usize, local: usize) -> Range<usize> {
        let column = self.dofs.rows(particle).start + local;
        let pointers = self.symbolic.col_ptr();
        pointers[column] as usize..pointers[column + 1] as usize
    }
}

/// For every particle the coupled particles above it, ascending and without repeats; offsets still zero.
fn adjacency_below(particles: usize, pairs: impl Iterator<Item = [usize; 2]> + Clone) -> (Vec<u32>, Vec<(u32, u32)>) {
    let (counts, mut above) = group(particles, || pairs.clone().map(|[i, j]| (i.min(j), i.max(j) as u32)));
    let mut starts = Vec::with_capacity(particles + 1);
    let mut neighbours: Vec<(u32, u32)> = Vec::with_capacity(above.len());
    starts.push(0);
    for p in 0..particles {
        let own = &mut above[counts[p]..counts[p + 1]];
        own.sort_unstable();
        neighbours.extend(own.chunk_by(|a, b| a == b).map(|repeats| (repeats[0], 0)));
        starts.push(neighbours.len() as u32);
    }
    (starts, neighbours)
}

/// Sets every neighbour's offset behind the diagonal part; returns the number of entries of the whole pattern.
fn set_offsets(dofs: &DofMap, starts: &[u32], neighbours: &mut [(u32, u32)]) -> u64 {
    let mut entries = 0u64;
    for particle in 0..dofs.particles() {
        let columns = dofs.rows(particle).len();
        let mut offset = 0;
        for (neighbour, at) in &mut neighbours[starts[particle] as usize..starts[particle + 1] as usize] {
            *at = offset;
            offset += dofs.rows(*neighbour as usize).len() as u32;
        }
        entries += (columns * (columns + 1) / 2) as u64 + columns as u64 * u64::from(offset);
    }
    entries
}

fn compressed_columns(
    dofs: &DofMap,
    starts: &[u32],
    neighbours: &[(u32, u32)],
    entries: usize,
) -> SymbolicSparseColMat<u32> {
    let mut column_pointers = Vec::with_capacity(dofs.len() + 1);
    let mut row_indices: Vec<u32> = Vec::with_capacity(entries);
    column_pointers.push(0);
    for particle in 0..dofs.particles() {
        let rows = dofs.rows(particle);
        for column in rows.clone() {
            row_indices.extend(column as u32..rows.end as u32);
            for &(neighbour, _) in &neighbours[starts[particle] as usize..starts[particle + 1] as usize] {
                let rows = dofs.rows(neighbour as usize);
                row_indices.extend(rows.start as u32..rows.end as u32);
            }
            column_pointers.push(row_indices.len() as u32);
        }
    }
    SymbolicSparseColMat::new_checked(dofs.len(), dofs.len(), column_pointers, None, row_indices)
}

#[cfg(test)]
mod tests {
    use super::{BlockPattern, set_offsets};
    use crate::{Constraint, Motion, SystemBuilder, system::Axes};

    /// The count rejects systems that are too large before anything of their size is stored.
    #[test]
    fn entries_are_counted_as_they_are_stored() {
        let mut builder = SystemBuilder::new();
        for p in 0..6 {
            builder.particle([f64::from(p), f64::from(p * p), 0.0], 1.0);
        }
        // Three, two, one and no degrees of freedom.
        for (particle, axes) in [(1, Axes::of(&[0])), (2, Axes::of(&[0, 2])), (3, Axes::ALL)] {
            builder.constraints.push(Constraint { particles: vec![particle], axes, motion: Motion::Held });
        }
        let (system, _) = builder.build().unwrap();
        for pairs in [&[][..], &[[0, 1]], &[[0, 1], [2, 0], [0, 3], [1, 2], [4, 5], [5, 1], [1, 0], [2, 4]]] {
            let pattern = BlockPattern::new(system.dofs(), pairs.iter().copied()).unwrap();
            let counted = set_offsets(system.dofs(), &pattern.starts, &mut pattern.neighbours.clone());
            assert_eq!(counted, pattern.entries() as u64, "{pairs:?}");
        }
    }

    #[test]
    fn neighbours_above_are_ascending_and_without_repeats() {
        let pairs = [[3, 1], [1, 2], [4, 1], [1, 3], [0, 4], [4, 2]];
        let pattern = BlockPattern::new(&crate::DofMap::unconstrained(5), pairs.into_iter()).unwrap();
        let above = [0, 1, 2, 3, 4].map(|particle| pattern.neighbours_above(particle).collect::<Vec<_>>());
        assert_eq!(above, [vec![4], vec![2, 3, 4], vec![4], vec![], vec![]]);
    }
}
