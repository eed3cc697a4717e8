//! Frames for [ParaView](https://www.paraview.org) and everything else that reads VTK.
//!
//! A frame is a `PolyData` file: particles are points, springs are lines. A `.pvd` file lists the frames with their
//! times, and opens as one time series.

use super::AtomicFile;
use crate::error::Result;
use crate::spring::Extension;
use crate::system::{State, System};
use nalgebra::Vector3;
use quick_xml::events::{BytesDecl, Event};
use std::io::{self, Write};
use std::num::NonZeroU64;
use std::path::PathBuf;
use vtkio::model::{Attribute, Attributes, ByteOrder, DataArray, DataSet, PolyDataPiece, Version, VertexNumbers, Vtk};

/// Writes the frames of a run, `frames/frame_000010.vtp` for step 10, and `frames.pvd` beside the folder.
#[derive(Debug)]
pub struct Frames {
    folder: PathBuf,
    every: NonZeroU64,
    /// Time and file of every frame written.
    series: Vec<(f64, String)>,
    /// Length of the series at which the list is written next.
    list_at: usize,
}

impl Frames {
    /// Frames of the steps that `every` divides, in an output folder.
    pub fn new(folder: impl Into<PathBuf>, every: NonZeroU64) -> Self {
        Self { folder: folder.into(), every, series: Vec::new(), list_at: 1 }
    }

    /// Writes the state after `step` steps as a frame, if the step is one of those wanted.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when a file cannot be written.
    pub fn record(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        if !step.is_multiple_of(self.every.get()) {
            return Ok(());
        }
        let name = format!("frames/frame_{step:06}.vtp");
        write_frame(self.folder.join(&name), system, state)?;
        self.series.push((state.time, name));
        // Rewriting the list whenever it has grown by an eighth keeps it valid at every moment, even when the process
        // is killed, for a total cost in proportion to its length.
        if self.series.len() >= self.list_at {
            self.write_list()?;
            self.list_at = self.series.len() + self.series.len() / 8 + 1;
        }
        Ok(())
    }

    /// Writes the complete list of frames.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when it cannot be written.
    pub fn finish(self) -> Result<()> {
        self.write_list()
    }

    fn write_list(&self) -> Result<()> {
        AtomicFile::write(self.folder.join("frames.pvd"), |file| {
            let mut xml = quick_xml::Writer::new_with_indent(file, b' ', 2);
            xml.write_event(Event::Decl(BytesDecl::new("1.0", None, None)))?;
            let root = xml.create_element("VTKFile").with_attributes([("type", "Collection"), ("version", "0.1")]);
            root.write_inner_content(|xml| {
                let list = xml.create_element("Collection").write_inner_content(|xml| {
                    for (time, file) in &self.series {
                        let timestep = format!("{time:?}");
                        let attributes = [("timestep", timestep.as_str()), ("part", "0"), ("file", file)];
                        xml.create_element("DataSet").with_attributes(attributes).write_empty()?;
                    }
                    Ok(())
                });
                list.map(drop)
            })?;
            xml.into_inner().write_all(b"\n")
        })
    }
}

/// Writes a state as VTK `PolyData` (`.vtp`): points in m with the data `velocity` in m/s, lines with the strain
/// `l/l0 − 1` as `strain`. Coordinates along axes that a scene does not model are zero.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be written.
pub fn write_frame(target: impl Into<PathBuf>, system: &System, state: &State) -> Result<()> {
    let pairs = system.pairs();
    let strain: Vec<f64> = (0..pairs.len()).map(|spring| strain(system, state, spring)).collect();
    let piece = PolyDataPiece {
        points: components(&state.positions).into(),
        lines: Some(VertexNumbers::XML {
            connectivity: pairs.iter().flatten().map(|&p| p.into()).collect(),
            offsets: (1..=pairs.len() as u64).map(|line| 2 * line).collect(),
        }),
        data: Attributes {
            point: vec![Attribute::DataArray(DataArray::vectors("velocity").with_data(components(&state.velocities)))],
            cell: vec![Attribute::DataArray(DataArray::scalars("strain", 1).with_data(strain))],
        },
        ..Default::default()
    };
    let vtk = Vtk {
        version: Version::XML { major: 1, minor: 0 },
        title: String::new(),
        byte_order: ByteOrder::LittleEndian,
        data: DataSet::inline(piece),
        file_path: None,
    };
    AtomicFile::write(target, |file| vtk.write_xml(file).map_err(io::Error::other))
}

/// l/l0 − 1, which is −1 where the ends coincide.
fn strain(system: &System, state: &State, spring: usize) -> f64 {
    let [i, j] = system.pair(spring);
    let extension = Extension::between(&state.positions[i], &state.positions[j]);
    extension.map_or(-1.0, |at| system.springs()[spring].strain(&at))
}

fn components(rows: &[Vector3<f64>]) -> Vec<f64> {
    rows.iter().flat_map(|row| [row.x, row.y, row.z]).collect()
}
