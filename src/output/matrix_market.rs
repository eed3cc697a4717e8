//! Matrices and vectors as [Matrix Market](https://math.nist.gov/MatrixMarket/formats.html) files, and the files of a failed step.
//!
//! Indices in the files count from 1, as in the format; here they count from 0.

use super::AtomicFile;
use crate::error::{Error, Result};
use crate::inspect::Inspection;
use crate::integrate::StepMatrices;
use crate::operator::LinearOperator;
use crate::report::inspection::InspectionReport;
use crate::scene::{Scene, TimeSettings};
use crate::system::{DofMap, State, System};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a symmetric matrix of order `n` as `coordinate real symmetric`: the entries (row, column, value) of its lower
/// triangle, `row ≥ column`, in the iterator's order. `entries` is their number, which the format states first.
/// Lines of `comment` go into the file's head.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written, or when the iterator does not yield `entries` entries of the lower
/// triangle.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::integrate::StepMatrices;
/// use sprung::output::write_symmetric;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let k = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01)?.k;
/// let file = std::env::temp_dir().join(format!("sprung-example-{}.mtx", std::process::id()));
/// write_symmetric(&file, "K, in N/m", system.dofs().len(), k.values().len(), k.iter())?;
/// assert!(std::fs::read_to_string(&file)?.starts_with("%%MatrixMarket matrix coordinate real symmetric"));
/// std::fs::remove_file(file)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_symmetric(
    target: impl Into<PathBuf>,
    comment: &str,
    n: usize,
    entries: usize,
    lower: impl IntoIterator<Item = (usize, usize, f64)>,
) -> Result<()> {
    AtomicFile::write(target, |file| {
        head(file, "coordinate real symmetric", comment)?;
        writeln!(file, "{n} {n} {entries}")?;
        let mut written = 0;
        for (row, column, value) in lower {
            if row >= n || column > row {
                return Err(io::Error::other(format!("({row}, {column}) is not in the lower triangle of order {n}")));
            }
            writeln!(file, "{} {} {value:?}", row + 1, column + 1)?;
            written += 1;
        }
        if written != entries {
            return Err(io::Error::other(format!("{written} entries instead of the announced {entries}")));
        }
        Ok(())
    })
}

/// Writes a vector as `array real general` with one column.
pub fn write_vector(target: impl Into<PathBuf>, comment: &str, vector: &[f64]) -> Result<()> {
    AtomicFile::write(target, |file| {
        head(file, "array real general", comment)?;
        writeln!(file, "{} 1", vector.len())?;
        vector.iter().try_for_each(|value| writeln!(file, "{value:?}"))
    })
}

fn head(file: &mut AtomicFile, kind: &str, comment: &str) -> io::Result<()> {
    writeln!(file, "%%MatrixMarket matrix {kind}")?;
    comment.lines().try_for_each(|line| writeln!(file, "% {line}"))
}

/// Writes the coordinate of each row, as CSV with the header `row,particle,axis`; rows and particles count from 0, the axis is a letter.
pub fn write_dofs(target: impl Into<PathBuf>, dofs: &DofMap) -> Result<()> {
    let target = target.into();
    let mut rows = csv::Writer::from_writer(AtomicFile::create(&target)?);
    let failed = |error: csv::Error| Error::io(&target, io::Error::from(error));
    rows.write_record(["row", "particle", "axis"]).map_err(failed)?;
    for (row, dof) in dofs.iter().enumerate() {
        rows.serialize((row, dof.particle, dof.axis_name())).map_err(failed)?;
    }
    rows.into_inner().map_err(|failed| Error::io(&target, failed.into_error()))?.commit()
}

/// A step that failed because its matrix is indefinite.
#[derive(Debug, Clone, Copy)]
pub struct FailedStep<'a> {
    /// The scene's name.
    pub scene: &'a str,
    /// The system.
    pub system: &'a System,
    /// The state at the start of the step.
    pub state: &'a State,
    /// Completed steps.
    pub steps: u64,
    /// The step's length, in s.
    pub dt: f64,
    /// The inspection of that state, for the dt of the step's matrix.
    pub inspection: &'a Inspection,
}

/// The names of its files.
pub const BUNDLE: [&str; 5] = ["scene.toml", "A.mtx", "b.mtx", "dofs.csv", "culprits.json"];

impl FailedStep<'_> {
    /// Writes `scene.toml`, which starts at the state and fails in its first step, `A.mtx` and `b.mtx` of that step's linear system in
    /// linearised backward Euler, `dofs.csv` with the meaning of their rows, and `culprits.json`, the inspection.
    ///
    /// # Errors
    /// A file that cannot be written; a matrix that is too large.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let Self { scene: name, system, state, dt, inspection, .. } = *self;
        let scene = Scene {
            time: TimeSettings { dt: Some(dt), duration: Some(dt) },
            ..Scene::snapshot(&format!("{name} at failure"), system, state)
        };
        AtomicFile::write_text(folder.join("scene.toml"), &scene.to_toml())?;
        let StepMatrices { a, b, .. } = StepMatrices::assemble(system, state, inspection.option, inspection.dt)?;
        let how = format!("dt = {:?} s, stiffness {}", inspection.dt, inspection.option.name());
        let comment = format!("A = M/dt^2 - G/dt - K, in N/m; {how}\nrows and columns as in dofs.csv");
        let entries = || a.iter().filter(|(_, _, value)| *value != 0.0);
        write_symmetric(folder.join("A.mtx"), &comment, a.order(), entries().count(), entries())?;
        let comment = format!("b = M v/dt + M gravity + f_elastic - A_fc dx_c, in N; {how}\nrows as in dofs.csv");
        write_vector(folder.join("b.mtx"), &comment, &b)?;
        write_dofs(folder.join("dofs.csv"), system.dofs())?;
        let report = InspectionReport { scene: name, step: self.steps, time: state.time, inspection, losses: None };
        AtomicFile::write_indented_json(folder.join("culprits.json"), &report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;

    /// 1 kg on a spring of 100 N, compressed to half its length, and a step of 1 s: A is diagonal, 1 + 100 along the spring and 1 − 100
    /// across it. The spring pushes with 50 N. The scene repeats one step of the run's length.
    #[test]
    fn the_failed_step_is_written() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([0.5, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(0);
        let (system, state) = builder.build().unwrap();
        let inspection = Inspection::at(&system, &state, 1.0, Stiffness::Full, faer::Par::Seq).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let step =
            FailedStep { scene: "s", system: &system, state: &state, steps: 3, dt: 0.25, inspection: &inspection };
        step.write(folder.path()).unwrap();
        let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(BUNDLE.iter().all(|name| !text(name).is_empty()));
        let time = Scene::load(folder.path().join("scene.toml")).unwrap().time;
        assert_eq!((time.dt, time.duration), (Some(0.25), Some(0.25)));
        let numbers = |name: &str| -> Vec<f64> {
            let text = text(name);
            let lines = text.lines().filter(|line| !line.starts_with('%'));
            lines.flat_map(str::split_whitespace).map(|word| word.parse().unwrap()).collect()
        };
        // Order and number of entries, then row, column and value of each.
        assert_eq!(numbers("A.mtx"), [2.0, 2.0, 2.0, 1.0, 1.0, 101.0, 2.0, 2.0, -99.0]);
        assert_eq!(numbers("b.mtx"), [2.0, 1.0, 50.0, 0.0]);
    }
}
