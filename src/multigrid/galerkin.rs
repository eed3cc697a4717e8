//! The coarse matrix `A_c = Pᵀ A P`: sparsity once, numbers many times.

use super::block::{add_product, add_transposed_product, zero};
use super::parallel::for_each_sparse_row;
use super::prolongator::Prolongator;
use super::sparse::{BlockMatrix, Pattern};
use crate::error::Result;

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
        let members = |row| prolongator.transpose.column(row).iter();
        let coarse = Pattern::build(
            columns,
            union(columns, |row| members(row).map(|&(node, _)| product.columns(node as usize))),
        )?;
        Ok(Self { product: BlockMatrix::zeros(product), coarse: BlockMatrix::zeros(coarse) })
    }

    /// Recomputes A P and A_c. A motion that an aggregate does not have gets the equation x = 0.
    pub fn update(&mut self, a: &BlockMatrix<N, N>, prolongator: &Prolongator<N, M>) {
        let p = &prolongator.matrix;
        let BlockMatrix { pattern, values } = &mut self.product;
        for_each_sparse_row(pattern, values, &|row, sums| {
            sums.fill(zero());
            for (node, a) in a.row(row) {
                let mut slots = pattern.columns(row).iter().zip(&mut *sums);
                for (column, p) in p.row(node) {
                    // Both lists of columns ascend, and the row's holds all of the node's.
                    if let Some((_, sum)) = slots.find(|&(&c, _)| c as usize == column) {
                        add_product(sum, a, p);
                    }
                }
            }
        });
        let product = &self.product;
        let BlockMatrix { pattern, values } = &mut self.coarse;
        for_each_sparse_row(pattern, values, &|row, sums| {
            sums.fill(zero());
            for &(node, position) in prolongator.transpose.column(row) {
                let p = &p.values[position as usize];
                let mut slots = pattern.columns(row).iter().zip(&mut *sums);
                for (column, product) in product.row(node as usize) {
                    if let Some((_, sum)) = slots.find(|&(&c, _)| c as usize == column) {
                        add_transposed_product(sum, p, product);
                    }
                }
            }
            let diagonal = pattern.columns(row).iter().zip(sums).find(|&(&column, _)| column as usize == row);
            if let Some((_, block)) = diagonal {
                for motion in (0..M).filter(|&motion| !prolongator.modes[row].has(motion)) {
                    block[motion][motion] = 1.0;
                }
            }
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.product.bytes() + self.coarse.bytes()
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
