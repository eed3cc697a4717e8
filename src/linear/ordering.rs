//! Orderings that keep a factor sparse, found on the graph of particles.
//!
//! The degrees of freedom of a particle have the same neighbours, so ordering particles and expanding them by their free
//! axes gives the fill of ordering scalars at a ninth of the entries. Two methods are there: approximate minimum degree
//! (Amestoy, Davis and Duff 1996), the better one for cloths, and nested dissection by multilevel bisection (George
//! 1973; Karypis and Kumar 1998), which lattices need. The elimination tree and the exact column counts of either (Liu
//! 1990) say what it costs; the cheaper one is put into postorder, so that columns of one structure lie side by side.
//!
//! A dissection takes ten to twenty times as long as a minimum degree, and for surfaces never pays: it is tried only where a minimum degree is
//! dearer than that of surfaces. Eliminating separators of `c √n` vertices of w rows each takes `c³ w³ n^(3/2)` operations, with c³ below a
//! hundred where a cloth is joined up to the second neighbour; volumes, whose separators have some n^(2/3) vertices, take more.

use crate::assembly::BlockPattern;
use feral_amd::CscPattern;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Operations from which a nested dissection is tried: below, a whole factorization takes less time than the dissection.
const DISSECTION_FLOPS: f64 = 1e8;

/// c³ above which a factorization is dearer than a surface's: cloths of 24² to 1000² particles have 37 to 109, slabs of three layers 160.
const SURFACE_COST: f64 = 130.0;

/// The power of the number of vertices by which a dissection takes fewer operations than a minimum degree, at most, as measured: lattices of 10³ to 60³
/// take 1.7 to 14.1 times fewer, networks of 3000 to 10⁵ particles 1.8 to 3.5 times.
const DISSECTION_GAIN: f64 = 0.22;

/// How an ordering was found.
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

/// A permutation of the rows of a matrix.
#[derive(Debug, Clone)]
pub(super) struct Ordering {
    pub method: OrderingMethod,
    /// The old row of every new one.
    pub forward: Vec<u32>,
    /// The new row of every old one.
    pub inverse: Vec<u32>,
}

/// What a minimum degree ordering shows of a pattern: for surfaces what a factorization takes, for volumes what it takes at least. A sixth to a
/// ninth of what an analysis with a dissection takes.
pub(super) struct OrderingEstimate {
    graph: ParticleGraph,
    method: OrderingMethod,
    elimination: Elimination,
    /// Whether a dissection is tried.
    may_gain: bool,
    took: Duration,
}

impl OrderingEstimate {
    pub fn of(pattern: &BlockPattern) -> Self {
        let start = Instant::now();
        let graph = ParticleGraph::new(pattern);
        let natural = || (0..graph.len() as u32).collect();
        let (method, order) = match graph.minimum_degree() {
            Some(order) => (OrderingMethod::MinimumDegree, order),
            None => (OrderingMethod::Natural, natural()),
        };
        let elimination = Elimination::new(&graph, order);
        let may_gain = elimination.flops > DISSECTION_FLOPS && graph.is_dear(elimination.flops);
        Self { graph, method, elimination, may_gain, took: start.elapsed() }
    }

    /// The method that the cheapest ordering probably comes from.
    pub fn method(&self) -> OrderingMethod {
        if self.may_gain { OrderingMethod::NestedDissection } else { self.method }
    }

    /// The time that it has taken.
    pub fn took(&self) -> Duration {
        self.took
    }

    /// Entries and operations of a factor, at least.
    pub fn least(&self) -> (f64, f64) {
        let gain = if self.may_gain { (self.graph.len() as f64).powf(DISSECTION_GAIN) } else { 1.0 };
        // Of a volume a factor of n vertices has n^(4/3) entries and takes n² operations.
        (self.elimination.entries / gain.powf(2.0 / 3.0), self.elimination.flops / gain)
    }

    /// The cheapest ordering that the methods find.
    pub fn order(self, pattern: &BlockPattern) -> Ordering {
        let Self { graph, mut method, mut elimination, may_gain, .. } = self;
        if may_gain && let Some(order) = graph.nested_dissection() {
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

/// The particles that can move, numbered anew, with all their neighbours.
struct ParticleGraph {
    /// The particle of every vertex.
    particles: Vec<u32>,
    /// How many rows every vertex stands for.
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
        let mut starts = vec![0i32; particles.len() + 1];
        for v in 0..particles.len() {
            for u in above(v) {
                starts[v + 1] += 1;
                starts[u + 1] += 1;
            }
        }
        for v in 0..particles.len() {
            starts[v + 1] += starts[v];
        }
        // A vertex gets its lower neighbours first, in the order of v, then its upper ones: ascending as a whole.
        let mut filled = starts.clone();
        let mut neighbours = vec![0i32; starts.last().map_or(0, |&entries| entries as usize)];
        let mut put = |at: usize, neighbour: usize| {
            neighbours[filled[at] as usize] = neighbour as i32;
            filled[at] += 1;
        };
        for v in 0..particles.len() {
            above(v).for_each(|u| put(u, v));
        }
        for v in 0..particles.len() {
            above(v).for_each(|u| put(v, u));
        }
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
        checked(feral_amd::amd_order(&self.as_columns()?).ok()?, self.len())
    }

    fn nested_dissection(&self) -> Option<Vec<u32>> {
        checked(feral_metis::metis_order(&self.as_columns()?).ok()?, self.len())
    }

    /// Whether an elimination of so many operations takes more than those of surfaces do.
    fn is_dear(&self, flops: f64) -> bool {
        let rows: f64 = self.weights.iter().map(|&weight| f64::from(weight)).sum();
        let vertices = self.len() as f64;
        flops > SURFACE_COST * (rows / vertices).powi(3) * vertices.powf(1.5)
    }

    fn as_columns(&self) -> Option<CscPattern<'_>> {
        CscPattern::new(self.len(), &self.starts, &self.neighbours)
    }
}

/// The order, if it is a permutation.
fn checked(order: Vec<i32>, length: usize) -> Option<Vec<u32>> {
    let mut seen = vec![false; length];
    let is_new = |&v: &i32| seen.get_mut(v as usize).is_some_and(|seen| !std::mem::replace(seen, true));
    (order.len() == length && order.iter().all(is_new)).then(|| order.into_iter().map(|v| v as u32).collect())
}

/// No vertex: the parent of a root.
const NONE: u32 = u32::MAX;

/// What elimination in a certain order does.
struct Elimination {
    order: Vec<u32>,
    /// The elimination tree, by places in the order; a parent comes after its children.
    parents: Vec<u32>,
    /// Of L.
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
        let mut seen = vec![NONE; order.len()];
        for k in 0..order.len() as u32 {
            for mut i in earlier(k) {
                while i != k && i != NONE && seen[i as usize] != k {
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

    /// The order with every subtree of the elimination tree in one piece. The fill is the same.
    fn postorder(&self) -> Vec<u32> {
        let count = self.order.len();
        let (mut first_child, mut next_sibling) = (vec![NONE; count], vec![NONE; count]);
        let mut roots = NONE;
        for k in (0..count as u32).rev() {
            let parent = self.parents[k as usize];
            let first = if parent == NONE { &mut roots } else { &mut first_child[parent as usize] };
            next_sibling[k as usize] = std::mem::replace(first, k);
        }
        let mut postorder = Vec::with_capacity(count);
        let mut path = Vec::new();
        let mut next = roots;
        loop {
            while next != NONE {
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
    let mut parents = vec![NONE; count];
    // Shortcuts up the tree built so far.
    let mut ancestors = vec![NONE; count];
    for k in 0..count as u32 {
        for mut i in earlier(k) {
            while i != k {
                let ancestor = std::mem::replace(&mut ancestors[i as usize], k);
                if ancestor == NONE {
                    parents[i as usize] = k;
                    break;
                }
                i = ancestor;
            }
        }
    }
    parents
}

#[cfg(all(test, feature = "scene"))]
mod tests;
