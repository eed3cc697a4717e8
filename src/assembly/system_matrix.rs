//! A system's M, G, K and A as assembled matrices: their pattern, the slot map, and the refill.
//!
//! The columns of a particle are contiguous values, to which every spring that ends in it adds. So each particle gathers from its own springs, in
//! their order: no two particles write to one place, and every entry adds up in one order for any number of threads, at the price of computing each
//! 3×3 block twice.

use super::triplets::{BlockTriplet, MatrixEntry, assemble};
use super::{BlockPattern, SymmetricMatrix};
use crate::error::Result;
use crate::memory;
use crate::operator::{SystemOperator, group};
use crate::parallel::parts;
use crate::system::System;
use nalgebra::Matrix3;
use std::ops::Range;
use std::sync::Arc;

/// A spring seen from one of its ends.
#[derive(Debug, Clone, Copy, Default)]
struct Incidence {
    /// Its position among the active springs.
    spring: u32,
    /// The values between the diagonal part of this end's columns and the block, or [`Incidence::ROW`].
    offset: u32,
}

impl Incidence {
    /// This end has the rows of the block, not its columns.
    const ROW: u32 = u32::MAX;
}

/// The pattern of a system's matrices and the slot map: for every particle its springs and the offsets of their blocks.
#[derive(Debug, Clone)]
pub struct SpringPattern {
    pattern: Arc<BlockPattern>,
    /// The springs of particle p are `incidences[starts[p]..starts[p + 1]]`, ascending.
    starts: Vec<usize>,
    incidences: Vec<Incidence>,
}

impl SpringPattern {
    /// The pattern of A and K: every active spring.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_stiffness(system: &System) -> Result<Self> {
        Self::of(system, |_| true)
    }

    /// The pattern of G: damped springs only.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_damping(system: &System) -> Result<Self> {
        Self::of(system, |damping| damping > 0.0)
    }

    fn of(system: &System, enters: impl Fn(f64) -> bool + Copy) -> Result<Self> {
        // Bytes that the pattern and its construction take at most, by lowering the limit on memory until a run failed.
        let bytes = 128 * (system.active_springs().len() + system.particles()) as u64;
        memory::ensure(bytes, "the pattern of the matrix")?;
        let chosen = (0u32..).zip(system.active()).filter(|(_, (_, _, spring))| enters(spring.damping));
        let (positions, pairs): (Vec<u32>, Vec<[usize; 2]>) = chosen.map(|(at, (_, pair, _))| (at, pair)).unzip();
        let pattern = BlockPattern::new(system.dofs(), pairs.iter().copied())?;
        let both_ends = |(&spring, &[i, j]): (&u32, &[usize; 2])| {
            [(i.min(j), Incidence { spring, offset: 0 }), (i.max(j), Incidence { spring, offset: Incidence::ROW })]
        };
        let ends = || positions.iter().zip(&pairs).flat_map(both_ends);
        let (starts, mut incidences) = group(system.particles(), ends);
        for incidence in incidences.iter_mut().filter(|incidence| incidence.offset != Incidence::ROW) {
            let [i, j] = system.pair(system.active_springs()[incidence.spring as usize] as usize);
            incidence.offset = pattern.slot(i, j).map_or(Incidence::ROW, |slot| slot.offset);
        }
        Ok(Self { pattern: Arc::new(pattern), starts, incidences })
    }

    #[inline]
    fn incidences(&self, particle: usize) -> &[Incidence] {
        &self.incidences[self.starts[particle]..self.starts[particle + 1]]
    }

    /// The positions of a particle's springs among the active ones, ascending.
    pub(crate) fn springs_at(&self, particle: usize) -> impl Iterator<Item = usize> + '_ {
        self.incidences(particle).iter().map(|incidence| incidence.spring as usize)
    }

    /// The pattern of the entries.
    pub fn pattern(&self) -> &BlockPattern {
        &self.pattern
    }
}

/// A system's matrix with the slot map that refills it.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::assembly::{SpringPattern, SystemMatrix};
/// use sprung::force::SpringGeometry;
/// use sprung::operator::{Combination, SystemOperator};
/// use std::sync::Arc;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// // Once: the pattern, and the slots of all blocks.
/// let mut matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(&system)?));
/// // As often as the values change: no search, no sort, no allocation.
/// let extensions = SpringGeometry::at(&system, &state.positions)?;
/// for dt in [0.1, 0.5] {
///     let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
///     matrix.refill(&a);
/// }
/// assert_eq!(matrix.matrix().values()[0], 4.0 + 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SystemMatrix {
    springs: Arc<SpringPattern>,
    matrix: SymmetricMatrix,
}

impl SystemMatrix {
    /// The zero matrix on a pattern.
    pub fn zeros(springs: Arc<SpringPattern>) -> Self {
        let matrix = SymmetricMatrix::zeros(springs.pattern.clone());
        Self { springs, matrix }
    }

    /// As [`zeros`](Self::zeros), if there is memory for it.
    ///
    /// # Errors
    /// [`Error::TooLarge`](crate::Error::TooLarge).
    pub fn try_zeros(springs: Arc<SpringPattern>) -> Result<Self> {
        memory::ensure(8 * springs.pattern().entries() as u64, "the matrix")?;
        Ok(Self::zeros(springs))
    }

    /// On the pattern of A and K, if there is memory for it.
    pub(crate) fn of_stiffness(system: &System) -> Result<Self> {
        Self::try_zeros(Arc::new(SpringPattern::of_stiffness(system)?))
    }

    /// The assembled operator, on the pattern that fits its blocks.
    pub fn assemble(springs: Arc<SpringPattern>, operator: &SystemOperator) -> Self {
        let mut matrix = Self::zeros(springs);
        matrix.refill(operator);
        matrix
    }

    /// Recomputes all values from the operator's blocks, without searching or allocating; the same bits for any number of threads.
    pub fn refill(&mut self, operator: &SystemOperator) {
        let values = &mut self.matrix.values;
        let (particles, parts) = (0..operator.system().particles(), parts(values.len(), GRAIN));
        Filling { springs: &self.springs, operator }.fill(particles, parts, values);
    }

    /// The matrix.
    pub fn matrix(&self) -> &SymmetricMatrix {
        &self.matrix
    }

    /// The matrix, by value.
    pub fn into_matrix(self) -> SymmetricMatrix {
        self.matrix
    }
}

/// Assembles an operator from all block triplets, sorted and added up: slow and simple, and the reference for [`SystemMatrix::refill`], to the bit.
pub fn assemble_afresh(operator: &SystemOperator) -> Vec<MatrixEntry> {
    let system = operator.system();
    let masses = system.masses().iter().map(|mass| Matrix3::from_diagonal_element(operator.mass_factor() * mass));
    let springs = system.active().zip(operator.blocks()).flat_map(|((_, [i, j], _), block)| {
        let block = block.matrix();
        [(i, i, block), (j, j, block), (i, j, -block), (j, i, -block)]
    });
    let own = |(p, block)| (p, p, block);
    let external = operator.external().iter().copied().enumerate().map(own);
    let all = masses.enumerate().map(own).chain(springs).chain(external);
    let triplets: Vec<_> = all.map(|(row, column, block)| BlockTriplet { row, column, block }).collect();
    assemble(system.dofs(), &triplets)
}

/// Least values for a thread: some ten microseconds of work.
const GRAIN: usize = 16_384;

#[derive(Clone, Copy)]
struct Filling<'a> {
    springs: &'a SpringPattern,
    operator: &'a SystemOperator<'a>,
}

impl Filling<'_> {
    /// Overwrites the columns of some particles, which are `values`, in so many parts.
    fn fill(&self, particles: Range<usize>, parts: usize, values: &mut [f64]) {
        let pattern = self.springs.pattern();
        let between = |from: usize, to: usize| pattern.values_before(to) - pattern.values_before(from);
        if parts > 1 {
            let Range { start, end } = particles;
            let middle = pattern.middle(&particles, parts);
            let (left, right) = values.split_at_mut(between(start, middle));
            rayon::join(
                || self.fill(start..middle, parts / 2, left),
                || self.fill(middle..end, parts - parts / 2, right),
            );
            return;
        }
        let mut rest = values;
        for particle in particles {
            let (own, others) = rest.split_at_mut(between(particle, particle + 1));
            self.fill_particle(particle, own);
            rest = others;
        }
    }

    fn fill_particle(&self, particle: usize, own: &mut [f64]) {
        let system = self.operator.system();
        let (pattern, free) = (self.springs.pattern(), system.dofs().free_axes(particle));
        let columns = free.count();
        let mass = self.operator.mass_factor() * system.masses()[particle];
        own.fill(0.0);
        let mut diagonal = Matrix3::from_diagonal_element(0.0 + mass);
        let start = |column: usize| pattern.column(particle, column).start - pattern.values_before(particle);
        for &Incidence { spring, offset } in self.springs.incidences(particle) {
            let block = self.operator.blocks()[spring as usize].matrix();
            diagonal += block;
            if offset == Incidence::ROW {
                continue;
            }
            let [i, j] = system.pair(system.active_springs()[spring as usize] as usize);
            let row_axes = system.dofs().free_axes(i.max(j));
            for (column, c) in free.iter().enumerate() {
                let values = &mut own[start(column) + columns - column + offset as usize..];
                for (value, r) in values.iter_mut().zip(row_axes.iter()) {
                    *value -= block[(r, c)];
                }
            }
        }
        if let Some(external) = self.operator.external().get(particle) {
            diagonal += external;
        }
        for (column, c) in free.iter().enumerate() {
            for (value, r) in own[start(column)..].iter_mut().zip(free.iter().skip(column)) {
                *value = diagonal[(r, c)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::memory::watch::asked;
    use crate::operator::{Combination, LinearOperator};
    use crate::spring::{Spring, Stiffness};
    use crate::system::{Axes, Constraint, Motion, State, SystemBuilder};
    use nalgebra::Vector3;

    /// A crooked chain, long enough for several threads, with springs to the next and the third particle, some repeated, some damped; some particles
    /// are held, or held along some axes.
    fn chain(dimension: usize) -> (System, State) {
        const PARTICLES: usize = 2500;
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        for i in 0..PARTICLES {
            let place = [1.0 * i as f64, 0.3 * (i % 3) as f64, 0.2 * (i % 5) as f64];
            let modelled = std::array::from_fn(|axis| if axis < dimension { place[axis] } else { 0.0 });
            builder.particle(modelled, 1.0 + (i % 4) as f64);
        }
        for i in 0..PARTICLES - 3 {
            let spring = Spring { stiffness: 10.0 + (i % 6) as f64, rest_length: 1.5, damping: (i % 2) as f64 };
            builder.spring(i, i + 1, spring);
            builder.spring(i + 3, i, spring);
            if i % 7 == 0 {
                builder.spring(i + 1, i, spring);
                builder.spring(i, i + 3, spring);
            }
        }
        let every = |step| (0..PARTICLES).step_by(step).collect::<Vec<_>>();
        builder.constrain(Constraint { particles: every(11), axes: Axes::of(&[0, 2]), motion: Motion::Held });
        builder.constrain(Constraint { particles: every(50), axes: Axes::ALL, motion: Motion::Held });
        builder.build().unwrap()
    }

    /// The pattern of G has the damped springs alone: every other particle's first and third neighbour.
    #[test]
    fn the_matrix_is_the_sum_of_its_triplets() {
        for dimension in [1, 2, 3] {
            let (system, state) = chain(dimension);
            let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
            let [all, damped] = [SpringPattern::of_stiffness, SpringPattern::of_damping].map(|of| of(&system).unwrap());
            assert!(damped.pattern().entries() < all.pattern().entries());
            for (pattern, combination) in [(all, Combination::step(0.1)), (damped, Combination::DAMPING)] {
                let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
                let mut matrix = SystemMatrix::assemble(Arc::new(pattern), &operator);
                // A second time, over what is there.
                matrix.refill(&operator);
                let triplets = assemble_afresh(&operator);
                let lower = triplets.iter().filter(|entry| entry.row >= entry.column && entry.value != 0.0);
                let expected: Vec<_> = lower.map(|entry| (entry.row, entry.column, entry.value)).collect();
                assert!(matrix.matrix().iter().filter(|entry| entry.2 != 0.0).eq(expected), "{dimension}");
            }
        }
    }

    /// What prescribed coordinates do to the free ones: the columns that the matrix does not have.
    #[test]
    fn the_coupling_is_what_the_whole_matrix_has_beside_the_free_one() {
        let (system, state) = chain(3);
        let (whole, _) = {
            let mut builder =
                SystemBuilder { dimension: 3, positions: state.positions.clone(), ..SystemBuilder::new() };
            builder.velocities = vec![Vector3::zeros(); system.particles()];
            builder.masses = system.masses().to_vec();
            (builder.pairs, builder.springs) = (system.pairs().to_vec(), system.springs().to_vec());
            builder.build().unwrap()
        };
        let operator = |system| {
            let extensions = SpringGeometry::at(system, &state.positions).unwrap();
            SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(0.1))
        };
        let (a, all) = (operator(&system), operator(&whole));
        // Prescribed coordinates alone are displaced.
        let mut displacement: Vec<Vector3<f64>> =
            (0..system.particles()).map(|p| Vector3::new(1.0, -2.0, (p % 3) as f64)).collect();
        system.dofs().scatter(&vec![0.0; system.dofs().len()], &mut displacement);
        let flat: Vec<f64> = displacement.iter().flatten().copied().collect();
        let mut product = vec![0.0; flat.len()];
        all.apply(&flat, &mut product);
        let product: Vec<Vector3<f64>> = product.chunks(3).map(Vector3::from_column_slice).collect();
        let mut expected = vec![0.0; system.dofs().len()];
        system.dofs().gather(&product, &mut expected);
        let mut found = vec![1.0; system.dofs().len()];
        a.subtract_coupling(&displacement, &mut found);
        // b loses it.
        let difference = found.iter().zip(&expected).map(|(b, coupled)| (b - 1.0 + coupled).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-10, "{difference:e}");
        assert!(expected.iter().any(|entry| entry.abs() > 1.0));
    }

    /// Six particles in a ring: every one has two springs.
    fn ring() -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        for p in 0..6 {
            builder.particle([f64::from(p), f64::from(p * p), 0.0], 1.0);
        }
        for p in 0..6 {
            builder.spring(p, (p + 1) % 6, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder
    }

    /// What is asked for covers what is held: 128 bytes for each of six springs and six particles.
    #[test]
    fn memory_is_asked_for_every_spring_and_particle() {
        let (system, _) = ring().build().unwrap();
        let (pattern, bytes) = asked("the pattern of the matrix", || SpringPattern::of_stiffness(&system).unwrap());
        assert_eq!(bytes, 128 * 12);
        let held = size_of_val(&pattern.incidences[..]) + size_of_val(&pattern.starts[..]);
        assert!(held < bytes as usize, "{held}");
    }

    /// Both ends know the spring; a block has its place in the columns of the particle with the lower number.
    #[test]
    fn both_ends_know_a_spring() {
        let (system, _) = ring().build().unwrap();
        let pattern = SpringPattern::of_stiffness(&system).unwrap();
        assert!(pattern.springs_at(3).eq([2, 3]) && pattern.springs_at(0).eq([0, 5]));
        let offsets = |particle: usize| -> Vec<_> {
            pattern
                .incidences(particle)
                .iter()
                .map(|incidence| Some(incidence.offset).filter(|&offset| offset != Incidence::ROW))
                .collect()
        };
        assert_eq!([offsets(0), offsets(3), offsets(5)], [[Some(0), Some(3)], [None, Some(0)], [None, None]]);
    }

    /// Values that one to sixteen threads write, counted as they are cut: none has more than a tenth above the mean.
    #[cfg(feature = "scene")]
    #[test]
    fn threads_fill_as_many_values_each() {
        use crate::scene::builtin::{cloth, lattice, network};
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
                    let middle = pattern.middle(&particles, parts);
                    ranges.extend([(particles.start..middle, parts / 2), (middle..particles.end, parts - parts / 2)]);
                }
                let mean = pattern.entries() as f64 / threads as f64;
                let most = counts.iter().copied().max().unwrap_or(0) as f64;
                assert!(counts.len() == threads && most <= 1.1 * mean, "{threads}: {most} {mean}");
            }
        }
    }
}
