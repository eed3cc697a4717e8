//! Where the springs of a system put their blocks: the pattern of its matrices and the slot map.

use super::{BlockPattern, BlockSlot};
use crate::error::Result;
use crate::memory;
use crate::system::System;
use std::sync::Arc;

/// A spring as one of its ends sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Incidence {
    /// Its position among the active springs.
    pub spring: u32,
    pub place: Place,
}

/// Where a spring's block goes in the columns of one of its ends, beside the diagonal block, in 32 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place(u32);

impl Place {
    /// Nowhere: this end is the row of the block.
    pub const ROW: Self = Self(u32::MAX);

    /// The values between the diagonal part and the block.
    #[inline]
    pub fn offset(self) -> Option<u32> {
        (self != Self::ROW).then_some(self.0)
    }
}

/// Bytes that the pattern and its making hold at most for a spring and for a particle: the pairs, both ends' neighbours, nine rows of
/// a block, two incidences. Found by lowering the limit on memory until a run failed.
const PATTERN: u64 = 128;

/// The pattern of a system's matrices and, for every particle, its springs and where their blocks go: the slot map.
#[derive(Debug, Clone)]
pub struct SpringPattern {
    pattern: Arc<BlockPattern>,
    /// The springs of particle p are `incidences[starts[p]..starts[p + 1]]`, ascending.
    starts: Vec<u32>,
    incidences: Vec<Incidence>,
}

impl SpringPattern {
    /// The pattern of A and K: every active spring.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_stiffness(system: &System) -> Result<Self> {
        Self::of(system, |_| true)
    }

    /// The pattern of G: damped springs only.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_damping(system: &System) -> Result<Self> {
        Self::of(system, |damping| damping > 0.0)
    }

    fn of(system: &System, enters: impl Fn(f64) -> bool + Copy) -> Result<Self> {
        let rows = system.particles() as u64;
        memory::ensure(PATTERN * (system.active_springs().len() as u64 + rows), "the pattern of the matrix")?;
        let chosen = || (0u32..).zip(system.active()).filter(move |(_, (_, _, spring))| enters(spring.damping));
        // Iterators handed to BlockPattern must be Clone; a list of pairs is, and it is short-lived.
        let pairs: Vec<[usize; 2]> = chosen().map(|(_, (_, pair, _))| pair).collect();
        let pattern = BlockPattern::new(system.dofs(), pairs.iter().copied())?;
        let (starts, mut ends) = row_starts(system.particles(), &pairs);
        let nothing = Incidence { spring: 0, place: Place::ROW };
        let mut incidences = vec![nothing; 2 * pairs.len()];
        for (position, (_, [i, j], _)) in chosen() {
            let Some(BlockSlot { row, column, offset, .. }) = pattern.slot(i, j) else { continue };
            for (particle, place) in [(column, Place(offset)), (row, Place::ROW)] {
                let end = &mut ends[particle as usize];
                incidences[*end as usize] = Incidence { spring: position, place };
                *end += 1;
            }
        }
        Ok(Self { pattern: Arc::new(pattern), starts, incidences })
    }

    /// The springs of a particle.
    #[inline]
    pub(super) fn incidences(&self, particle: usize) -> &[Incidence] {
        &self.incidences[self.starts[particle] as usize..self.starts[particle + 1] as usize]
    }

    /// The positions of a particle's springs among the active ones, ascending.
    pub(crate) fn springs_at(&self, particle: usize) -> impl Iterator<Item = usize> + '_ {
        self.incidences(particle).iter().map(|incidence| incidence.spring as usize)
    }

    /// The pattern of the entries.
    pub fn pattern(&self) -> &BlockPattern {
        &self.pattern
    }

    /// The same pattern, to be shared by matrices.
    pub(super) fn shared_pattern(&self) -> Arc<BlockPattern> {
        self.pattern.clone()
    }
}

/// How often every particle is an end, as running sums; twice, the second for counting up to the next particle's.
fn row_starts(particles: usize, pairs: &[[usize; 2]]) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; particles + 1];
    for end in pairs.iter().flatten() {
        starts[end + 1] += 1;
    }
    for particle in 0..particles {
        starts[particle + 1] += starts[particle];
    }
    let ends = starts.clone();
    (starts, ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::watch::asked;
    use crate::{Spring, SystemBuilder};

    /// Six particles in a ring: every one has two springs.
    fn ring() -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        for p in 0..6 {
            builder.particle([f64::from(p), f64::from(p * p), 0.0], 1.0);
        }
        for p in 0..6 {
            builder.spring(p, (p + 1) % 6, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder
    }

    /// What is asked for covers what is held: 128 bytes for each of six springs and six particles.
    #[test]
    fn memory_is_asked_for_every_spring_and_particle() {
        let (system, _) = ring().build().unwrap();
        let (pattern, bytes) = asked("the pattern of the matrix", || SpringPattern::of_stiffness(&system).unwrap());
        assert_eq!(bytes, 128 * 12);
        let held = size_of_val(&pattern.incidences[..]) + size_of_val(&pattern.starts[..]);
        assert!(held < bytes as usize, "{held}");
    }

    /// Both ends know the spring; a block has its place in the columns of the particle with the lower number.
    #[test]
    fn both_ends_know_a_spring() {
        let (system, _) = ring().build().unwrap();
        let pattern = SpringPattern::of_stiffness(&system).unwrap();
        assert!(pattern.springs_at(3).eq([2, 3]) && pattern.springs_at(0).eq([0, 5]));
        let offsets = |particle: usize| -> Vec<_> {
            pattern.incidences(particle).iter().map(|incidence| incidence.place.offset()).collect()
        };
        assert_eq!([offsets(0), offsets(3), offsets(5)], [[Some(0), Some(3)], [None, Some(0)], [None, None]]);
    }
}
