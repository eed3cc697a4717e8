//! `trajectory.npz`: the frames of a run in one file, for NumPy and for the page that plays them.
//!
//! An `.npz` file is a zip of `.npy` arrays; `numpy.load("trajectory.npz")` opens it. Everything needed to look at the motion is in it:
//!
//! | array | type | shape | |
//! |---|---|---|---|
//! | `times` | float64 | (F) | in s |
//! | `steps` | uint64 | (F) | steps done |
//! | `positions`, `velocities` | float64 | (F, N, d) | in m and m/s, to the bit |
//! | `masses` | float64 | (N) | in kg |
//! | `bindings` | uint8 | (N) | 0 free, 1 a coordinate is held, 2 a coordinate is moved |
//! | `pairs` | uint32 | (S, 2) | end points of every spring |
//! | `stiffness`, `rest_lengths`, `damping` | float64 | (S) | k in N, l0 in m, b in N·s/m |
//! | `triangles` | uint32 | (T, 3) | corners of a mesh's faces |
//! | `gravity` | float64 | (d) | in m/s² |
//!
//! F frames, N particles, S springs, d modelled axes. A zip holds one array after the other, a run gives one frame after the other: frames
//! wait in a file of their own until the run ends.

use super::AtomicFile;
use super::arrays::{Archive, array, list, wrong};
use crate::error::{Error, Result};
use crate::figure::Binding;
use crate::scene::NpzWriter;
use crate::system::{State, System};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// The name of the file in an output folder.
pub const TRAJECTORY: &str = "trajectory.npz";

/// The frames of a run under way.
#[derive(Debug)]
pub struct Trajectory {
    target: PathBuf,
    waiting: Waiting,
    times: Vec<f64>,
    steps: Vec<u64>,
}

/// The name of the file in which frames wait.
pub const WAITING: &str = ".sprung-trajectory.part";

/// Frames in a file of their own, which goes when this goes, unless it is to be gone on with: positions, then velocities, in doubles of the machine's order.
#[derive(Debug)]
struct Waiting {
    path: PathBuf,
    file: BufWriter<File>,
    is_kept: bool,
}

impl Drop for Waiting {
    fn drop(&mut self) {
        if !self.is_kept {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl Trajectory {
    /// Starts the trajectory of a run in an output folder, which is created.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder or a file in it cannot be written.
    pub fn create(folder: &Path) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
        let path = folder.join(WAITING);
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path);
        let file = BufWriter::with_capacity(1 << 18, file.map_err(|source| Error::io(&path, source))?);
        let waiting = Waiting { path, file, is_kept: false };
        Ok(Self { target: folder.join(TRAJECTORY), waiting, times: Vec::new(), steps: Vec::new() })
    }

    /// Goes on behind frames of these times and steps, which wait in the folder, or are the first of the trajectory that a run which came to its end wrote.
    ///
    /// # Errors
    /// [`Error::Io`] when they do not.
    pub fn resume(folder: &Path, frames: &[(f64, u64)], system: &System) -> Result<Self> {
        let path = folder.join(WAITING);
        let length = (2 * 8 * system.particles() * system.dimension() * frames.len()) as u64;
        let waits = std::fs::metadata(&path).is_ok_and(|file| file.len() >= length);
        if !waits && folder.join(TRAJECTORY).is_file() {
            let target = folder.join(TRAJECTORY);
            restore(&target, &path, frames, system).map_err(|source| Error::io(target, source))?;
        }
        let open = || -> io::Result<File> {
            let mut file = File::options().read(true).write(true).open(&path)?;
            if file.metadata()?.len() < length {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            file.set_len(length)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        };
        let file = BufWriter::with_capacity(1 << 18, open().map_err(|source| Error::io(&path, source))?);
        let waiting = Waiting { path, file, is_kept: true };
        let (times, steps) = frames.iter().copied().unzip();
        Ok(Self { target: folder.join(TRAJECTORY), waiting, times, steps })
    }

    /// The frames that wait stay when this goes.
    pub fn keep(&mut self) {
        self.waiting.is_kept = true;
    }

    /// Makes sure that all frames are in the file.
    ///
    /// # Errors
    /// [`Error::Io`] when they cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        let Waiting { path, file, .. } = &mut self.waiting;
        file.flush().map_err(|source| Error::io(&*path, source))
    }

    /// Adds the state after `step` steps.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn push(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        let axes = system.dimension();
        let Waiting { path, file, .. } = &mut self.waiting;
        for row in state.positions.iter().chain(&state.velocities) {
            for value in row.iter().take(axes) {
                file.write_all(&value.to_le_bytes()).map_err(|source| Error::io(&*path, source))?;
            }
        }
        self.times.push(state.time);
        self.steps.push(step);
        Ok(())
    }

    /// Writes `trajectory.npz`.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn finish(mut self, system: &System, triangles: &[[u32; 3]]) -> Result<()> {
        let target = self.target.clone();
        self.waiting.file.flush().map_err(|source| Error::io(&self.waiting.path, source))?;
        let mut frames = BufReader::with_capacity(1 << 18, self.waiting.file.get_ref());
        let [n, axes, count] = [system.particles(), system.dimension(), self.times.len()];
        let springs = system.springs();
        AtomicFile::write(&target, |file| {
            let mut npz = NpzWriter::new(file);
            npz.put("times", &[count], self.times.iter().copied())?;
            npz.put("steps", &[count], self.steps.iter().copied())?;
            npz.put("masses", &[n], system.masses().iter().copied())?;
            npz.put("bindings", &[n], Binding::of(system).into_iter().map(|binding| binding as u8))?;
            npz.put("pairs", &[springs.len(), 2], system.pairs().iter().flatten().copied())?;
            npz.put("stiffness", &[springs.len()], springs.iter().map(|spring| spring.stiffness))?;
            npz.put("rest_lengths", &[springs.len()], springs.iter().map(|spring| spring.rest_length))?;
            npz.put("damping", &[springs.len()], springs.iter().map(|spring| spring.damping))?;
            npz.put("triangles", &[triangles.len(), 3], triangles.iter().flatten().copied())?;
            npz.put("gravity", &[axes], system.gravity().iter().copied().take(axes))?;
            for (name, skipped) in [("positions", 0), ("velocities", n * axes)] {
                put_frames(&mut npz, name, &mut frames, [count, n, axes], skipped)?;
            }
            npz.finish()
        })
    }
}

/// Puts the first frames of a trajectory back to where they waited for its end.
fn restore(from: &Path, to: &Path, frames: &[(f64, u64)], system: &System) -> io::Result<()> {
    let open = || -> io::Result<Archive> { Ok(ZipArchive::new(BufReader::new(File::open(from)?))?) };
    let (mut first, mut second) = (open()?, open()?);
    let (times, steps): (Vec<f64>, Vec<u64>) = (list(&mut first, "times")?, list(&mut first, "steps")?);
    let is_ours = times.len() >= frames.len() && times.into_iter().zip(steps).zip(frames).all(|(a, b)| a == *b);
    let (positions, velocities) = (array(&mut first, "positions")?, array(&mut second, "velocities")?);
    let rows = [system.particles() as u64, system.dimension() as u64];
    if !is_ours || [&positions, &velocities].iter().any(|array| array.shape().get(1..) != Some(&rows)) {
        return Err(wrong("what the checkpoint goes on from is not there any more"));
    }
    let number = |error: npyz::DTypeError| wrong(&error.to_string());
    let mut halves = [positions.data::<f64>().map_err(number)?, velocities.data::<f64>().map_err(number)?];
    let mut waiting = BufWriter::with_capacity(1 << 18, File::create(to)?);
    for _ in frames {
        for half in &mut halves {
            for _ in 0..rows[0] * rows[1] {
                let value = half.next().ok_or_else(|| wrong("it ends early"))??;
                waiting.write_all(&value.to_le_bytes())?;
            }
        }
    }
    waiting.flush()
}

/// Half of every waiting frame: what comes after so many skipped numbers.
fn put_frames<W: Write>(
    npz: &mut NpzWriter<W>,
    name: &str,
    frames: &mut BufReader<&File>,
    [count, n, axes]: [usize; 3],
    skipped: usize,
) -> io::Result<()> {
    let array = npz.doubles(name, &[count, n, axes].map(|length| length as u64))?;
    let half = (n * axes * 8) as u64;
    for frame in 0..count as u64 {
        frames.seek(SeekFrom::Start(2 * half * frame + 8 * skipped as u64))?;
        io::copy(&mut frames.take(half), array)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
