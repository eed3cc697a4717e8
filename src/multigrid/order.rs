//! The order of the nodes on the finest level: neighbours near each other in memory.

use super::graph::Graph;

/// Nodes in the order given, or by breadth-first search (Cuthill and McKee 1969) if that brings neighbours nearer to each
/// other: `order[new] = old`.
pub(super) fn order(graph: &Graph) -> Vec<u32> {
    let given: Vec<u32> = (0..graph.nodes() as u32).collect();
    let searched = breadth_first(graph);
    if span(graph, &searched) < span(graph, &given) { searched } else { given }
}

/// The sum over all edges of the distance in the order between their ends.
fn span(graph: &Graph, order: &[u32]) -> f64 {
    let mut place = vec![0u32; order.len()];
    for (new, &old) in (0..).zip(order) {
        place[old as usize] = new;
    }
    let distance = |(i, j): (usize, u32)| f64::from(place[i].abs_diff(place[j as usize]));
    (0..graph.nodes()).flat_map(|i| graph.neighbours(i).iter().map(move |&j| (i, j))).map(distance).sum()
}

/// Part by part, each from its node found last by a search from its first one: a node at an end.
fn breadth_first(graph: &Graph) -> Vec<u32> {
    let mut order = Vec::with_capacity(graph.nodes());
    let mut ordered = vec![false; graph.nodes()];
    for node in 0..graph.nodes() as u32 {
        if ordered[node as usize] {
            continue;
        }
        let start = order.len();
        search(graph, node, &mut order, &mut ordered);
        let end = order.last().copied().unwrap_or(node);
        for node in order.drain(start..) {
            ordered[node as usize] = false;
        }
        search(graph, end, &mut order, &mut ordered);
    }
    order
}

fn search(graph: &Graph, from: u32, order: &mut Vec<u32>, ordered: &mut [bool]) {
    let mut next = order.len();
    order.push(from);
    ordered[from as usize] = true;
    while let Some(&node) = order.get(next) {
        next += 1;
        for &neighbour in graph.neighbours(node as usize) {
            if !ordered[neighbour as usize] {
                ordered[neighbour as usize] = true;
                order.push(neighbour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{order, span};
    use crate::multigrid::graph::Graph;

    fn graph(nodes: usize, edges: &[(u32, u32)]) -> Graph {
        Graph::new(nodes, edges.iter().map(|&(i, j)| (i, j, 1.0)))
    }

    /// Each edge is seen from both ends.
    #[test]
    fn a_path_is_followed_from_its_end_if_that_is_nearer() {
        let path = graph(5, &[(0, 3), (3, 1), (1, 4), (4, 2)]);
        assert_eq!(span(&path, &[0, 1, 2, 3, 4]), 20.0);
        assert_eq!(span(&path, &[2, 4, 1, 3, 0]), 8.0);
        assert_eq!(order(&path), [2, 4, 1, 3, 0]);
        // What is in order, or as near in another one, stays.
        assert_eq!(order(&graph(3, &[(0, 1), (1, 2)])), [0, 1, 2]);
        // From a node in the middle a search ends at an end, and each part is ordered by itself.
        assert_eq!(order(&graph(6, &[(0, 4), (0, 2), (1, 5), (5, 3)])), [4, 0, 2, 3, 5, 1]);
        assert_eq!(order(&graph(0, &[])), [0u32; 0]);
    }
}
