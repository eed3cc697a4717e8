//! The prolongator P from aggregates to nodes: tentative, then smoothed, without weak couplings.
//!
//! `P = (I − ω D⁻¹A) T` with `ω = 4/(3 λ_max(D⁻¹A))` and D the diagonal blocks of A: one step of damped block Jacobi takes the jumps between
//! aggregates out of T, so that a coarse motion costs little energy (Vaněk, Mandel, Brezina 1996, section 4).
//!
//! λ_max is bounded, not computed: a spring's block B is positive semidefinite where A is of use, and
//! `(x_i − x_j)ᵀ B (x_i − x_j) ≤ 2 x_iᵀ B x_i + 2 x_jᵀ B x_j`; summed over the springs, `xᵀA x ≤ 2 xᵀD x`, so `λ_max ≤ 2`. Using 2 for the actual 1.6
//! to 1.8 changes iteration counts by at most two. Any ω gives a preconditioner that is positive definite, up to rounding, which is small unless an
//! eigenvalue λ of D⁻¹A of a motion of aggregates has ωλ near 1: `galerkin` keeps those out of the coarse level.
//!
//! **Sparsity.** Weak couplings would make P, the coarse matrices and every transfer expensive. Vaněk, Mandel and Brezina (1996) add the weak entries
//! of A to the diagonal, which preserves translations. Here rigid motions are preserved too (own derivation). Row i is
//!
//! ```text
//! P_i = T_i − ω D_i⁻¹ Σ_j A_ij T̃_j,
//! ```
//!
//! with T̃_j = T_j if the aggregate of j is in the row. Otherwise j is taken to be fixed to one that is, which *stands in*:
//! `T̃_j = B_j S(c_j − C) R⁻¹` with C and R of that aggregate, see `modes`. It is the strongest of the others, or the node's own if there is no
//! other. Where all aggregates follow one rigid motion `Σ_j A_ij T̃_j` is `(A T)_i`, as far as the one that stands in has all motions.

use super::aggregate::{Aggregates, Graph};
use super::block::{Block, add_apply, add_product, add_transposed_apply, single, sum, without_negligible, zero};
use super::gauss_seidel::GaussSeidel;
use super::modes::{AggregateModes, Frames};
use super::parallel::{GRAIN, Values, for_each_row, for_each_row_of};
use super::sparse::{BlockMatrix, Pattern, Rows, Transpose, ahead};
use crate::error::Result;
use crate::operator::{group, prefetch_all};
use std::ops::Range;
use std::sync::Arc;

/// Blocks of a row summed at once; more take another pass through the row of A.
const AT_ONCE: usize = 8;

#[derive(Debug, Clone)]
struct Sparsity {
    /// The aggregates that each node is coupled to, with its own: the pattern of A T.
    coupled: Arc<Pattern>,
    /// Those in its row of P.
    reached: Arc<Pattern>,
    /// The aggregate of every row that stands in for those left out; 0 for nodes without aggregates.
    stand_ins: Vec<u32>,
}

impl Sparsity {
    /// For a matrix of pattern `a`, whose nodes are coupled by the edges of the graph.
    fn new(a: &Pattern, graph: &Graph, aggregates: &Aggregates) -> Result<Self> {
        let of_nodes = |row| a.columns(row).iter().filter_map(|&node| aggregates.of_node(node as usize));
        let coupled = Pattern::union(a.rows(), aggregates.count(), of_nodes)?;
        let mut stand_ins = vec![0; a.rows()];
        let mut others = Vec::new();
        let reached = Pattern::build(a.rows(), |row, columns| {
            let own = aggregates.of_node(row);
            strongest_first(row, graph, aggregates, coupled.columns(row), &mut others);
            let all: f64 = graph.edges(row).map(|(_, weight)| weight).sum();
            let mut left_out = 0.0;
            // Each below 15 % of the node's couplings (at a fifth, without a limit in all, a lattice of 46³ takes 26 iterations, not 16),
            // a quarter in all.
            while let Some(&(_, weight)) = others.last() {
                left_out += weight;
                if weight >= 0.15 * all || left_out > 0.25 * all {
                    break;
                }
                others.pop();
            }
            let others = others.iter().map(|&(aggregate, _)| aggregate);
            stand_ins[row] = others.clone().next().or(own).unwrap_or(0);
            columns.extend(own.into_iter().chain(others));
        })?;
        let coupled = Arc::new(coupled);
        let reached = if reached.blocks() == coupled.blocks() { coupled.clone() } else { Arc::new(reached) };
        Ok(Self { coupled, reached, stand_ins })
    }

    #[inline(always)]
    fn leaves_out(&self, row: usize, aggregate: u32) -> bool {
        !self.reached.columns(row).contains(&aggregate)
    }
}

/// The aggregates that a node is coupled to, without its own, with the sums of their weights; stable.
fn strongest_first(node: usize, graph: &Graph, aggregates: &Aggregates, coupled: &[u32], others: &mut Vec<(u32, f64)>) {
    let own = aggregates.of_node(node);
    others.clear();
    others.extend(coupled.iter().filter(|&&aggregate| Some(aggregate) != own).map(|&aggregate| (aggregate, 0.0)));
    for (neighbour, weight) in graph.edges(node) {
        let there = aggregates.of_node(neighbour);
        if let Some((_, sum)) = others.iter_mut().find(|&&mut (aggregate, _)| Some(aggregate) == there) {
            *sum += weight;
        }
    }
    others.sort_by(|(_, a), (_, b)| b.total_cmp(a));
}

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
    sparsity: Sparsity,
    /// P.
    pub matrix: BlockMatrix<N, M, f32>,
    pub transpose: Transpose,
    /// The blocks of P by columns: reading in order is twice as fast.
    by_columns: Vec<Block<N, M, f32>>,
}

impl<const N: usize, const M: usize> Prolongator<N, M> {
    /// The pattern of P for a matrix of pattern `a`; all values zero.
    pub fn new(a: &Pattern, graph: &Graph, aggregates: Aggregates) -> Result<Self> {
        let count = aggregates.count();
        let sparsity = Sparsity::new(a, graph, &aggregates)?;
        let of_node = |node| aggregates.of_node(node).map(|aggregate| (aggregate as usize, node as u32));
        let (starts, members) = group(count, || (0..a.rows()).filter_map(of_node));
        let pattern = sparsity.reached.clone();
        let transpose = pattern.transpose(count);
        let by_columns = vec![zero(); pattern.blocks()];
        let modes = vec![AggregateModes::NONE; count];
        let tentative = vec![zero(); a.rows()];
        Ok(Self {
            aggregates,
            starts,
            members,
            modes,
            tentative,
            matrix: BlockMatrix::zeros(pattern),
            sparsity,
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
        let Self { aggregates, starts, members, modes, tentative, sparsity, matrix, transpose, by_columns } = self;
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
                // −ω D⁻¹, for `λ_max = 2`.
                let mut damped = smoother.inverse(row);
                damped.as_flattened_mut().iter_mut().for_each(|entry| *entry *= -(2.0 / 3.0));
                let stand_in = sparsity.stand_ins[row];
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
                            } else if substituted.is_some() && sparsity.leaves_out(row, aggregate) {
                                let fixed = frames.frame(node).about(modes[stand_in as usize].frame.centre);
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
                        *p = without_negligible(&smoothed);
                    }
                }
            },
        );
        let values = &matrix.values;
        for_each_row(
            by_columns,
            #[inline(always)]
            |place, p| *p = values[transpose.entries[place].1 as usize],
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
        let nodes = self.transpose.entries[places.clone()].iter().map(|&(node, _)| node as usize);
        nodes.zip(&self.by_columns[places])
    }

    /// The aggregates that nodes are coupled to: the pattern of A T.
    pub fn coupled(&self) -> &Pattern {
        &self.sparsity.coupled
    }

    /// The block of a row of T, and its column; `None` for a node without aggregate.
    pub fn tentative_row(&self, node: usize) -> Option<(u32, &Block<N, M, f32>)> {
        Some((self.aggregates.of_node(node)?, self.tentative.get(node)?))
    }

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
                self.prefetch(&places);
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
                let later = self.matrix.pattern.values_of(&self.matrix.values, row + ahead::<Block<N, M, f32>>());
                prefetch_all(later.as_flattened().as_flattened());
                for (aggregate, p) in self.matrix.row(row) {
                    add_apply(x, p, &coarse[aggregate]);
                }
            },
        );
    }

    /// Prefetches the blocks by columns that follow some, 64 blocks before they are used.
    #[inline(always)]
    fn prefetch(&self, places: &Range<usize>) {
        let [from, to] = [places.start, places.end].map(|at| (at + 64).min(self.by_columns.len()));
        prefetch_all(self.by_columns[from..to].as_flattened().as_flattened());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs of nodes that stiff edges join, each an aggregate, and soft edges of these weights from node 0 to the first of the other pairs.
    fn sparsity(stiff: f64, soft: &[f64]) -> Sparsity {
        let pairs = 1 + soft.len() as u32;
        let joined = (0..pairs).map(|pair| (2 * pair, 2 * pair + 1, if pair == 0 { stiff } else { 1e6 }));
        let edges: Vec<_> = joined.chain((1..).zip(soft).map(|(pair, &weight)| (0, 2 * pair, weight))).collect();
        let graph = Graph::new(2 * pairs as usize, edges.into_iter());
        let aggregates = Aggregates::new(&graph);
        assert_eq!(aggregates.count(), pairs as usize);
        let pattern = Pattern::build(graph.nodes(), |node, columns| {
            columns.extend_from_slice(graph.neighbours(node));
            columns.push(node as u32);
        });
        Sparsity::new(&pattern.unwrap(), &graph, &aggregates).unwrap()
    }

    fn first_row(sparsity: &Sparsity) -> (Vec<u32>, u32) {
        (sparsity.reached.columns(0).to_vec(), sparsity.stand_ins[0])
    }

    /// Of 100 in all what is below 15 goes, the strongest of the others stands in, the first of equals.
    #[test]
    fn weak_couplings_are_left_out() {
        let sparsity = sparsity(40.0, &[14.0, 15.0, 31.0]);
        assert_eq!(sparsity.coupled.columns(0), [0, 1, 2, 3]);
        assert_eq!(first_row(&sparsity), (vec![0, 2, 3], 3));
        assert!(sparsity.leaves_out(0, 1) && !sparsity.leaves_out(0, 2) && !sparsity.leaves_out(0, 0));
        assert_eq!(first_row(&self::sparsity(40.0, &[20.0, 20.0, 20.0])), (vec![0, 1, 2, 3], 1));
    }

    /// Four times 13 of 100 are more than a quarter: the first of equals stay. Of the weakest some go.
    #[test]
    fn no_more_than_a_quarter_is_left_out() {
        assert_eq!(first_row(&sparsity(48.0, &[13.0; 4])), (vec![0, 1, 2, 3], 1));
        assert_eq!(first_row(&sparsity(70.0, &[12.0, 9.0, 9.0])), (vec![0, 1], 1));
    }

    /// With nothing else to hold on to the node's own aggregate stands in.
    #[test]
    fn the_own_aggregate_stays() {
        assert_eq!(first_row(&sparsity(90.0, &[10.0])), (vec![0], 0));
        assert_eq!(first_row(&sparsity(10.0, &[90.0])), (vec![0, 1], 1));
    }
}
