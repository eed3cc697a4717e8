//! Meshes from files: Wavefront OBJ, PLY, STL, VTK (legacy and XML) and Gmsh MSH.
//!
//! A format is recognised by the contents of a file, never by its name. Only what becomes particles and springs is read: vertices, and the edges
//! of lines, faces and solid elements. The readers are our own: those that there are give single precision, no lines for errors, or break
//! off the program on files that are cut short.

mod cursor;
mod msh;
mod obj;
mod ply;
mod raw;
mod stl;
mod vtk;
mod vtu;
mod weld;

use crate::error::{Error, Result};
use crate::memory;
use nalgebra::Vector3;
use raw::{Fault, Raw};
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
    /// Lines for people: what was left out of the file, or joined.
    pub notes: Vec<String>,
    /// Where in the file each edge comes from; empty where there is no file.
    places: Vec<u32>,
    /// What places are counted in, and the number that the file's first vertex has there.
    unit: &'static str,
    first: u32,
}

/// Bytes that reading holds at most for a byte of a file.
const BYTES: u64 = 30;

impl MeshGeometry {
    /// Reads the vertices and edges of a mesh file, whatever its format.
    ///
    /// # Errors
    /// [`Error::Io`] for an unreadable file, [`Error::Format`] with the line or the element for one that is broken, empty or none of the formats,
    /// [`Error::Invalid`] for a vertex that is not finite.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        memory::ensure(bytes.saturating_mul(BYTES), "the mesh")?;
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        Self::from_bytes(&bytes, path)
    }

    /// As [`load`](Self::load), from the bytes of a file; errors call it by `path`.
    ///
    /// # Errors
    /// As for [`load`](Self::load).
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let raw = read(bytes).map_err(|Fault(message)| Error::Format { file: path.into(), message })?;
        raw.finish(path)
    }

    /// Positions and pairs that are no mesh's.
    pub(super) fn of_lists(vertices: Vec<Vector3<f64>>, edges: Vec<[u32; 2]>) -> Self {
        Self { vertices, edges, ..Self::default() }
    }

    /// Where an edge comes from and which vertices of the file it joins, for a message.
    pub(super) fn place(&self, edge: usize) -> String {
        let [i, j] =
            self.edges.get(edge).copied().unwrap_or_default().map(|vertex| u64::from(vertex) + u64::from(self.first));
        let place = self.places.get(edge).copied().unwrap_or_default();
        format!("{} {place}: an edge joins vertices {i} and {j}", self.unit)
    }
}

/// Reads a mesh in the format that its bytes are in.
fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let text = bytes.trim_ascii_start();
    if text.is_empty() {
        return Err(Fault("is empty".into()));
    }
    if stl::is_binary(bytes) {
        return stl::read_binary(bytes);
    }
    if bytes.starts_with(b"ply") && bytes.get(3).is_some_and(u8::is_ascii_whitespace) {
        return ply::read(bytes);
    }
    if text.get(..14).is_some_and(|start| start.eq_ignore_ascii_case(b"# vtk DataFile")) {
        return vtk::read(bytes);
    }
    if text.starts_with(b"$") {
        return msh::read(bytes);
    }
    if text.starts_with(b"<") {
        return vtu::read(bytes);
    }
    if text.get(..5).is_some_and(|start| start.eq_ignore_ascii_case(b"solid")) {
        return stl::read_text(bytes);
    }
    obj::read(bytes)
}

#[cfg(test)]
mod tests;
