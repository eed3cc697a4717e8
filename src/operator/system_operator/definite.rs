//! What masses make definite for certain, without looking at a matrix.

use super::{SystemOperator, lowest};
use crate::spring::SpringBlock;
use crate::system::{Axes, System};

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

/// By how much the mass of every particle outweighs its springs, in N/m.
#[derive(Debug, Clone)]
pub struct Margins(Vec<Margin>);

/// What is definite if it is positive beyond rounding.
#[derive(Debug, Clone, Copy)]
struct Margin {
    matrix: f64,
    block: f64,
    /// What both may be wrong by.
    rounding: f64,
}

impl Margin {
    fn definite(&self) -> SurelyDefinite {
        match self {
            margin if margin.matrix > margin.rounding => SurelyDefinite::Matrix,
            margin if margin.block > margin.rounding => SurelyDefinite::Blocks,
            _ => SurelyDefinite::Nothing,
        }
    }
}

impl Margins {
    /// Of a system, all of whose blocks may be anything.
    pub fn new(system: &System) -> Self {
        let unknown = Margin { matrix: f64::NEG_INFINITY, block: f64::NEG_INFINITY, rounding: 0.0 };
        Self(vec![unknown; system.particles()])
    }

    /// Whether the diagonal block of a particle is not surely definite.
    pub fn is_doubtful(&self, particle: usize) -> bool {
        self.0.get(particle).is_none_or(|margin| margin.definite() == SurelyDefinite::Nothing)
    }
}

impl SystemOperator<'_> {
    /// What is definite because masses outweigh what springs can take away; the rest may be, too.
    ///
    /// A spring whose block has the least eigenvalue λ adds λ or more to the diagonal blocks of its ends, and, if λ is negative, `λ |xᵢ − xⱼ|²` or more,
    /// which is at least `2λ (|xᵢ|² + |xⱼ|²)`, to `xᵀA x`. So the diagonal block of a particle is definite if its mass, times the factor of M, and the λ of
    /// its springs have a positive sum, and the matrix is if twice those λ that are negative leave something of every mass (own derivation). A sum of n
    /// terms is off by n rounding errors of the sum of their magnitudes at most, and has to be more. `margins` holds these sums afterwards, unless the matrix
    /// is seen to be definite at once.
    pub fn surely_definite(&self, margins: &mut Margins) -> SurelyDefinite {
        let least = |block: &SpringBlock| block.axial.min(block.transverse);
        let most = self.blocks.iter().map(|block| -least(block)).fold(0.0, f64::max);
        // Two products on one side and one on the other are rounded, and the terms of the sum are.
        let rounding = (self.most_springs + 4.0) * f64::EPSILON;
        if self.external.is_empty() && self.mass * self.lightest * (1.0 - rounding) > 2.0 * most * self.most_springs {
            return SurelyDefinite::Matrix;
        }
        for (margin, mass) in margins.0.iter_mut().zip(self.system.masses()) {
            let mass = self.mass * mass;
            *margin = Margin { matrix: mass, block: mass, rounding: rounding * mass };
        }
        for (margin, external) in margins.0.iter_mut().zip(&self.external) {
            let least = lowest(external);
            margin.matrix += least;
            margin.block += least;
            // Eigenvalues of three rows are off by some rounding errors of the matrix.
            margin.rounding += (rounding + 16.0 * f64::EPSILON) * external.norm();
        }
        for (pair, block) in self.stamps() {
            let least = least(block);
            for particle in pair {
                if let Some(margin) = margins.0.get_mut(particle) {
                    margin.matrix += 2.0 * least.min(0.0);
                    margin.block += least;
                    margin.rounding += rounding * 2.0 * least.abs();
                }
            }
        }
        let dofs = self.system.dofs();
        let free = margins.0.iter().enumerate().filter(|(particle, _)| dofs.free_axes(*particle) != Axes::NONE);
        free.map(|(_, margin)| margin.definite()).min().unwrap_or(SurelyDefinite::Matrix)
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
            assert_eq!(operator.surely_definite(&mut Margins::new(&system)), expected, "{length} {factor} {holds:?}");
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
            let mut margins = Margins::new(&system);
            operator.surely_definite(&mut margins);
            assert_eq!(margins.0[0].block.is_finite(), is_looked_at, "{factor}");
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
            assert_eq!(operator.surely_definite(&mut Margins::new(&system)), expected, "{mass}");
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
        let mut margins = Margins::new(&system);
        assert!((0..3).all(|particle| margins.is_doubtful(particle)));
        assert_eq!(operator.surely_definite(&mut margins), SurelyDefinite::Blocks);
        assert!((0..3).all(|particle| !margins.is_doubtful(particle)) && margins.is_doubtful(3));
        for (margin, expected) in margins.0.iter().zip([10.0, 5.0, 55.0]) {
            assert!((margin.block - expected).abs() < 1e-12, "{margin:?}");
        }
        // Of a factor of 26 the first is left 2, the second 1, of 24 less than nothing; the third has enough.
        for (mass, doubtful) in [(26.0, [false; 3]), (25.5, [false; 3]), (24.0, [true, true, false])] {
            let operator =
                SystemOperator::new(&system, &extensions, Stiffness::Full, Combination { mass, ..combination });
            operator.surely_definite(&mut margins);
            assert_eq!([0, 1, 2].map(|particle| margins.is_doubtful(particle)), doubtful, "{mass}");
        }
    }
}
