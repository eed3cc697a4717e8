//! Aggregation: which nodes become one node of the next coarser level.
//!
//! Algorithm 5.1 of Vaněk, Mandel and Brezina (1996), on the graph of couplings alone: it needs no matrix, so it is done
//! once a scene. An edge of weight w_ij is strong where `w_ij² ≥ θ² w_i w_j`, w_i the largest weight at i. The weights are
//! those of the springs, k/l0, on the finest level and their sums over the edges between two aggregates on the others.

use super::graph::Graph;

/// θ. Weights that differ by less than a hundredfold count as equal: aggregates are then as round as the graph lets them be.
const STRENGTH: f64 = 0.01;

const NONE: u32 = u32::MAX;

/// The aggregate of every node.
#[derive(Debug, Clone)]
pub(super) struct Aggregates {
    of_node: Vec<u32>,
    count: usize,
}

impl Aggregates {
    /// Aggregates a graph. A node without neighbours gets none: its equations stand alone, and smoothing solves them.
    pub fn of(graph: &Graph) -> Self {
        let largest: Vec<f64> = (0..graph.nodes())
            .map(|node| graph.edges(node).fold(0.0, |largest, (_, w)| f64::max(largest, w)))
            .collect();
        let is_strong = |i: usize, j: usize, w: f64| w * w >= STRENGTH * STRENGTH * largest[i] * largest[j];
        let strong = |i: usize| graph.edges(i).filter(move |&(j, w)| is_strong(i, j, w)).map(|(j, _)| j);
        let mut of_node = vec![NONE; graph.nodes()];
        let mut count = 0;

        // Whole neighbourhoods, as many as fit side by side.
        for root in 0..graph.nodes() {
            let mut others = strong(root).peekable();
            if of_node[root] == NONE && others.peek().is_some() && strong(root).all(|j| of_node[j] == NONE) {
                of_node[root] = count;
                others.for_each(|j| of_node[j] = count);
                count += 1;
            }
        }
        // What lies between them joins the aggregate to which it is coupled most stiffly.
        let neighbourhoods = of_node.clone();
        for node in (0..graph.nodes()).filter(|&node| neighbourhoods[node] == NONE) {
            let mut joined = graph.edges(node).filter(|&(j, _)| neighbourhoods[j] != NONE);
            if let Some((j, _)) = stiffest(&mut joined) {
                of_node[node] = neighbourhoods[j];
            }
        }
        // What is left is far from every whole neighbourhood. No aggregate is a single node, so each level at least halves.
        for root in 0..graph.nodes() {
            if of_node[root] != NONE {
                continue;
            }
            if graph.edges(root).any(|(j, _)| of_node[j] == NONE) {
                of_node[root] = count;
                for (j, _) in graph.edges(root) {
                    if of_node[j] == NONE {
                        of_node[j] = count;
                    }
                }
                count += 1;
            } else if let Some((j, _)) = stiffest(&mut graph.edges(root)) {
                of_node[root] = of_node[j];
            }
        }
        Self { of_node, count: count as usize }
    }

    /// Number of aggregates.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The aggregate of a node, if it has one.
    #[inline]
    pub fn of_node(&self, node: usize) -> Option<u32> {
        let aggregate = self.of_node[node];
        (aggregate != NONE).then_some(aggregate)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.of_node[..])
    }
}

/// The first of the edges with the largest weight.
fn stiffest(edges: &mut dyn Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    edges.reduce(|best, edge| if edge.1 > best.1 { edge } else { best })
}
