//! Frames for [ParaView](https://www.paraview.org) and everything else that reads VTK.
//!
//! A `.pvd` file lists the frames with their times, and opens as one time series; [`write_frame`] says what a frame holds.

use super::vtk::write_frame;
use super::{AtomicFile, OutputFolder, Trajectory};
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
    /// Time and step of every frame.
    series: Vec<(f64, u64)>,
    /// Length of the series at which the list is written next.
    list_at: usize,
}

impl Frames {
    /// Frames of the steps that `every` divides, in an output folder, which is created. Those of an earlier run must be gone, see
    /// [`clear_frames`].
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when the folder cannot be written.
    pub fn create(folder: impl Into<PathBuf>, every: NonZeroU64) -> Result<Self> {
        let folder = folder.into();
        let trajectory = Trajectory::create(&folder)?;
        Ok(Self { folder, every, triangles: Vec::new(), trajectory, vtk: true, series: Vec::new(), list_at: 1 })
    }

    /// Goes on behind frames of which [`position`](Self::position) gave the list.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when what waited for the end is not there any more.
    pub fn resume(
        folder: impl Into<PathBuf>,
        every: NonZeroU64,
        series: Vec<(f64, u64)>,
        system: &System,
    ) -> Result<Self> {
        let folder = folder.into();
        let trajectory = Trajectory::resume(&folder, &series, system)?;
        Ok(Self { folder, every, triangles: Vec::new(), trajectory, vtk: true, series, list_at: 1 })
    }

    /// What a later process can go on with stays when this goes.
    pub fn resumable(mut self) -> Self {
        self.trajectory.keep();
        self
    }

    /// Time, in s, and step of every frame so far: all of them are in files, whatever happens to the process.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when they cannot be written.
    pub fn position(&mut self) -> Result<Vec<(f64, u64)>> {
        self.trajectory.flush()?;
        Ok(self.series.clone())
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
        self.series.push((state.time, step));
        if !self.vtk {
            return Ok(());
        }
        write_frame(self.folder.join(name(step)), system, state, &self.triangles)?;
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
                    for &(time, step) in &self.series {
                        let (timestep, file) = (format!("{time:?}"), name(step));
                        let attributes = [("timestep", timestep.as_str()), ("part", "0"), ("file", &file)];
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

/// The file of a step's frame.
fn name(step: u64) -> String {
    format!("frames/frame_{step:06}.vtp")
}

/// Removes the frames of an earlier run, and their list.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when a file cannot be removed.
pub fn clear_frames(folder: &OutputFolder) -> Result<()> {
    folder.remove("frames.pvd")?;
    let is_frame = |name: &str| name.starts_with("frame_") && name.ends_with(".vtp");
    folder.remove_inside("frames", is_frame)
}

/// Removes the frames after a step, which a run that goes on from there writes anew, or does not come to.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when a file cannot be removed.
pub fn clear_frames_after(folder: &OutputFolder, step: u64) -> Result<()> {
    let number = |name: &str| name.strip_prefix("frame_")?.strip_suffix(".vtp")?.parse().ok();
    folder.remove_inside("frames", |name| number(name).is_some_and(|number: u64| number > step))
}

#[cfg(test)]
mod tests {
    use super::{Frames, clear_frames};
    use crate::output::{OutputFolder, TRAJECTORY};
    use crate::system::{State, System, SystemBuilder};
    use std::collections::BTreeSet;
    use std::num::NonZeroU64;
    use std::path::Path;

    fn particle() -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.build().unwrap()
    }

    fn every(steps: u64) -> NonZeroU64 {
        NonZeroU64::new(steps).unwrap()
    }

    /// Frames in the list as it is.
    fn listed(folder: &Path) -> usize {
        std::fs::read_to_string(folder.join("frames.pvd")).unwrap().matches("<DataSet ").count()
    }

    /// The first eight frames, and then those with which an eighth has come, and one: 8 + 1 + 1 = 10, 10 + 1 + 1 = 12, …
    #[test]
    fn the_list_is_written_when_it_has_grown_by_an_eighth() {
        let (folder, (system, state)) = (tempfile::tempdir().unwrap(), particle());
        let mut frames = Frames::create(folder.path(), every(1)).unwrap();
        let mut lists = BTreeSet::new();
        for step in 0..24 {
            frames.record(&system, &state, step).unwrap();
            lists.insert(listed(folder.path()));
        }
        assert_eq!(Vec::from_iter(lists), [1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 19, 22]);
    }

    /// At every moment at most an eighth of the frames is not in the list, which is not written for every frame.
    #[test]
    fn the_list_follows_the_frames() {
        let (folder, (system, mut state)) = (tempfile::tempdir().unwrap(), particle());
        let mut frames = Frames::create(folder.path(), every(2)).unwrap();
        let mut lists = BTreeSet::new();
        for count in 1..=64_usize {
            let step = 2 * (count as u64 - 1);
            state.time = 0.5 * step as f64;
            frames.record(&system, &state, step).unwrap();
            frames.record(&system, &state, step + 1).unwrap();
            let listed = listed(folder.path());
            assert!(listed <= count && count - listed <= listed / 8, "{listed} of {count}");
            lists.insert(listed);
        }
        // Eight one by one, then whenever an eighth has come: 8 ln(64/8) = 16.6 times.
        assert!(lists.len() <= 24, "{lists:?}");
        let position = frames.position().unwrap();
        assert_eq!((position.len(), position[0], position[63]), (64, (0.0, 0), (63.0, 126)));
        frames.finish(&system).unwrap();
        assert_eq!(listed(folder.path()), 64);
    }

    #[test]
    fn frames_may_have_triangles_and_no_files_of_their_own() {
        let (folder, (system, state)) = (tempfile::tempdir().unwrap(), particle());
        let polygons = |triangles: Vec<[u32; 3]>| {
            let mut frames = Frames::create(folder.path(), every(1)).unwrap().with_triangles(triangles);
            frames.record(&system, &state, 0).unwrap();
            std::fs::read_to_string(folder.path().join("frames/frame_000000.vtp")).unwrap()
        };
        assert!(polygons(vec![]).contains("NumberOfPolys=\"0\""));
        assert!(polygons(vec![[0, 0, 0]; 2]).contains("NumberOfPolys=\"2\""));
        let other = tempfile::tempdir().unwrap();
        let mut frames = Frames::create(other.path(), every(1)).unwrap().without_vtk();
        frames.record(&system, &state, 0).unwrap();
        frames.finish(&system).unwrap();
        let left: Vec<_> = std::fs::read_dir(other.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, [TRAJECTORY]);
    }

    /// Frames of an earlier run go, with their list; what others have put beside them stays.
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
}
