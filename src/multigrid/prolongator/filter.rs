//! Which aggregates a row of the prolongator reaches: those that its node is coupled to strongly.
//!
//! `P = (I − ω D⁻¹A) T` would have a block for every aggregate that a node is coupled to, were it by one spring of thirteen. Such a
//! block carries little and costs what any other does: in `Pᵀ A P`, where the blocks of a row meet each other, in the coarse
//! matrices, which get more neighbours by it, and in every transfer. Vaněk, Mandel and Brezina (1996) smooth with a filtered
//! matrix, whose weak entries are added to the diagonal: that keeps translations. Here rigid motions are kept too (own
//! derivation). Row i is
//!
//! ```text
//! P_i = T_i − ω D_i⁻¹ Σ_j A_ij T̃_j,
//! ```
//!
//! with T̃_j = T_j if the row reaches the aggregate of j. If not, j is taken to be fixed to one that it does reach, which *stands in*:
//! `T̃_j = B_j S(c_j − C) R⁻¹` with C and R of that aggregate, see `modes`. It is the strongest of the others, or the node's own if the
//! row reaches no other. Where all aggregates follow one rigid motion `Σ_j A_ij T̃_j` is `(A T)_i`, and P takes it to what it always did, as far
//! as the one that stands in has all motions: one that lacks some, as of particles on a line, leaves them out beside that line too.
//!
//! P of a cloth has two thirds of the blocks then, `Pᵀ A P` of all levels half of the multiplications and coarse matrices half of the entries; of a
//! lattice two thirds of the multiplications, of a random network a third. 240 random systems (cloths, lattices and networks of 200 to 5600 particles)
//! take 1.02 to 1.04 times the iterations, none more than 1.12 times; cloths that swing down 1.13 to 1.23 times.

use super::super::aggregate::Aggregates;
use super::super::graph::Graph;
use super::super::sparse::Pattern;
use crate::error::Result;
use std::sync::Arc;

/// The share of a node's couplings below which those to an aggregate may be left out. At a fifth, however much that is in all, a lattice of 46³ takes 26
/// iterations instead of 16.
const WEAK: f64 = 0.15;

/// How much of its couplings may be left out in all: in networks every node that a node is coupled to may be in an aggregate of its own.
const LEFT_OUT: f64 = 0.25;

/// The sparsity of a prolongator.
#[derive(Debug, Clone)]
pub struct Filter {
    /// The aggregates that each node is coupled to, with its own: the pattern of A T.
    pub coupled: Arc<Pattern>,
    /// Those that its row of P reaches.
    pub reached: Arc<Pattern>,
    /// For every row the aggregate that stands in for those left out; for nodes without aggregates 0.
    stand_ins: Vec<u32>,
}

impl Filter {
    /// For a matrix of pattern `a`, whose nodes are coupled by the edges of the graph.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, graph: &Graph, aggregates: &Aggregates) -> Result<Self> {
        let mut last_seen = vec![u32::MAX; aggregates.count()];
        let coupled = Pattern::build(a.rows(), |row, columns| {
            for aggregate in a.columns(row).iter().filter_map(|&node| aggregates.of_node(node as usize)) {
                if last_seen[aggregate as usize] != row as u32 {
                    last_seen[aggregate as usize] = row as u32;
                    columns.push(aggregate);
                }
            }
        })?;
        let mut stand_ins = vec![0; a.rows()];
        let mut others = Vec::new();
        let reached = Pattern::build(a.rows(), |row, columns| {
            let own = aggregates.of_node(row);
            strongest_first(row, graph, aggregates, coupled.columns(row), &mut others);
            let all: f64 = graph.edges(row).map(|(_, weight)| weight).sum();
            let mut left_out = 0.0;
            while let Some(&(_, weight)) = others.last() {
                left_out += weight;
                if weight >= WEAK * all || left_out > LEFT_OUT * all {
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

    /// The aggregate that stands in for those that a row leaves out.
    #[inline(always)]
    pub fn stand_in(&self, row: usize) -> u32 {
        self.stand_ins[row]
    }

    /// Whether a row leaves out an aggregate that its node is coupled to.
    #[inline(always)]
    pub fn leaves_out(&self, row: usize, aggregate: u32) -> bool {
        !self.reached.columns(row).contains(&aggregate)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let reached = if Arc::ptr_eq(&self.coupled, &self.reached) { 0 } else { self.reached.bytes() };
        self.coupled.bytes() + reached + size_of_val(&self.stand_ins[..])
    }
}

/// The aggregates that a node is coupled to, without its own, with the weights of all edges there; of equals the first in front.
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

#[cfg(test)]
mod tests {
    use super::{Aggregates, Filter, Graph};
    use crate::multigrid::sparse::Pattern;
    use std::sync::Arc;

    /// Pairs of nodes that stiff edges join, each an aggregate, and soft edges of these weights from node 0 to the first of the other pairs.
    fn filter(stiff: f64, soft: &[f64]) -> Filter {
        let pairs = 1 + soft.len() as u32;
        let joined = (0..pairs).map(|pair| (2 * pair, 2 * pair + 1, if pair == 0 { stiff } else { 1e6 }));
        let edges: Vec<_> = joined.chain((1..).zip(soft).map(|(pair, &weight)| (0, 2 * pair, weight))).collect();
        let graph = Graph::new(2 * pairs as usize, edges.into_iter());
        let aggregates = Aggregates::of(&graph);
        assert_eq!(aggregates.count(), pairs as usize);
        let pattern = Pattern::build(graph.nodes(), |node, columns| {
            columns.extend_from_slice(graph.neighbours(node));
            columns.push(node as u32);
        });
        Filter::new(&pattern.unwrap(), &graph, &aggregates).unwrap()
    }

    fn first_row(filter: &Filter) -> (Vec<u32>, u32) {
        (filter.reached.columns(0).to_vec(), filter.stand_in(0))
    }

    /// Of 100 in all what is below 15 goes, the strongest of the others stands in, the first of equals.
    #[test]
    fn weak_couplings_are_left_out() {
        let filter = filter(40.0, &[14.0, 15.0, 31.0]);
        assert_eq!(filter.coupled.columns(0), [0, 1, 2, 3]);
        assert_eq!(first_row(&filter), (vec![0, 2, 3], 3));
        assert!(filter.leaves_out(0, 1) && !filter.leaves_out(0, 2) && !filter.leaves_out(0, 0));
        assert_eq!(first_row(&self::filter(40.0, &[20.0, 20.0, 20.0])), (vec![0, 1, 2, 3], 1));
    }

    /// Four times 13 of 100 are more than a quarter: the first of equals stay. Of the weakest some go.
    #[test]
    fn no_more_than_a_quarter_is_left_out() {
        assert_eq!(first_row(&filter(48.0, &[13.0; 4])), (vec![0, 1, 2, 3], 1));
        assert_eq!(first_row(&filter(70.0, &[12.0, 9.0, 9.0])), (vec![0, 1], 1));
    }

    /// With nothing else to hold on to the node's own aggregate stands in.
    #[test]
    fn the_own_aggregate_stays() {
        assert_eq!(first_row(&filter(90.0, &[10.0])), (vec![0], 0));
        assert_eq!(first_row(&filter(10.0, &[90.0])), (vec![0, 1], 1));
    }

    #[test]
    fn patterns_that_are_alike_are_kept_once() {
        let (all, some) = (filter(1.0, &[]), filter(90.0, &[10.0]));
        assert!(Arc::ptr_eq(&all.coupled, &all.reached));
        assert_eq!(all.bytes(), all.coupled.bytes() + 2 * 4);
        assert_eq!(some.bytes(), some.coupled.bytes() + some.reached.bytes() + 4 * 4);
    }
}
