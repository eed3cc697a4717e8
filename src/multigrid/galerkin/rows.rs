//! Products of small blocks in double precision, row by row of the second factor.

use super::super::block::{Block, add_product, add_transposed_product, double};

/// What a triple product does with blocks that have C columns.
pub trait RowProducts<const C: usize>: Copy + Send + Sync {
    /// A row, as products take it.
    type Row: Copy;

    /// The rows of a block.
    fn rows<const R: usize>(self, block: &Block<R, C>) -> [Self::Row; R];
    /// The rows of a block in single precision.
    fn double_rows<const R: usize>(self, block: &Block<R, C, f32>) -> [Self::Row; R];

    /// `C += A B`.
    fn add_product<const R: usize, const K: usize>(self, c: &mut Block<R, C>, a: &Block<R, K>, b: &[Self::Row; K]);
    /// `C += Aᵀ B`.
    fn add_transposed_product<const R: usize, const K: usize>(
        self,
        c: &mut Block<K, C>,
        a: &Block<R, K>,
        b: &[Self::Row; R],
    );
}

/// For any number of columns and every processor.
#[derive(Debug, Clone, Copy)]
pub struct AnyRows;

impl<const C: usize> RowProducts<C> for AnyRows {
    type Row = [f64; C];

    #[inline(always)]
    fn rows<const R: usize>(self, block: &Block<R, C>) -> [[f64; C]; R] {
        *block
    }

    #[inline(always)]
    fn double_rows<const R: usize>(self, block: &Block<R, C, f32>) -> [[f64; C]; R] {
        double(block)
    }

    #[inline(always)]
    fn add_product<const R: usize, const K: usize>(self, c: &mut Block<R, C>, a: &Block<R, K>, b: &[[f64; C]; K]) {
        add_product(c, a, b);
    }

    #[inline(always)]
    fn add_transposed_product<const R: usize, const K: usize>(
        self,
        c: &mut Block<K, C>,
        a: &Block<R, K>,
        b: &[[f64; C]; R],
    ) {
        add_transposed_product(c, a, b);
    }
}
