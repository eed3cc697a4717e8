//! `trajectory.npz`: the frames of a run in one file, for NumPy and for the page that plays them. The guide lists its arrays (`reading-results.md`).
//! A zip has one array after the other: until the run ends frames are in a temporary file.

use super::AtomicFile;
use super::files::{MISSING, truncated};
use crate::error::{Error, Result};
use crate::figure::Binding;
use crate::scene::NpzWriter;
use crate::system::{State, System};
use npyz::NpyFile;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;
use zip::ZipArchive;
use zip::read::ZipFile;

/// The name of the file in an output folder.
pub const TRAJECTORY: &str = "trajectory.npz";

/// The name of the temporary file of frames.
pub const WAITING: &str = ".sprung-trajectory.part";

/// The frames of a run under way.
#[derive(Debug)]
pub struct Trajectory {
    target: PathBuf,
    /// The temporary file: of every frame positions, then velocities, in little-endian doubles. Removed when dropped, unless kept.
    file: BufWriter<File>,
    path: TempPath,
    /// Time and step of every frame.
    pub frames: Vec<(f64, u64)>,
}

impl Trajectory {
    /// Starts the trajectory of a run in an output folder, which is created.
    pub fn create(folder: &Path) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
        let path = folder.join(WAITING);
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path);
        Self::new(folder, file, path, Vec::new())
    }

    fn new(folder: &Path, file: io::Result<File>, path: PathBuf, frames: Vec<(f64, u64)>) -> Result<Self> {
        let failed = |source| Error::io(&path, source);
        let file = BufWriter::with_capacity(1 << 18, file.map_err(failed)?);
        let path = TempPath::try_from_path(&path).map_err(failed)?;
        Ok(Self { target: folder.join(TRAJECTORY), file, path, frames })
    }

    /// Continues after frames of these times and steps, from the temporary file or from the trajectory of a finished run.
    ///
    /// # Errors
    /// [`Error::Io`] when neither has them.
    pub fn resume(folder: &Path, frames: Vec<(f64, u64)>, system: &System) -> Result<Self> {
        let path = folder.join(WAITING);
        let length = (2 * 8 * system.particles() * system.dimension() * frames.len()) as u64;
        let waits = std::fs::metadata(&path).is_ok_and(|file| file.len() >= length);
        if !waits && folder.join(TRAJECTORY).is_file() {
            let target = folder.join(TRAJECTORY);
            restore(&target, &path, &frames, system).map_err(|source| Error::io(target, source))?;
        }
        let mut trajectory = Self::new(folder, truncated(&path, length), path, frames)?;
        trajectory.keep();
        Ok(trajectory)
    }

    /// Keeps the temporary file for a later process.
    pub fn keep(&mut self) {
        self.path.disable_cleanup(true);
    }

    /// Writes all frames to the file.
    pub fn flush(&mut self) -> Result<()> {
        self.file.flush().map_err(|source| Error::io(&self.path, source))
    }

    /// Adds the state after `step` steps.
    pub fn push(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        let axes = system.dimension();
        for row in state.positions.iter().chain(&state.velocities) {
            for value in row.iter().take(axes) {
                self.file.write_all(&value.to_le_bytes()).map_err(|source| Error::io(&self.path, source))?;
            }
        }
        self.frames.push((state.time, step));
        Ok(())
    }

    /// Writes `trajectory.npz`.
    pub fn finish(mut self, system: &System, triangles: &[[u32; 3]]) -> Result<()> {
        self.flush()?;
        let mut frames = BufReader::with_capacity(1 << 18, self.file.get_ref());
        let [n, axes, count] = [system.particles(), system.dimension(), self.frames.len()];
        let springs = system.springs();
        AtomicFile::write(&self.target, |file| {
            let mut npz = NpzWriter::new(file);
            npz.put("times", &[count], self.frames.iter().map(|(time, _)| *time))?;
            npz.put("steps", &[count], self.frames.iter().map(|(_, step)| *step))?;
            npz.put("masses", &[n], system.masses().iter().copied())?;
            npz.put("bindings", &[n], Binding::of(system).into_iter().map(|binding| binding as u8))?;
            npz.put("pairs", &[springs.len(), 2], system.pairs().iter().flatten().copied())?;
            npz.put("stiffness", &[springs.len()], springs.iter().map(|spring| spring.stiffness))?;
            npz.put("rest_lengths", &[springs.len()], springs.iter().map(|spring| spring.rest_length))?;
            npz.put("damping", &[springs.len()], springs.iter().map(|spring| spring.damping))?;
            npz.put("triangles", &[triangles.len(), 3], triangles.iter().flatten().copied())?;
            npz.put("gravity", &[axes], system.gravity().iter().copied().take(axes))?;
            let bytes = (8 * n * axes) as u64;
            for (name, skipped) in [("positions", 0), ("velocities", bytes)] {
                let array = npz.doubles(name, &[count, n, axes].map(|length| length as u64))?;
                for frame in 0..count as u64 {
                    frames.seek(SeekFrom::Start(2 * bytes * frame + skipped))?;
                    io::copy(&mut (&mut frames).take(bytes), array)?;
                }
            }
            npz.finish()
        })
    }
}

fn restore(from: &Path, to: &Path, frames: &[(f64, u64)], system: &System) -> io::Result<()> {
    let open = || -> io::Result<Archive> { Ok(ZipArchive::new(BufReader::new(File::open(from)?))?) };
    let (mut first, mut second) = (open()?, open()?);
    let (times, steps): (Vec<f64>, Vec<u64>) = (list(&mut first, "times")?, list(&mut first, "steps")?);
    let has_frames = times.len() >= frames.len() && times.into_iter().zip(steps).zip(frames).all(|(a, b)| a == *b);
    let (positions, velocities) = (array(&mut first, "positions")?, array(&mut second, "velocities")?);
    let rows = [system.particles() as u64, system.dimension() as u64];
    if !has_frames || [&positions, &velocities].iter().any(|array| array.shape().get(1..) != Some(&rows)) {
        return Err(wrong(MISSING));
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

pub(super) type Archive = ZipArchive<BufReader<File>>;

pub(super) fn array<'a>(
    archive: &'a mut Archive,
    name: &str,
) -> io::Result<NpyFile<BufReader<ZipFile<'a, BufReader<File>>>>> {
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|error| wrong(&format!("{name}: {error}")))?;
    NpyFile::new(BufReader::with_capacity(1 << 18, entry))
}

pub(super) fn list<T: npyz::Deserialize>(archive: &mut Archive, name: &str) -> io::Result<Vec<T>> {
    array(archive, name)?.into_vec()
}

pub(super) fn wrong(message: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::playback;
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;

    /// Three particles in a plane: a free, a held and a moved one.
    fn scene() -> (System, State) {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.gravity(0.5, -9.81, 0.0);
        for x in [1.0, 2.0, 4.0] {
            builder.particle([x, -x, 0.0], 1.0);
        }
        builder.spring(0, 1, Spring { stiffness: 7.0, rest_length: 1.5, damping: 0.0 });
        builder.spring(2, 1, Spring { stiffness: 8.0, rest_length: 2.5, damping: 0.0 });
        builder.hold(1);
        let motion = Motion::Velocity(Vector3::new(1.0, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
        builder.build().unwrap()
    }

    /// The state of a frame: all coordinates and velocities differ.
    fn frame(start: &State, number: u64) -> State {
        let mut state = start.clone();
        state.time = 0.5 * number as f64;
        for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
            *x += Vector3::new(10.0 * number as f64, p as f64, 0.0);
            *v = Vector3::new(-(number as f64), 100.0 + p as f64, 0.0);
        }
        state
    }

    #[test]
    fn frames_continue_after_a_checkpoint_and_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let (system, start) = scene();
        let states = [0, 1, 2].map(|number| frame(&start, number));
        let mut trajectory = Trajectory::create(folder.path()).unwrap();
        for (step, state) in (0..).zip(&states) {
            trajectory.push(&system, state, step).unwrap();
        }
        trajectory.keep();
        trajectory.flush().unwrap();
        let waiting = folder.path().join(WAITING);
        let bytes = std::fs::metadata(&waiting).unwrap().len();
        // Two vectors of two doubles for each of three particles.
        assert_eq!(bytes, 3 * (3 * 2 * 2 * 8));
        drop(trajectory);
        assert!(waiting.exists());
        let missing = [(0.0, 0), (0.5, 1), (1.0, 2), (1.5, 3)];
        assert!(Trajectory::resume(folder.path(), missing.to_vec(), &system).is_err());
        // The frame after the checkpoint is written again.
        let known = [(0.0, 0), (0.5, 1)];
        let mut trajectory = Trajectory::resume(folder.path(), known.to_vec(), &system).unwrap();
        let other = frame(&start, 5);
        trajectory.push(&system, &other, 2).unwrap();
        trajectory.flush().unwrap();
        assert_eq!(std::fs::metadata(&waiting).unwrap().len(), bytes);
        let all = [known[0], known[1], (2.5, 2)];
        drop(trajectory);
        Trajectory::resume(folder.path(), all.to_vec(), &system).unwrap().finish(&system, &[[2, 1, 0]]).unwrap();
        let [first, second, _] = states;
        let written = [first, second, other];
        let velocities = written.iter().flat_map(|state| &state.velocities).flat_map(|v| [v.x, v.y]);
        let file = BufReader::new(File::open(folder.path().join(TRAJECTORY)).unwrap());
        let found: Vec<f64> = list(&mut ZipArchive::new(file).unwrap(), "velocities").unwrap();
        assert_eq!(found, velocities.collect::<Vec<_>>());

        let animation = playback(folder.path()).unwrap();
        assert_eq!(animation.times, [0.0, 0.5, 2.5]);
        assert_eq!(animation.positions, written.map(|state| state.positions).concat());
        let cast = animation.cast();
        assert_eq!((cast.dimension, cast.gravity), (2, Vector3::new(0.5, -9.81, 0.0)));
        assert_eq!(cast.bindings, [Binding::Free, Binding::Held, Binding::Moved]);
        assert_eq!((&cast.pairs[..], &cast.triangles[..]), (&[[0, 1], [2, 1]][..], &[[2, 1, 0]][..]));
        assert_eq!((&cast.rest_lengths[..], &cast.stiffnesses[..]), (&[1.5, 2.5][..], &[7.0, 8.0][..]));
        assert_eq!(animation.remarks, ["a frame every 0.5 s"]);
        assert!(animation.tracks.is_empty());
    }

    /// A trajectory of two particles and the lists given beside it.
    fn with_lists(
        folder: &Path,
        gravity: &[f64],
        pairs: &[u32],
        rest_lengths: &[f64],
        times: &[f64],
    ) -> Option<String> {
        let mut npz = NpzWriter::new(File::create(folder.join(TRAJECTORY)).unwrap());
        npz.put("times", &[times.len()], times.iter().copied()).unwrap();
        npz.put("bindings", &[2], [0u8, 1].into_iter()).unwrap();
        npz.put("gravity", &[gravity.len()], gravity.iter().copied()).unwrap();
        npz.put("pairs", &[pairs.len() / 2, 2], pairs.iter().copied()).unwrap();
        npz.put("rest_lengths", &[rest_lengths.len()], rest_lengths.iter().copied()).unwrap();
        npz.put("stiffness", &[1], [1.0].into_iter()).unwrap();
        npz.put("triangles", &[0, 3], std::iter::empty::<u32>()).unwrap();
        npz.put("positions", &[1, 2, 1], [0.0, 1.0].into_iter()).unwrap();
        npz.finish().unwrap();
        playback(folder).err().map(|error| error.to_string())
    }

    #[test]
    fn inconsistent_lists_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        for (gravity, pairs, rest_lengths, times, end) in [
            (&[0.0][..], &[0, 2][..], 1, 1, "its arrays do not fit together"),
            (&[], &[0, 1], 1, 1, "its arrays do not fit together"),
            (&[0.0; 4], &[0, 1], 1, 1, "its arrays do not fit together"),
            (&[0.0], &[0, 1], 2, 1, "not every spring has a rest length and a stiffness"),
            (&[0.0], &[0, 1, 1, 0], 2, 1, "not every spring has a rest length and a stiffness"),
            (&[0.0], &[0, 1], 1, 2, "its positions do not fit to its times and masses"),
            (&[0.0; 2], &[0, 1], 1, 1, "its positions do not fit to its times and masses"),
        ] {
            let message = with_lists(folder.path(), gravity, pairs, &vec![1.0; rest_lengths], &[0.0, 1.0][..times]);
            assert!(message.as_deref().is_some_and(|message| message.ends_with(end)), "{message:?}");
        }
    }

    #[test]
    fn the_summary_and_the_energies_of_a_run_are_shown() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(with_lists(folder.path(), &[0.0], &[0, 1], &[1.0], &[0.0]), None);
        let remarks = |summary: &str| {
            std::fs::write(folder.path().join("summary.json"), summary).unwrap();
            playback(folder.path()).unwrap().remarks
        };
        let all = r#"{"method": "bdf2", "stiffness": "full", "dt": 0.0123456, "status": "completed"}"#;
        assert_eq!(remarks(all), ["bdf2, stiffness full", "dt = 0.0123456 s"]);
        let failed = r#"{"method": "verlet", "stiffness": "none", "rtol": 1e-3, "dt": 1.0, "status": "unstable",
            "failure": {"message": "energy from nowhere"}}"#;
        assert_eq!(remarks(failed), ["verlet", "steps by rtol 0.001", "the run ended unstable: energy from nowhere"]);
        assert_eq!(remarks("no summary"), [""; 0]);

        let tracks = |text: &str| {
            std::fs::write(folder.path().join("energy.csv"), text).unwrap();
            playback(folder.path()).unwrap().tracks
        };
        let found = tracks("time,kinetic,elastic,work,rope_length\n0,1,2,3,4\n0.5,5,,7,8\n");
        let titles: Vec<_> = found.iter().map(|track| (track.title.as_str(), track.unit.as_str())).collect();
        assert_eq!(titles, [("energy", "J"), ("balance of energy", "J"), ("rope length", "")]);
        assert!(found.iter().all(|track| track.times == [0.0, 0.5]));
        assert_eq!((&found[0].curves[0], found[0].curves[1].1[0]), (&("kinetic".into(), vec![1.0, 5.0]), 2.0));
        assert!(found[0].curves[1].1[1].is_nan());
        assert_eq!(found[1].curves, [("work".into(), vec![3.0, 7.0])]);
        assert_eq!(tracks("time,kinetic\n0,1\n1,1\n").len(), 1);
        // One moment is no curve, and a table of something else none of energies.
        assert!(tracks("time,kinetic\n0,1\n").is_empty() && tracks("step,kinetic\n0,1\n1,2\n").is_empty());
    }
}
