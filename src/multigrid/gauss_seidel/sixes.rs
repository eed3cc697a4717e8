//! Blocks of six by six, as coarse levels in three dimensions have: a row a register.
//!
//! Products with rows are summed up number by number, `s_r ∘ += A_r ∘ x`, and across only when the sum is complete.

use super::super::block::Block;
use super::super::eight::{Eight, SIX};
use super::kernel::Kernel;
use crate::operator::prefetch_all;
use pulp::cast;
use std::arch::x86_64::__m256;

/// For processors that multiply and add in one operation.
#[derive(Debug, Clone, Copy)]
pub struct Sixes(Eight);

impl Sixes {
    /// For blocks of this size, if it is six and the processor has such registers.
    pub fn of(size: usize) -> Option<Self> {
        Eight::of(size).map(Self)
    }

    /// `A x`, before it is summed across.
    #[inline(always)]
    fn times<const N: usize>(self, mut sums: [__m256; SIX], a: &Block<N, N, f32>, x: __m256) -> [__m256; SIX] {
        for (sum, row) in sums.iter_mut().zip(0..N) {
            *sum = self.0.add(*sum, self.0.row(a, row), x);
        }
        sums
    }
}

/// Six numbers with two behind them: zeros in x, anything in what is left of b.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Row([f32; 8]);

impl Row {
    #[inline(always)]
    fn of(six: &[f32]) -> Self {
        Self(std::array::from_fn(|k| six.get(k).copied().unwrap_or(0.0)))
    }

    #[inline(always)]
    fn register(self) -> __m256 {
        cast(self.0)
    }
}

/// What a sum begins with, and what is to be taken from it, before that is summed across.
#[derive(Debug, Clone, Copy)]
pub struct Sum {
    b: Row,
    less: [__m256; SIX],
}

impl<const N: usize> Kernel<N> for Sixes {
    type Block = Block<N, N, f32>;
    type Vector = Row;
    type Sum = Sum;

    #[inline(always)]
    fn keep(self, block: &Block<N, N, f32>) -> Block<N, N, f32> {
        *block
    }

    #[inline(always)]
    fn block(self, kept: &Block<N, N, f32>) -> Block<N, N, f32> {
        *kept
    }

    #[inline(always)]
    fn ask_for(self, blocks: &[Block<N, N, f32>]) {
        prefetch_all(blocks.as_flattened().as_flattened());
    }

    #[inline(always)]
    fn vector(self, numbers: [f32; N]) -> Row {
        Row::of(&numbers)
    }

    #[inline(always)]
    fn numbers(self, vector: Row) -> [f32; N] {
        std::array::from_fn(|k| vector.0[k])
    }

    #[inline(always)]
    fn begin(self, b: Row) -> Sum {
        Sum { b, less: [self.0.nothing(); SIX] }
    }

    #[inline(always)]
    fn subtract(self, sum: &mut Sum, a: &Block<N, N, f32>, x: Row) {
        sum.less = self.times(sum.less, a, x.register());
    }

    #[inline(always)]
    fn apply(self, a: &Block<N, N, f32>, Sum { b, less }: Sum) -> Row {
        let sum = self.0.first_six(self.0.difference(b.register(), self.0.across(less)));
        Row(cast(self.0.across(self.times([self.0.nothing(); SIX], a, sum))))
    }

    #[inline(always)]
    fn subtract_transposed(self, y: &mut Row, a: &Block<N, N, f32>, x: Row) {
        let mut sum = y.register();
        for (row, x) in (0..N).zip(x.0) {
            sum = self.0.subtract(sum, self.0.row(a, row), self.0.all(x));
        }
        *y = Row(cast(sum));
    }
}
