//! Graphs of coupled nodes, and the aggregation of nodes for the next coarser level.
//!
//! Algorithm 5.1 of Vaněk, Mandel and Brezina (1996), on the graph of couplings alone, once a scene. An edge of weight w_ij is strong where
//! `w_ij² ≥ θ² w_i w_j`, w_i the largest weight at i. The weights are those of the springs, k/l0, on the finest level and their sums over the edges
//! between two aggregates on the others.

use crate::operator::group;

/// θ. Weights that differ by less than a hundredfold count as equal, which keeps aggregates round.
const STRENGTH: f64 = 0.01;

/// A weighted undirected graph: the neighbours of every node, ascending, without loops and repeats.
#[derive(Debug, Clone)]
pub(super) struct Graph {
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    weights: Vec<f64>,
}

impl Graph {
    /// From weighted edges; the weights of repeated edges are added up, loops are dropped.
    pub fn new(nodes: usize, edges: impl Iterator<Item = (u32, u32, f64)> + Clone) -> Self {
        let ends = |(i, j, weight)| [(i as usize, (j, weight)), (j as usize, (i, weight))];
        let (starts, mut unsorted) = group(nodes, || edges.clone().filter(|&(i, j, _)| i != j).flat_map(ends));
        let mut graph = Self { starts: Vec::with_capacity(nodes + 1), neighbours: Vec::new(), weights: Vec::new() };
        graph.starts.push(0);
        for node in 0..nodes {
            let mine = &mut unsorted[starts[node]..starts[node + 1]];
            // A stable sort keeps the order in which the weights of repeats are added up.
            mine.sort_by_key(|&(neighbour, _)| neighbour);
            for repeats in mine.chunk_by(|a, b| a.0 == b.0) {
                graph.neighbours.push(repeats[0].0);
                graph.weights.push(repeats.iter().map(|&(_, weight)| weight).sum());
            }
            graph.starts.push(graph.neighbours.len());
        }
        graph
    }

    pub fn nodes(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn neighbours(&self, node: usize) -> &[u32] {
        &self.neighbours[self.starts[node]..self.starts[node + 1]]
    }

    pub fn edges(&self, node: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let range = self.starts[node]..self.starts[node + 1];
        self.neighbours[range.clone()]
            .iter()
            .map(|&neighbour| neighbour as usize)
            .zip(self.weights[range].iter().copied())
    }

    /// The graph of groups of nodes, coupled by all edges between their members. Nodes without a group are dropped.
    pub fn quotient(&self, groups: usize, group: impl Fn(usize) -> Option<u32> + Copy) -> Self {
        let edges = (0..self.nodes()).flat_map(move |i| {
            let later = self.edges(i).filter(move |&(j, _)| i < j);
            later.filter_map(move |(j, weight)| Some((group(i)?, group(j)?, weight)))
        });
        Self::new(groups, edges)
    }
}

#[derive(Debug, Clone)]
pub(super) struct Aggregates {
    of_node: Vec<Option<u32>>,
    count: usize,
}

impl Aggregates {
    /// Aggregates a graph. A node without neighbours gets no aggregate: smoothing solves its equations.
    pub fn new(graph: &Graph) -> Self {
        let largest: Vec<f64> = (0..graph.nodes())
            .map(|node| graph.edges(node).fold(0.0, |largest, (_, w)| f64::max(largest, w)))
            .collect();
        let is_strong = |i: usize, j: usize, w: f64| w * w >= STRENGTH * STRENGTH * largest[i] * largest[j];
        let strong = |i: usize| graph.edges(i).filter(move |&(j, w)| is_strong(i, j, w)).map(|(j, _)| j);
        let mut of_node = vec![None; graph.nodes()];
        let mut count = 0;

        for root in 0..graph.nodes() {
            let mut others = strong(root).peekable();
            if of_node[root].is_none() && others.peek().is_some() && strong(root).all(|j| of_node[j].is_none()) {
                of_node[root] = Some(count);
                others.for_each(|j| of_node[j] = Some(count));
                count += 1;
            }
        }
        // A node between them joins the aggregate to which it is coupled most stiffly.
        let neighbourhoods = of_node.clone();
        for node in (0..graph.nodes()).filter(|&node| neighbourhoods[node].is_none()) {
            let mut joined = graph.edges(node).filter(|&(j, _)| neighbourhoods[j].is_some());
            if let Some((j, _)) = stiffest(&mut joined) {
                of_node[node] = neighbourhoods[j];
            }
        }
        // The rest is far from every neighbourhood. No aggregate is a single node, so each level at least halves.
        for root in 0..graph.nodes() {
            if of_node[root].is_some() {
                continue;
            }
            if graph.edges(root).any(|(j, _)| of_node[j].is_none()) {
                of_node[root] = Some(count);
                for (j, _) in graph.edges(root) {
                    of_node[j].get_or_insert(count);
                }
                count += 1;
            } else if let Some((j, _)) = stiffest(&mut graph.edges(root)) {
                of_node[root] = of_node[j];
            }
        }
        Self { of_node, count: count as usize }
    }

    pub fn count(&self) -> usize {
        self.count
    }

    #[inline]
    pub fn of_node(&self, node: usize) -> Option<u32> {
        self.of_node[node]
    }
}

/// The first of the edges with the largest weight.
fn stiffest(edges: &mut dyn Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    edges.reduce(|best, edge| if edge.1 > best.1 { edge } else { best })
}

#[cfg(test)]
mod tests {
    use super::{Aggregates, Graph};

    fn aggregates(nodes: usize, edges: &[(u32, u32, f64)]) -> (usize, Vec<Option<u32>>) {
        let aggregates = Aggregates::new(&Graph::new(nodes, edges.iter().copied()));
        (aggregates.count(), (0..nodes).map(|node| aggregates.of_node(node)).collect())
    }

    /// Two stiff pairs with a soft edge of weight 3 between them: 3² against θ² = 10⁻⁴ times the product of their weights, which is 8 and 10. Where
    /// it is strong the first neighbourhood has three nodes, and the fourth joins it.
    #[test]
    fn an_edge_is_strong_beside_the_largest_at_both_ends() {
        let pairs = |first, second| aggregates(4, &[(0, 1, first), (0, 2, 3.0), (2, 3, second)]);
        assert_eq!(pairs(400.0, 200.0), (1, vec![Some(0); 4]));
        let apart = [Some(0), Some(0), Some(1), Some(1)];
        assert_eq!(pairs(1000.0, 100.0), (2, apart.to_vec()));
        assert_eq!(pairs(100.0, 1000.0), (2, apart.to_vec()));
    }

    /// Two stiff chains of three; weak edges lead to nodes 6 to 9: 6 and 7 become an aggregate, 8 joins its stiffest neighbour, and 9 the first of
    /// two. Node 10 has no neighbours.
    #[test]
    fn what_is_far_from_every_neighbourhood_is_aggregated_last() {
        let stiff = 1e6;
        let chains = [(0, 1, stiff), (1, 2, stiff), (3, 4, stiff), (4, 5, stiff)];
        let soft = [(2, 6, 1.0), (5, 7, 1.0), (6, 7, 1e-3), (2, 8, 0.5), (5, 8, 1.0), (2, 9, 1.0), (5, 9, 1.0)];
        let (count, of_node) = aggregates(11, &[&chains[..], &soft[..]].concat());
        assert_eq!(count, 3);
        let expected = [0, 0, 0, 1, 1, 1, 2, 2, 1, 0].map(Some);
        assert_eq!(of_node, [&expected[..], &[None]].concat());
    }

    #[test]
    fn couplings_are_undirected_and_those_of_groups_are_added_up() {
        let graph = Graph::new(4, [(2, 0, 1.0), (0, 1, 2.0), (1, 0, 4.0), (3, 3, 9.0), (3, 2, 8.0)].into_iter());
        let edges = |graph: &Graph, node| graph.edges(node).collect::<Vec<_>>();
        assert_eq!((graph.nodes(), graph.neighbours(0)), (4, &[1, 2][..]));
        assert_eq!(edges(&graph, 0), [(1, 6.0), (2, 1.0)]);
        assert_eq!((edges(&graph, 2), edges(&graph, 3)), (vec![(0, 1.0), (3, 8.0)], vec![(2, 8.0)]));
        // 0 in one group, 1 and 2 in another, 3 in none.
        let groups = graph.quotient(2, |node| [Some(0), Some(1), Some(1), None][node]);
        assert_eq!((groups.nodes(), edges(&groups, 0), edges(&groups, 1)), (2, vec![(1, 7.0)], vec![(0, 7.0)]));
    }
}
