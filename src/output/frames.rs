//! Frames as VTK XML `PolyData`, for [ParaView](https://www.paraview.org), VisIt and everything else built on VTK. A `.pvd` file opens as their time series.

use super::{AtomicFile, OutputFolder, Trajectory};
use crate::error::Result;
use crate::spring::Extension;
use crate::system::{State, System};
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use nalgebra::Vector3;
use std::io::{self, Write};
use std::num::NonZeroU64;
use std::path::PathBuf;

/// The frames of a run: `frames/frame_000010.vtp` for step 10, `frames.pvd` beside the folder, and all together as `trajectory.npz`.
#[derive(Debug)]
pub struct Frames {
    folder: PathBuf,
    every: NonZeroU64,
    triangles: Vec<[u32; 3]>,
    trajectory: Trajectory,
    vtk: bool,
    /// Number of frames at which the list is written next.
    list_at: usize,
}

impl Frames {
    /// Frames of the steps that `every` divides, in an output folder, which is created. [`clear_frames`] removes those of an earlier run.
    pub fn create(folder: impl Into<PathBuf>, every: NonZeroU64) -> Result<Self> {
        let folder = folder.into();
        let trajectory = Trajectory::create(&folder)?;
        Ok(Self { folder, every, triangles: Vec::new(), trajectory, vtk: true, list_at: 1 })
    }

    /// Continues after the frames that [`position`](Self::position) listed.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when they do not exist any more.
    pub fn resume(
        folder: impl Into<PathBuf>,
        every: NonZeroU64,
        frames: Vec<(f64, u64)>,
        system: &System,
    ) -> Result<Self> {
        let folder = folder.into();
        let trajectory = Trajectory::resume(&folder, frames, system)?;
        Ok(Self { folder, every, triangles: Vec::new(), trajectory, vtk: true, list_at: 1 })
    }

    /// Keeps what a later process needs to continue.
    pub fn resumable(mut self) -> Self {
        self.trajectory.keep();
        self
    }

    /// Time, in s, and step of every frame so far, all of which are in files, whatever happens to the process.
    pub fn position(&mut self) -> Result<Vec<(f64, u64)>> {
        self.trajectory.flush()?;
        Ok(self.trajectory.frames.clone())
    }

    /// With the triangles of a mesh in every frame.
    pub fn with_triangles(self, triangles: Vec<[u32; 3]>) -> Self {
        Self { triangles, ..self }
    }

    /// The trajectory alone, without files for VTK.
    pub fn without_vtk(self) -> Self {
        Self { vtk: false, ..self }
    }

    /// Writes the state after `step` steps as a frame, if `every` divides the step.
    pub fn record(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        if !step.is_multiple_of(self.every.get()) {
            return Ok(());
        }
        self.trajectory.push(system, state, step)?;
        if !self.vtk {
            return Ok(());
        }
        write_frame(self.folder.join(name(step)), system, state, &self.triangles)?;
        // Rewritten whenever it has grown by an eighth, the list is valid even when the process is killed, at a total cost proportional to its length.
        let frames = self.trajectory.frames.len();
        if frames >= self.list_at {
            self.write_list()?;
            self.list_at = frames + frames / 8 + 1;
        }
        Ok(())
    }

    /// Writes the complete list of frames and the trajectory.
    pub fn finish(self, system: &System) -> Result<()> {
        if self.vtk {
            self.write_list()?;
        }
        self.trajectory.finish(system, &self.triangles)
    }

    fn write_list(&self) -> Result<()> {
        AtomicFile::write(self.folder.join("frames.pvd"), |file| {
            writeln!(file, "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>")?;
            for &(time, step) in &self.trajectory.frames {
                writeln!(file, "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>", name(step))?;
            }
            writeln!(file, "</Collection>\n</VTKFile>")
        })
    }
}

fn name(step: u64) -> String {
    format!("frames/frame_{step:06}.vtp")
}

/// Removes the frames of an earlier run, and their list.
pub fn clear_frames(folder: &OutputFolder) -> Result<()> {
    folder.remove("frames.pvd")?;
    folder.remove_inside("frames", |name| name.starts_with("frame_") && name.ends_with(".vtp"))
}

/// Removes the frames after a step, before a run continues from there.
pub fn clear_frames_after(folder: &OutputFolder, step: u64) -> Result<()> {
    let number = |name: &str| name.strip_prefix("frame_")?.strip_suffix(".vtp")?.parse().ok();
    folder.remove_inside("frames", |name| number(name).is_some_and(|number: u64| number > step))
}

/// Writes a state as `.vtp`: particles are points in m with the data `velocity` in m/s; springs are lines, `triangles` of a mesh are polygons, both with
/// the strain `l/l0 − 1` as `strain`, a triangle with the mean of those of its sides that are springs. Units are in the file as VTK's `UNITS_LABEL`.
pub fn write_frame(target: impl Into<PathBuf>, system: &System, state: &State, triangles: &[[u32; 3]]) -> Result<()> {
    let pairs = system.pairs();
    let mut strains: Vec<f64> = (0..pairs.len()).map(|spring| strain(system, state, spring)).collect();
    strains.extend(mean_of_sides(pairs, &strains, triangles));
    let (points, lines, polygons) = (state.positions.len(), pairs.len(), triangles.len());
    AtomicFile::write(target, |file| {
        writeln!(
            file,
            r#"<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>
<Piece NumberOfPoints="{points}" NumberOfVerts="0" NumberOfLines="{lines}" NumberOfStrips="0" NumberOfPolys="{polygons}">
<PointData Vectors="velocity">"#
        )?;
        vectors(file, "velocity", "m/s", &state.velocities)?;
        writeln!(file, "</PointData>\n<CellData Scalars=\"strain\">")?;
        let values = strains.iter().map(|strain| strain.to_le_bytes());
        array(file, "type=\"Float64\" Name=\"strain\" NumberOfComponents=\"1\"", "1", strains.len(), values)?;
        writeln!(file, "</CellData>\n<Points>")?;
        vectors(file, "position", "m", &state.positions)?;
        writeln!(file, "</Points>\n<Lines>")?;
        cells(file, pairs)?;
        writeln!(file, "</Lines>\n<Polys>")?;
        cells(file, triangles)?;
        writeln!(file, "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>")
    })
}

/// l/l0 − 1, which is −1 where the ends coincide.
fn strain(system: &System, state: &State, spring: usize) -> f64 {
    let [i, j] = system.pair(spring);
    let extension = Extension::between(&state.positions[i], &state.positions[j]);
    extension.map_or(-1.0, |at| system.springs()[spring].strain(&at))
}

/// The mean strain of those of every triangle's sides that are springs, zero where none is. A mesh's pairs are sorted.
fn mean_of_sides(pairs: &[[u32; 2]], strains: &[f64], triangles: &[[u32; 3]]) -> Vec<f64> {
    let side = |a: u32, b: u32| pairs.binary_search(&[a.min(b), a.max(b)]).ok().and_then(|s| strains.get(s));
    let mean = |&[a, b, c]: &[u32; 3]| {
        let sides = [side(a, b), side(b, c), side(c, a)];
        let count = sides.iter().flatten().count().max(1) as f64;
        sides.iter().flatten().copied().sum::<f64>() / count
    };
    triangles.iter().map(mean).collect()
}

fn vectors(file: &mut AtomicFile, name: &str, unit: &str, rows: &[Vector3<f64>]) -> io::Result<()> {
    let values = rows.iter().flat_map(|row| [row.x, row.y, row.z]).map(f64::to_le_bytes);
    let attributes = format!("type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"3\"");
    array(file, &attributes, unit, 3 * rows.len(), values)
}

fn cells<const N: usize>(file: &mut AtomicFile, corners: &[[u32; N]]) -> io::Result<()> {
    let all = corners.iter().flatten().map(|&p| i64::from(p).to_le_bytes());
    array(file, "type=\"Int64\" Name=\"connectivity\"", "", N * corners.len(), all)?;
    let ends = (1..=corners.len()).map(|k| ((N * k) as i64).to_le_bytes());
    array(file, "type=\"Int64\" Name=\"offsets\"", "", corners.len(), ends)
}

/// A data array: the number of its bytes, then its values of eight bytes, in base64.
fn array(
    file: &mut AtomicFile,
    attributes: &str,
    unit: &str,
    count: usize,
    values: impl Iterator<Item = [u8; 8]>,
) -> io::Result<()> {
    writeln!(file, "<DataArray {attributes} format=\"binary\">")?;
    let mut text = EncoderWriter::new(&mut *file, &STANDARD);
    text.write_all(&(8 * count as u64).to_le_bytes())?;
    for value in values {
        text.write_all(&value)?;
    }
    text.finish()?;
    drop(text);
    if !unit.is_empty() {
        let key = "InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\"";
        write!(file, "\n<{key}>{unit}</InformationKey>")?;
    }
    writeln!(file, "\n</DataArray>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::TRAJECTORY;
    use crate::system::SystemBuilder;

    #[test]
    fn frames_may_have_triangles_and_no_files_of_their_own() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, state) = builder.build().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let start = || Frames::create(folder.path(), NonZeroU64::MIN).unwrap();
        let mut frames = start().without_vtk();
        frames.record(&system, &state, 0).unwrap();
        assert_eq!(frames.position().unwrap(), [(0.0, 0)]);
        frames.finish(&system).unwrap();
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, [TRAJECTORY]);
        start().with_triangles(vec![[0, 0, 0]; 2]).record(&system, &state, 0).unwrap();
        let frame = std::fs::read_to_string(folder.path().join("frames/frame_000000.vtp")).unwrap();
        assert!(frame.contains("NumberOfPolys=\"2\""));
    }

    #[test]
    fn frames_are_cleared_and_nothing_else() {
        let parent = tempfile::tempdir().unwrap();
        let path = |name: &str| parent.path().join(name);
        std::fs::create_dir(path("frames")).unwrap();
        let ours = ["frames.pvd", "frames/frame_000001.vtp"];
        let others = ["frames/frame_notes.txt", "frames/mine.vtp"];
        ours.iter().chain(&others).for_each(|name| std::fs::write(path(name), "").unwrap());
        clear_frames(&OutputFolder::claim(parent.path(), false).unwrap()).unwrap();
        assert!(!ours.iter().any(|name| path(name).exists()) && others.iter().all(|name| path(name).exists()));
    }

    /// Strains of the sides 0–1, 0–2 and 1–2; another triangle has one of them, a third none.
    #[test]
    fn triangles_have_the_mean_strain_of_their_sides() {
        let means = mean_of_sides(&[[0, 1], [0, 2], [1, 2]], &[0.5, 0.25, 0.75], &[[2, 0, 1], [3, 1, 0], [3, 4, 5]]);
        assert_eq!(means, [0.5, 0.5, 0.0]);
        assert_eq!(mean_of_sides(&[[0, 1], [0, 2]], &[0.5, 0.25], &[[0, 1, 2]]), [0.375]);
    }
}
