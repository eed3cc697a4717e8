//! Meshes from files: Wavefront OBJ, PLY, STL, VTK (legacy and XML) and Gmsh MSH.
//!
//! A format is recognised by the contents of a file, never by its name. Only vertices and the edges of lines, faces and solid elements
//! are read. Existing readers have single precision, no lines for errors, or panic on truncated files.

mod cursor;
mod msh;
mod surface;
mod vtk;
mod vtu;

use crate::error::{Error, Result};
use crate::memory;
use nalgebra::Vector3;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use std::collections::HashSet;
use std::path::Path;

/// The geometry of a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshGeometry {
    /// Vertices in the file's order, whether or not a face uses them, in the mesh's unit.
    pub vertices: Vec<Vector3<f64>>,
    /// Every edge of every line, face and solid element once, as (i, j) with i < j, ascending. A polygon has its sides only, no diagonals.
    pub edges: Vec<[u32; 2]>,
    /// The faces, a polygon as a fan of triangles around its first corner.
    pub triangles: Vec<[u32; 3]>,
    /// Notes for the user: omitted faces, joined vertices.
    pub notes: Vec<String>,
    /// The place in the file of each edge; empty where there is no file.
    places: Vec<u32>,
    /// The unit of places, and the file's number of its first vertex.
    unit: &'static str,
    first: u32,
}

impl MeshGeometry {
    /// Reads the vertices and edges of a mesh file, whatever its format.
    ///
    /// # Errors
    /// [`Error::Io`] for an unreadable file, [`Error::Format`] with the line or the element for one that is broken, empty or none of the
    /// formats, or has a vertex that is not finite.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        // Parsing holds at most 30 bytes for a byte of the file.
        memory::ensure(bytes.saturating_mul(30), "the mesh")?;
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        Self::from_bytes(&bytes, path)
    }

    /// As [`load`](Self::load), from the bytes of a file; errors call it by `path`.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let mesh = read(bytes).and_then(|raw| raw.finish(path));
        mesh.map_err(|Fault(message)| Error::Format { file: path.into(), message })
    }

    pub(super) fn of_lists(vertices: Vec<Vector3<f64>>, edges: Vec<[u32; 2]>) -> Self {
        Self { vertices, edges, ..Self::default() }
    }

    /// The place of an edge in the file and the vertices it joins, for a message.
    pub(super) fn place(&self, edge: usize) -> String {
        let ends = self.edges.get(edge).copied().unwrap_or_default();
        let [i, j] = ends.map(|vertex| self.number(vertex as usize));
        let place = self.places.get(edge).copied().unwrap_or_default();
        format!("{} {place}: an edge joins vertices {i} and {j}", self.unit)
    }

    pub(super) fn number(&self, vertex: usize) -> u64 {
        vertex as u64 + u64::from(self.first)
    }

    /// Joins vertices that are no farther apart than `distance`, directly or through others; the first of them stays. Edges and
    /// triangles between joined vertices vanish.
    pub(super) fn weld(&mut self, distance: f64) {
        let points = self.vertices.iter().zip(0u32..);
        let tree =
            RTree::bulk_load(points.map(|(&x, vertex)| GeomWithData::new(<[f64; 3]>::from(x), vertex)).collect());
        let mut sets = Sets::new(self.vertices.len());
        for (vertex, &x) in (0u32..).zip(&self.vertices) {
            // Later vertices find this one.
            let near = tree.locate_within_distance(x.into(), distance * distance);
            near.filter(|other| other.data < vertex).for_each(|other| sets.join(vertex, other.data));
        }
        let mut numbers = vec![0; self.vertices.len()];
        let mut welded = Vec::new();
        for (vertex, x) in self.vertices.iter().enumerate() {
            let first = sets.first(vertex as u32) as usize;
            if first == vertex {
                numbers[vertex] = welded.len() as u32;
                welded.push(*x);
            } else {
                numbers[vertex] = numbers[first];
            }
        }
        if welded.len() == self.vertices.len() {
            return;
        }
        self.notes.push(format!("mesh.weld joins {} vertices to {}", self.vertices.len(), welded.len()));
        self.vertices = welded;
        let renumbered = |edge: [u32; 2]| {
            let [i, j] = edge.map(|vertex| numbers[vertex as usize]);
            [i.min(j), i.max(j)]
        };
        let edges = self.edges.iter().map(|edge| renumbered(*edge)).zip(self.places.iter().copied());
        (self.edges, self.places) = unique(edges.filter(|([i, j], _)| i != j).collect());
        self.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    }

    /// Adds notes on loose parts, coincident and unused vertices, which are named as particles of the scene.
    pub(super) fn add_notes(&mut self) {
        let count = self.vertices.len();
        let mut sets = Sets::new(count);
        let mut is_used = vec![false; count];
        for &[i, j] in &self.edges {
            sets.join(i, j);
            (is_used[i as usize], is_used[j as usize]) = (true, true);
        }
        let is_part = |&vertex: &u32| is_used[vertex as usize] && sets.first(vertex) == vertex;
        let parts = (0..count as u32).filter(is_part).count();
        if parts > 1 {
            self.notes.push(format!("the mesh is {parts} loose parts, which no edge joins"));
        }
        let mut places = HashSet::with_capacity(count);
        let coincident = self.vertices.iter().filter(|&&x| !places.insert(place_key(x.into()))).count();
        if coincident > 0 {
            let vertices = if coincident == 1 { "1 vertex lies".into() } else { format!("{coincident} vertices lie") };
            self.notes.push(format!("{vertices} where another does; mesh.weld = 0 joins them"));
        }
        let unused: Vec<usize> = (0..count).filter(|&vertex| !is_used[vertex]).collect();
        match unused[..] {
            [] => {}
            [vertex] => self.notes.push(format!("particle {vertex} is in no edge: it moves on its own")),
            [first, ..] => self.notes.push(format!(
                "{} particles are in no edge (the first is {first}): they move on their own",
                unused.len()
            )),
        }
    }
}

/// The bits of a place, with one zero.
fn place_key(x: [f64; 3]) -> [u64; 3] {
    x.map(|c| (c + 0.0).to_bits())
}

/// Edges sorted, each once, at its first place.
fn unique(mut edges: Vec<([u32; 2], u32)>) -> (Vec<[u32; 2]>, Vec<u32>) {
    edges.sort_unstable();
    edges.dedup_by_key(|(edge, _)| *edge);
    edges.into_iter().unzip()
}

/// Disjoint sets of vertices, each known by its first.
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

fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let text = bytes.trim_ascii_start();
    let starts = |word: &str| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()));
    if text.is_empty() {
        Err(Fault("is empty".into()))
    } else if surface::is_binary_stl(bytes) {
        surface::read_binary_stl(bytes)
    } else if bytes.starts_with(b"ply") && bytes.get(3).is_some_and(u8::is_ascii_whitespace) {
        surface::read_ply(bytes)
    } else if starts("# vtk DataFile") {
        vtk::read(bytes)
    } else if starts("$") {
        msh::read(bytes)
    } else if starts("<") {
        vtu::read(bytes)
    } else if starts("solid") && !bytes.contains(&0) {
        surface::read_text_stl(bytes)
    } else {
        surface::read_obj(bytes)
    }
}

const REPEATED: &str = "a vertex twice";
const SHORT: &str = "fewer than two vertices";

/// An error in a file, without its name.
struct Fault(String);

struct Raw {
    /// The mesh without its edges.
    mesh: MeshGeometry,
    /// Edges, some of them more than once, with their places.
    edges: Vec<([u32; 2], u32)>,
    /// Faces and segments of lines left out: their number, and the place and the defect of the first.
    omitted: Option<(usize, u32, &'static str)>,
}

impl Raw {
    /// Nothing yet, with the unit of places and the file's number of its first vertex.
    fn new(unit: &'static str, first: u32) -> Self {
        Self { mesh: MeshGeometry { unit, first, ..MeshGeometry::default() }, edges: Vec::new(), omitted: None }
    }

    fn add_vertex(&mut self, x: [f64; 3], place: impl std::fmt::Display) -> Result<(), Fault> {
        if x.iter().any(|c| !c.is_finite()) {
            return Err(Fault(format!("{place}: the coordinates {x:?} must be finite")));
        }
        self.mesh.vertices.push(x.into());
        Ok(())
    }

    fn add_vertices(&mut self, coordinates: &[f64]) -> Result<(), Fault> {
        coordinates.as_chunks().0.iter().try_for_each(|&x| {
            let number = self.mesh.vertices.len();
            self.add_vertex(x, format_args!("vertex {number}"))
        })
    }

    /// Adds the segments of a line; those from a vertex to itself are counted instead.
    fn add_line(&mut self, corners: &[u32], place: u32) {
        for ends in corners.windows(2) {
            if ends[0] == ends[1] {
                self.omit(place, REPEATED);
            }
            self.add_edge([ends[0], ends[1]], place);
        }
        if corners.len() < 2 {
            self.omit(place, SHORT);
        }
    }

    /// Adds a face; one that names a vertex twice is counted instead.
    fn add_face(&mut self, corners: &[u32], place: u32) {
        let mut sorted = corners.to_vec();
        sorted.sort_unstable();
        if sorted.windows(2).any(|two| two[0] == two[1]) {
            return self.omit(place, REPEATED);
        }
        self.add_line(corners, place);
        let [first, rest @ ..] = corners else { return };
        self.add_edge([*first, rest.last().copied().unwrap_or(*first)], place);
        self.mesh.triangles.extend(rest.windows(2).map(|side| [*first, side[0], side[1]]));
    }

    fn omit(&mut self, place: u32, defect: &'static str) {
        let (count, place, defect) = self.omitted.unwrap_or((0, place, defect));
        self.omitted = Some((count + 1, place, defect));
    }

    fn add_strip(&mut self, corners: &[u32], place: u32) {
        corners.windows(3).for_each(|corners| self.add_face(corners, place));
    }

    /// Adds the edges of a solid element, without collapsed ones.
    fn add_solid(&mut self, corners: &[u32], edges: &[[usize; 2]], place: u32) {
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

    /// Checks the collected parts, and counts every edge once.
    fn finish(self, path: &Path) -> Result<MeshGeometry, Fault> {
        let Self { mut mesh, edges, omitted } = self;
        let (unit, count) = (mesh.unit, mesh.vertices.len());
        if count == 0 {
            return Err(Fault("has no vertices".into()));
        }
        if let Some(([_, vertex], place)) = edges.iter().find(|([_, last], _)| *last as usize >= count) {
            let [number, last] = [*vertex as usize, count - 1].map(|vertex| mesh.number(vertex));
            return Err(Fault(format!("{unit} {place}: names vertex {number}, and the last is {last}")));
        }
        if let Some((count, place, defect)) = omitted {
            let (parts, first) =
                if count == 1 { ("face or segment", "") } else { ("faces or segments", "the first is ") };
            let file = path.display();
            let note = format!("{file}: {count} {parts} left out ({first}in {unit} {place}, which names {defect})");
            mesh.notes.push(note);
        }
        (mesh.edges, mesh.places) = unique(edges);
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests;
