//! Orders against elimination vertex by vertex, and which method has which scenes.

use super::*;
use crate::assembly::SpringPattern;
use crate::scene::builtin::{cloth, column, lattice, network};
use std::collections::BTreeSet;

fn graph(scene: crate::Scene) -> (ParticleGraph, BlockPattern) {
    let (system, _) = scene.build().unwrap();
    let pairs = system.active().map(|(_, pair, _)| pair).collect::<Vec<_>>();
    let pattern = BlockPattern::new(system.dofs(), pairs.into_iter()).unwrap();
    assert!(SpringPattern::of_stiffness(&system).is_ok());
    (ParticleGraph::new(&pattern), pattern)
}

/// Entries and operations by eliminating vertex by vertex, joining all later neighbours.
fn by_elimination(graph: &ParticleGraph, order: &[u32]) -> (f64, f64) {
    let mut adjacent: Vec<BTreeSet<u32>> = (0..graph.len() as u32).map(|v| graph.neighbours(v).collect()).collect();
    let (mut entries, mut flops) = (0.0, 0.0);
    for &v in order {
        let later = std::mem::take(&mut adjacent[v as usize]);
        let below: u32 = later.iter().map(|&u| graph.weights[u as usize]).sum();
        for column in (1..=graph.weights[v as usize]).map(|rows| f64::from(below + rows)) {
            entries += column;
            flops += column.powi(2);
        }
        for &u in &later {
            adjacent[u as usize].remove(&v);
            adjacent[u as usize].extend(later.iter().filter(|&&w| w != u));
        }
    }
    (entries, flops)
}

#[test]
fn orderings_are_permutations_and_their_cost_is_that_of_elimination() {
    for scene in [cloth(12), lattice(6), network(300, 3)] {
        let (graph, pattern) = graph(scene.unwrap());
        let natural: Vec<u32> = (0..graph.len() as u32).collect();
        for order in [Some(natural), graph.minimum_degree(), graph.nested_dissection()] {
            let elimination = Elimination::new(&graph, order.unwrap());
            let counted = (elimination.entries, elimination.flops);
            assert_eq!(counted, by_elimination(&graph, &elimination.order));
            let postorder = elimination.postorder();
            assert_eq!(counted, by_elimination(&graph, &postorder), "postorder changes no fill");
            assert!(checked(postorder.iter().map(|&v| v as i32).collect(), graph.len()).is_some());
        }
        let Ordering { forward, inverse, .. } = OrderingEstimate::of(&pattern).order(&pattern);
        assert_eq!(forward.len(), pattern.order());
        assert!((0..forward.len()).all(|new| inverse[forward[new] as usize] as usize == new));
    }
}

/// Of a surface all is seen at first glance, of a volume a bound.
#[test]
fn glances_show_the_least() {
    for scene in [cloth(32), column(200), lattice(6), lattice(10), lattice(16), network(3000, 3)] {
        let (graph, pattern) = graph(scene.unwrap());
        let glance = OrderingEstimate::of(&pattern);
        let ((entries, flops), may_gain, expected) = (glance.least(), glance.may_gain, glance.method());
        let Ordering { method, forward, .. } = glance.order(&pattern);
        assert_eq!((method, method == OrderingMethod::NestedDissection), (expected, may_gain));
        // The rows of a vertex are neighbours in the order, and here all are three.
        let vertex: Vec<u32> = (0..graph.len() as u32)
            .flat_map(|v| pattern.dofs().rows(graph.particles[v as usize] as usize).map(move |_| v))
            .collect();
        let order = forward.iter().step_by(pattern.order() / graph.len()).map(|&row| vertex[row as usize]).collect();
        let found = Elimination::new(&graph, order);
        if may_gain {
            let [fewer, least] = [found.entries / entries, found.flops / flops];
            assert!((1.0..3.0).contains(&fewer) && (1.0..4.0).contains(&least), "{fewer} {least}");
        } else {
            assert_eq!((found.entries, found.flops), (entries, flops));
        }
    }
}

/// In a postorder the parent of a vertex that is no last child is not its successor's business: every subtree is one
/// interval that ends with its root.
#[test]
fn postorder_keeps_subtrees_together() {
    let (graph, _) = graph(lattice(6).unwrap());
    let elimination = Elimination::new(&graph, graph.nested_dissection().unwrap());
    let again = Elimination::new(&graph, elimination.postorder());
    let mut sizes = vec![1usize; again.order.len()];
    for k in 0..again.order.len() {
        let parent = again.parents[k] as usize;
        if again.parents[k] != NONE {
            sizes[parent] += sizes[k];
        }
    }
    let mut next_start = vec![0; again.order.len()];
    for k in 0..again.order.len() {
        next_start[k] = k + 1 - sizes[k];
        assert!(again.parents[k] == NONE || again.parents[k] as usize > k);
    }
    for k in 0..again.order.len() {
        if again.parents[k] != NONE {
            assert!(next_start[again.parents[k] as usize] <= next_start[k], "a subtree lies inside its parent's");
        }
    }
}

/// No vertex, no edge, many components, one vertex joined to all others: nothing that a scene may bring is refused.
#[test]
fn odd_graphs_are_ordered() {
    let star: Vec<[usize; 2]> = (1..3000).map(|leaf| [0, leaf]).collect();
    let pairs: Vec<[usize; 2]> = (0..1000).map(|pair| [2 * pair, 2 * pair + 1]).collect();
    for (particles, edges) in [(0, vec![]), (1, vec![]), (500, vec![]), (3000, star), (2100, pairs)] {
        let pattern = BlockPattern::new(&crate::DofMap::unconstrained(particles), edges.into_iter()).unwrap();
        let graph = ParticleGraph::new(&pattern);
        assert!(particles == 0 || graph.minimum_degree().is_some() && graph.nested_dissection().is_some());
        assert_eq!(OrderingEstimate::of(&pattern).order(&pattern).forward.len(), 3 * particles);
    }
}

#[test]
fn lattices_are_dissected() {
    let (_, pattern) = graph(lattice(14).unwrap());
    assert_eq!(OrderingEstimate::of(&pattern).order(&pattern).method, OrderingMethod::NestedDissection);
}

/// What is not dissected would not take a tenth less work; what is like a volume is, and takes that much less.
#[test]
fn surfaces_are_not_dissected_and_would_not_gain_by_it() {
    let scenes = [(cloth(32), false), (cloth(60), false), (column(300), false), (lattice(10), true)];
    for (scene, is_volume) in scenes {
        let (graph, pattern) = graph(scene.unwrap());
        let minimum_degree = Elimination::new(&graph, graph.minimum_degree().unwrap());
        let dissection = Elimination::new(&graph, graph.nested_dissection().unwrap());
        assert_eq!(graph.is_dear(minimum_degree.flops), is_volume, "{} vertices", graph.len());
        let gain = 1.0 - dissection.flops / minimum_degree.flops;
        assert_eq!(gain > 0.1, is_volume, "{} vertices: {gain}", graph.len());
        let method = if is_volume { OrderingMethod::NestedDissection } else { OrderingMethod::MinimumDegree };
        let glance = OrderingEstimate::of(&pattern);
        assert!(glance.took() > Duration::ZERO);
        assert_eq!(glance.order(&pattern).method, method);
    }
}

/// Where all particles are joined every order costs the same, the sum of the first n squares; minimum degree then stays.
#[test]
fn a_dissection_must_be_cheaper() {
    let particles = 230;
    let pairs: Vec<[usize; 2]> = (0..particles).flat_map(|j| (0..j).map(move |i| [i, j])).collect();
    let pattern = BlockPattern::new(&crate::DofMap::unconstrained(particles), pairs.into_iter()).unwrap();
    let graph = ParticleGraph::new(&pattern);
    for order in [graph.minimum_degree(), graph.nested_dissection()] {
        let flops = Elimination::new(&graph, order.unwrap()).flops;
        assert_eq!(flops, f64::from(690 * 691 / 6 * 1381));
        assert!(flops > DISSECTION_FLOPS);
    }
    assert_eq!(OrderingEstimate::of(&pattern).order(&pattern).method, OrderingMethod::MinimumDegree);
}

#[test]
fn an_order_names_every_vertex_once() {
    assert_eq!(checked(vec![2, 0, 1], 3), Some(vec![2, 0, 1]));
    assert_eq!(checked(vec![], 0), Some(vec![]));
    for wrong in [vec![0, 1], vec![0, 1, 2, 0], vec![0, 1, 1], vec![0, 1, 3], vec![0, 1, -1]] {
        assert_eq!(checked(wrong.clone(), 3), None, "{wrong:?}");
    }
}
