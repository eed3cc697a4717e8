//! Rows of six numbers in registers of eight, for processors that multiply and add in one operation.
//!
//! In three dimensions aggregates have six motions: blocks of prolongators and of coarse levels have rows of six. A row is loaded with the two
//! numbers behind it; what they become is left out of sums, or never looked at.

use super::block::Block;
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

    /// Six numbers, and zeros behind them.
    #[inline(always)]
    pub fn six<const N: usize>(self, numbers: &[f32; N]) -> __m256 {
        match numbers[..] {
            [a, b, c, d, e, f] => cast([a, b, c, d, e, f, 0.0, 0.0]),
            _ => self.nothing(),
        }
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
        avx._mm256_add_ps(
            avx._mm256_permute2f128_ps::<0x20>(four, two),
            avx._mm256_permute2f128_ps::<0x31>(four, two),
        )
    }
}
