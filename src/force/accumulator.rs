//! Forces of one spring after the other, put on their ends.

use nalgebra::Vector3;

/// The end that successive springs often share, and its force so far, which stays in registers until another one comes: the next spring
/// would wait for it to be stored and loaded again.
pub(crate) struct Run {
    particle: u32,
    force: Vector3<f64>,
}

impl Run {
    #[inline(always)]
    pub fn new() -> Self {
        Self { particle: u32::MAX, force: Vector3::zeros() }
    }

    /// Adds f to end i and takes it from end j, if `total`, the particles from `first` on, holds them.
    #[inline(always)]
    pub fn add(&mut self, [i, j]: [u32; 2], f: &Vector3<f64>, first: usize, total: &mut [Vector3<f64>]) {
        if i != self.particle {
            self.end(first, total);
            let force = total.get((i as usize).wrapping_sub(first)).copied().unwrap_or_default();
            *self = Self { particle: i, force };
        }
        self.force += f;
        if let Some(total) = total.get_mut((j as usize).wrapping_sub(first)) {
            *total -= f;
        }
    }

    /// Puts the sum back.
    #[inline(always)]
    pub fn end(&self, first: usize, total: &mut [Vector3<f64>]) {
        if let Some(total) = total.get_mut((self.particle as usize).wrapping_sub(first)) {
            *total = self.force;
        }
    }
}
