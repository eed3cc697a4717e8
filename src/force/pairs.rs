//! Forces between the ends of springs, added up particle by particle.

use super::Extensions;
use crate::spring::{Extension, Spring};
use crate::system::{Share, System};
use nalgebra::Vector3;

/// A force on end i of a spring with ends (i, j), or none.
pub(super) trait PairForce: Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>> + Sync {}

impl<F: Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>> + Sync> PairForce for F {}

/// Adds to `total` the force on end i of every active spring and its opposite on end j.
pub(super) fn add(system: &System, extensions: &Extensions, total: &mut [Vector3<f64>], force: &impl PairForce) {
    if let Some(shares) = system.several_shares() {
        return add_shares(system, extensions, &shares, total, force);
    }
    for ((_, pair, spring), at) in extensions.springs(system) {
        if let Some(f) = force(spring, pair, at) {
            add_own(total, 0, pair, f);
        }
    }
}

/// `total` holds the particles of these shares.
fn add_shares(
    system: &System,
    extensions: &Extensions,
    shares: &[Share],
    total: &mut [Vector3<f64>],
    force: &impl PairForce,
) {
    match shares {
        [] => {}
        [Share { particles, springs }] => {
            for &position in &**springs {
                let position = position as usize;
                let pair = system.pair(system.active_springs()[position] as usize);
                let spring = extensions.spring(system, position);
                if let Some(f) = force(spring, pair, &extensions.as_slice()[position]) {
                    add_own(total, particles.start, pair, f);
                }
            }
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

/// Adds to the ends of a spring that `total`, the particles from `first` on, holds.
#[inline(always)]
fn add_own(total: &mut [Vector3<f64>], first: usize, [i, j]: [usize; 2], f: Vector3<f64>) {
    if let Some(total) = total.get_mut(i.wrapping_sub(first)) {
        *total += f;
    }
    if let Some(total) = total.get_mut(j.wrapping_sub(first)) {
        *total -= f;
    }
}
