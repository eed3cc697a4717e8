//! Springs by the batch, for processors that compute on several numbers at once.
//!
//! A spring needs a root and two divisions, for which a processor that takes its springs one by one waits most of the time. So a
//! batch goes through three loops: the first gathers what its springs need from their ends into lists of numbers, the second computes
//! the tensions of all of them, list by list and without a branch, and the third adds the forces to the ends, in the order of
//! the springs. Every number is computed as it would be for one spring alone, and every particle gets its forces in the
//! springs' order: the result does not depend on where batches begin.
//!
//! With `d = x_i − x_j` and `l = ‖d‖` the force on end i is
//!
//! ```text
//! −d (k (l − l0)/l0 + b (d·Δv)/l)/l.
//! ```

use super::accumulator::Run;
use crate::spring::Spring;
use crate::system::StateView;
use nalgebra::Vector3;

/// Springs of a batch: its lists are to stay in the fastest cache.
pub(crate) const BATCH: usize = 32;

/// One number for every spring of a batch.
pub(crate) type List = [f64; BATCH];

/// A spring with its ends.
pub(crate) type Ends<'a> = ([u32; 2], &'a Spring);

/// Adds the forces of springs to their ends, compiled for every kind of processor that [`pulp`] tells apart.
pub(super) struct AddForces<'a, I> {
    pub at: &'a StateView<'a>,
    pub springs: I,
    /// The particle that `total` begins with. Ends that it does not hold are left out.
    pub first: usize,
    pub total: &'a mut [Vector3<f64>],
}

impl<'a, I: Iterator<Item = Ends<'a>>> pulp::NullaryFnOnce for AddForces<'a, I> {
    type Output = Result<(), Coincident>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { at, mut springs, first, total } = self;
        let (mut batch, mut run) = (Batch::new(), Run::new());
        loop {
            let count = batch.gather::<false>(at, &mut springs);
            batch.set_pulls()?;
            batch.add_forces(count, first, total, &mut run);
            if count < BATCH {
                run.end(first, total);
                return Ok(());
            }
        }
    }
}

/// Some spring has ends that coincide.
pub(crate) struct Coincident;

/// The numbers of a batch. What is left of the one before in a batch that is not full does no harm to forces.
pub(crate) struct Batch {
    ends: [[u32; 2]; BATCH],
    d: [Vector3<f64>; BATCH],
    squared: List,
    /// d·Δv where there is damping, whatever velocities are where there is none.
    along: List,
    stiffness: List,
    damping: List,
    /// The tension over the length, in N/m.
    pull: List,
    pub rest_length: List,
    pub length: List,
    /// 1/l.
    pub inverse: List,
    /// d·Δv of all springs, where it is asked for.
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

    /// Takes the next springs, with all that their velocities say where that is `WATCHED`; returns how many there were.
    #[inline(always)]
    pub fn gather<'a, const WATCHED: bool>(
        &mut self,
        at: &StateView<'_>,
        springs: &mut impl Iterator<Item = Ends<'a>>,
    ) -> usize {
        let (mut from, mut xi, mut vi) = (u32::MAX, Vector3::zeros(), Vector3::zeros());
        for slot in 0..BATCH {
            let Some(([i, j], spring)) = springs.next() else { return slot };
            if i != from {
                (from, xi, vi) = (i, at.positions[i as usize], at.velocities[i as usize]);
            }
            let d = xi - at.positions[j as usize];
            let is_damped = spring.damping > 0.0;
            self.ends[slot] = [i, j];
            self.d[slot] = d;
            self.squared[slot] = d.norm_squared();
            if WATCHED {
                let v = vi - at.velocities[j as usize];
                self.product[slot] = d.dot(&v);
                self.along[slot] = if is_damped { self.product[slot] } else { 0.0 };
            } else {
                self.along[slot] = if is_damped { d.dot(&(vi - at.velocities[j as usize])) } else { 0.0 };
            }
            self.stiffness[slot] = spring.stiffness;
            self.rest_length[slot] = spring.rest_length;
            self.damping[slot] = spring.damping;
        }
        BATCH
    }

    /// Computes lengths and tensions. A root is zero where its square is.
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

    /// Adds the forces of the first `count` springs to those of their ends that `total`, the particles from `first` on, holds.
    #[inline(always)]
    pub fn add_forces(&self, count: usize, first: usize, total: &mut [Vector3<f64>], run: &mut Run) {
        for ((&ends, d), pull) in self.ends.iter().zip(&self.d).zip(&self.pull).take(count) {
            run.add(ends, &(d * -pull), first, total);
        }
    }
}
