//! Matrices and vectors as [Matrix Market](https://math.nist.gov/MatrixMarket/formats.html) files.
//!
//! Indices in the files count from 1, as the format wants; here they count from 0.

use super::AtomicFile;
use crate::error::{Error, Result};
use crate::system::DofMap;
use std::io::{self, Write};
use std::path::PathBuf;

/// Writes a symmetric matrix of order `n` as `coordinate real symmetric`: the entries (row, column, value) of its lower
/// triangle, `row ≥ column`, in the iterator's order. `entries` says how many there are; the format states it first.
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
        match written == entries {
            true => Ok(()),
            false => Err(io::Error::other(format!("{written} entries where {entries} were announced"))),
        }
    })
}

/// Writes a vector as `array real general` with one column.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written.
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

/// Writes which coordinate each row stands for, as CSV with the header `row,particle,axis`; rows and particles count
/// from 0, the axis is a letter.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written.
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
