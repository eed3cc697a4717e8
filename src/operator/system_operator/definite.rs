//! What masses make definite for certain, and the diagonal blocks of which that is not known.

use super::SystemOperator;
use crate::spring::SpringBlock;
use crate::system::{Axes, System};
use nalgebra::Matrix3;

/// What of a matrix is definite for certain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SurelyDefinite {
    /// Maybe not even its diagonal blocks.
    Nothing,
    /// Its diagonal blocks.
    Blocks,
    /// All of it.
    Matrix,
}

/// What masses have left of every particle once springs have taken theirs, in N/m.
#[derive(Debug, Clone)]
pub struct Left(Vec<OfParticle>);

/// What is definite if it is positive.
#[derive(Debug, Clone, Copy)]
struct OfParticle {
    matrix: f64,
    block: f64,
}

impl Left {
    /// Of a system, all of whose blocks may be anything.
    pub fn new(system: &System) -> Self {
        Self(vec![OfParticle { matrix: f64::NEG_INFINITY, block: f64::NEG_INFINITY }; system.particles()])
    }

    /// Whether the diagonal block of a particle is not surely definite.
    pub fn is_doubtful(&self, particle: usize) -> bool {
        self.0.get(particle).is_none_or(|left| left.block <= 0.0 || left.block.is_nan())
    }
}

impl SystemOperator<'_> {
    /// What is definite because masses outweigh what springs can take away; the rest may be, too.
    ///
    /// A spring whose block has the least eigenvalue λ adds λ or more to the diagonal blocks of its ends, and, if λ is negative, `λ |xᵢ − xⱼ|²` or more,
    /// which is at least `2λ (|xᵢ|² + |xⱼ|²)`, to `xᵀA x`. So the diagonal block of a particle is definite if its mass, times the factor of M, and the λ of
    /// its springs have a positive sum, and the matrix is if twice those λ that are negative leave something of every mass (own derivation). `left` holds
    /// these sums afterwards, unless the matrix is definite.
    pub fn surely_definite(&self, left: &mut Left) -> SurelyDefinite {
        let least = |block: &SpringBlock| block.axial.min(block.transverse);
        let most = self.blocks.iter().map(|block| -least(block)).fold(0.0, f64::max);
        if self.mass * self.lightest > 2.0 * most * self.most_springs {
            return SurelyDefinite::Matrix;
        }
        for (left, mass) in left.0.iter_mut().zip(self.system.masses()) {
            *left = OfParticle { matrix: self.mass * mass, block: self.mass * mass };
        }
        for (pair, block) in self.stamps() {
            let least = least(block);
            for particle in pair {
                if let Some(left) = left.0.get_mut(particle) {
                    left.matrix += 2.0 * least.min(0.0);
                    left.block += least;
                }
            }
        }
        let dofs = self.system.dofs();
        let free = left.0.iter().enumerate().filter(|(particle, _)| dofs.free_axes(*particle) != Axes::NONE);
        let definite = free.map(|(_, left)| match left {
            left if left.matrix > 0.0 => SurelyDefinite::Matrix,
            left if left.block > 0.0 => SurelyDefinite::Blocks,
            _ => SurelyDefinite::Nothing,
        });
        definite.min().unwrap_or(SurelyDefinite::Matrix)
    }

    /// Writes the diagonal blocks of some particles.
    pub(crate) fn diagonal_blocks_of(&self, is_wanted: impl Fn(usize) -> bool, blocks: &mut [Matrix3<f64>]) {
        for (particle, (block, mass)) in blocks.iter_mut().zip(self.system.masses()).enumerate() {
            if is_wanted(particle) {
                *block = Matrix3::from_diagonal_element(self.mass * mass);
            }
        }
        for (pair, block) in self.stamps() {
            if pair.iter().any(|&end| is_wanted(end)) {
                let matrix = block.matrix();
                pair.into_iter().filter(|&end| is_wanted(end)).for_each(|end| blocks[end] += matrix);
            }
        }
        for (particle, block) in blocks.iter_mut().enumerate() {
            let free = self.system.dofs().free_axes(particle);
            if free == Axes::ALL || !is_wanted(particle) {
                continue;
            }
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block.row_mut(axis).fill(0.0);
                block.column_mut(axis).fill(0.0);
            }
        }
    }
}

/// The least mass and the most springs of a particle that moves.
pub(super) fn extremes(system: &System) -> [f64; 2] {
    let mut springs = vec![0u32; system.particles()];
    system.active().flat_map(|(_, pair, _)| pair).for_each(|end| springs[end] += 1);
    let free = (0..system.particles()).filter(|&particle| system.dofs().free_axes(particle) != Axes::NONE);
    free.fold([f64::INFINITY, 0.0], |[lightest, most], particle| {
        [system.masses()[particle].min(lightest), f64::from(springs[particle]).max(most)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::Extensions;
    use crate::operator::Combination;
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;

    /// A spring of 100 N and 2 m, pressed to half its length, takes 50 N/m across itself: masses of 1 and 2 kg outweigh twice that from a factor of
    /// 100 on, and without the first, which is held, from 50; for their blocks half as much will do. The spring between 2 and 30 kg beside it, pressed as
    /// much, takes as much from the second, for which twice 100 N/m come to the same factor.
    #[test]
    fn masses_outweigh_compressed_springs() {
        use SurelyDefinite::{Blocks, Matrix, Nothing};
        for (length, factor, holds, expected) in [
            (1.0, 49.0, None, Nothing),
            (1.0, 51.0, None, Blocks),
            (1.0, 99.0, None, Blocks),
            (1.0, 101.0, None, Matrix),
            (2.5, 1e-3, None, Matrix),
            (1.0, 49.0, Some(0), Nothing),
            (1.0, 51.0, Some(0), Blocks),
            (1.0, 99.0, Some(0), Blocks),
            (1.0, 101.0, Some(0), Matrix),
        ] {
            let mut builder = SystemBuilder::new();
            for (particle, mass) in [1.0, 2.0, 30.0].into_iter().enumerate() {
                builder.particle([length * particle as f64, 0.0, 0.0], mass);
            }
            for i in 0..2 {
                builder.spring(i, i + 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 0.0 });
            }
            if let Some(held) = holds {
                builder.hold(held);
            }
            let (system, state) = builder.build().unwrap();
            let extensions = Extensions::at(&system, &state.positions).unwrap();
            let combination = Combination { mass: factor, damping: 0.0, stiffness: -1.0 };
            let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
            assert_eq!(operator.surely_definite(&mut Left::new(&system)), expected, "{length} {factor} {holds:?}");
        }
    }

    /// Where the lightest outweighs as many springs as any particle has, no particle is looked at.
    #[test]
    fn heavy_masses_are_seen_at_once() {
        let mut builder = SystemBuilder::new();
        (0..3).for_each(|particle| _ = builder.particle([f64::from(particle), 0.0, 0.0], 1.0));
        (0..2).for_each(|i| _ = builder.spring(i, i + 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 0.0 }));
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        for (factor, is_looked_at) in [(199.0, true), (201.0, false)] {
            let combination = Combination { mass: factor, damping: 0.0, stiffness: -1.0 };
            let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
            let mut left = Left::new(&system);
            operator.surely_definite(&mut left);
            assert_eq!(left.0[0].block.is_finite(), is_looked_at, "{factor}");
        }
    }

    /// Without mass nothing is definite, whatever the springs are: two free particles can move together. And masses that are just
    /// outweighed, 1 kg times a factor of 100 by twice 50 N/m, leave a matrix that may be singular, but definite blocks.
    #[test]
    fn what_may_be_singular_is_not_surely_definite() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        for (mass, stiffness, option, expected) in [
            (0.0, -1.0, Stiffness::Tension, SurelyDefinite::Nothing),
            (-1.0, -1.0, Stiffness::Tension, SurelyDefinite::Nothing),
            (50.0, -1.0, Stiffness::Full, SurelyDefinite::Nothing),
            (100.0, -1.0, Stiffness::Full, SurelyDefinite::Blocks),
        ] {
            let combination = Combination { mass, damping: 0.0, stiffness };
            let operator = SystemOperator::new(&system, &extensions, option, combination);
            assert_eq!(operator.surely_definite(&mut Left::new(&system)), expected, "{mass}");
        }
    }

    /// A chain of masses of 2, 1 and 1 kg times 30 whose first spring is pressed to half its length and whose second is stretched to twice its own: across
    /// themselves −50 and 25 N/m, which leave 10, 5 and 55 of the blocks.
    #[test]
    fn stretched_springs_make_up_for_pressed_ones() {
        let mut builder = SystemBuilder::new();
        for (x, mass) in [(0.0, 2.0), (1.0, 1.0), (5.0, 1.0)] {
            builder.particle([x, 0.0, 0.0], mass);
        }
        (0..2).for_each(|i| _ = builder.spring(i, i + 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 0.0 }));
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let combination = Combination { mass: 30.0, damping: 0.0, stiffness: -1.0 };
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
        let mut left = Left::new(&system);
        assert!((0..3).all(|particle| left.is_doubtful(particle)));
        assert_eq!(operator.surely_definite(&mut left), SurelyDefinite::Blocks);
        assert!((0..3).all(|particle| !left.is_doubtful(particle)) && left.is_doubtful(3));
        for (left, expected) in left.0.iter().zip([10.0, 5.0, 55.0]) {
            assert!((left.block - expected).abs() < 1e-12, "{left:?}");
        }
        // Of a factor of 26 the first is left 2, the second 1, of 24 less than nothing; the third has enough.
        for (mass, doubtful) in [(26.0, [false; 3]), (25.5, [false; 3]), (24.0, [true, true, false])] {
            let operator =
                SystemOperator::new(&system, &extensions, Stiffness::Full, Combination { mass, ..combination });
            operator.surely_definite(&mut left);
            assert_eq!([0, 1, 2].map(|particle| left.is_doubtful(particle)), doubtful, "{mass}");
        }
    }

    /// Those that are asked for are the blocks of all, and the others stay.
    #[test]
    fn some_blocks_are_made_alone() {
        let mut builder = SystemBuilder::new();
        (0..4).for_each(|p| _ = builder.particle([1.3 * f64::from(p), f64::from(p % 2), 0.0], 1.0));
        (0..3).for_each(|i| _ = builder.spring(i, i + 1, Spring { stiffness: 50.0, rest_length: 1.0, damping: 0.0 }));
        builder.hold(0);
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let untouched = Matrix3::from_element(7.0);
        let [mut all, mut some] = [[untouched; 4]; 2];
        operator.diagonal_blocks_of(|_| true, &mut all);
        operator.diagonal_blocks_of(|particle| particle != 2, &mut some);
        assert_eq!(some, [all[0], all[1], untouched, all[3]]);
        assert!(all[0] == Matrix3::zeros() && all[2] != untouched);
    }
}
