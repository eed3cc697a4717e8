//! Matrices and vectors as [Matrix Market](https://math.nist.gov/MatrixMarket/formats.html) files, whose indices count from 1, and the files of a failed step.

use super::AtomicFile;
use crate::error::Result;
use crate::inspect::Inspection;
use crate::integrate::StepMatrices;
use crate::operator::LinearOperator;
use crate::report::inspection::InspectionReport;
use crate::scene::{Scene, TimeSettings};
use crate::system::{DofMap, State, System};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a symmetric matrix of order `n` as `coordinate real symmetric`: the entries (row, column, value) of its lower triangle, `row ≥ column`, in
/// the iterator's order. `entries` is their number, which the format states first. Lines of `comment` go into the file's head.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be written, or when the iterator does not yield `entries` entries of the lower triangle.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::integrate::StepMatrices;
/// use sprung::output::write_symmetric;
///
/// let (system, state) = sprung::scene::builtin::chain(2)?.build()?;
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
    AtomicFile::write(target, |file| {
        writeln!(file, "row,particle,axis")?;
        let mut rows = dofs.iter().enumerate();
        rows.try_for_each(|(row, dof)| writeln!(file, "{row},{},{}", dof.particle, dof.axis_name()))
    })
}

/// The files of a [failed step](write_failed_step).
pub const BUNDLE: [&str; 5] = ["scene.toml", "A.mtx", "b.mtx", "dofs.csv", "culprits.json"];

/// Writes the step of dt seconds, after so many steps, that failed because its matrix is indefinite: `scene.toml`, which starts at its state and fails
/// in its first step, `A.mtx` and `b.mtx` of its linear system in linearised backward Euler, `dofs.csv` with the meaning of their rows, and
/// `culprits.json`, the inspection of that state for the dt of the step's matrix.
///
/// # Errors
/// A file that cannot be written; a matrix that is too large.
pub fn write_failed_step(
    folder: &Path,
    name: &str,
    (system, state): (&System, &State),
    steps: u64,
    dt: f64,
    inspection: &Inspection,
) -> Result<()> {
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
    let report = InspectionReport { scene: name, step: steps, time: state.time, inspection, losses: None };
    AtomicFile::write_indented_json(folder.join("culprits.json"), &report)
}
