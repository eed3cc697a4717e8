//! Filling in the values of a system's matrix, particle by particle.
//!
//! The columns of a particle lie together in the values, and every spring that ends in it adds to them. So each particle
//! gathers from its own springs, in the order of the springs: no two particles write to one place, every entry adds up in
//! one order whatever the number of threads. The price is that both ends of a
//! spring compute its 3×3 block; blocks are read twice, but the second time from cache where the ends are numbered closely.

use super::pattern::BlockPattern;
use super::spring_pattern::{Incidence, SpringPattern};
use crate::operator::SystemOperator;
use crate::parallel::{for_parts, parts, share};
use nalgebra::Matrix3;
use std::ops::Range;

/// Values that are not worth a second thread.
const LEAST: usize = 16_384;

/// What a refill reads.
#[derive(Clone, Copy)]
pub(super) struct Filling<'a> {
    pub springs: &'a SpringPattern,
    pub operator: &'a SystemOperator<'a>,
}

impl Filling<'_> {
    /// Overwrites all values of the matrix.
    pub fn fill_all(&self, values: &mut [f64]) {
        let pattern = self.springs.pattern();
        let cut = |particles: &Range<usize>, parts| {
            let middle = middle(pattern, particles, parts);
            (middle, pattern.values_before(middle) - pattern.values_before(particles.start))
        };
        let particles = 0..self.operator.system().particles();
        for_parts(particles, parts(values.len(), LEAST), values, &cut, &|particles, values| {
            self.fill(particles, values)
        });
    }

    /// Overwrites the columns of some particles, which are what `values` holds.
    fn fill(&self, particles: Range<usize>, values: &mut [f64]) {
        let pattern = self.springs.pattern();
        let mut rest = values;
        for particle in particles {
            let (own, others) =
                rest.split_at_mut(pattern.values_before(particle + 1) - pattern.values_before(particle));
            self.fill_particle(particle, own);
            self.add_external(particle, own);
            rest = others;
        }
    }

    /// Adds the derivatives of forces from outside to the diagonal block.
    fn add_external(&self, particle: usize, own: &mut [f64]) {
        let Some(block) = self.operator.external().get(particle) else { return };
        let (pattern, free) = (self.springs.pattern(), self.operator.system().dofs().free_axes(particle));
        for (column, c) in free.iter().enumerate() {
            let start = pattern.column(particle, column).start - pattern.values_before(particle);
            for (value, r) in own[start..].iter_mut().zip(free.iter().skip(column)) {
                *value += block[(r, c)];
            }
        }
    }

    /// Overwrites the columns of a particle.
    fn fill_particle(&self, particle: usize, own: &mut [f64]) {
        let system = self.operator.system();
        let (pattern, free) = (self.springs.pattern(), system.dofs().free_axes(particle));
        let columns = free.count();
        let mass = self.operator.mass_factor() * system.masses()[particle];
        own.fill(0.0);
        let mut diagonal = Matrix3::from_diagonal_element(0.0 + mass);
        let start = |column: usize| pattern.column(particle, column).start - pattern.values_before(particle);
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

/// Where some particles are cut, so that each of so many parts gets as many values.
pub(super) fn middle(pattern: &BlockPattern, particles: &Range<usize>, parts: usize) -> usize {
    let values = pattern.values_before(particles.end) - pattern.values_before(particles.start);
    pattern.particle_with(particles.clone(), share(values, parts / 2, parts))
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::*;
    use crate::scene::builtin::{cloth, lattice, network};

    /// Values that one to sixteen threads write, counted as they are cut: none has more than a tenth above the mean.
    #[test]
    fn threads_fill_as_many_values_each() {
        for scene in [cloth(60), lattice(14), network(3000, 3)] {
            let (system, _) = scene.unwrap().build().unwrap();
            let springs = SpringPattern::of_stiffness(&system).unwrap();
            let pattern = springs.pattern();
            for threads in 1..=16 {
                let mut ranges = vec![(0..system.particles(), threads)];
                let mut counts = Vec::new();
                while let Some((particles, parts)) = ranges.pop() {
                    let values = pattern.values_before(particles.end) - pattern.values_before(particles.start);
                    if parts == 1 {
                        counts.push(values);
                        continue;
                    }
                    let middle = middle(pattern, &particles, parts);
                    ranges.extend([(particles.start..middle, parts / 2), (middle..particles.end, parts - parts / 2)]);
                }
                let mean = pattern.entries() as f64 / threads as f64;
                let most = counts.iter().copied().max().unwrap_or(0) as f64;
                assert!(counts.len() == threads && most <= 1.1 * mean, "{threads}: {most} {mean}");
            }
        }
    }
}
