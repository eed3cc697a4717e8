//! Frames for [ParaView](https://www.paraview.org) and everything else that reads VTK.
//!
//! A `.pvd` file lists the frames with their times, and opens as one time series; [`write_frame`] says what a frame holds.

use super::vtk::write_frame;
use super::{AtomicFile, Trajectory};
use crate::error::Result;
use crate::system::{State, System};
use quick_xml::events::{BytesDecl, Event};
use std::io::Write;
use std::num::NonZeroU64;
use std::path::PathBuf;

/// Writes the frames of a run, `frames/frame_000010.vtp` for step 10 and `frames.pvd` beside the folder, and all of them together as
/// `trajectory.npz`.
#[derive(Debug)]
pub struct Frames {
    folder: PathBuf,
    every: NonZeroU64,
    triangles: Vec<[u32; 3]>,
    trajectory: Trajectory,
    /// Whether there are files for VTK.
    vtk: bool,
    /// Time and file of every frame written.
    series: Vec<(f64, String)>,
    /// Length of the series at which the list is written next.
    list_at: usize,
}

impl Frames {
    /// Frames of the steps that `every` divides, in an output folder, which is created.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when the folder cannot be written.
    pub fn create(folder: impl Into<PathBuf>, every: NonZeroU64) -> Result<Self> {
        let folder = folder.into();
        let trajectory = Trajectory::create(&folder)?;
        Ok(Self { folder, every, triangles: Vec::new(), trajectory, vtk: true, series: Vec::new(), list_at: 1 })
    }

    /// With the triangles of a mesh in every frame.
    pub fn with_triangles(self, triangles: Vec<[u32; 3]>) -> Self {
        Self { triangles, ..self }
    }

    /// The trajectory alone, without files for VTK.
    pub fn without_vtk(self) -> Self {
        Self { vtk: false, ..self }
    }

    /// Writes the state after `step` steps as a frame, if the step is one of those wanted.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when a file cannot be written.
    pub fn record(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        if !step.is_multiple_of(self.every.get()) {
            return Ok(());
        }
        self.trajectory.push(system, state, step)?;
        if !self.vtk {
            return Ok(());
        }
        let name = format!("frames/frame_{step:06}.vtp");
        write_frame(self.folder.join(&name), system, state, &self.triangles)?;
        self.series.push((state.time, name));
        // Rewriting the list whenever it has grown by an eighth keeps it valid at every moment, even when the process
        // is killed, for a total cost in proportion to its length.
        if self.series.len() >= self.list_at {
            self.write_list()?;
            self.list_at = self.series.len() + self.series.len() / 8 + 1;
        }
        Ok(())
    }

    /// Writes the complete list of frames and the trajectory.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when one of them cannot be written.
    pub fn finish(self, system: &System) -> Result<()> {
        if self.vtk {
            self.write_list()?;
        }
        self.trajectory.finish(system, &self.triangles)
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
