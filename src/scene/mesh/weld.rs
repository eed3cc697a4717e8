//! Vertices that are joined, and what of a mesh may surprise: loose parts, coincident and unused vertices.

use super::MeshGeometry;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use std::collections::HashSet;

/// Sets of vertices, each known by its first.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn first(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            let above = self.0[self.0[vertex as usize] as usize];
            self.0[vertex as usize] = above;
            vertex = above;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [self.first(a), self.first(b)];
        self.0[a.max(b) as usize] = a.min(b);
    }
}

impl MeshGeometry {
    /// Joins vertices that are no farther apart than `distance`, directly or by way of others; the first of them stays. Edges and triangles
    /// within what is joined vanish.
    pub(in crate::scene) fn weld(&mut self, distance: f64) {
        let points =
            self.vertices.iter().zip(0u32..).map(|(&x, vertex)| GeomWithData::new(<[f64; 3]>::from(x), vertex));
        let tree = RTree::bulk_load(points.collect());
        let mut sets = Sets::new(self.vertices.len());
        for (vertex, &x) in (0u32..).zip(&self.vertices) {
            // Those that come later find this one.
            let near = tree.locate_within_distance(x.into(), distance * distance);
            near.filter(|other| other.data < vertex).for_each(|other| sets.join(vertex, other.data));
        }
        let mut numbers = vec![0; self.vertices.len()];
        let mut kept = Vec::new();
        for (vertex, x) in self.vertices.iter().enumerate() {
            let first = sets.first(vertex as u32) as usize;
            if first == vertex {
                numbers[vertex] = kept.len() as u32;
                kept.push(*x);
            } else {
                numbers[vertex] = numbers[first];
            }
        }
        let joined = self.vertices.len() - kept.len();
        if joined == 0 {
            return;
        }
        self.notes.push(format!("mesh.weld joins {} vertices to {}", self.vertices.len(), kept.len()));
        self.vertices = kept;
        let renumbered = |edge: [u32; 2]| {
            let [i, j] = edge.map(|vertex| numbers[vertex as usize]);
            [i.min(j), i.max(j)]
        };
        let edges = self.edges.iter().map(|edge| renumbered(*edge)).zip(self.places.iter().copied());
        let mut edges: Vec<_> = edges.filter(|([i, j], _)| i != j).collect();
        edges.sort_unstable();
        edges.dedup_by_key(|(edge, _)| *edge);
        (self.edges, self.places) = edges.into_iter().unzip();
        self.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    }

    /// Adds to the notes what may surprise. Numbers of vertices are those of the mesh, from 0.
    pub(in crate::scene) fn note_surprises(&mut self) {
        let count = self.vertices.len();
        let mut sets = Sets::new(count);
        let mut is_used = vec![false; count];
        for &[i, j] in &self.edges {
            sets.join(i, j);
            (is_used[i as usize], is_used[j as usize]) = (true, true);
        }
        let parts =
            (0..count as u32).filter(|&vertex| is_used[vertex as usize] && sets.first(vertex) == vertex).count();
        if parts > 1 {
            self.notes.push(format!("the mesh is {parts} loose parts, which no edge joins"));
        }
        let mut places = HashSet::with_capacity(count);
        // Zero has two signs, and one place.
        let place = |x: &nalgebra::Vector3<f64>| <[f64; 3]>::from(*x).map(|c| (c + 0.0).to_bits());
        let coincident = self.vertices.iter().filter(|x| !places.insert(place(x))).count();
        if coincident > 0 {
            let vertices = if coincident == 1 { "1 vertex lies".into() } else { format!("{coincident} vertices lie") };
            self.notes.push(format!("{vertices} where another does; mesh.weld = 0 joins them"));
        }
        let unused: Vec<usize> = (0..count).filter(|&vertex| !is_used[vertex]).collect();
        if let Some(first) = unused.first() {
            let one = format!("vertex {first} is in no edge: it moves on its own");
            let several =
                format!("{} vertices are in no edge (the first is {first}): they move on their own", unused.len());
            self.notes.push(if unused.len() == 1 { one } else { several });
        }
    }
}
