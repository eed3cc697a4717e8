//! One state as VTK XML `PolyData`, which [ParaView](https://www.paraview.org), VisIt and everything else built on VTK reads.

use super::AtomicFile;
use crate::error::Result;
use crate::spring::Extension;
use crate::system::{State, System};
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use nalgebra::Vector3;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};
use std::io::{self, Write};
use std::path::PathBuf;

/// Writes a state as `.vtp`: particles are points in m with the data `velocity` in m/s; springs are lines, `triangles` of a mesh are
/// polygons, both with the strain `l/l0 − 1` as `strain`, a triangle with the mean of those of its sides that are springs.
/// The units stand in the file as VTK's `UNITS_LABEL`. Coordinates along axes that a scene does not model are zero.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be written.
pub fn write_frame(target: impl Into<PathBuf>, system: &System, state: &State, triangles: &[[u32; 3]]) -> Result<()> {
    let pairs = system.pairs();
    let mut strains: Vec<f64> = (0..pairs.len()).map(|spring| strain(system, state, spring)).collect();
    let of_triangles = mean_of_sides(pairs, &strains, triangles);
    strains.extend(of_triangles);
    AtomicFile::write(target, |file| {
        let mut xml = Writer::new_with_indent(file, b' ', 1);
        xml.write_event(Event::Decl(BytesDecl::new("1.0", None, None)))?;
        let root =
            [("type", "PolyData"), ("version", "1.0"), ("byte_order", "LittleEndian"), ("header_type", "UInt64")];
        inside(&mut xml, "VTKFile", &root, |xml| {
            inside(xml, "PolyData", &[], |xml| {
                let counts = [state.positions.len(), pairs.len(), triangles.len()].map(|count| count.to_string());
                let [points, lines, polys] = &counts;
                let piece = [
                    ("NumberOfPoints", points.as_str()),
                    ("NumberOfVerts", "0"),
                    ("NumberOfLines", lines),
                    ("NumberOfStrips", "0"),
                    ("NumberOfPolys", polys),
                ];
                inside(xml, "Piece", &piece, |xml| {
                    inside(xml, "PointData", &[("Vectors", "velocity")], |xml| {
                        vectors(xml, "velocity", "m/s", &state.velocities)
                    })?;
                    inside(xml, "CellData", &[("Scalars", "strain")], |xml| scalars(xml, "strain", "1", &strains))?;
                    inside(xml, "Points", &[], |xml| vectors(xml, "position", "m", &state.positions))?;
                    inside(xml, "Lines", &[], |xml| cells(xml, pairs))?;
                    inside(xml, "Polys", &[], |xml| cells(xml, triangles))
                })
            })
        })?;
        xml.into_inner().write_all(b"\n")
    })
}

/// l/l0 − 1, which is −1 where the ends coincide.
fn strain(system: &System, state: &State, spring: usize) -> f64 {
    let [i, j] = system.pair(spring);
    let extension = Extension::between(&state.positions[i], &state.positions[j]);
    extension.map_or(-1.0, |at| system.springs()[spring].strain(&at))
}

/// For every triangle the mean strain of its sides, as far as they are springs; zero where none is. A mesh's pairs are sorted.
fn mean_of_sides(pairs: &[[u32; 2]], strains: &[f64], triangles: &[[u32; 3]]) -> Vec<f64> {
    let side = |a: u32, b: u32| pairs.binary_search(&[a.min(b), a.max(b)]).ok().and_then(|s| strains.get(s));
    let mean = |&[a, b, c]: &[u32; 3]| {
        let sides = [side(a, b), side(b, c), side(c, a)];
        let count = sides.iter().flatten().count().max(1) as f64;
        sides.iter().flatten().copied().sum::<f64>() / count
    };
    triangles.iter().map(mean).collect()
}

type Xml<'f> = Writer<&'f mut AtomicFile>;

fn inside<W: Write>(
    xml: &mut Writer<W>,
    name: &str,
    attributes: &[(&str, &str)],
    content: impl FnOnce(&mut Writer<W>) -> io::Result<()>,
) -> io::Result<()> {
    xml.create_element(name).with_attributes(attributes.iter().copied()).write_inner_content(content).map(drop)
}

fn vectors(xml: &mut Xml<'_>, name: &str, unit: &str, rows: &[Vector3<f64>]) -> io::Result<()> {
    let values = rows.iter().flat_map(|row| [row.x, row.y, row.z]).map(f64::to_le_bytes);
    let about = [("type", "Float64"), ("Name", name), ("NumberOfComponents", "3")];
    array(xml, &about, Some(unit), 3 * rows.len(), values)
}

fn scalars(xml: &mut Xml<'_>, name: &str, unit: &str, values: &[f64]) -> io::Result<()> {
    let about = [("type", "Float64"), ("Name", name), ("NumberOfComponents", "1")];
    array(xml, &about, Some(unit), values.len(), values.iter().copied().map(f64::to_le_bytes))
}

/// Cells of equal size, as their corners one after the other and the ends of each.
fn cells<const N: usize>(xml: &mut Xml<'_>, corners: &[[u32; N]]) -> io::Result<()> {
    let long = |value: u64| (value as i64).to_le_bytes();
    let all = corners.iter().flatten().map(|&p| long(u64::from(p)));
    array(xml, &[("type", "Int64"), ("Name", "connectivity")], None, N * corners.len(), all)?;
    let ends = (1..=corners.len()).map(|k| long((N * k) as u64));
    array(xml, &[("type", "Int64"), ("Name", "offsets")], None, corners.len(), ends)
}

/// A data array: the number of its bytes, then its values of eight bytes, in base64.
fn array(
    xml: &mut Xml<'_>,
    about: &[(&str, &str)],
    unit: Option<&str>,
    count: usize,
    values: impl Iterator<Item = [u8; 8]>,
) -> io::Result<()> {
    let binary = [("format", "binary")];
    let attributes: Vec<(&str, &str)> = about.iter().chain(&binary).copied().collect();
    inside(xml, "DataArray", &attributes, |xml| {
        {
            let mut text = EncoderWriter::new(xml.get_mut(), &STANDARD);
            text.write_all(&(8 * count as u64).to_le_bytes())?;
            for value in values {
                text.write_all(&value)?;
            }
            text.finish()?;
        }
        match unit {
            Some(unit) => {
                let key = [("name", "UNITS_LABEL"), ("location", "vtkDataArray")];
                xml.create_element("InformationKey")
                    .with_attributes(key)
                    .write_text_content(quick_xml::events::BytesText::new(unit))
                    .map(drop)
            }
            None => Ok(()),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{mean_of_sides, write_frame};
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;

    /// Strains of the sides 0–1, 0–2 and 1–2; another triangle has one of them, a third none.
    #[test]
    fn triangles_have_the_mean_strain_of_their_sides() {
        let means = mean_of_sides(&[[0, 1], [0, 2], [1, 2]], &[0.5, 0.25, 0.75], &[[2, 0, 1], [3, 1, 0], [3, 4, 5]]);
        assert_eq!(means, [0.5, 0.5, 0.0]);
        assert_eq!(mean_of_sides(&[[0, 1], [0, 2]], &[0.5, 0.25], &[[0, 1, 2]]), [0.375]);
    }

    /// Every array says how many bytes follow: of three particles, two springs and a triangle.
    #[test]
    fn arrays_are_as_long_as_they_say() {
        let folder = tempfile::tempdir().unwrap();
        let mut builder = SystemBuilder::new();
        for x in [0.0, 1.0, 3.0] {
            builder.particle([x, x * x, 0.0], 1.0);
        }
        for i in [0, 1] {
            builder.spring(i, i + 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        write_frame(folder.path().join("frame.vtp"), &system, &state, &[[0, 1, 2]]).unwrap();
        let text = std::fs::read_to_string(folder.path().join("frame.vtp")).unwrap();
        let values: Vec<u64> = text
            .split("<DataArray ")
            .skip(1)
            .map(|array| {
                let content = array.split('>').nth(1).unwrap().split('<').next().unwrap();
                let bytes = STANDARD.decode(content.trim()).unwrap();
                let (length, values) = bytes.split_first_chunk().unwrap();
                assert_eq!(u64::from_le_bytes(*length), values.len() as u64, "{array}");
                values.len() as u64 / 8
            })
            .collect();
        // Velocities, strains, positions, corners and ends of the lines, corners and ends of the triangles.
        assert_eq!(values, [9, 3, 9, 4, 2, 3, 1]);
    }
}
