//! What readers collect from a file, and what a mesh is made of it.

use super::MeshGeometry;
use crate::error::{Error, Invalid, Result};
use nalgebra::Vector3;
use std::path::Path;

/// What is wrong with a file, without its name.
pub struct Fault(pub String);

/// Vertices and edges as a file has them.
pub struct Raw {
    /// What places are counted in.
    unit: &'static str,
    /// The number that the file's first vertex has there.
    first: u32,
    vertices: Vec<Vector3<f64>>,
    edges: Vec<([u32; 2], u32)>,
    triangles: Vec<[u32; 3]>,
    /// Faces that name a vertex twice: how many, and where the first is.
    repeated: Option<(usize, u32)>,
    corners: Vec<u32>,
}

/// The edges of solid elements between their corners, as VTK and Gmsh number them alike.
pub const TETRAHEDRON: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
pub const HEXAHEDRON: &[[usize; 2]] =
    &[[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];
pub const WEDGE: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]];
pub const PYRAMID: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]];

impl Raw {
    /// Nothing yet; places are counted in `unit`, and the file's first vertex has the number `first`.
    pub fn new(unit: &'static str, first: u32) -> Self {
        let (vertices, edges, triangles) = (Vec::new(), Vec::new(), Vec::new());
        Self { unit, first, vertices, edges, triangles, repeated: None, corners: Vec::new() }
    }

    /// How many vertices there are so far.
    pub fn vertices(&self) -> usize {
        self.vertices.len()
    }

    pub fn add_vertex(&mut self, x: [f64; 3]) {
        self.vertices.push(x.into());
    }

    /// Adds the segments of a line; those from a vertex to itself are passed over.
    pub fn add_line(&mut self, corners: &[u32], place: u32) {
        corners.windows(2).for_each(|ends| self.add_edge([ends[0], ends[1]], place));
    }

    /// Adds a face; one that names a vertex twice is left out, and counted.
    pub fn add_face(&mut self, corners: &[u32], place: u32) {
        let [first, rest @ ..] = corners else { return };
        self.corners.clear();
        self.corners.extend_from_slice(corners);
        self.corners.sort_unstable();
        if self.corners.windows(2).any(|two| two[0] == two[1]) {
            let (count, place) = self.repeated.unwrap_or((0, place));
            self.repeated = Some((count + 1, place));
            return;
        }
        self.add_line(corners, place);
        self.add_edge([*first, rest.last().copied().unwrap_or(*first)], place);
        self.triangles.extend(rest.windows(2).map(|side| [*first, side[0], side[1]]));
    }

    /// Adds the triangles of a strip.
    pub fn add_strip(&mut self, corners: &[u32], place: u32) {
        corners.windows(3).for_each(|corners| self.add_face(corners, place));
    }

    /// Adds edges between the corners of a solid element; those that have collapsed are passed over.
    pub fn add_solid(&mut self, corners: &[u32], edges: &[[usize; 2]], place: u32) {
        for ends in edges {
            if let [Some(i), Some(j)] = ends.map(|end| corners.get(end)) {
                self.add_edge([*i, *j], place);
            }
        }
    }

    fn add_edge(&mut self, [i, j]: [u32; 2], place: u32) {
        if i != j {
            self.edges.push(([i.min(j), i.max(j)], place));
        }
    }

    /// Checks what was collected, and counts every edge once.
    pub fn finish(self, path: &Path) -> Result<MeshGeometry> {
        let Self { unit, first, vertices, mut edges, triangles, repeated, .. } = self;
        let refuse = |message: String| Err(Error::Format { file: path.into(), message });
        if vertices.is_empty() {
            return refuse("has no vertices".into());
        }
        if let Some((index, vertex)) = vertices.iter().enumerate().find(|(_, x)| x.iter().any(|c| !c.is_finite())) {
            let invalid = Invalid::new("v", format!("{:?}", vertex.as_slice()), "must be finite").at(index);
            return Err(Error::from(invalid).in_file(path));
        }
        let count = vertices.len();
        if let Some(([_, vertex], place)) = edges.iter().find(|([_, last], _)| *last as usize >= count) {
            let number = u64::from(*vertex) + u64::from(first);
            return refuse(format!(
                "{unit} {place}: names vertex {number}, and the last is {}",
                count as u64 + u64::from(first) - 1
            ));
        }
        edges.sort_unstable();
        edges.dedup_by_key(|(edge, _)| *edge);
        let left_out = repeated.map(|(count, place)| {
            let faces = if count == 1 { "1 face that names".into() } else { format!("{count} faces that name") };
            format!("{}: {faces} a vertex twice left out ({unit} {place})", path.display())
        });
        let (edges, places) = edges.into_iter().unzip();
        Ok(MeshGeometry { vertices, edges, triangles, notes: left_out.into_iter().collect(), places, unit, first })
    }
}
