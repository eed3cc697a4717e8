//! Rows of six numbers in registers of eight, for processors that multiply and add in one operation.
//!
//! In three dimensions aggregates have six motions: blocks of prolongators and of coarse levels have rows of six. A row is loaded with the two
//! numbers behind it; what they become is left out of sums, or never looked at.

use super::block::Block;
use super::packed::Packed;
use pulp::cast;
use pulp::x86::V3;
use std::arch::x86_64::__m256;

/// Numbers of a row.
pub(super) const SIX: usize = 6;

/// The operations, of single precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eight(V3);

impl Eight {
    /// For rows of so many numbers, if they are six and the processor is such a one.
    pub fn of(columns: usize) -> Option<Self> {
        V3::try_new().filter(|_| columns == SIX).map(Self)
    }

    #[inline(always)]
    pub fn nothing(self) -> __m256 {
        cast([0f32; 8])
    }

    /// A row of a block.
    #[inline(always)]
    pub fn row<const R: usize, const C: usize>(self, block: &Block<R, C, f32>, row: usize) -> __m256 {
        let numbers = &block.as_flattened()[row * C..];
        // Behind the last row there is nothing.
        numbers.first_chunk::<8>().map_or_else(|| self.six(&block[row]), |eight| cast(*eight))
    }

    /// A row of a packed block, without its scale.
    #[inline(always)]
    pub fn packed_row<const R: usize, const C: usize>(self, block: &Packed<R, C>, row: usize) -> __m256 {
        let numbers = &block.numbers().as_flattened()[row * C..];
        let eight = match (numbers.first_chunk::<8>(), numbers) {
            (Some(eight), _) => *eight,
            (None, &[a, b, c, d, e, f]) => [a, b, c, d, e, f, 0, 0],
            _ => [0; 8],
        };
        self.0.avx._mm256_cvtepi32_ps(self.0.avx2._mm256_cvtepi16_epi32(cast(eight)))
    }

    /// Six numbers, and zeros behind them.
    #[inline(always)]
    pub fn six<const N: usize>(self, numbers: &[f32; N]) -> __m256 {
        match numbers[..] {
            [a, b, c, d, e, f] => cast([a, b, c, d, e, f, 0.0, 0.0]),
            _ => self.nothing(),
        }
    }

    /// With zeros behind the first six.
    #[inline(always)]
    pub fn first_six(self, eight: __m256) -> __m256 {
        self.0.avx._mm256_blend_ps::<0b1100_0000>(eight, self.nothing())
    }

    /// The first numbers of a register.
    #[inline(always)]
    pub fn first<const N: usize>(self, eight: __m256) -> [f32; N] {
        let numbers: [f32; 8] = cast(eight);
        std::array::from_fn(|k| numbers[k])
    }

    #[inline(always)]
    pub fn all(self, number: f32) -> __m256 {
        self.0.avx._mm256_set1_ps(number)
    }

    #[inline(always)]
    pub fn sum(self, a: __m256, b: __m256) -> __m256 {
        self.0.avx._mm256_add_ps(a, b)
    }

    #[inline(always)]
    pub fn difference(self, a: __m256, b: __m256) -> __m256 {
        self.0.avx._mm256_sub_ps(a, b)
    }

    #[inline(always)]
    pub fn product(self, a: __m256, b: __m256) -> __m256 {
        self.0.avx._mm256_mul_ps(a, b)
    }

    /// `sum + a b`.
    #[inline(always)]
    pub fn add(self, sum: __m256, a: __m256, b: __m256) -> __m256 {
        self.0.fma._mm256_fmadd_ps(a, b, sum)
    }

    /// `sum − a b`.
    #[inline(always)]
    pub fn subtract(self, sum: __m256, a: __m256, b: __m256) -> __m256 {
        self.0.fma._mm256_fnmadd_ps(a, b, sum)
    }

    /// The sums of all numbers of each of six registers, and zeros behind them.
    #[inline(always)]
    pub fn across(self, [a, b, c, d, e, f]: [__m256; SIX]) -> __m256 {
        let avx = self.0.avx;
        let pairs = |a, b| avx._mm256_hadd_ps(a, b);
        // The halves of each sum, in the two halves of a register.
        let four = pairs(pairs(a, b), pairs(c, d));
        let two = pairs(pairs(e, f), self.nothing());
        avx._mm256_add_ps(avx._mm256_permute2f128_ps::<0x20>(four, two), avx._mm256_permute2f128_ps::<0x31>(four, two))
    }
}

#[cfg(test)]
mod tests {
    use super::{Eight, SIX};
    use crate::multigrid::packed::Packed;

    #[test]
    fn rows_are_six_numbers_and_sums_go_across_them() {
        assert!(Eight::of(5).is_none());
        let Some(eight) = Eight::of(SIX) else { return };
        let block: [[f32; SIX]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| (10 * r + c) as f32));
        for (r, row) in block.iter().enumerate() {
            assert_eq!(eight.first::<SIX>(eight.row(&block, r)), *row);
            let mut zeros_behind = [0.0; 8];
            zeros_behind[..SIX].copy_from_slice(row);
            assert_eq!(eight.first::<8>(eight.six(row)), zeros_behind);
            assert_eq!(eight.first::<8>(eight.first_six(eight.row(&block, r))), zeros_behind);
            let packed = Packed::of(&block);
            let numbers = packed.numbers()[r].map(f32::from);
            assert_eq!(eight.first::<SIX>(eight.packed_row(&packed, r)), numbers);
        }
        assert_eq!(eight.first::<8>(eight.row(&block, 1)), [10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 20.0, 21.0]);
        let registers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0].map(|number| eight.all(number));
        assert_eq!(eight.first::<8>(eight.across(registers)), [8.0, 16.0, 24.0, 32.0, 40.0, 48.0, 0.0, 0.0]);
        let [two, three, five] = [2.0, 3.0, 5.0].map(|number| eight.all(number));
        let found = [
            eight.sum(two, three),
            eight.difference(two, three),
            eight.product(two, three),
            eight.add(two, three, five),
            eight.subtract(two, three, five),
        ];
        assert_eq!(found.map(|found| eight.first::<1>(found)[0]), [5.0, -1.0, 6.0, 17.0, -13.0]);
    }
}
