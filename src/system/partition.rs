//! Partitions of a system among threads and among processes.
//!
//! **Threads.** A [`ThreadPartition`] owns consecutive particles and lists all active springs that end in them, in order; a spring between two
//! partitions is in both. Sums over them have the terms and the order of sequential ones: results have the same bits for any number of threads.
//!
//! **Processes.** A subdomain is a system whose own particles come first, followed by *ghosts*: copies of the particles of other subdomains that its
//! own are joined to. It has every spring that ends in an own particle: forces on own particles are complete, and those on ghosts are never used. Sums
//! and maxima run over own particles and springs and are combined by a [`Communicator`], which does nothing for a system that is not a subdomain.

use super::System;
use nalgebra::Vector3;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Communication between the subdomains of a system. All of them make every call, in the same order.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// Replaces every number by its sum over all subdomains, with the same bits in all of them.
    fn sum(&self, numbers: &mut [f64]);

    /// Replaces every number by its maximum over all subdomains; the result for NaN is unspecified.
    fn largest(&self, numbers: &mut [f64]);

    /// Copies the vectors of particles from their owners to ghosts; one vector for every particle of the subdomain.
    fn halo_exchange(&self, vectors: &mut [Vector3<f64>]);

    /// The index of a particle in the whole scene.
    fn particle(&self, particle: usize) -> usize;

    /// The index of a spring in the whole scene.
    fn spring(&self, spring: usize) -> usize;
}

#[derive(Debug, Clone)]
pub(super) struct Subdomain {
    own: usize,
    is_damped: bool,
    communicator: Arc<dyn Communicator>,
}

impl System {
    /// Makes this system a subdomain whose first `own` particles are its own and the others ghosts; see [`Communicator`]. All subdomains
    /// must call it together.
    pub fn into_part(mut self, own: usize, communicator: Arc<dyn Communicator>) -> Self {
        let mut damped = [f64::from(u8::from(self.is_damped()))];
        communicator.largest(&mut damped);
        self.subdomain = Some(Subdomain { own: own.min(self.particles()), is_damped: damped[0] > 0.0, communicator });
        self
    }

    /// Number of own particles, which come first: all, unless this is a subdomain.
    pub fn own_particles(&self) -> usize {
        self.subdomain.as_ref().map_or(self.particles(), |subdomain| subdomain.own)
    }

    /// True if a spring belongs to this subdomain in sums over all springs: if its first end does.
    #[inline]
    pub fn owns_spring(&self, spring: usize) -> bool {
        self.subdomain.as_ref().is_none_or(|subdomain| (self.pairs[spring][0] as usize) < subdomain.own)
    }

    /// True if any spring that enters the matrices, or any external force, may have damping. Otherwise G is absent.
    pub fn is_damped(&self) -> bool {
        let here = || self.has_external_derivatives() || self.active().any(|(_, _, spring)| spring.damping > 0.0);
        self.subdomain.as_ref().map_or_else(here, |subdomain| subdomain.is_damped)
    }

    pub(crate) fn total<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if let Some(communicator) = self.communicator() {
            communicator.sum(&mut numbers);
        }
        numbers
    }

    pub(crate) fn largest<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if let Some(communicator) = self.communicator() {
            communicator.largest(&mut numbers);
        }
        numbers
    }

    pub(crate) fn halo_exchange(&self, vectors: &mut [Vector3<f64>]) {
        if let Some(communicator) = self.communicator() {
            communicator.halo_exchange(vectors);
        }
    }

    pub(crate) fn communicator(&self) -> Option<&dyn Communicator> {
        self.subdomain.as_ref().map(|subdomain| &*subdomain.communicator)
    }

    /// One partition for each current thread, or fewer where there are few springs, in which about as many springs end; computed once for each number.
    pub(crate) fn all_partitions(&self) -> Arc<[ThreadPartition]> {
        let count = partition_count(self);
        let mut known = self.partitions.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, partitions)) = known.iter().find(|(requested, _)| *requested == count) {
            return partitions.clone();
        }
        let partitions: Arc<[ThreadPartition]> = partition(self, count).into();
        known.push((count, partitions.clone()));
        partitions
    }

    pub(crate) fn thread_partitions(&self) -> Option<Arc<[ThreadPartition]>> {
        (partition_count(self) > 1).then(|| self.all_partitions())
    }
}

/// Springs below which a partition does not pay for its thread.
const LEAST_SPRINGS: usize = 8192;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ThreadPartition {
    pub particles: Range<usize>,
    /// Positions among the active springs, ascending.
    pub springs: Arc<[u32]>,
}

/// The partitions of a system by the number requested. There may be fewer than requested where many springs end in one particle.
#[derive(Debug, Default)]
pub(super) struct PartitionCache(Mutex<Vec<(usize, Arc<[ThreadPartition]>)>>);

/// A clone is empty, as a cloned system may be changed.
impl Clone for PartitionCache {
    fn clone(&self) -> Self {
        Self::default()
    }
}

fn partition_count(system: &System) -> usize {
    (system.active_springs().len() / LEAST_SPRINGS).clamp(1, rayon::current_num_threads())
}

fn partition(system: &System, count: usize) -> Vec<ThreadPartition> {
    let partition = |particles: Range<usize>| {
        let ends_here = |pair: [usize; 2]| pair.iter().any(|end| particles.contains(end));
        let active = (0u32..).zip(system.active());
        // Reserved at once: a growing list fragments memory.
        let mut springs = Vec::with_capacity(system.active_springs().len());
        springs.extend(active.filter(|(_, (_, pair, _))| ends_here(*pair)).map(|(position, _)| position));
        ThreadPartition { particles, springs: springs.into() }
    };
    particle_ranges(system, count).into_iter().map(partition).collect()
}

/// At most `count` ranges of particles in which about as many springs end.
fn particle_ranges(system: &System, count: usize) -> Vec<Range<usize>> {
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
    use super::{LEAST_SPRINGS, partition, partition_count};
    use crate::spring::Spring;
    use crate::system::fixtures::{Cut, in_parts, row};
    use crate::system::{System, SystemBuilder};
    use nalgebra::Vector3;

    const SPRING: Spring = Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 };

    /// One, two, two, two and one springs end in five particles in a row: eight ends.
    #[test]
    fn partitions_are_balanced_and_share_the_springs_between_them() {
        let found = |system: &System, count| {
            let partitions = partition(system, count).into_iter();
            partitions.map(|partition| (partition.particles, partition.springs.to_vec())).collect::<Vec<_>>()
        };
        let (system, state) = row(5);
        assert_eq!(found(&system, 1), [(0..5, vec![0, 1, 2, 3])]);
        assert_eq!(found(&system, 2), [(0..3, vec![0, 1, 2]), (3..5, vec![2, 3])]);
        assert_eq!(found(&system, 3), [(0..2, vec![0, 1]), (2..4, vec![1, 2, 3]), (4..5, vec![3])]);
        // The spring between two held particles is not active: positions count the others.
        let held: Vec<_> = system.dofs().iter().take(6).collect();
        let held = system.with_held(&held, &state.positions);
        assert_eq!(found(&held, 2), [(0..3, vec![0, 1]), (3..5, vec![1, 2])]);
    }

    #[test]
    fn two_partitions_take_twice_the_springs_of_one() {
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for (springs, expected) in [(1, 1), (2 * LEAST_SPRINGS - 1, 1), (2 * LEAST_SPRINGS, 2), (4 * LEAST_SPRINGS, 3)]
        {
            let (system, _) = row(springs + 1);
            let (count, several) = pool(3).install(|| (partition_count(&system), system.thread_partitions()));
            assert_eq!((count, several.map_or(1, |several| several.len())), (expected, expected), "{springs}");
        }
        // A hub is a partition of its own, and there are fewer than requested; they are computed once too.
        let mut builder = SystemBuilder::new();
        let spokes = 6 * LEAST_SPRINGS;
        for i in 0..=spokes {
            builder.particle([i as f64, 0.0, 0.0], 1.0);
        }
        for i in 0..spokes {
            builder.spring(i, spokes, SPRING);
        }
        let (hub, _) = builder.build().unwrap();
        let [first, second] = pool(5).install(|| [hub.all_partitions(), hub.all_partitions()]);
        assert!(first.len() < 5 && std::sync::Arc::ptr_eq(&first, &second), "{}", first.len());
        // One system may be used by any number of threads.
        let (system, _) = row(4 * LEAST_SPRINGS + 1);
        for threads in [2, 3, 2] {
            assert_eq!(pool(threads).install(|| system.all_partitions().len()), threads);
        }
    }

    /// Three particles in a row; the middle one belongs to another subdomain than the others.
    fn three(damping: f64) -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        for x in [0.0, 1.0, 2.5] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        builder.spring(0, 1, SPRING);
        builder.spring(2, 1, Spring { damping, ..SPRING });
        builder
    }

    /// Every particle and every spring belongs to one subdomain, and damping anywhere is damping everywhere.
    #[test]
    fn subdomains_make_up_the_whole() {
        let count = |Cut { system, .. }: Cut| {
            let springs = (0..system.springs().len()).filter(|&spring| system.owns_spring(spring)).count();
            (system.own_particles(), system.particles(), springs, system.is_damped())
        };
        assert_eq!(in_parts(&three(2.0), 2, |p| p % 2, count), [(2, 3, 2, true), (1, 3, 0, true)]);
        let is_damped = |Cut { system, .. }: Cut| system.is_damped();
        assert_eq!(in_parts(&three(2.0), 3, |p| p, is_damped), [true; 3]);
        assert_eq!(in_parts(&three(0.0), 2, |p| p % 2, is_damped), [false; 2]);
    }

    #[test]
    fn ghosts_get_the_vectors_of_their_owners() {
        let exchanged = |Cut { particles, system, .. }: Cut| {
            let mine = |p: usize| Vector3::repeat(if p < system.own_particles() { particles[p] as f64 } else { -1.0 });
            let mut vectors: Vec<_> = (0..system.particles()).map(mine).collect();
            system.halo_exchange(&mut vectors);
            particles.iter().zip(&vectors).all(|(&p, v)| *v == Vector3::repeat(p as f64))
        };
        assert_eq!(in_parts(&three(0.0), 2, |p| p % 2, exchanged), [true, true]);
    }
}
