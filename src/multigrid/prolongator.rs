//! The prolongator P from aggregates to nodes: tentative, then smoothed.
//!
//! `P = (I − ω D⁻¹A) T` with `ω = 4/(3 λ_max(D⁻¹A))` and D the diagonal blocks of A: one step of damped block Jacobi takes the
//! jumps between aggregates out of T, so that a coarse motion costs little energy (Vaněk, Mandel, Brezina 1996, section 4).

use super::aggregate::Aggregates;
use super::block::{Block, add_apply, add_product, add_transposed_apply, apply, zero};
use super::modes::{AggregateModes, Frame};
use super::parallel::{for_each_row, for_each_sparse_row};
use super::sparse::{BlockMatrix, Pattern, Transpose};
use crate::error::Result;

/// The smoothed prolongator of a level, with the modes of its aggregates.
#[derive(Debug, Clone)]
pub(super) struct Prolongator<const N: usize, const M: usize> {
    aggregates: Aggregates,
    /// Members of every aggregate: positions in `members`, and the nodes.
    starts: Vec<usize>,
    members: Vec<u32>,
    pub modes: Vec<AggregateModes<M>>,
    pub matrix: BlockMatrix<N, M>,
    pub transpose: Transpose,
}

impl<const N: usize, const M: usize> Prolongator<N, M> {
    /// The pattern of P for a matrix of pattern `a`; all values zero.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, aggregates: Aggregates) -> Result<Self> {
        let count = aggregates.count();
        let mut last_seen = vec![u32::MAX; count];
        let pattern = Pattern::build(a.rows(), |row, columns| {
            for aggregate in a.columns(row).iter().filter_map(|&node| aggregates.of_node(node as usize)) {
                if last_seen[aggregate as usize] != row as u32 {
                    last_seen[aggregate as usize] = row as u32;
                    columns.push(aggregate);
                }
            }
        })?;
        let mut starts = vec![0usize; count + 1];
        let of_nodes =
            || (0..a.rows()).filter_map(|node| aggregates.of_node(node).map(|aggregate| (node, aggregate as usize)));
        of_nodes().for_each(|(_, aggregate)| starts[aggregate + 1] += 1);
        (0..count).for_each(|aggregate| starts[aggregate + 1] += starts[aggregate]);
        let mut members = vec![0; starts[count]];
        let mut next = starts.clone();
        for (node, aggregate) in of_nodes() {
            members[next[aggregate]] = node as u32;
            next[aggregate] += 1;
        }
        let transpose = pattern.transpose(count);
        let modes = vec![AggregateModes::NOTHING; count];
        Ok(Self { aggregates, starts, members, modes, matrix: BlockMatrix::zeros(pattern), transpose })
    }

    /// Recomputes the modes of the aggregates and P. `inverses` holds D⁻¹; `tentative` is scratch, at least one block a node.
    pub fn update(
        &mut self,
        a: &BlockMatrix<N, N>,
        inverses: &[Block<N, N>],
        damping: f64,
        frames: &[Frame<N, M>],
        tentative: &mut [Block<N, M>],
    ) {
        let Self { aggregates, starts, members, modes, matrix, .. } = self;
        for_each_row(modes, |aggregate, modes| {
            let members = &members[starts[aggregate]..starts[aggregate + 1]];
            *modes = AggregateModes::of(members.iter().map(|&node| &frames[node as usize]));
        });
        let tentative = &mut tentative[..frames.len()];
        for_each_row(tentative, |node, t| {
            *t =
                aggregates.of_node(node).map_or(zero(), |aggregate| modes[aggregate as usize].tentative(&frames[node]));
        });
        let BlockMatrix { pattern, values } = matrix;
        for_each_sparse_row(pattern, values, &|row, p| {
            let columns = pattern.columns(row);
            let slot =
                |node| aggregates.of_node(node).and_then(|aggregate| columns.iter().position(|&c| c == aggregate));
            p.fill(zero());
            for (node, a) in a.row(row) {
                if let Some(slot) = slot(node) {
                    add_product(&mut p[slot], a, &tentative[node]);
                }
            }
            for p in p.iter_mut() {
                let mut smoothed = zero();
                add_product(&mut smoothed, &inverses[row], p);
                *p = smoothed.map(|row| row.map(|value| -damping * value));
            }
            if let Some(slot) = slot(row) {
                for (p, t) in p[slot].iter_mut().flatten().zip(tentative[row].as_flattened()) {
                    *p += t;
                }
            }
        });
    }

    /// Number of aggregates.
    pub fn columns(&self) -> usize {
        self.modes.len()
    }

    /// The first node of an aggregate.
    pub fn member(&self, aggregate: usize) -> usize {
        self.starts.get(aggregate).and_then(|&at| self.members.get(at)).map_or(0, |&node| node as usize)
    }

    /// `r_c = Pᵀ r`.
    pub fn restrict(&self, r: &[[f64; N]], coarse: &mut [[f64; M]]) {
        for_each_row(coarse, |aggregate, sum| {
            *sum = [0.0; M];
            for &(node, position) in self.transpose.column(aggregate) {
                add_transposed_apply(sum, &self.matrix.values[position as usize], &r[node as usize]);
            }
        });
    }

    /// `x += P e`.
    pub fn prolong(&self, coarse: &[[f64; M]], x: &mut [[f64; N]]) {
        for_each_row(x, |row, x| {
            for (aggregate, p) in self.matrix.row(row) {
                add_apply(x, p, &coarse[aggregate]);
            }
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.aggregates.bytes()
            + size_of_val(&self.starts[..])
            + size_of_val(&self.members[..])
            + size_of_val(&self.modes[..])
            + self.matrix.bytes()
            + self.transpose.bytes()
    }
}

/// An estimate of λ_max(D⁻¹A) by the power method, kept from one matrix to the next.
#[derive(Debug, Clone)]
pub(super) struct LargestEigenvalue<const N: usize> {
    /// Approximates the eigenvector.
    vector: Vec<[f64; N]>,
    product: Vec<[f64; N]>,
    iterations: usize,
}

impl<const N: usize> LargestEigenvalue<N> {
    /// Iterations for the first matrix, and for each later one, which starts from what is known.
    const FIRST: usize = 12;
    const LATER: usize = 3;

    /// Starts from a vector without pattern.
    pub fn new(rows: usize) -> Self {
        // The fractional parts of multiples of the golden ratio are spread evenly; centred, they favour no mode.
        let entry = |index: usize| (index as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        let vector = (0..rows).map(|row| std::array::from_fn(|k| entry(row * N + k + 1))).collect();
        Self { vector, product: vec![[0.0; N]; rows], iterations: Self::FIRST }
    }

    /// The Rayleigh quotient `uᵀAu/uᵀDu` would need D; the growth `‖D⁻¹A u‖/‖u‖` serves as well.
    pub fn update(&mut self, a: &BlockMatrix<N, N>, inverses: &[Block<N, N>]) -> f64 {
        let mut growth = 0.0;
        for _ in 0..std::mem::replace(&mut self.iterations, Self::LATER) {
            let Self { vector, product, .. } = self;
            let norm = norm(vector);
            for_each_row(product, |row, y| {
                let mut sum = [0.0; N];
                for (column, a) in a.row(row) {
                    add_apply(&mut sum, a, &vector[column]);
                }
                *y = apply(&inverses[row], &sum).map(|y| y / norm);
            });
            std::mem::swap(&mut self.vector, &mut self.product);
            growth = self::norm(&self.vector);
        }
        growth
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.vector[..]) + size_of_val(&self.product[..])
    }
}

fn norm<const N: usize>(x: &[[f64; N]]) -> f64 {
    x.iter().flatten().map(|x| x * x).sum::<f64>().sqrt()
}
