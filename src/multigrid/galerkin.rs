//! The coarse matrix `A_c = Pᵀ A P + ε Tᵀ A T`: sparsity once, numbers many times.
//!
//! `Pᵀ A P` alone is what smoothed aggregation has. But a motion e of the aggregates for which `T e` belongs to an eigenvalue λ of
//! D⁻¹A with ωλ near 1 is smoothed away: `P e = (1 − ωλ) T e` is nothing but rounding errors, its energy is
//! `(1 − ωλ)²` times that of `T e`, and the correction that the coarse level finds for it is rounding errors divided by that. Two
//! particles that move together sideways are enough. Such a motion must not enter the coarse level. It may be shared by many
//! aggregates, so no look at one of them finds it, but the energy before smoothing tells: with ε of it added, the
//! energy of e is at least ε times that of T e, its correction is bounded by `(1 − ωλ)²/ε` of what T e would need, and the
//! errors of single precision are at most 1e-7/ε of it. Motions that are meant to be corrected here have little energy before
//! smoothing, a few times what they have after it: for them ε changes nothing.
//!
//! Both terms are positive semidefinite where A is, so `A_c` is refused only if A is indefinite.

mod rows;
#[cfg(target_arch = "x86_64")]
mod six;

use super::block::{Block, double, scaled, zero};
use super::parallel::for_each_row_of;
use super::prolongator::Prolongator;
use super::sparse::{BlockMatrix, Pattern, Rows};
use crate::error::Result;
use rows::{General, RowProducts};
use std::ops::Range;
use std::sync::Arc;

/// ε. Ten times less changes iteration counts as little, and leaves a digit less of the corrections near ωλ = 1.
pub(super) const UNSMOOTHED: f64 = 1e-3;

/// Rows of A P that are held at once.
const SECTION: usize = 16_384;

/// Rows of A_c that one thread sums up at a stretch: few of them have a part in a section.
const GRAIN: usize = 64;

/// Aggregates around a node that are added up before they go to a row of A_c.
const FEW: usize = 6;

/// The triple product. Its intermediate A P takes several times the memory of P, so it is made section by section.
#[derive(Debug, Clone)]
pub(super) struct Galerkin<const N: usize, const M: usize> {
    /// Which blocks A P has.
    product: Pattern,
    sections: Vec<Section>,
    /// The blocks of one section of A P.
    section: Vec<Block<N, M>>,
    /// A_c.
    pub coarse: BlockMatrix<M, M>,
    /// Multiplications of numbers in `Pᵀ A P`.
    pub multiplications: f64,
}

/// Consecutive rows of A P, and the range of rows of A_c that they add to.
#[derive(Debug, Clone)]
struct Section {
    rows: Range<usize>,
    coarse: Range<usize>,
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
        let section = |start: usize| {
            let rows = start..a.rows().min(start + SECTION);
            let touched = || rows.clone().flat_map(|row| p.columns(row)).map(|&column| column as usize);
            let coarse = touched().min().unwrap_or(0)..touched().max().map_or(0, |last| last + 1);
            Section { rows, coarse }
        };
        let sections: Vec<_> = (0..a.rows()).step_by(SECTION).map(section).collect();
        let largest = sections.iter().map(|section| product.positions(&section.rows).len()).max().unwrap_or(0);
        let multiplications = (0..a.rows()).map(|row| {
            let of_neighbours: usize = a.columns(row).iter().map(|&node| p.row(node as usize).len()).sum();
            let transposed = p.row(row).len() * product.row(row).len();
            (N * N * M * of_neighbours + N * M * M * transposed) as f64
        });
        let multiplications = multiplications.sum();
        let (section, coarse) = (vec![zero(); largest], BlockMatrix::zeros(Arc::new(coarse)));
        Ok(Self { product, sections, section, coarse, multiplications })
    }

    /// Recomputes A_c. A motion that an aggregate does not have gets the equation x = 0.
    pub fn update(&mut self, a: &impl Rows<N>, prolongator: &Prolongator<N, M>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(six) = six::Six::of(M) {
            return self.update_with(six, a, prolongator);
        }
        self.update_with(General, a, prolongator);
    }

    fn update_with(&mut self, products: impl RowProducts<M>, a: &impl Rows<N>, prolongator: &Prolongator<N, M>) {
        let p = &prolongator.matrix;
        let Self { product, sections, section, coarse: BlockMatrix { pattern, values }, .. } = self;
        values.fill(zero());
        for Section { rows, coarse } in sections {
            let positions = product.positions(rows);
            let section = &mut section[..positions.len()];
            for_each_row_of(
                product,
                rows.clone(),
                GRAIN,
                section,
                #[inline(always)]
                |row, sums| {
                    sums.fill(zero());
                    a.visit(
                        row,
                        #[inline(always)]
                        |node, a| {
                            let mut slots = Slots::new(product.columns(row), sums);
                            for (column, p) in p.row(node) {
                                if let Some(sum) = slots.find(column) {
                                    products.add_product(sum, a, &products.double_rows(p));
                                }
                            }
                        },
                    );
                },
            );
            let values = &mut values[pattern.positions(coarse)];
            for_each_row_of(
                pattern,
                coarse.clone(),
                GRAIN,
                values,
                #[inline(always)]
                |row, sums| {
                    for (node, p) in prolongator.column_within(row, rows.clone()) {
                        let p = double(p);
                        let mut slots = Slots::new(pattern.columns(row), sums);
                        let of_node = product.row(node);
                        let blocks = &section[of_node.start - positions.start..of_node.end - positions.start];
                        for (&column, product) in product.columns(node).iter().zip(blocks) {
                            if let Some(sum) = slots.find(column as usize) {
                                products.add_transposed_product(sum, &p, &products.rows(product));
                            }
                        }
                    }
                },
            );
        }
        for_each_row_of(
            pattern,
            0..pattern.rows(),
            GRAIN,
            values,
            #[inline(always)]
            |row, sums| {
                for (node, t) in prolongator.tentative_column(row) {
                    let t: Block<N, M> = double(t);
                    // A node has many neighbours in few aggregates: A T is added up by these first.
                    let mut count = 0;
                    let mut sums_of = [(0, zero()); FEW];
                    a.visit(
                        node,
                        #[inline(always)]
                        |other, a| {
                            let Some((aggregate, of_other)) = prolongator.tentative_row(other) else { return };
                            let found = sums_of[..count].iter().position(|&(known, _)| known == aggregate);
                            let at = found.unwrap_or(count);
                            if at == FEW {
                                let (aggregate, product) = sums_of[FEW - 1];
                                add(products, pattern.columns(row), sums, aggregate, &t, &product);
                            }
                            let at = at.min(FEW - 1);
                            if found.is_none() {
                                sums_of[at] = (aggregate, zero());
                                count = at + 1;
                            }
                            products.add_product(&mut sums_of[at].1, &scaled(UNSMOOTHED, a), &products.double_rows(of_other));
                        },
                    );
                    for (aggregate, product) in &sums_of[..count] {
                        add(products, pattern.columns(row), sums, *aggregate, &t, product);
                    }
                }
                if let Some(block) = Slots::new(pattern.columns(row), sums).find(row) {
                    for motion in (0..M).filter(|&motion| !prolongator.modes[row].has(motion)) {
                        block[motion][motion] = 1.0;
                    }
                }
            },
        );
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let patterns = self.product.bytes() + self.coarse.pattern.bytes();
        patterns + size_of_val(&self.section[..]) + size_of_val(&self.sections[..]) + self.coarse.bytes()
    }
}

/// `A_c += Tᵀ (A T)` in one block of a row with these columns.
#[inline(always)]
fn add<const N: usize, const M: usize>(
    products: impl RowProducts<M>,
    columns: &[u32],
    sums: &mut [Block<M, M>],
    aggregate: u32,
    t: &Block<N, M>,
    product: &Block<N, M>,
) {
    if let Ok(slot) = columns.binary_search(&aggregate)
        && let Some(sum) = sums.get_mut(slot)
    {
        products.add_transposed_product(sum, t, &products.rows(product));
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
