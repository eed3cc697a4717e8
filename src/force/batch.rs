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

use crate::error::DegenerateSpring;
use crate::spring::Spring;
use crate::system::Moment;
use nalgebra::Vector3;

/// Springs of a batch: its lists are to stay in the fastest cache.
const BATCH: usize = 32;

/// A spring with its number and its ends.
pub(super) type Numbered<'a> = (usize, [usize; 2], &'a Spring);

/// Adds the forces of springs to their ends, compiled for every kind of processor that [`pulp`] tells apart.
pub(super) struct AddForces<'a, I> {
    pub at: &'a Moment<'a>,
    pub springs: I,
    /// The particle that `total` begins with. Ends that it does not hold are left out.
    pub first: usize,
    pub total: &'a mut [Vector3<f64>],
}

impl<'a, I: Iterator<Item = Numbered<'a>>> pulp::NullaryFnOnce for AddForces<'a, I> {
    type Output = Result<(), DegenerateSpring>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { at, mut springs, first, total } = self;
        let mut batch = Batch::new();
        // Successive springs often share their first end: its sum stays in registers until another one comes.
        let mut run = Run { particle: usize::MAX, force: Vector3::zeros() };
        loop {
            let count = batch.gather(at, &mut springs);
            if batch.is_degenerate() {
                return Err(batch.degenerate());
            }
            batch.set_pulls();
            for ((&[i, j], d), pull) in batch.ends.iter().zip(&batch.d).zip(&batch.pull).take(count) {
                if i != run.particle {
                    run.end(first, total);
                    let force = total.get(i.wrapping_sub(first)).copied().unwrap_or_default();
                    run = Run { particle: i, force };
                }
                let f = d * *pull;
                run.force -= f;
                if let Some(total) = total.get_mut(j.wrapping_sub(first)) {
                    *total += f;
                }
            }
            if count < BATCH {
                run.end(first, total);
                return Ok(());
            }
        }
    }
}

/// The end that successive springs share, and its force so far.
struct Run {
    particle: usize,
    force: Vector3<f64>,
}

impl Run {
    /// Puts the sum back, if `total`, the particles from `first` on, holds it.
    #[inline(always)]
    fn end(&self, first: usize, total: &mut [Vector3<f64>]) {
        if let Some(total) = total.get_mut(self.particle.wrapping_sub(first)) {
            *total = self.force;
        }
    }
}

/// The numbers of a batch. What is left of the one before in a batch that is not full does no harm.
struct Batch {
    numbers: [usize; BATCH],
    ends: [[usize; 2]; BATCH],
    d: [Vector3<f64>; BATCH],
    /// l².
    squared: [f64; BATCH],
    /// d·Δv; zero without damping, whatever the velocities are.
    along: [f64; BATCH],
    stiffness: [f64; BATCH],
    rest_length: [f64; BATCH],
    damping: [f64; BATCH],
    /// The tension over the length, in N/m.
    pull: [f64; BATCH],
}

impl Batch {
    #[inline(always)]
    fn new() -> Self {
        let (zeros, ones) = ([0.0; BATCH], [1.0; BATCH]);
        Self {
            numbers: [0; BATCH],
            ends: [[0; 2]; BATCH],
            d: [Vector3::zeros(); BATCH],
            squared: ones,
            along: zeros,
            stiffness: ones,
            rest_length: ones,
            damping: zeros,
            pull: zeros,
        }
    }

    /// Takes the next springs; returns how many there were.
    #[inline(always)]
    fn gather<'a>(&mut self, at: &Moment<'_>, springs: &mut impl Iterator<Item = Numbered<'a>>) -> usize {
        for slot in 0..BATCH {
            let Some((number, [i, j], spring)) = springs.next() else { return slot };
            let d = at.positions[i] - at.positions[j];
            self.numbers[slot] = number;
            self.ends[slot] = [i, j];
            self.d[slot] = d;
            self.squared[slot] = d.norm_squared();
            self.along[slot] =
                if spring.damping > 0.0 { d.dot(&(at.velocities[i] - at.velocities[j])) } else { 0.0 };
            self.stiffness[slot] = spring.stiffness;
            self.rest_length[slot] = spring.rest_length;
            self.damping[slot] = spring.damping;
        }
        BATCH
    }

    /// Whether the ends of any spring coincide. A root is zero where its square is.
    #[inline(always)]
    fn is_degenerate(&self) -> bool {
        self.squared.iter().fold(false, |any, &squared| any | (squared == 0.0))
    }

    /// The first spring whose ends coincide.
    #[cold]
    fn degenerate(&self) -> DegenerateSpring {
        let slot = self.squared.iter().position(|&squared| squared == 0.0).unwrap_or(0);
        DegenerateSpring { spring: self.numbers[slot], pair: self.ends[slot] }
    }

    #[inline(always)]
    fn set_pulls(&mut self) {
        for slot in 0..BATCH {
            let length = self.squared[slot].sqrt();
            let inverse = 1.0 / length;
            let strain = (length - self.rest_length[slot]) / self.rest_length[slot];
            let damped = self.damping[slot] * (self.along[slot] * inverse);
            self.pull[slot] = (self.stiffness[slot] * strain + damped) * inverse;
        }
    }
}
