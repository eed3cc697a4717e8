//! Spring forces in vectorized batches.
//!
//! Three loops run over each batch: the first gathers positions, velocities and parameters, the second computes all tensions without a branch, so
//! that square roots and divisions vectorize, and the third adds the forces to the ends in the order of the springs. The operations on each number
//! are those for a single spring, so results do not depend on where batches begin.
//!
//! With `d = x_i − x_j` and `l = ‖d‖` the force on end i is
//!
//! ```text
//! −d (k (l − l0)/l0 + b (d·Δv)/l)/l.
//! ```

use crate::spring::Spring;
use crate::system::StateView;
use nalgebra::Vector3;

/// Springs per batch; its arrays fit the first-level cache.
pub(super) const BATCH: usize = 32;

/// One number for every spring of a batch.
pub(super) type List = [f64; BATCH];
pub(super) type Ends<'a> = ([u32; 2], &'a Spring);

/// Adds the forces of springs to their ends, compiled for every instruction set that [`pulp`] detects.
pub(super) struct AddForces<'a, I> {
    pub at: &'a StateView<'a>,
    pub springs: I,
    /// The first particle of `total`. Ends outside `total` are skipped.
    pub first: usize,
    pub total: &'a mut [Vector3<f64>],
}

impl<'a, I: Iterator<Item = Ends<'a>>> pulp::NullaryFnOnce for AddForces<'a, I> {
    type Output = Result<(), Coincident>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { at, mut springs, first, total } = self;
        let (mut batch, mut accumulator) = (Batch::new(), Accumulator::new());
        loop {
            let count = batch.gather(at, &mut springs);
            batch.set_pulls()?;
            batch.add_forces(count, first, total, &mut accumulator);
            if count < BATCH {
                accumulator.flush(first, total);
                return Ok(());
            }
        }
    }
}

pub(super) struct Coincident;

/// The arrays of a batch. An incomplete batch keeps values of the previous one, which are not used.
pub(super) struct Batch {
    ends: [[u32; 2]; BATCH],
    d: [Vector3<f64>; BATCH],
    squared: List,
    /// d·Δv for damped springs, otherwise zero, so that overflowing velocities do not matter.
    along: List,
    stiffness: List,
    damping: List,
    /// The tension over the length, in N/m.
    pull: List,
    pub rest_length: List,
    pub length: List,
    /// 1/l.
    pub inverse: List,
    /// d·Δv of all springs.
    pub product: List,
}

impl Batch {
    #[inline(always)]
    pub fn new() -> Self {
        let (zeros, ones) = ([0.0; BATCH], [1.0; BATCH]);
        Self {
            ends: [[0; 2]; BATCH],
            d: [Vector3::zeros(); BATCH],
            squared: ones,
            along: zeros,
            stiffness: ones,
            damping: zeros,
            pull: zeros,
            rest_length: ones,
            length: ones,
            inverse: ones,
            product: zeros,
        }
    }

    /// Loads the next springs and returns their number.
    #[inline(always)]
    pub fn gather<'a>(&mut self, at: &StateView<'_>, springs: &mut impl Iterator<Item = Ends<'a>>) -> usize {
        let (mut from, mut xi, mut vi) = (u32::MAX, Vector3::zeros(), Vector3::zeros());
        for slot in 0..BATCH {
            let Some(([i, j], spring)) = springs.next() else { return slot };
            if i != from {
                (from, xi, vi) = (i, at.positions[i as usize], at.velocities[i as usize]);
            }
            let (d, v) = (xi - at.positions[j as usize], vi - at.velocities[j as usize]);
            self.ends[slot] = [i, j];
            self.d[slot] = d;
            self.squared[slot] = d.norm_squared();
            self.product[slot] = d.dot(&v);
            self.along[slot] = if spring.damping > 0.0 { self.product[slot] } else { 0.0 };
            self.stiffness[slot] = spring.stiffness;
            self.rest_length[slot] = spring.rest_length;
            self.damping[slot] = spring.damping;
        }
        BATCH
    }

    /// Computes lengths. The inverse of a length of zero counts as zero.
    #[inline(always)]
    pub fn set_lengths(&mut self) {
        for slot in 0..BATCH {
            let length = self.squared[slot].sqrt();
            self.length[slot] = length;
            self.inverse[slot] = if length > 0.0 { 1.0 / length } else { 0.0 };
        }
    }

    #[inline(always)]
    pub fn set_pulls(&mut self) -> Result<(), Coincident> {
        if self.squared.iter().fold(false, |any, &squared| any | (squared == 0.0)) {
            return Err(Coincident);
        }
        for slot in 0..BATCH {
            let length = self.squared[slot].sqrt();
            let inverse = 1.0 / length;
            let strain = (length - self.rest_length[slot]) / self.rest_length[slot];
            let damped = self.damping[slot] * (self.along[slot] * inverse);
            self.pull[slot] = (self.stiffness[slot] * strain + damped) * inverse;
            self.length[slot] = length;
            self.inverse[slot] = inverse;
        }
        Ok(())
    }

    /// Adds the forces of the first `count` springs to their ends in `total`, the particles from `first` on.
    #[inline(always)]
    pub fn add_forces(&self, count: usize, first: usize, total: &mut [Vector3<f64>], accumulator: &mut Accumulator) {
        for ((&ends, d), pull) in self.ends.iter().zip(&self.d).zip(&self.pull).take(count) {
            accumulator.add(ends, &(d * -pull), first, total);
        }
    }
}

/// Adds spring forces to their ends and keeps the sum of the first end, which successive springs often share, in registers.
pub(super) struct Accumulator {
    particle: u32,
    force: Vector3<f64>,
}

impl Accumulator {
    #[inline(always)]
    pub fn new() -> Self {
        Self { particle: u32::MAX, force: Vector3::zeros() }
    }

    /// Adds f to end i and subtracts it from end j, if they are in `total`, the particles from `first` on.
    #[inline(always)]
    pub fn add(&mut self, [i, j]: [u32; 2], f: &Vector3<f64>, first: usize, total: &mut [Vector3<f64>]) {
        if i != self.particle {
            self.flush(first, total);
            let force = total.get((i as usize).wrapping_sub(first)).copied().unwrap_or_default();
            *self = Self { particle: i, force };
        }
        self.force += f;
        if let Some(total) = total.get_mut((j as usize).wrapping_sub(first)) {
            *total -= f;
        }
    }

    #[inline(always)]
    pub fn flush(&self, first: usize, total: &mut [Vector3<f64>]) {
        if let Some(total) = total.get_mut((self.particle as usize).wrapping_sub(first)) {
            *total = self.force;
        }
    }
}
