//! Meshes from Wavefront OBJ files.

use crate::error::{Error, Invalid, Result};
use crate::memory;
use nalgebra::Vector3;
use std::path::Path;
use tobj::{LoadError, LoadOptions};

/// The geometry of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshGeometry {
    /// Vertices in the file's order, whether or not a face uses them, in the mesh's unit.
    pub vertices: Vec<Vector3<f64>>,
    /// Every edge of every face once, as (i, j) with i ≤ j, ascending. A polygon has its sides only, no diagonals.
    pub edges: Vec<[u32; 2]>,
    /// The faces, a polygon as a fan of triangles around its first corner.
    pub triangles: Vec<[u32; 3]>,
}

/// Bytes that reading holds at most for a byte of a file.
const BYTES: u64 = 30;

impl MeshGeometry {
    /// Reads the vertices (`v`) and faces (`f`) of an OBJ file and passes over everything else in it.
    ///
    /// # Errors
    /// [`Error::Io`] for an unreadable file, [`Error::Format`] with the line for one that is not OBJ,
    /// [`Error::Invalid`] for a vertex that is not finite.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        memory::ensure(bytes.saturating_mul(BYTES), "the mesh")?;
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        Self::from_obj(&bytes, path)
    }

    /// As [`load`](Self::load), from the bytes of a file; errors call it by `path`.
    ///
    /// # Errors
    /// [`Error::Format`] with the line for one that is not OBJ, [`Error::Invalid`] for a vertex that is not finite.
    pub fn from_obj(bytes: &[u8], path: &Path) -> Result<Self> {
        let text = String::from_utf8_lossy(bytes);
        let lines: Vec<&str> = text.lines().filter(|line| is_vertex(line) || is_face(line)).collect();
        let mesh = Self::parse(&lines).map_err(|error| {
            let line = first_refused(&lines).unwrap_or_default();
            Error::Format { file: path.into(), message: format!("{error}: {line:?}") }
        })?;
        let unusable = mesh.vertices.iter().enumerate().find(|(_, x)| x.iter().any(|c| !c.is_finite()));
        if let Some((index, vertex)) = unusable {
            let invalid = Invalid::new("v", format!("{:?}", vertex.as_slice()), "must be finite").at(index);
            return Err(Error::from(invalid).in_file(path));
        }
        Ok(mesh)
    }

    /// From `v` and `f` lines. tobj numbers vertices by their first use and drops unused ones, so a face that uses
    /// all of them in the file's order goes first.
    fn parse(lines: &[&str]) -> Result<Self, LoadError> {
        let vertices = lines.iter().filter(|line| is_vertex(line)).count();
        let all: String = (1..=vertices).map(|vertex| format!(" {vertex}")).collect();
        let text = format!("f{all}\n{}", lines.join("\n"));
        let no_materials = |_: &Path| Err(LoadError::OpenFileFailed);
        let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &LoadOptions::default(), no_materials)?;
        let mesh = models.into_iter().next().map(|model| model.mesh).unwrap_or_default();

        let faces = mesh.indices.get(vertices..).unwrap_or_default();
        let mut edges = Vec::with_capacity(faces.len());
        let mut triangles = Vec::with_capacity(faces.len() / 3);
        let mut add_face = |face: &[u32]| {
            let next = face.iter().cycle().skip(1);
            edges.extend(face.iter().zip(next).map(|(&a, &b)| [a.min(b), a.max(b)]));
            if let [first, rest @ ..] = face {
                triangles.extend(rest.windows(2).filter_map(|side| Some([*first, *side.first()?, *side.last()?])));
            }
        };
        if mesh.face_arities.is_empty() {
            faces.chunks(3).for_each(add_face);
        } else {
            let mut rest = faces;
            for &arity in mesh.face_arities.iter().skip(1) {
                let (face, others) = rest.split_at_checked(arity as usize).unwrap_or((rest, &[]));
                add_face(face);
                rest = others;
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let vertices = mesh.positions.chunks_exact(3).map(Vector3::from_column_slice).collect();
        Ok(Self { vertices, edges, triangles })
    }
}

fn is_vertex(line: &str) -> bool {
    line.split_whitespace().next() == Some("v")
}

fn is_face(line: &str) -> bool {
    line.split_whitespace().next() == Some("f")
}

/// The first line without which the others could be read. Vertices stand for themselves; a face can be right only
/// together with all vertices, so the first wrong one is searched by bisection.
fn first_refused<'a>(lines: &[&'a str]) -> Option<&'a str> {
    let wrong = |line: &&&str| is_vertex(line) && MeshGeometry::parse(&[**line]).is_err();
    if let Some(vertex) = lines.iter().find(wrong) {
        return Some(vertex.trim());
    }
    let numbers: Vec<usize> = (0..lines.len()).collect();
    let first = numbers.partition_point(|&last| {
        let kept: Vec<&str> = lines
            .iter()
            .enumerate()
            .filter_map(|(number, line)| (number <= last || is_vertex(line)).then_some(*line))
            .collect();
        MeshGeometry::parse(&kept).is_ok()
    });
    lines.get(first).map(|line| line.trim())
}
