//! The smoother: block Gauss–Seidel, forward before the coarse correction and backward after it.
//!
//! With A = L + D + Lᵀ a forward sweep from zero is `x = (D + L)⁻¹ b`, and a backward sweep `x += (D + Lᵀ)⁻¹ (b − A x)`: one is the transpose of the
//! other, which makes the preconditioner symmetric. Sweeps are sequential, so for threads rows are cut into domains, by their number alone: L has the
//! blocks within a domain, and rows with blocks E outside are damped, with [`D̃ = D + ½ S`](super::border) on the diagonal, so that smoothing
//! converges for any domains.
//!
//! Smoothing takes the time of reading the matrix, so one of the two triangles is stored, in single precision, times a factor that brings its entries
//! near one: rounding changes a correction by 1e-7 of itself, which conjugate gradients do not notice. A sweep reads each block once and uses it
//! twice, for its row and, transposed, for its column: a forward sweep gives the residual as well,
//!
//! ```text
//! r = b − A x = −Lᵀ x − (E − ½ S) x,
//! ```
//!
//! and a backward sweep uses L x of the old x and Lᵀ x of the new one.

use super::block::{
    BadPivot, Block, add_transposed_apply, apply, inverse_of, scaled, single, subtract_apply, sum, zero,
};
use super::border::Border;
use super::parallel::{GRAIN, OneEach, Values, for_chunks, for_each_row, for_each_row_of};
use super::sparse::{BlockMatrix, Pattern, Rows, ahead};
use crate::error::Result;
use crate::operator::prefetch_all;
use std::cmp::Ordering;
use std::sync::Arc;

#[derive(Debug, Clone)]
pub(super) struct GaussSeidel<const N: usize> {
    /// Rows of a domain; the last may have fewer.
    domain: usize,
    lower: Pattern,
    blocks: Vec<Block<N, N, f32>>,
    /// E − ½ S.
    outside: BlockMatrix<N, N, f32>,
    /// D̃⁻¹; zero where D is not positive definite.
    inverses: Vec<Block<N, N, f32>>,
    /// `b − E x` of every row with blocks outside, for a backward sweep.
    borders: Vec<(u32, [f32; N])>,
    /// The nodes of a domain, for every thread.
    workspaces: Vec<Vec<Node<N>>>,
}

/// The data of a row during a sweep over its domain, which stays in the caches.
#[derive(Debug, Clone, Copy)]
struct Node<const N: usize> {
    x: [f32; N],
    /// r of a forward sweep; the remaining right-hand side of a backward one.
    rest: [f32; N],
}

impl<const N: usize> GaussSeidel<N> {
    pub fn new(pattern: &Pattern) -> Result<Self> {
        Self::with_domains(pattern, domain(pattern.rows()))
    }

    pub fn with_domains(pattern: &Pattern, domain: usize) -> Result<Self> {
        let rows = pattern.rows();
        let is_within = |row: usize, column: u32| column as usize / domain == row / domain;
        let lower = Pattern::build(rows, |row, columns| {
            let is_lower = |column: u32| (column as usize) < row && is_within(row, column);
            columns.extend(pattern.columns(row).iter().filter(|&&column| is_lower(column)));
        })?;
        let outside = Pattern::build(rows, |row, columns| {
            let before = columns.len();
            columns.extend(pattern.columns(row).iter().filter(|&&column| !is_within(row, column)));
            if columns.len() > before {
                columns.push(row as u32);
            }
        })?;
        let has_blocks = |row: &u32| !outside.row(*row as usize).is_empty();
        let borders = (0..rows as u32).filter(has_blocks).map(|row| (row, [0.0; N])).collect();
        Ok(Self {
            domain,
            blocks: vec![zero(); lower.blocks()],
            lower,
            outside: BlockMatrix::zeros(Arc::new(outside)),
            inverses: vec![zero(); rows],
            borders,
            workspaces: vec![vec![Node { x: [0.0; N], rest: [0.0; N] }; domain.min(rows)]],
        })
    }

    /// Sets the matrix `factor·A`; fails with the first row whose diagonal block is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) -> std::result::Result<(), (usize, BadPivot)> {
        let Self { domain, lower, blocks, outside, inverses, .. } = self;
        let BlockMatrix { pattern, values } = outside;
        let failed = zero();
        let inverse_or_failed = |block: &Block<N, N>| inverse_of(block).map_or(failed, |inverse| single(1.0, &inverse));
        for_each_row_of(
            0..lower.rows(),
            GRAIN,
            (Values(&*lower, blocks), (Values(&**pattern, values), OneEach(inverses))),
            #[inline(always)]
            |row, (lower, (outside, inverse))| {
                let mut places = lower.iter_mut();
                let keep = |block: &Block<N, N>| {
                    if let Some(place) = places.next() {
                        *place = single(factor, block);
                    }
                };
                *inverse = if outside.is_empty() {
                    inverse_or_failed(&visit_lower(a, row, factor, keep))
                } else {
                    let border = Border { row, start: row - row % *domain, length: *domain, factor };
                    let (diagonal, half) = border.update(a, pattern.columns(row), outside, keep);
                    if inverse_of(&diagonal).is_ok() { inverse_or_failed(&sum(&diagonal, &half)) } else { failed }
                };
            },
        );
        let Some(row) = inverses.iter().position(|inverse| *inverse == failed) else { return Ok(()) };
        inverse_of(&scaled(factor, &a.diagonal_block(row))).map(drop).map_err(|bad| (row, bad))
    }

    /// `D̃⁻¹` of a row of `factor·A`.
    #[inline(always)]
    pub fn inverse(&self, row: usize) -> Block<N, N, f32> {
        self.inverses[row]
    }

    /// `x = M⁻¹ b`, a forward sweep from zero, and `r = b − A x`.
    pub fn forward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]], r: &mut [[f32; N]]) {
        let Self { domain, lower, blocks, outside, inverses, workspaces, .. } = self;
        for_chunks(
            x,
            r,
            *domain,
            workspaces,
            #[inline(always)]
            |start, x, r, nodes| {
                for i in 0..x.len() {
                    let row = start + i;
                    prefetch(lower.values_of(blocks, row + ahead::<Block<N, N, f32>>()));
                    let row_blocks = (lower.columns(row), &blocks[lower.row(row)]);
                    x[i] = relax(b[row], &inverses[row], row_blocks, start, nodes);
                    nodes[i] = Node { x: x[i], rest: [0.0; N] };
                }
                r.iter_mut().zip(&*nodes).for_each(|(r, node)| *r = node.rest);
            },
        );
        if outside.values.is_empty() {
            return;
        }
        for_each_row(
            r,
            #[inline(always)]
            |row, r| {
                for (column, a) in outside.row(row) {
                    subtract_apply(r, a, &x[column]);
                }
            },
        );
    }

    /// `x += M⁻ᵀ (b − A x)`, a backward sweep.
    pub fn backward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let Self { domain, lower, blocks, outside, inverses, borders, workspaces } = self;
        for_each_row(
            borders,
            #[inline(always)]
            |_, (row, sum)| {
                *sum = b[*row as usize];
                for (column, a) in outside.row(*row as usize) {
                    subtract_apply(sum, a, &x[column]);
                }
            },
        );
        let none = &mut vec![(); x.len()];
        for_chunks(
            x,
            none,
            *domain,
            workspaces,
            #[inline(always)]
            |start, x, _, nodes| {
                for ((node, x), b) in nodes.iter_mut().zip(&*x).zip(&b[start..]) {
                    *node = Node { x: *x, rest: *b };
                }
                let end = start + x.len();
                let [first, last] = [start, end].map(|at| borders.partition_point(|(row, _)| (*row as usize) < at));
                for (row, sum) in &borders[first..last] {
                    nodes[*row as usize - start].rest = *sum;
                }
                for i in (0..x.len()).rev() {
                    let row = start + i;
                    prefetch(lower.values_of(blocks, row.wrapping_sub(ahead::<Block<N, N, f32>>())));
                    let row_blocks = (lower.columns(row), &blocks[lower.row(row)]);
                    x[i] = relax(nodes[i].rest, &inverses[row], row_blocks, start, nodes);
                    nodes[i].x = x[i];
                }
            },
        );
    }
}

/// Solves for a row, and subtracts its column from the rest of the rows before it.
#[inline(always)]
fn relax<const N: usize>(
    mut sum: [f32; N],
    inverse: &Block<N, N, f32>,
    (columns, blocks): (&[u32], &[Block<N, N, f32>]),
    start: usize,
    nodes: &mut [Node<N>],
) -> [f32; N] {
    for (&column, a) in columns.iter().zip(blocks) {
        subtract_apply(&mut sum, a, &nodes[column as usize - start].x);
    }
    let x = apply(inverse, &sum);
    for (&column, a) in columns.iter().zip(blocks) {
        add_transposed_apply(&mut nodes[column as usize - start].rest, a, &x.map(|x| -x));
    }
    x
}

#[inline(always)]
fn prefetch<const N: usize>(blocks: &[Block<N, N, f32>]) {
    prefetch_all(blocks.as_flattened().as_flattened());
}

/// Rows of a domain: fewer domains smooth better, more keep more threads busy.
fn domain(rows: usize) -> usize {
    rows.div_ceil((rows / 8192).clamp(1, 16)).max(1)
}

/// The diagonal block of a row of `factor·A`; `before` gets the blocks of A before it.
#[inline(always)]
fn visit_lower<const N: usize>(
    a: &impl Rows<N>,
    row: usize,
    factor: f64,
    mut before: impl FnMut(&Block<N, N>),
) -> Block<N, N> {
    let mut diagonal = zero();
    a.visit(
        row,
        #[inline(always)]
        |column, block| match column.cmp(&row) {
            Ordering::Less => before(block),
            Ordering::Equal => diagonal = scaled(factor, block),
            Ordering::Greater => (),
        },
    );
    diagonal
}

#[cfg(test)]
mod tests;
