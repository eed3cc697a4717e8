//! The coarse matrix `A_c = Pᵀ A P`: sparsity once, numbers many times.

use super::block::{Block, add_product, add_transposed_product, double, zero};
use super::parallel::for_each_sparse_row;
use super::prolongator::Prolongator;
use super::sparse::{BlockMatrix, Pattern, Rows};
use crate::error::Result;
use std::sync::Arc;

/// The triple product with its intermediate A P.
#[derive(Debug, Clone)]
pub(super) struct Galerkin<const N: usize, const M: usize> {
    /// A P.
    pub product: BlockMatrix<N, M>,
    /// A_c.
    pub coarse: BlockMatrix<M, M>,
}

impl<const N: usize, const M: usize> Galerkin<N, M> {
    /// The patterns of A P and A_c.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, prolongator: &Prolongator<N, M>) -> Result<Self> {
        let p = &prolongator.matrix.pattern;
        let columns = prolongator.columns();
        let product = Pattern::build(
            a.rows(),
            union(columns, |row| a.columns(row).iter().map(|&node| p.columns(node as usize))),
        )?;
        let coarse = Pattern::build(
            columns,
            union(columns, |row| prolongator.column(row).map(|(node, _)| product.columns(node))),
        )?;
        Ok(Self { product: BlockMatrix::zeros(Arc::new(product)), coarse: BlockMatrix::zeros(Arc::new(coarse)) })
    }

    /// Recomputes A P and A_c. A motion that an aggregate does not have gets the equation x = 0.
    pub fn update(&mut self, a: &impl Rows<N>, prolongator: &Prolongator<N, M>) {
        let p = &prolongator.matrix;
        let BlockMatrix { pattern, values } = &mut self.product;
        for_each_sparse_row(pattern, values, &mut vec![(); pattern.rows()], &|row, sums, ()| {
            sums.fill(zero());
            a.visit(row, |node, a| {
                let mut slots = Slots::new(pattern.columns(row), sums);
                for (column, p) in p.row(node) {
                    if let Some(sum) = slots.find(column) {
                        add_product(sum, a, &double(p));
                    }
                }
            });
        });
        let product = &self.product;
        let BlockMatrix { pattern, values } = &mut self.coarse;
        for_each_sparse_row(pattern, values, &mut vec![(); pattern.rows()], &|row, sums, ()| {
            sums.fill(zero());
            for (node, p) in prolongator.column(row) {
                let p = double(p);
                let mut slots = Slots::new(pattern.columns(row), sums);
                for (column, product) in product.row(node) {
                    if let Some(sum) = slots.find(column) {
                        add_transposed_product(sum, &p, product);
                    }
                }
            }
            if let Some(block) = Slots::new(pattern.columns(row), sums).find(row) {
                for motion in (0..M).filter(|&motion| !prolongator.modes[row].has(motion)) {
                    block[motion][motion] = 1.0;
                }
            }
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let patterns = self.product.pattern.bytes() + self.coarse.pattern.bytes();
        patterns + self.product.bytes() + self.coarse.bytes()
    }
}

/// The blocks of a row, to be found by columns that ascend.
struct Slots<'r, const R: usize, const C: usize> {
    columns: &'r [u32],
    blocks: &'r mut [Block<R, C>],
    next: usize,
}

impl<'r, const R: usize, const C: usize> Slots<'r, R, C> {
    fn new(columns: &'r [u32], blocks: &'r mut [Block<R, C>]) -> Self {
        Self { columns, blocks, next: 0 }
    }

    #[inline(always)]
    fn find(&mut self, column: usize) -> Option<&mut Block<R, C>> {
        while *self.columns.get(self.next)? as usize != column {
            self.next += 1;
        }
        self.blocks.get_mut(self.next)
    }
}

/// Fills the columns of a row with the union of lists of columns below `columns`.
fn union<'p, L: Iterator<Item = &'p [u32]>>(
    columns: usize,
    lists: impl Fn(usize) -> L,
) -> impl FnMut(usize, &mut Vec<u32>) {
    let mut last_seen = vec![u32::MAX; columns];
    move |row, united| {
        for &column in lists(row).flatten() {
            let seen = &mut last_seen[column as usize];
            if *seen != row as u32 {
                *seen = row as u32;
                united.push(column);
            }
        }
    }
}
