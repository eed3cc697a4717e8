//! Parts of a scene that hang by one spring: a spring resists one of the motions of such a part, and leaves the others free.
//!
//! They are found by the bridges of the graph whose edges are springs: edges that lie on no cycle (Tarjan, Inf. Process. Lett. 2, 1974).

use crate::system::System;

/// The particles of each part that one spring alone joins to the rest, with all that the part carries: to what is held, or, of a body that nothing
/// holds, to the largest part of it that is joined by more than one. Ordered by their first particles.
pub(super) fn hanging(system: &System) -> Vec<Vec<usize>> {
    let graph = Graph::new(system);
    let ground = system.particles();
    let first_pass = graph.components(0..ground);
    let mut sizes = vec![0; first_pass.above.len()];
    first_pass.of_node[..ground].iter().for_each(|&component| sizes[component] += 1);
    // From the ground, and of every body from its largest component.
    let mut starts: Vec<usize> = (0..ground).collect();
    starts.sort_by_key(|&p| std::cmp::Reverse(sizes[first_pass.of_node[p]]));
    let components = graph.components(starts);
    let mut top = vec![None; components.above.len()];
    for (component, above) in components.above.iter().enumerate() {
        top[component] = above.and_then(|above| top[above].or(Some(component)));
    }
    let mut parts: Vec<Vec<usize>> = vec![Vec::new(); components.above.len()];
    for (p, component) in components.of_node[..ground].iter().enumerate() {
        if let Some(top) = top[*component] {
            parts[top].push(p);
        }
    }
    parts.retain(|part| !part.is_empty());
    parts.sort();
    parts
}

/// Springs at each node with their other ends. Nodes are particles, and last the ground: all that are held in any axis.
struct Graph(Vec<Vec<(usize, usize)>>);

/// The components that remain without bridges. Each comes after that which it hangs from, or hangs from none.
struct Components {
    of_node: Vec<usize>,
    above: Vec<Option<usize>>,
}

impl Graph {
    fn new(system: &System) -> Self {
        let ground = system.particles();
        let node = |p: usize| if system.dofs().rows(p).len() < system.dimension() { ground } else { p };
        let mut neighbours = vec![Vec::new(); ground + 1];
        for (spring, ends, _) in system.active() {
            let [a, b] = ends.map(node);
            if a != b {
                neighbours[a].push((spring, b));
                neighbours[b].push((spring, a));
            }
        }
        Self(neighbours)
    }

    /// By a search in depth, from the ground and then from each start that none before has reached.
    fn components(&self, starts: impl IntoIterator<Item = usize>) -> Components {
        const NONE: usize = usize::MAX;
        let nodes = self.0.len();
        let mut next = vec![0; nodes];
        // The place in the order of discovery, the least place that is reached from below, and the spring and node by which it is entered.
        let (mut place, mut low, mut entry) = (vec![NONE; nodes], vec![NONE; nodes], vec![(NONE, NONE); nodes]);
        let mut order = Vec::with_capacity(nodes);
        for start in std::iter::once(nodes - 1).chain(starts) {
            if place[start] != NONE {
                continue;
            }
            let mut at = start;
            (place[at], low[at]) = (order.len(), order.len());
            order.push(at);
            loop {
                let (spring, parent) = entry[at];
                if let Some(&(along, to)) = self.0[at].get(next[at]) {
                    next[at] += 1;
                    if place[to] == NONE {
                        (place[to], low[to], entry[to]) = (order.len(), order.len(), (along, at));
                        order.push(to);
                        at = to;
                    } else if along != spring {
                        low[at] = low[at].min(place[to]);
                    }
                } else if parent != NONE {
                    low[parent] = low[parent].min(low[at]);
                    at = parent;
                } else {
                    break;
                }
            }
        }
        let mut components = Components { of_node: vec![NONE; nodes], above: Vec::new() };
        for node in order {
            let (_, parent) = entry[node];
            let above = (parent != NONE).then(|| components.of_node[parent]);
            components.of_node[node] = match above {
                Some(component) if low[node] < place[node] => component,
                _ => {
                    components.above.push(above);
                    components.above.len() - 1
                }
            };
        }
        components
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, SystemBuilder};

    fn parts_of(particles: usize, pairs: &[[usize; 2]], constraint: Constraint) -> Vec<Vec<usize>> {
        let mut builder = SystemBuilder::new();
        (0..particles).for_each(|p| {
            builder.particle([p as f64, (p * p) as f64, 0.0], 1.0);
        });
        for &[i, j] in pairs {
            builder.spring(i, j, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.constrain(constraint);
        hanging(&builder.build().unwrap().0)
    }

    fn parts(particles: usize, pairs: &[[usize; 2]], held: &[usize]) -> Vec<Vec<usize>> {
        parts_of(particles, pairs, Constraint::hold(held.iter().copied()))
    }

    /// Two triangles joined by one spring, a tail of two on the second, and a triangle apart.
    #[test]
    fn parts_hang_from_what_is_held_or_from_the_largest() {
        let pairs = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 4], [4, 5], [5, 3], [5, 6], [6, 7], [8, 9], [9, 10], [10, 8]];
        assert_eq!(parts(11, &pairs, &[]), [vec![3, 4, 5, 6, 7]]);
        assert_eq!(parts(11, &pairs, &[4]), [vec![0, 1, 2], vec![6, 7]]);
        assert_eq!(parts(11, &pairs, &[0, 7]), [] as [Vec<usize>; 0]);
        // A second spring side by side with the first.
        assert_eq!(parts(11, &[&pairs[..], &[[2, 3]]].concat(), &[]), [vec![6, 7]]);
        // The largest component carries the rest, wherever it is.
        assert_eq!(parts(5, &[[0, 1], [1, 2], [2, 3], [3, 4], [4, 2]], &[]), [vec![0, 1]]);
        // A chain from its held end.
        let pairs: Vec<[usize; 2]> = (0..4).map(|k| [k, k + 1]).collect();
        assert_eq!(parts(5, &pairs, &[4]), [vec![0, 1, 2, 3]]);
        assert_eq!(parts(5, &pairs, &[0, 4]), [] as [Vec<usize>; 0]);
        assert_eq!(parts(5, &pairs, &[]), [vec![1, 2, 3, 4]]);
    }

    /// A particle on a roller is part of the ground.
    #[test]
    fn parts_hang_from_rollers() {
        let roller = Constraint { axes: Axes::of(&[1]), ..Constraint::hold([0]) };
        assert_eq!(parts_of(4, &[[0, 1], [1, 2], [2, 3], [3, 1]], roller), [vec![1, 2, 3]]);
    }
}
