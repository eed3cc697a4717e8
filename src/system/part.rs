//! A system that is one part of a larger one, whose parts are computed by processes of their own.
//!
//! A part has particles of its own, which come first, and *ghosts*: copies of the particles of other parts to which its own
//! have springs. It has every spring that ends in a particle of its own, so one that is cut is in both parts, and each computes
//! it: what own particles get from springs is complete, and nothing about it has to be sent. What ghosts get is not complete and
//! is never used; their positions and velocities come from the parts that own them.
//!
//! The rest of the crate knows of this in three places only: sums and maxima over particles or springs take own particles
//! and the springs that *count* here, and go on to [`Communicator`]; a failure of one part becomes one of all, so that no part waits
//! for another for ever; and positions that were not computed from a solution of the linear system, which has the ghosts in it,
//! are refreshed. A system that is not part of anything passes all of it without a change of its numbers.

use super::System;
use nalgebra::Vector3;
use std::sync::Arc;

/// How the parts of a system speak with each other. Every call is made by all parts, in the same order.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// Replaces every number by its sum over all parts, with the same bits in all of them.
    fn sum(&self, numbers: &mut [f64]);

    /// Replaces every number by the largest of all parts; one that is undefined anywhere may be anything.
    fn largest(&self, numbers: &mut [f64]);

    /// Gives ghosts what the owners of their particles have: one vector for every particle of the part.
    fn refresh(&self, vectors: &mut [Vector3<f64>]);

    /// The number that a particle of this part has in the whole scene.
    fn particle(&self, particle: usize) -> usize;

    /// The number that a spring of this part has in the whole scene.
    fn spring(&self, spring: usize) -> usize;
}

/// What makes a system a part.
#[derive(Debug, Clone)]
pub(super) struct Part {
    own: usize,
    is_damped: bool,
    peers: Arc<dyn Communicator>,
}

impl System {
    /// Makes this a part of a larger system: the first `own` particles are its own, the others ghosts; see [`Communicator`]. All parts
    /// must do so together.
    pub fn into_part(mut self, own: usize, peers: Arc<dyn Communicator>) -> Self {
        let mut damped = [f64::from(u8::from(self.is_damped()))];
        peers.largest(&mut damped);
        self.part = Some(Part { own: own.min(self.particles()), is_damped: damped[0] > 0.0, peers });
        self
    }

    /// Number of own particles, which come first: all, unless this is a part.
    pub fn own_particles(&self) -> usize {
        self.part.as_ref().map_or(self.particles(), |part| part.own)
    }

    /// Whether this is the part that a spring counts in, where each is to count once: that of its first end.
    #[inline]
    pub fn counts(&self, spring: usize) -> bool {
        self.part.as_ref().is_none_or(|part| (self.pairs[spring][0] as usize) < part.own)
    }

    /// Whether any part has damping, where this is one.
    pub(super) fn damping_of_parts(&self) -> Option<bool> {
        self.part.as_ref().map(|part| part.is_damped)
    }

    /// Sums over all parts of sums over own particles and springs that count.
    pub(crate) fn total<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if let Some(part) = &self.part {
            part.peers.sum(&mut numbers);
        }
        numbers
    }

    /// The largest numbers of all parts.
    pub(crate) fn largest<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if let Some(part) = &self.part {
            part.peers.largest(&mut numbers);
        }
        numbers
    }

    /// Gives ghosts what their owners have.
    pub(crate) fn refresh(&self, vectors: &mut [Vector3<f64>]) {
        if let Some(part) = &self.part {
            part.peers.refresh(vectors);
        }
    }

    /// Whom to speak with, where this is a part.
    pub(crate) fn peers(&self) -> Option<&dyn Communicator> {
        self.part.as_ref().map(|part| &*part.peers)
    }
}

#[cfg(test)]
pub(crate) mod tests;
