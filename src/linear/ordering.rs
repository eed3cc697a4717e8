//! Fill-reducing orderings, computed on the graph of particles.
//!
//! The degrees of freedom of a particle have the same neighbours, so ordering particles and expanding them by their free axes gives the fill of
//! ordering scalars at a ninth of the entries. There are two methods: approximate minimum degree (Amestoy, Davis and Duff 1996), the better one for
//! cloths, and nested dissection by multilevel bisection (George 1973; Karypis and Kumar 1998), which lattices need. The elimination tree and the
//! exact column counts of either (Liu 1990) give its cost; the cheaper one is put into postorder, so that columns of one structure are neighbours.
//!
//! A dissection takes ten to twenty times as long as a minimum degree and never pays for surfaces, so it is tried only where a minimum degree costs
//! more than for surfaces. Eliminating separators of `c √n` vertices of w rows each takes `c³ w³ n^(3/2)` operations, with c³ below a hundred where a
//! cloth is joined up to the second neighbour; volumes, whose separators have about n^(2/3) vertices, take more.

use crate::assembly::BlockPattern;
use crate::operator::group;
use feral_amd::CscPattern;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Operations from which a nested dissection is tried: a smaller factorization takes less time than the dissection.
const DISSECTION_FLOPS: f64 = 1e8;

/// c³ above which a factorization costs more than a surface's: cloths of 24² to 1000² particles have 37 to 109, slabs of three layers 160.
const SURFACE_COST: f64 = 130.0;

/// The method that found an ordering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum OrderingMethod {
    /// The order of the scene.
    Natural,
    /// Approximate minimum degree.
    MinimumDegree,
    /// Nested dissection.
    NestedDissection,
}

/// The cost of a factorization, known from the pattern alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FactorSize {
    /// Stored values of L, the zeros inside supernodes included.
    pub entries: usize,
    /// Floating-point operations of a numeric factorization.
    pub flops: f64,
    /// The ordering of the rows.
    pub ordering: OrderingMethod,
}

/// A permutation of the rows of a matrix.
#[derive(Debug, Clone)]
pub(super) struct Ordering {
    pub method: OrderingMethod,
    /// The old row of every new one.
    pub forward: Vec<u32>,
    /// The new row of every old one.
    pub inverse: Vec<u32>,
}

/// A lower bound of the cost of a factorization by minimum degree, exact for surfaces, in a sixth to a ninth of the time of a dissection.
pub(super) struct OrderingEstimate {
    graph: ParticleGraph,
    method: OrderingMethod,
    elimination: Elimination,
    tries_dissection: bool,
    pub duration: Duration,
}

impl OrderingEstimate {
    pub fn new(pattern: &BlockPattern) -> Self {
        let start = Instant::now();
        let graph = ParticleGraph::new(pattern);
        let (method, order) = match graph.minimum_degree() {
            Some(order) => (OrderingMethod::MinimumDegree, order),
            None => (OrderingMethod::Natural, (0..graph.len() as u32).collect()),
        };
        let elimination = Elimination::new(&graph, order);
        let tries_dissection = elimination.flops > DISSECTION_FLOPS && graph.exceeds_surface_cost(elimination.flops);
        Self { graph, method, elimination, tries_dissection, duration: start.elapsed() }
    }

    /// The lower bound, with the method that probably gives the cheapest ordering.
    pub fn least(&self) -> FactorSize {
        let Elimination { entries, flops, .. } = self.elimination;
        if !self.tries_dissection {
            return FactorSize { entries: entries as usize, flops, ordering: self.method };
        }
        // An upper bound: 1.7 to 14.1 times fewer operations on lattices of 10³ to 60³, 1.8 to 3.5 on networks of 3000 to 10⁵ particles.
        let gain = (self.graph.len() as f64).powf(0.22);
        // The factor of a volume of n vertices has n^(4/3) entries and takes n² operations.
        let entries = (entries / gain.powf(2.0 / 3.0)) as usize;
        FactorSize { entries, flops: flops / gain, ordering: OrderingMethod::NestedDissection }
    }

    /// The cheapest ordering.
    pub fn order(self, pattern: &BlockPattern) -> Ordering {
        let Self { graph, mut method, mut elimination, tries_dissection, .. } = self;
        if tries_dissection && let Some(order) = graph.nested_dissection() {
            let dissection = Elimination::new(&graph, order);
            if dissection.flops < elimination.flops {
                (method, elimination) = (OrderingMethod::NestedDissection, dissection);
            }
        }
        let rows = |&vertex: &u32| pattern.dofs().rows(graph.particles[vertex as usize] as usize);
        let forward: Vec<u32> = elimination.postorder().iter().flat_map(rows).map(|row| row as u32).collect();
        let mut inverse = vec![0; forward.len()];
        for (new, &old) in (0..).zip(&forward) {
            inverse[old as usize] = new;
        }
        Ordering { method, forward, inverse }
    }
}

/// The particles that can move, as the vertices of a graph.
struct ParticleGraph {
    /// The particle of every vertex.
    particles: Vec<u32>,
    /// Rows of every vertex.
    weights: Vec<u32>,
    /// The neighbours of v are `neighbours[starts[v]..starts[v + 1]]`, ascending.
    starts: Vec<i32>,
    neighbours: Vec<i32>,
}

impl ParticleGraph {
    fn new(pattern: &BlockPattern) -> Self {
        let dofs = pattern.dofs();
        let particles: Vec<u32> =
            (0..dofs.particles() as u32).filter(|&particle| !dofs.rows(particle as usize).is_empty()).collect();
        let weights = particles.iter().map(|&particle| dofs.rows(particle as usize).len() as u32).collect();
        let mut vertex = vec![u32::MAX; dofs.particles()];
        for (v, &particle) in (0..).zip(&particles) {
            vertex[particle as usize] = v;
        }
        let above = |v: usize| {
            let neighbours = pattern.neighbours_above(particles[v] as usize);
            neighbours.map(|particle| vertex[particle] as usize).filter(|&u| u != u32::MAX as usize)
        };
        // Lower neighbours first, then upper ones: ascending as a whole.
        let pairs = || (0..particles.len()).flat_map(|v| above(v).map(move |u| (v, u)));
        let both = || pairs().map(|(v, u)| (u, v as i32)).chain(pairs().map(|(v, u)| (v, u as i32)));
        let (starts, neighbours) = group(particles.len(), both);
        let starts = starts.into_iter().map(|start| start as i32).collect();
        Self { particles, weights, starts, neighbours }
    }

    fn len(&self) -> usize {
        self.particles.len()
    }

    fn neighbours(&self, v: u32) -> impl Iterator<Item = u32> {
        let range = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
        self.neighbours[range].iter().map(|&u| u as u32)
    }

    fn minimum_degree(&self) -> Option<Vec<u32>> {
        permutation(feral_amd::amd_order(&self.as_columns()?).ok()?, self.len())
    }

    fn nested_dissection(&self) -> Option<Vec<u32>> {
        permutation(feral_metis::metis_order(&self.as_columns()?).ok()?, self.len())
    }

    fn exceeds_surface_cost(&self, flops: f64) -> bool {
        let rows: f64 = self.weights.iter().map(|&weight| f64::from(weight)).sum();
        let vertices = self.len() as f64;
        flops > SURFACE_COST * (rows / vertices).powi(3) * vertices.powf(1.5)
    }

    fn as_columns(&self) -> Option<CscPattern<'_>> {
        CscPattern::new(self.len(), &self.starts, &self.neighbours)
    }
}

fn permutation(order: Vec<i32>, length: usize) -> Option<Vec<u32>> {
    let mut seen = vec![false; length];
    let is_new = |&v: &i32| seen.get_mut(v as usize).is_some_and(|seen| !std::mem::replace(seen, true));
    (order.len() == length && order.iter().all(is_new)).then(|| order.into_iter().map(|v| v as u32).collect())
}

/// The elimination tree and the cost of an order.
struct Elimination {
    order: Vec<u32>,
    /// The parent of every place in the order, after its children; `u32::MAX` for a root.
    parents: Vec<u32>,
    entries: f64,
    /// Operations of a factorization: a column of h entries takes h² (multiply and add counted).
    flops: f64,
}

impl Elimination {
    fn new(graph: &ParticleGraph, order: Vec<u32>) -> Self {
        let mut place = vec![0u32; order.len()];
        for (k, &v) in (0..).zip(&order) {
            place[v as usize] = k;
        }
        let earlier = |k: u32| graph.neighbours(order[k as usize]).map(|u| place[u as usize]).filter(move |&i| i < k);
        let parents = elimination_tree(order.len(), earlier);
        // Row k of L has entries on the paths from the earlier neighbours of k up to k: walk each path once.
        let weight = |k: u32| u64::from(graph.weights[order[k as usize] as usize]);
        let mut below = vec![0u64; order.len()];
        let mut seen = vec![u32::MAX; order.len()];
        for k in 0..order.len() as u32 {
            for mut i in earlier(k) {
                while i != k && i != u32::MAX && seen[i as usize] != k {
                    seen[i as usize] = k;
                    below[i as usize] += weight(k);
                    i = parents[i as usize];
                }
            }
        }
        // A vertex has a column for each of its rows.
        let columns = (0..).zip(&below).flat_map(|(k, &below)| (1..=weight(k)).map(move |rows| (below + rows) as f64));
        let (entries, flops) =
            columns.fold((0.0, 0.0), |(entries, flops), column| (entries + column, flops + column * column));
        Self { order, parents, entries, flops }
    }

    /// The order with every subtree of the elimination tree contiguous, which has the same fill.
    fn postorder(&self) -> Vec<u32> {
        let count = self.order.len();
        let (mut first_child, mut next_sibling) = (vec![u32::MAX; count], vec![u32::MAX; count]);
        let mut roots = u32::MAX;
        for k in (0..count as u32).rev() {
            let parent = self.parents[k as usize];
            let first = if parent == u32::MAX { &mut roots } else { &mut first_child[parent as usize] };
            next_sibling[k as usize] = std::mem::replace(first, k);
        }
        let mut postorder = Vec::with_capacity(count);
        let mut path = Vec::new();
        let mut next = roots;
        loop {
            while next != u32::MAX {
                path.push(next);
                next = first_child[next as usize];
            }
            let Some(done) = path.pop() else { return postorder };
            postorder.push(self.order[done as usize]);
            next = next_sibling[done as usize];
        }
    }
}

/// Liu's algorithm: the parent of i is the first later vertex that it is joined to by a path through earlier ones.
fn elimination_tree<I: Iterator<Item = u32>>(count: usize, earlier: impl Fn(u32) -> I) -> Vec<u32> {
    let mut parents = vec![u32::MAX; count];
    // Shortcuts up the tree built so far.
    let mut ancestors = vec![u32::MAX; count];
    for k in 0..count as u32 {
        for mut i in earlier(k) {
            while i != k {
                let ancestor = std::mem::replace(&mut ancestors[i as usize], k);
                if ancestor == u32::MAX {
                    parents[i as usize] = k;
                    break;
                }
                i = ancestor;
            }
        }
    }
    parents
}

#[cfg(feature = "scene")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::{cloth, column, lattice, network};
    use std::collections::BTreeSet;

    fn graph(scene: crate::Scene) -> (ParticleGraph, BlockPattern) {
        let (system, _) = scene.build().unwrap();
        let pairs = system.active().map(|(_, pair, _)| pair).collect::<Vec<_>>();
        let pattern = BlockPattern::new(system.dofs(), pairs.into_iter()).unwrap();
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
                assert_eq!(postorder.iter().collect::<BTreeSet<_>>().len(), graph.len());
            }
            let Ordering { forward, inverse, .. } = OrderingEstimate::new(&pattern).order(&pattern);
            assert_eq!(forward.len(), pattern.order());
            assert!((0..forward.len()).all(|new| inverse[forward[new] as usize] as usize == new));
        }
    }

    /// For a surface the estimate is exact, for a volume it is a lower bound.
    #[test]
    fn estimates_are_lower_bounds() {
        for scene in [cloth(32), column(200), lattice(6), lattice(10), lattice(16), network(3000, 3)] {
            let (graph, pattern) = graph(scene.unwrap());
            let estimate = OrderingEstimate::new(&pattern);
            let (least, tries_dissection) = (estimate.least(), estimate.tries_dissection);
            let Ordering { method, forward, .. } = estimate.order(&pattern);
            assert_eq!((method, method == OrderingMethod::NestedDissection), (least.ordering, tries_dissection));
            // The rows of a vertex are neighbours in the order, and here all are three.
            let vertex: Vec<u32> = (0..graph.len() as u32)
                .flat_map(|v| pattern.dofs().rows(graph.particles[v as usize] as usize).map(move |_| v))
                .collect();
            let order =
                forward.iter().step_by(pattern.order() / graph.len()).map(|&row| vertex[row as usize]).collect();
            let found = Elimination::new(&graph, order);
            if tries_dissection {
                let [fewer, bound] = [found.entries / least.entries as f64, found.flops / least.flops];
                assert!((1.0..3.0).contains(&fewer) && (1.0..4.0).contains(&bound), "{fewer} {bound}");
            } else {
                assert_eq!((found.entries, found.flops), (least.entries as f64, least.flops));
            }
        }
    }

    /// Every subtree is one interval that ends with its root.
    #[test]
    fn postorder_keeps_subtrees_together() {
        let (graph, _) = graph(lattice(6).unwrap());
        let elimination = Elimination::new(&graph, graph.nested_dissection().unwrap());
        let again = Elimination::new(&graph, elimination.postorder());
        for (k, &parent) in again.parents.iter().enumerate().filter(|(_, parent)| **parent != u32::MAX) {
            assert!(parent as usize > k && again.parents[k + 1..parent as usize].iter().all(|&next| next <= parent));
        }
    }

    /// No vertex, no edge, many components, one vertex joined to all others.
    #[test]
    fn odd_graphs_are_ordered() {
        let star: Vec<[usize; 2]> = (1..3000).map(|leaf| [0, leaf]).collect();
        let pairs: Vec<[usize; 2]> = (0..1000).map(|pair| [2 * pair, 2 * pair + 1]).collect();
        for (particles, edges) in [(0, vec![]), (1, vec![]), (500, vec![]), (3000, star), (2100, pairs)] {
            let pattern = BlockPattern::new(&crate::DofMap::unconstrained(particles), edges.into_iter()).unwrap();
            let graph = ParticleGraph::new(&pattern);
            assert!(particles == 0 || graph.minimum_degree().is_some() && graph.nested_dissection().is_some());
            assert_eq!(OrderingEstimate::new(&pattern).order(&pattern).forward.len(), 3 * particles);
        }
    }

    /// A dissection saves less than a tenth of the work on surfaces, and more on volumes, which are dissected.
    #[test]
    fn surfaces_are_not_dissected_and_would_not_gain_by_it() {
        let scenes =
            [(cloth(32), false), (cloth(60), false), (column(300), false), (lattice(10), true), (lattice(14), true)];
        for (scene, is_volume) in scenes {
            let (graph, pattern) = graph(scene.unwrap());
            let minimum_degree = Elimination::new(&graph, graph.minimum_degree().unwrap());
            let dissection = Elimination::new(&graph, graph.nested_dissection().unwrap());
            assert_eq!(graph.exceeds_surface_cost(minimum_degree.flops), is_volume, "{} vertices", graph.len());
            let gain = 1.0 - dissection.flops / minimum_degree.flops;
            assert_eq!(gain > 0.1, is_volume, "{} vertices: {gain}", graph.len());
            let method = if is_volume { OrderingMethod::NestedDissection } else { OrderingMethod::MinimumDegree };
            let estimate = OrderingEstimate::new(&pattern);
            assert!(estimate.duration > Duration::ZERO);
            assert_eq!(estimate.order(&pattern).method, method);
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
        assert_eq!(OrderingEstimate::new(&pattern).order(&pattern).method, OrderingMethod::MinimumDegree);
    }
}
