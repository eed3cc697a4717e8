//! Particles shared out among threads.
//!
//! Every share owns consecutive particles and knows all active springs that end in it; a spring between two shares is in
//! both. A thread that goes through the springs of a share, in their order, and adds to its own particles only gives
//! every sum over springs the terms and the order that one thread alone would: the result is the same to the bit.

use super::System;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Springs below which a share is not worth a thread.
const LEAST_SPRINGS: usize = 8192;

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ThreadPartition {
    pub particles: Range<usize>,
    /// Positions among the active springs, ascending.
    pub springs: Arc<[u32]>,
}

/// The shares of a system for the numbers of threads that have asked, each made once: how many were asked for, and what there is, which
/// may be less where many springs end in one particle.
#[derive(Debug, Default)]
pub(super) struct ThreadPartitions(Mutex<Vec<(usize, Arc<[ThreadPartition]>)>>);

/// A copy may become another system, and makes its own.
impl Clone for ThreadPartitions {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl System {
    /// All particles, a share for each of the current threads where that pays; about as many springs end in each. The first call
    /// on so many threads allocates.
    pub(crate) fn shares(&self) -> Arc<[ThreadPartition]> {
        let count = count(self);
        let mut known = self.shares.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, shares)) = known.iter().find(|(asked, _)| *asked == count) {
            return shares.clone();
        }
        let shares: Arc<[ThreadPartition]> = shares(self, count).into();
        known.push((count, shares.clone()));
        shares
    }

    /// The shares, where there is more than one.
    pub(crate) fn thread_partitions(&self) -> Option<Arc<[ThreadPartition]>> {
        (count(self) > 1).then(|| self.shares())
    }
}

fn count(system: &System) -> usize {
    let worth = system.active_springs().len() / LEAST_SPRINGS;
    if worth > 1 { worth.min(rayon::current_num_threads()) } else { 1 }
}

fn shares(system: &System, count: usize) -> Vec<ThreadPartition> {
    let share = |particles: Range<usize>| {
        let ends_here = |pair: [usize; 2]| pair.iter().any(|end| particles.contains(end));
        let active = (0u32..).zip(system.active());
        // Room for all: a list that grows leaves holes in the memory.
        let mut springs = Vec::with_capacity(system.active_springs().len());
        springs.extend(active.filter(|(_, (_, pair, _))| ends_here(*pair)).map(|(at, _)| at));
        ThreadPartition { particles, springs: springs.into() }
    };
    cut(system, count).into_iter().map(share).collect()
}

fn cut(system: &System, count: usize) -> Vec<Range<usize>> {
    let mut ends = vec![0u64; system.particles()];
    for (_, pair, _) in system.active() {
        pair.into_iter().for_each(|particle| ends[particle] += 1);
    }
    let total: u64 = ends.iter().sum();
    let mut ranges = Vec::with_capacity(count);
    let (mut start, mut passed) = (0, 0);
    for (particle, &here) in ends.iter().enumerate() {
        passed += here;
        if ranges.len() + 1 < count && passed * count as u64 >= total * (ranges.len() as u64 + 1) {
            ranges.push(start..particle + 1);
            start = particle + 1;
        }
    }
    ranges.push(start..ends.len());
    ranges
}

#[cfg(test)]
mod tests {
    use super::{LEAST_SPRINGS, count, shares};
    use crate::spring::Spring;
    use crate::system::{System, SystemBuilder};

    fn chain(springs: usize, held: &[usize]) -> System {
        let mut builder = SystemBuilder::new();
        for i in 0..=springs {
            builder.particle([i as f64, 0.0, 0.0], 1.0);
        }
        for i in 0..springs {
            builder.spring(i, i + 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        held.iter().for_each(|&particle| _ = builder.hold(particle));
        builder.build().unwrap().0
    }

    /// One, two, two, two and one springs end in five particles in a row: eight ends.
    #[test]
    fn shares_have_about_as_many_ends_each_and_springs_between_two_are_in_both() {
        let found = |system: &System, count| {
            let shares = shares(system, count).into_iter();
            shares.map(|share| (share.particles, share.springs.to_vec())).collect::<Vec<_>>()
        };
        let system = chain(4, &[]);
        assert_eq!(found(&system, 1), [(0..5, vec![0, 1, 2, 3])]);
        assert_eq!(found(&system, 2), [(0..3, vec![0, 1, 2]), (3..5, vec![2, 3])]);
        assert_eq!(found(&system, 3), [(0..2, vec![0, 1]), (2..4, vec![1, 2, 3]), (4..5, vec![3])]);
        // Between the two that are held there is a spring that is not active: positions are among the others.
        let held = chain(4, &[0, 1]);
        assert_eq!(found(&held, 2), [(0..3, vec![0, 1]), (3..5, vec![1, 2])]);
    }

    #[test]
    fn two_shares_take_twice_the_springs_of_one() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        pool.install(|| {
            for (springs, expected) in
                [(1, 1), (2 * LEAST_SPRINGS - 1, 1), (2 * LEAST_SPRINGS, 2), (4 * LEAST_SPRINGS, 3)]
            {
                let system = chain(springs, &[]);
                let several = system.thread_partitions();
                assert_eq!(
                    (count(&system), several.map_or(1, |shares| shares.len())),
                    (expected, expected),
                    "{springs}"
                );
                assert_eq!(system.shares().len(), expected);
            }
        });
        // A hub that comes last is a share of its own, and there are fewer than were asked for; they are made once too.
        let mut builder = SystemBuilder::new();
        let spokes = 6 * LEAST_SPRINGS;
        for i in 0..=spokes {
            builder.particle([i as f64, 0.0, 0.0], 1.0);
        }
        for i in 0..spokes {
            builder.spring(i, spokes, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        let (hub, _) = builder.build().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(5).build().unwrap();
        let [first, second] = pool.install(|| [hub.shares(), hub.shares()]);
        assert!(first.len() < 5 && std::sync::Arc::ptr_eq(&first, &second), "{}", first.len());
        // One system may be asked on any number of threads.
        let system = chain(4 * LEAST_SPRINGS, &[]);
        for threads in [2, 3, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| system.shares().len()), threads);
        }
    }
}
