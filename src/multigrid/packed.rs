//! Blocks with sixteen bits a number, for what a cycle reads from memory.
//!
//! A block is a scale, by which its largest number is 2¹⁵ − 1, times whole numbers. What is packed is off by at most 2⁻¹⁶ of its largest number, 1.5e-5. That is little enough
//! for a prolongator P, of which the coarse matrix is made as it is packed: an error E in it costs its square in energy, `|E e|² λ_max`, 2e-10 of the stiffest motion's.
//! It would be too much for the blocks of a smoother, of which soft motions are differences.

use super::block::{Block, NOTHING, zero};
use crate::operator::prefetch_all;

/// The largest whole number.
const LARGEST: f32 = i16::MAX as f32;

/// Added to numbers below 2²², it leaves them rounded to whole ones in the last bits of their sum.
const ROUND: f32 = 12_582_912.0;

/// An R × C block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Packed<const R: usize, const C: usize> {
    numbers: [[i16; C]; R],
    scale: f32,
}

impl<const R: usize, const C: usize> Packed<R, C> {
    pub const ZERO: Self = Self { numbers: [[0; C]; R], scale: 0.0 };

    /// Packs a block; zeros for what is nothing beside one, and what is not finite stays so.
    #[inline(always)]
    pub fn of(block: &Block<R, C, f32>) -> Self {
        // Bits of magnitudes are in the order of magnitudes, behind all of them those of what is not finite.
        let bits = block.as_flattened().iter().map(|entry| entry.abs().to_bits());
        let largest = f32::from_bits(bits.fold(0, u32::max));
        let of_one = if largest > NOTHING as f32 { LARGEST / largest } else { 0.0 };
        let mut numbers = [[0; C]; R];
        for (number, entry) in numbers.as_flattened_mut().iter_mut().zip(block.as_flattened()) {
            // The bits of the sum are those of `ROUND` with the whole number added.
            *number = (entry * of_one + ROUND).to_bits() as i16;
        }
        Self { numbers, scale: largest / LARGEST }
    }

    /// What the numbers are to be multiplied by.
    #[inline(always)]
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// The whole numbers.
    #[inline(always)]
    pub fn numbers(&self) -> &[[i16; C]; R] {
        &self.numbers
    }

    /// The block.
    #[inline(always)]
    pub fn unpacked(&self) -> Block<R, C, f32> {
        let mut block = zero();
        for (entry, &number) in block.as_flattened_mut().iter_mut().zip(self.numbers.as_flattened()) {
            *entry = f32::from(number) * self.scale;
        }
        block
    }
}

/// Asks for the memory of blocks that are read soon.
#[inline(always)]
pub(super) fn ask_for<const R: usize, const C: usize>(blocks: &[Packed<R, C>]) {
    blocks.iter().for_each(|block| prefetch_all(block.numbers.as_flattened()));
}

#[cfg(test)]
mod tests {
    use super::Packed;

    #[test]
    fn numbers_are_off_by_half_of_the_last_bit() {
        let block: [[f32; 6]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| ((7 * r + c) as f32).sin() * 1e4));
        let largest = block.as_flattened().iter().fold(0.0, |most, x| f32::max(most, x.abs()));
        let packed = Packed::of(&block);
        let pairs = packed.unpacked().into_iter().flatten().zip(block.into_iter().flatten());
        let most = pairs.map(|(found, exact)| (found - exact).abs()).fold(0.0, f32::max);
        // Packing and unpacking round to single precision besides, each to 2⁻²⁴ of the largest number: 0.4 % of half of the last bit.
        let half = 0.5 * largest / 32767.0;
        assert!(most <= 1.01 * half && most > 0.5 * half, "{most:e} {half:e}");
        assert_eq!(packed.numbers().as_flattened().iter().map(|n| n.unsigned_abs()).max(), Some(32767));
    }

    #[test]
    fn whole_numbers_come_back_and_nothing_is_zero() {
        let block = [[32767.0, -3.0], [0.0, -32767.0]];
        assert_eq!(Packed::of(&block).unpacked(), block);
        assert_eq!(Packed::of(&[[1e-26, -1e-30], [0.0, 0.0]]).numbers(), &[[0; 2]; 2]);
        assert_eq!(Packed::<2, 2>::ZERO.unpacked(), [[0.0; 2]; 2]);
    }

    #[test]
    fn what_is_not_finite_stays_so() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for place in 0..4 {
                let mut block = [[1.0; 2]; 2];
                block.as_flattened_mut()[place] = bad;
                let packed = Packed::of(&block);
                assert!(packed.unpacked().as_flattened().iter().all(|entry| !entry.is_finite()), "{packed:?}");
            }
        }
    }
}
