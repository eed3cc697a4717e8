//! How blocks are kept and multiplied in a sweep.

use super::super::block::{Block, add_transposed_apply, apply, subtract_apply};
use crate::operator::prefetch_all;
use std::fmt::Debug;

/// What a sweep does with blocks and vectors of N numbers, in single precision.
pub trait Kernel<const N: usize>: Copy + Debug + Send + Sync {
    /// A block, as it is kept.
    type Block: Copy + Debug + PartialEq + Send + Sync;
    /// A vector of N numbers, as it is worked with.
    type Vector: Copy + Debug + Send + Sync;
    /// A vector that is summed up.
    type Sum: Copy;

    fn keep(self, block: &Block<N, N, f32>) -> Self::Block;
    fn block(self, kept: &Self::Block) -> Block<N, N, f32>;
    /// Asks for all lines of the memory in which blocks are that are read soon.
    fn ask_for(self, blocks: &[Self::Block]);
    fn vector(self, numbers: [f32; N]) -> Self::Vector;
    fn numbers(self, vector: Self::Vector) -> [f32; N];

    /// A sum that begins with b.
    fn begin(self, b: Self::Vector) -> Self::Sum;
    /// `sum −= A x`.
    fn subtract(self, sum: &mut Self::Sum, a: &Self::Block, x: Self::Vector);
    /// `A sum`.
    fn apply(self, a: &Self::Block, sum: Self::Sum) -> Self::Vector;
    /// `y −= Aᵀ x`.
    fn subtract_transposed(self, y: &mut Self::Vector, a: &Self::Block, x: Self::Vector);
}

/// Blocks of any size by rows, for every processor.
#[derive(Debug, Clone, Copy)]
pub struct General;

impl<const N: usize> Kernel<N> for General {
    type Block = Block<N, N, f32>;
    type Vector = [f32; N];
    type Sum = [f32; N];

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
    fn vector(self, numbers: [f32; N]) -> [f32; N] {
        numbers
    }

    #[inline(always)]
    fn numbers(self, vector: [f32; N]) -> [f32; N] {
        vector
    }

    #[inline(always)]
    fn begin(self, b: [f32; N]) -> [f32; N] {
        b
    }

    #[inline(always)]
    fn subtract(self, sum: &mut [f32; N], a: &Block<N, N, f32>, x: [f32; N]) {
        subtract_apply(sum, a, &x);
    }

    #[inline(always)]
    fn apply(self, a: &Block<N, N, f32>, sum: [f32; N]) -> [f32; N] {
        apply(a, &sum)
    }

    #[inline(always)]
    fn subtract_transposed(self, y: &mut [f32; N], a: &Block<N, N, f32>, x: [f32; N]) {
        add_transposed_apply(y, a, &x.map(|x| -x));
    }
}
