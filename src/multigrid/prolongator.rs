//! The prolongator P from aggregates to nodes: tentative, then smoothed.
//!
//! `P = (I − ω D⁻¹A) T` with `ω = 4/(3 λ_max(D⁻¹A))` and D the diagonal blocks of A: one step of damped block Jacobi takes the
//! jumps between aggregates out of T, so that a coarse motion costs little energy (Vaněk, Mandel, Brezina 1996, section 4). Of A what couples a
//! node weakly to other aggregates is left out, see `filter`: P is sparser, and nearly as good.
//!
//! λ_max is not computed but bounded: a spring's block B is positive semidefinite where A is of use, and
//! `(x_i − x_j)ᵀ B (x_i − x_j) ≤ 2 x_iᵀ B x_i + 2 x_jᵀ B x_j`; summed over the springs, `xᵀA x ≤ 2 xᵀD x`, so `λ_max ≤ 2`. Where the power
//! method says 1.7 to 1.8, using 2 changes iteration counts by at most two, on coarse levels too, where 1.6 to 1.7 is usual. Any ω gives
//! a preconditioner that is positive definite, up to rounding. That is small unless an eigenvalue λ of D⁻¹A that belongs to motions
//! of aggregates has ωλ near 1: their P is 1 − ωλ times the motion. `galerkin` keeps these out of the coarse level.

mod filter;

use super::aggregate::Aggregates;
use super::block::{Block, add_apply, add_product, add_transposed_apply, settled, single, sum, zero};
use super::gauss_seidel::GaussSeidel;
use super::graph::Graph;
use super::modes::{AggregateModes, Frames};
use super::parallel::{GRAIN, Values, for_each_row, for_each_row_of};
use super::sparse::{BlockMatrix, Pattern, Rows, Transpose, ahead};
use crate::error::Result;
use crate::operator::prefetch_all;
use filter::Filter;
use std::ops::Range;

/// ω, for `λ_max = 2`.
const OMEGA: f32 = 2.0 / 3.0;

/// How many blocks ahead of their use those by columns are asked for, as [rows](ahead) are.
const BLOCKS_AHEAD: usize = 64;

/// Blocks of a row that are added up at once; more take another pass through the row of A.
const AT_ONCE: usize = 8;

/// The smoothed prolongator of a level, with the modes of its aggregates.
#[derive(Debug, Clone)]
pub(super) struct Prolongator<const N: usize, const M: usize> {
    aggregates: Aggregates,
    /// Members of every aggregate: positions in `members`, and the nodes.
    starts: Vec<usize>,
    members: Vec<u32>,
    pub modes: Vec<AggregateModes<M>>,
    /// T, the one block of every row.
    tentative: Vec<Block<N, M, f32>>,
    filter: Filter,
    /// P.
    pub matrix: BlockMatrix<N, M, f32>,
    pub transpose: Transpose,
    /// The blocks of P by columns: read in order they come twice as fast.
    by_columns: Vec<Block<N, M, f32>>,
}

impl<const N: usize, const M: usize> Prolongator<N, M> {
    /// The pattern of P for a matrix of pattern `a`; all values zero.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, graph: &Graph, aggregates: Aggregates) -> Result<Self> {
        let count = aggregates.count();
        let filter = Filter::new(a, graph, &aggregates)?;
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
        let pattern = filter.reached.clone();
        let transpose = pattern.transpose(count);
        let by_columns = vec![zero(); pattern.blocks()];
        let modes = vec![AggregateModes::NOTHING; count];
        let tentative = vec![zero(); a.rows()];
        Ok(Self {
            aggregates,
            starts,
            members,
            modes,
            tentative,
            matrix: BlockMatrix::zeros(pattern),
            filter,
            transpose,
            by_columns,
        })
    }

    /// Recomputes the modes of the aggregates, and P with the D of a smoother that has `factor·A`.
    ///
    /// In single precision: errors in P cost energy by their square, and the coarse matrix is that of the P at hand.
    pub fn update(
        &mut self,
        a: &impl Rows<N>,
        factor: f64,
        smoother: &GaussSeidel<N>,
        frames: &(impl Frames<N, M> + ?Sized),
    ) {
        let Self { aggregates, starts, members, modes, tentative, filter, matrix, transpose, by_columns } = self;
        for_each_row(
            modes,
            #[inline(always)]
            |aggregate, modes| {
                let members = &members[starts[aggregate]..starts[aggregate + 1]];
                *modes = AggregateModes::of(members.iter().map(|&node| frames.frame(node as usize)));
            },
        );
        for_each_row(
            tentative,
            #[inline(always)]
            |node, t| {
                let of_aggregate =
                    |aggregate: u32| single(1.0, &modes[aggregate as usize].tentative(&frames.frame(node)));
                *t = aggregates.of_node(node).map_or(zero(), of_aggregate);
            },
        );
        let BlockMatrix { pattern, values } = matrix;
        for_each_row_of(
            0..pattern.rows(),
            GRAIN,
            Values(&**pattern, values),
            #[inline(always)]
            |row, p| {
                let mut damped = smoother.inverse(row);
                damped.as_flattened_mut().iter_mut().for_each(|entry| *entry *= -OMEGA);
                let stand_in = filter.stand_in(row);
                for (columns, p) in pattern.columns(row).chunks(AT_ONCE).zip(p.chunks_mut(AT_ONCE)) {
                    let mut sums = [zero(); AT_ONCE];
                    let substituted = columns.iter().position(|&column| column == stand_in);
                    let mut left_out: Option<Block<N, M>> = None;
                    a.visit(
                        row,
                        #[inline(always)]
                        |node, a| {
                            let Some(aggregate) = aggregates.of_node(node) else { return };
                            if let Some(slot) = columns.iter().position(|&column| column == aggregate) {
                                add_product(&mut sums[slot], &single(factor, a), &tentative[node]);
                            } else if substituted.is_some() && filter.leaves_out(row, aggregate) {
                                let fixed = modes[stand_in as usize].followed_by(&frames.frame(node));
                                add_product(left_out.get_or_insert(zero()), a, &fixed);
                            }
                        },
                    );
                    if let (Some(slot), Some(left_out)) = (substituted, left_out) {
                        let left_out = single(factor, &modes[stand_in as usize].normalised(&left_out));
                        sums[slot] = sum(&sums[slot], &left_out);
                    }
                    for ((p, sum), &aggregate) in p.iter_mut().zip(&sums).zip(columns) {
                        let is_own = aggregates.of_node(row) == Some(aggregate);
                        let mut smoothed = if is_own { tentative[row] } else { zero() };
                        add_product(&mut smoothed, &damped, sum);
                        *p = settled(&smoothed);
                    }
                }
            },
        );
        let values = &matrix.values;
        for_each_row(
            by_columns,
            #[inline(always)]
            |place, p| *p = values[transpose.entry(place).1 as usize],
        );
    }

    /// Nodes and blocks of a column of P.
    #[inline(always)]
    pub fn column(&self, aggregate: usize) -> impl Iterator<Item = (usize, &Block<N, M, f32>)> {
        self.blocks_at(self.transpose.column(aggregate))
    }

    /// Nodes and blocks of a column of P within some rows.
    #[inline(always)]
    pub fn column_within(
        &self,
        aggregate: usize,
        rows: Range<usize>,
    ) -> impl Iterator<Item = (usize, &Block<N, M, f32>)> {
        self.blocks_at(self.transpose.column_within(aggregate, rows))
    }

    #[inline(always)]
    fn blocks_at(&self, places: Range<usize>) -> impl Iterator<Item = (usize, &Block<N, M, f32>)> {
        let nodes = self.transpose.entries(places.clone()).iter().map(|&(node, _)| node as usize);
        nodes.zip(&self.by_columns[places])
    }

    /// The aggregates that nodes are coupled to: the pattern of A T.
    pub fn coupled(&self) -> &Pattern {
        &self.filter.coupled
    }

    /// The one block of a row of T, and its column; none where the node has no aggregate.
    pub fn tentative_row(&self, node: usize) -> Option<(u32, &Block<N, M, f32>)> {
        Some((self.aggregates.of_node(node)?, self.tentative.get(node)?))
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
    pub fn restrict(&self, r: &[[f32; N]], coarse: &mut [[f32; M]]) {
        for_each_row(
            coarse,
            #[inline(always)]
            |aggregate, sum| {
                *sum = [0.0; M];
                let places = self.transpose.column(aggregate);
                self.ask_for(&places);
                for (node, p) in self.blocks_at(places) {
                    add_transposed_apply(sum, p, &r[node]);
                }
            },
        );
    }

    /// `x += P e`.
    pub fn prolong(&self, coarse: &[[f32; M]], x: &mut [[f32; N]]) {
        for_each_row(
            x,
            #[inline(always)]
            |row, x| {
                ask_for(self.matrix.pattern.values_of(&self.matrix.values, row + ahead::<Block<N, M, f32>>()));
                for (aggregate, p) in self.matrix.row(row) {
                    add_apply(x, p, &coarse[aggregate]);
                }
            },
        );
    }

    /// Asks for the blocks by columns that are read soon after some.
    #[inline(always)]
    fn ask_for(&self, places: &Range<usize>) {
        let [from, to] = [places.start, places.end].map(|at| (at + BLOCKS_AHEAD).min(self.by_columns.len()));
        ask_for(&self.by_columns[from..to]);
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.aggregates.bytes()
            + size_of_val(&self.starts[..])
            + size_of_val(&self.members[..])
            + size_of_val(&self.modes[..])
            + size_of_val(&self.tentative[..])
            + self.filter.bytes()
            + self.matrix.bytes()
            + self.transpose.bytes()
            + size_of_val(&self.by_columns[..])
    }
}

/// Asks for the memory of blocks that are read soon.
#[inline(always)]
fn ask_for<const N: usize, const M: usize>(blocks: &[Block<N, M, f32>]) {
    prefetch_all(blocks.as_flattened().as_flattened());
}
