//! Filling in the values of a system's matrix, particle by particle.
//!
//! The columns of a particle lie together in the values, and every spring that ends in it adds to them. So each particle
//! gathers from its own springs, in the order of the springs: no two particles write to one place, every entry adds up in
//! one order whatever the number of threads, and nothing has to be set to zero first. The price is that both ends of a
//! spring compute its 3×3 block; blocks are read twice, but the second time from cache where the ends are numbered closely.

use super::pattern::BlockPattern;
use super::spring_pattern::{Incidence, SpringPattern};
use crate::operator::lanes::{Lanes, Portable};
use crate::operator::{SystemOperator, prefetch};
use crate::parallel::{for_parts, parts, share};
use crate::spring::SpringBlock;
use nalgebra::Matrix3;
use std::ops::Range;

/// Values that are not worth a second thread.
const LEAST: usize = 16_384;

/// How many incidences ahead of its use a spring's block is asked for.
const AHEAD: usize = 48;

/// The columns of some particles, to be filled by one thread with the widest registers that the processor has and this knows.
struct Stretch<'a, L> {
    lanes: L,
    filling: Filling<'a>,
    particles: Range<usize>,
    values: &'a mut [f64],
}

impl<L: Lanes> pulp::NullaryFnOnce for Stretch<'_, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { lanes, filling, particles, values } = self;
        let pattern = filling.springs.pattern();
        let mut rest = values;
        for particle in particles {
            let (own, others) =
                rest.split_at_mut(pattern.values_before(particle + 1) - pattern.values_before(particle));
            if filling.springs.is_free(particle) {
                filling.fill_free(lanes, particle, own);
            } else {
                filling.fill_any(particle, own);
            }
            filling.add_external(particle, own);
            rest = others;
        }
    }
}

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
        #[cfg(target_arch = "x86_64")]
        if let Some(lanes) = pulp::x86::V3::try_new() {
            return lanes.vectorize(Stretch { lanes, filling: *self, particles, values });
        }
        pulp::NullaryFnOnce::call(Stretch { lanes: Portable, filling: *self, particles, values });
    }

    /// The columns of a particle when it and its neighbours in them are free along all axes. Of the [matrix](crate::spring::SpringBlock::matrix)
    /// of a block the diagonal and what is beside it are computed at once each, by the same operations.
    #[inline(always)]
    fn fill_free<L: Lanes>(&self, lanes: L, particle: usize, own: &mut [f64]) {
        let blocks = self.operator.blocks();
        let mass = self.operator.mass_factor() * self.operator.system().masses()[particle];
        // The three columns are 3, 2 and 1 values of the diagonal block, each with the same number of values below.
        let below = (own.len() - 6) / 3;
        let (x, yz) = own.split_at_mut(3 + below);
        let (y, z) = yz.split_at_mut(2 + below);
        let (x_diagonal, x) = x.split_at_mut(3);
        let (y_diagonal, y) = y.split_at_mut(2);
        let (z_diagonal, z) = z.split_at_mut(1);
        let zero = lanes.four([0.0; 4]);
        let (mut diagonal, mut beside) = (lanes.four([0.0 + mass; 4]), zero);
        for &Incidence { spring, place } in self.springs.incidences(particle) {
            let SpringBlock { direction, transverse, axial } = blocks[spring as usize];
            // What lies behind the direction comes along: the fourth lane is of no use.
            let n = lanes.four([direction.x, direction.y, direction.z, transverse]);
            let turned = lanes.turned(n);
            let twice = lanes.turned(turned);
            let (axial, transverse) = (lanes.four([axial; 4]), lanes.four([transverse; 4]));
            let along = lanes.mul(n, n);
            let across = lanes.add(lanes.mul(turned, turned), lanes.mul(twice, twice));
            let of_axes = lanes.add(lanes.mul(axial, along), lanes.mul(transverse, across));
            let of_pairs = lanes.mul(lanes.sub(axial, transverse), lanes.mul(n, turned));
            diagonal = lanes.add(diagonal, of_axes);
            beside = lanes.add(beside, of_pairs);
            let Some(offset) = place.offset() else { continue };
            let rows = offset as usize..offset as usize + 3;
            let columns = lanes.columns(of_axes, of_pairs);
            for (column, values) in columns.into_iter().zip([&mut *x, &mut *y, &mut *z]) {
                let values = &mut values[rows.clone()];
                let before = if place.is_again() { lanes.four([values[0], values[1], values[2], 0.0]) } else { zero };
                let (xy, z) = lanes.pieces(lanes.sub(before, column));
                let [first, second] = lanes.numbers(xy);
                (values[0], values[1], values[2]) = (first, second, z);
            }
        }
        let [x, y, z] = lanes.columns(diagonal, beside).map(|column| {
            let (xy, z) = lanes.pieces(column);
            (lanes.numbers(xy), z)
        });
        x_diagonal.copy_from_slice(&[x.0[0], x.0[1], x.1]);
        y_diagonal.copy_from_slice(&[y.0[1], y.1]);
        z_diagonal.copy_from_slice(&[z.1]);
        for ahead in self.springs.incidences_ahead(particle, AHEAD) {
            prefetch(&blocks[ahead.spring as usize]);
        }
    }

    /// Adds what forces from outside do to the diagonal block.
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

    /// The columns of any particle.
    fn fill_any(&self, particle: usize, own: &mut [f64]) {
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
