//! Forces between the ends of springs, added up particle by particle.

use super::accumulator::Run;
use super::{SpringGeometry, has_only_active};
use crate::spring::{Extension, Spring};
use crate::system::{System, ThreadPartition};
use nalgebra::Vector3;

/// A force on end i of a spring with ends (i, j), or none.
pub(super) trait PairForce: Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>> + Sync {}

impl<F: Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>> + Sync> PairForce for F {}

/// Adds to `total` the force on end i of every active spring and its opposite on end j.
pub(super) fn add(system: &System, extensions: &SpringGeometry, total: &mut [Vector3<f64>], force: &impl PairForce) {
    if let Some(shares) = system.thread_partitions() {
        return add_shares(system, extensions, &shares, total, force);
    }
    if has_only_active(system) && !system.has_spring_law() {
        // Nothing is looked up that stands in order.
        let springs = system.pairs().iter().copied().zip(system.springs());
        let springs = springs.zip(extensions.iter()).map(|((pair, spring), at)| (pair, spring, at));
        return add_each(springs, 0, total, force);
    }
    let springs = system.active_springs().iter().enumerate();
    let springs = springs.map(|(position, &number)| placed(system, extensions, position, number));
    add_each(springs, 0, total, force);
}

/// A spring with its ends and its extension.
type Placed<'a> = ([u32; 2], &'a Spring, &'a Extension);

/// The spring of this number, at a position among the active ones.
#[inline(always)]
fn placed<'a>(system: &'a System, extensions: &'a SpringGeometry, position: usize, number: u32) -> Placed<'a> {
    let pair = system.pairs()[number as usize];
    (pair, extensions.spring(system, position), &extensions.as_slice()[position])
}

/// `total` holds the particles from `first` on.
#[inline(always)]
fn add_each<'a>(
    springs: impl Iterator<Item = Placed<'a>>,
    first: usize,
    total: &mut [Vector3<f64>],
    force: &impl PairForce,
) {
    let mut run = Run::new();
    for (pair, spring, at) in springs {
        if let Some(f) = force(spring, pair.map(|end| end as usize), at) {
            run.add(pair, &f, first, total);
        }
    }
    run.end(first, total);
}

/// `total` holds the particles of these shares.
fn add_shares(
    system: &System,
    extensions: &SpringGeometry,
    shares: &[ThreadPartition],
    total: &mut [Vector3<f64>],
    force: &impl PairForce,
) {
    match shares {
        [] => {}
        [ThreadPartition { particles, springs }] => {
            let springs = springs.iter().map(|&position| {
                let number = system.active_springs()[position as usize];
                placed(system, extensions, position as usize, number)
            });
            add_each(springs, particles.start, total, force);
        }
        [first, ..] => {
            let (left, right) = shares.split_at(shares.len() / 2);
            let boundary = right.first().map_or(0, |share| share.particles.start - first.particles.start);
            let (low, high) = total.split_at_mut(boundary);
            rayon::join(
                || add_shares(system, extensions, left, low, force),
                || add_shares(system, extensions, right, high, force),
            );
        }
    }
}
