//! The coarse matrix `A_c = Pᵀ A P + ε Tᵀ A T`: sparsity once, numbers many times.
//!
//! `Pᵀ A P` alone is what smoothed aggregation has. But a motion e of the aggregates for which `T e` belongs to an eigenvalue λ of D⁻¹A with ωλ near
//! 1 is smoothed away: `P e = (1 − ωλ) T e` is mostly rounding errors, its energy is `(1 − ωλ)²` times that of `T e`, and its correction by the
//! coarse level is rounding errors divided by that. It may be shared by many aggregates, so no single one shows it, but the energy before smoothing
//! does: with ε of it added, the energy of e is at least ε times that of T e, its correction is bounded by `(1 − ωλ)²/ε` of what T e would need, and
//! the rounding errors of P, in single precision, are at most 6e-8/ε of it. Motions to be corrected here have little energy before smoothing, a few
//! times that after it: for them ε changes nothing.
//!
//! Both terms are positive semidefinite where A is, so a failure of `A_c` proves that A is indefinite. The diagonal blocks and those after them are
//! summed up; the others are their transposes.

use super::block::{Block, add_product, add_transposed_product, double, scaled, transposed, zero};
use super::parallel::{Starts as _, Values, for_each_row_of};
use super::prolongator::Prolongator;
use super::sparse::{BlockMatrix, Pattern, Rows};
use crate::error::Result;
use std::ops::Range;
use std::sync::Arc;

/// ε. A tenth of it changes iteration counts as little, and leaves a digit less of the corrections near ωλ = 1.
pub(super) const UNSMOOTHED: f64 = 1e-3;

const SECTION: usize = 4096;

/// Least rows of A_c for a thread: few of them have a part in a section.
const GRAIN: usize = 64;

/// The triple products. A P and A T take several times the memory of P, so they are computed section by section.
#[derive(Debug, Clone)]
pub(super) struct Galerkin<const N: usize, const M: usize> {
    product: Pattern,
    sections: Vec<Section>,
    section: Vec<Block<N, M>>,
    pub coarse: BlockMatrix<M, M>,
}

/// Consecutive rows of A P, and the range of rows of A_c that they add to.
#[derive(Debug, Clone)]
struct Section {
    rows: Range<usize>,
    coarse: Range<usize>,
}

impl<const N: usize, const M: usize> Galerkin<N, M> {
    pub fn new(a: &Pattern, prolongator: &Prolongator<N, M>) -> Result<Self> {
        let p = &prolongator.matrix.pattern;
        let columns = prolongator.columns();
        let reached = |row| a.columns(row).iter().flat_map(|&node| p.columns(node as usize)).copied();
        let product = Pattern::union(a.rows(), columns, reached)?;
        let coupled = |row| prolongator.column(row).flat_map(|(node, _)| product.columns(node)).copied();
        let coarse = Pattern::union(columns, columns, coupled)?;
        let rows = || (0..a.rows()).step_by(SECTION).map(|start| start..a.rows().min(start + SECTION));
        let columns_of = |pattern: &Pattern, rows: Range<usize>| {
            let columns = || rows.clone().flat_map(|row| pattern.columns(row)).map(|&column| column as usize);
            columns().min().unwrap_or(0)..columns().max().map_or(0, |last| last + 1)
        };
        let sections: Vec<_> = rows().map(|rows| Section { coarse: columns_of(p, rows.clone()), rows }).collect();
        let blocks =
            |section: &Section| [&product, prolongator.coupled()].map(|pattern| pattern.positions(&section.rows).len());
        let largest = sections.iter().map(|section| blocks(section).iter().sum()).max().unwrap_or(0);
        let (section, coarse) = (vec![zero(); largest], BlockMatrix::zeros(Arc::new(coarse)));
        Ok(Self { product, sections, section, coarse })
    }

    /// Recomputes A_c. An absent motion of an aggregate gets the equation x = 0.
    pub fn update(&mut self, a: &impl Rows<N>, prolongator: &Prolongator<N, M>) {
        let (p, coupled) = (&prolongator.matrix, prolongator.coupled());
        let Self { product, sections, section, coarse: BlockMatrix { pattern, values } } = self;
        values.fill(zero());
        for Section { rows, coarse } in sections {
            let both = [&*product, coupled];
            let first = both.start(rows.start);
            let section = &mut section[..both.start(rows.end) - first];
            for_each_row_of(
                rows.clone(),
                GRAIN,
                Values(&both, section),
                #[inline(always)]
                |row, sums| {
                    sums.fill(zero());
                    let (smoothed, tentative) = sums.split_at_mut(product.columns(row).len());
                    a.visit(
                        row,
                        #[inline(always)]
                        |node, a| {
                            let mut slots = Slots::new(product.columns(row), smoothed);
                            for (column, p) in p.row(node) {
                                if let Some(sum) = slots.find(column) {
                                    add_product(sum, a, &double(p));
                                }
                            }
                            if let Some((column, t)) = prolongator.tentative_row(node)
                                && let Some(sum) = Slots::new(coupled.columns(row), tentative).find(column as usize)
                            {
                                add_product(sum, a, &double(t));
                            }
                        },
                    );
                },
            );
            let values = &mut values[pattern.positions(coarse)];
            for_each_row_of(
                coarse.clone(),
                GRAIN,
                Values(&**pattern, values),
                #[inline(always)]
                |row, sums| {
                    for (node, of_node) in prolongator.column_within(row, rows.clone()) {
                        let blocks = &section[both.start(node) - first..both.start(node + 1) - first];
                        let (smoothed, tentative) = blocks.split_at(product.columns(node).len());
                        let sums = &mut UpperRow { row, columns: pattern.columns(row), blocks: sums };
                        add(sums, &double(of_node), product.columns(node), smoothed);
                        if let Some((aggregate, t)) = prolongator.tentative_row(node)
                            && aggregate as usize == row
                        {
                            let t = scaled(UNSMOOTHED, &double(t));
                            add(sums, &t, coupled.columns(node), tentative);
                        }
                    }
                },
            );
        }
        mirror(pattern, values);
        for row in 0..pattern.rows() {
            if let Some(block) = Slots::new(pattern.columns(row), &mut values[pattern.row(row)]).find(row) {
                for motion in (0..M).filter(|&motion| !prolongator.modes[row].has(motion)) {
                    block[motion][motion] = 1.0;
                }
            }
        }
    }
}

/// A row of A_c, of which the diagonal block and those after it are summed up.
struct UpperRow<'r, const M: usize> {
    row: usize,
    columns: &'r [u32],
    blocks: &'r mut [Block<M, M>],
}

/// Adds `Pᵀ B` for a block P and the columns and blocks of a row B.
#[inline(always)]
fn add<const N: usize, const M: usize>(
    sums: &mut UpperRow<M>,
    p: &Block<N, M>,
    columns: &[u32],
    blocks: &[Block<N, M>],
) {
    let mut slots = Slots::new(sums.columns, sums.blocks);
    for (&column, block) in columns.iter().zip(blocks) {
        if column as usize >= sums.row
            && let Some(sum) = slots.find(column as usize)
        {
            add_transposed_product(sum, p, block);
        }
    }
}

/// Completes a symmetric matrix: the blocks before the diagonal are the transposes of those after it.
fn mirror<const M: usize>(pattern: &Pattern, values: &mut [Block<M, M>]) {
    for row in 0..pattern.rows() {
        let (done, mine) = values.split_at_mut(pattern.row(row).start);
        for (&column, block) in
            pattern.columns(row).iter().zip(mine).take_while(|(column, _)| (**column as usize) < row)
        {
            let other = column as usize;
            if let Ok(place) = pattern.columns(other).binary_search(&(row as u32)) {
                *block = transposed(&done[pattern.row(other).start + place]);
            }
        }
    }
}

/// The blocks of a row, found by ascending columns.
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
