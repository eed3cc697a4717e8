//! Weighted undirected graphs: which nodes are coupled, and how stiffly.

/// Neighbours of every node, ascending, with positive weights; no loops, no repeats.
#[derive(Debug, Clone)]
pub(super) struct Graph {
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    weights: Vec<f64>,
}

impl Graph {
    /// From undirected edges with weights; those of repeated edges are added up, loops are dropped.
    pub fn new(nodes: usize, edges: impl Iterator<Item = (u32, u32, f64)> + Clone) -> Self {
        let mut starts = vec![0usize; nodes + 1];
        for (i, j, _) in edges.clone().filter(|&(i, j, _)| i != j) {
            starts[i as usize + 1] += 1;
            starts[j as usize + 1] += 1;
        }
        for node in 0..nodes {
            starts[node + 1] += starts[node];
        }
        let mut next = starts.clone();
        let mut unsorted = vec![(0u32, 0.0); starts[nodes]];
        let mut put = |i: u32, j: u32, weight: f64| {
            let at = &mut next[i as usize];
            unsorted[*at] = (j, weight);
            *at += 1;
        };
        for (i, j, weight) in edges.filter(|&(i, j, _)| i != j) {
            put(i, j, weight);
            put(j, i, weight);
        }
        let mut graph = Self { starts: Vec::with_capacity(nodes + 1), neighbours: Vec::new(), weights: Vec::new() };
        graph.starts.push(0);
        for node in 0..nodes {
            let mine = &mut unsorted[starts[node]..starts[node + 1]];
            // Stable, so that the weights of repeats are added up in the order given.
            mine.sort_by_key(|&(neighbour, _)| neighbour);
            for repeats in mine.chunk_by(|a, b| a.0 == b.0) {
                graph.neighbours.push(repeats[0].0);
                graph.weights.push(repeats.iter().map(|&(_, weight)| weight).sum());
            }
            graph.starts.push(graph.neighbours.len());
        }
        graph
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.starts.len() - 1
    }

    /// Neighbours of a node, ascending.
    pub fn neighbours(&self, node: usize) -> &[u32] {
        &self.neighbours[self.starts[node]..self.starts[node + 1]]
    }

    /// Neighbours of a node with the weights of the edges to them.
    pub fn edges(&self, node: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let range = self.starts[node]..self.starts[node + 1];
        self.neighbours[range.clone()]
            .iter()
            .map(|&neighbour| neighbour as usize)
            .zip(self.weights[range].iter().copied())
    }

    /// The graph of groups of nodes: two are coupled by all edges between their members. Nodes without a group are left
    /// out.
    pub fn quotient(&self, groups: usize, group: impl Fn(usize) -> Option<u32> + Copy) -> Self {
        let edges = (0..self.nodes()).flat_map(move |i| {
            let later = self.edges(i).filter(move |&(j, _)| i < j);
            later.filter_map(move |(j, weight)| Some((group(i)?, group(j)?, weight)))
        });
        Self::new(groups, edges)
    }
}
