//! Filling in the values of a system's matrix, particle by particle.
//!
//! The columns of a particle lie together in the values, and every spring that ends in it adds to them. So each particle
//! gathers from its own springs, in the order of the springs: no two particles write to one place, every entry adds up in
//! one order whatever the number of threads, and nothing has to be set to zero first. The price is that both ends of a
//! spring compute its 3×3 block; blocks are read twice, but the second time from cache where the ends are numbered closely.

use super::spring_pattern::{Incidence, SpringPattern};
use crate::operator::{SystemOperator, prefetch};
use nalgebra::Matrix3;
use std::ops::Range;

/// Particles that one thread fills at a stretch.
const STRETCH: usize = 1024;

/// How many incidences ahead of its use a spring's block is asked for.
const AHEAD: usize = 48;

/// What a refill reads.
#[derive(Clone, Copy)]
pub(super) struct Filling<'a> {
    pub springs: &'a SpringPattern,
    pub operator: &'a SystemOperator<'a>,
}

impl Filling<'_> {
    /// Overwrites all values of the matrix.
    pub fn fill_all(&self, values: &mut [f64]) {
        self.fill_range(0..self.operator.system().particles(), values);
    }

    /// Overwrites the columns of some particles, which are what `values` holds.
    fn fill_range(&self, particles: Range<usize>, values: &mut [f64]) {
        let pattern = self.springs.pattern();
        let before = |particle| pattern.values_before(particle) - pattern.values_before(particles.start);
        if particles.len() > STRETCH {
            let middle = particles.start + particles.len() / 2;
            let (left, right) = values.split_at_mut(before(middle));
            let Range { start, end } = particles;
            rayon::join(|| self.fill_range(start..middle, left), || self.fill_range(middle..end, right));
            return;
        }
        for particle in particles.clone() {
            let own = &mut values[before(particle)..before(particle + 1)];
            if self.springs.is_free(particle) {
                self.fill_free(particle, own);
            } else {
                self.fill_any(particle, own);
            }
        }
    }

    /// The columns of a particle when it and its neighbours in them are free along all axes.
    fn fill_free(&self, particle: usize, own: &mut [f64]) {
        let blocks = self.operator.blocks();
        let mass = self.operator.mass_factor() * self.operator.system().masses()[particle];
        // The three columns are 3, 2 and 1 values of the diagonal block, each with the same number of values below.
        let below = (own.len() - 6) / 3;
        let (x, yz) = own.split_at_mut(3 + below);
        let (y, z) = yz.split_at_mut(2 + below);
        let (x_diagonal, x) = x.split_at_mut(3);
        let (y_diagonal, y) = y.split_at_mut(2);
        let (z_diagonal, z) = z.split_at_mut(1);
        let mut diagonal = Matrix3::from_diagonal_element(0.0 + mass);
        for &Incidence { spring, place } in self.springs.incidences(particle) {
            let block = blocks[spring as usize].matrix();
            diagonal += block;
            let Some(offset) = place.offset() else { continue };
            let rows = offset as usize..offset as usize + 3;
            for (column, values) in [&mut *x, &mut *y, &mut *z].into_iter().enumerate() {
                let values = &mut values[rows.clone()];
                if place.is_again() {
                    (0..3).for_each(|row| values[row] -= block[(row, column)]);
                } else {
                    (0..3).for_each(|row| values[row] = 0.0 - block[(row, column)]);
                }
            }
        }
        x_diagonal.copy_from_slice(&[diagonal.m11, diagonal.m21, diagonal.m31]);
        y_diagonal.copy_from_slice(&[diagonal.m22, diagonal.m32]);
        z_diagonal.copy_from_slice(&[diagonal.m33]);
        for ahead in self.springs.incidences_ahead(particle, AHEAD) {
            prefetch(&blocks[ahead.spring as usize]);
        }
    }

    /// The columns of any particle.
    fn fill_any(&self, particle: usize, own: &mut [f64]) {
        let system = self.operator.system();
        let free = system.dofs().free_axes(particle);
        let columns = free.count();
        let mass = self.operator.mass_factor() * system.masses()[particle];
        own.fill(0.0);
        let mut diagonal = Matrix3::from_diagonal_element(0.0 + mass);
        let below = own.len().saturating_sub(columns * (columns + 1) / 2) / columns.max(1);
        let start = |column: usize| (0..column).map(|c| columns - c + below).sum::<usize>();
        for &Incidence { spring, place } in self.springs.incidences(particle) {
            let block = self.operator.blocks()[spring as usize].matrix();
            diagonal += block;
            let Some(offset) = place.offset() else { continue };
            let [i, j] = system.pair(system.active_springs()[spring as usize] as usize);
            let row_axes = system.dofs().free_axes(i.max(j));
            for (column, c) in free.iter().enumerate() {
                let values = &mut own[start(column) + columns - column + offset as usize..];
                for (value, r) in values.iter_mut().zip(row_axes.iter()) {
                    *value -= block[(r, c)];
                }
            }
        }
        for (column, c) in free.iter().enumerate() {
            for (value, r) in own[start(column)..].iter_mut().zip(free.iter().skip(column)) {
                *value = diagonal[(r, c)];
            }
        }
    }
}
