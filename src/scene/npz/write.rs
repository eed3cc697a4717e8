//! From a [`Scene`] to arrays, and any arrays to a zip.

use super::TEXT;
use crate::scene::{Row, Scene, Springs, Values};
use npyz::WriterBuilder;
use std::io::{self, BufWriter, Write};
use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, DateTime, ZipWriter};

impl Scene {
    /// Writes the scene as arrays, see the table of what is read: what [`load`](Self::load) reads from a file that ends in `.npz`, to the bit.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_npz(&self, file: impl Write) -> io::Result<()> {
        let mut npz = NpzWriter::new(file);
        let (particles, springs) = (&self.particles, &self.springs);
        let mut small = self.without_arrays();
        if let Some(rows) = Rows::of(&particles.positions) {
            npz.put("particles.positions", &rows.shape, rows.numbers())?;
        } else {
            small.particles.positions.clone_from(&particles.positions);
        }
        match particles.velocities.as_deref().and_then(Rows::of) {
            Some(rows) => npz.put("particles.velocities", &rows.shape, rows.numbers())?,
            None => small.particles.velocities.clone_from(&particles.velocities),
        }
        if !springs.pairs.is_empty() {
            npz.put("springs.pairs", &[springs.pairs.len(), 2], springs.pairs.iter().flatten().copied())?;
        }
        let values = [
            ("particles.masses", &particles.masses),
            ("springs.stiffness", &springs.stiffness),
            ("springs.rest_lengths", &springs.rest_lengths),
            ("springs.damping", &springs.damping),
        ];
        for (name, values) in values {
            match values {
                Some(Values::Uniform(value)) => npz.put(name, &[], [*value].into_iter())?,
                Some(Values::Each(values)) => npz.put(name, &[values.len()], values.iter().copied())?,
                None => {}
            }
        }
        npz.put_text(TEXT, &small.to_json())?;
        npz.finish()
    }

    /// The scene without what is written as arrays.
    fn without_arrays(&self) -> Self {
        Self {
            name: self.name.clone(),
            gravity: self.gravity.clone(),
            mesh: self.mesh.clone(),
            constraints: self.constraints.clone(),
            forces: self.forces.clone(),
            drag: self.drag.clone(),
            springs: Springs {
                tension_only: self.springs.tension_only.clone(),
                actuation: self.springs.actuation.clone(),
                ..Springs::default()
            },
            time: self.time,
            ..Self::default()
        }
    }
}

/// Rows of one length, which can be an array.
struct Rows<'a> {
    rows: &'a [Row],
    shape: [usize; 2],
}

impl<'a> Rows<'a> {
    fn of(rows: &'a [Row]) -> Option<Self> {
        let dimension = rows.first()?.dimension();
        let is_array = rows.iter().all(|row| row.dimension() == dimension);
        is_array.then_some(Self { rows, shape: [rows.len(), dimension] })
    }

    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().flat_map(|row| row.as_slice()).copied()
    }
}

/// A writer of which the first failure alone is told: a zip that is given up then ends in silence, where it would print what it
/// could not write.
pub(crate) struct FailsOnce<W> {
    file: W,
    has_failed: bool,
}

impl<W: Write> FailsOnce<W> {
    fn attempt<T>(&mut self, act: impl FnOnce(&mut W) -> io::Result<T>, pretended: T) -> io::Result<T> {
        if self.has_failed {
            return Ok(pretended);
        }
        let outcome = act(&mut self.file);
        // An interrupted attempt is made again.
        self.has_failed = outcome.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::Interrupted);
        outcome
    }
}

impl<W: Write> Write for FailsOnce<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|file| file.write(bytes), bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(W::flush, ())
    }
}

/// A zip of arrays, written from front to back.
pub(crate) struct NpzWriter<W: Write>(ZipWriter<StreamWriter<FailsOnce<W>>>);

impl<W: Write> NpzWriter<W> {
    /// Begins a zip.
    pub(crate) fn new(file: W) -> Self {
        Self(ZipWriter::new_stream(FailsOnce { file, has_failed: false }))
    }

    /// Begins an array. Sizes are 64-bit, and the date is always the same one: equal values give equal files.
    fn start(&mut self, name: &str) -> io::Result<()> {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        let options = options.large_file(true).last_modified_time(DateTime::default());
        self.0.start_file(format!("{name}.npy"), options).map_err(io::Error::from)
    }

    /// Adds an array of these values.
    pub(crate) fn put<T: npyz::AutoSerialize>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: impl Iterator<Item = T>,
    ) -> io::Result<()> {
        self.start(name)?;
        let shape: Vec<u64> = shape.iter().map(|&length| length as u64).collect();
        let options = npyz::WriteOptions::new().default_dtype().shape(&shape);
        let mut array = options.writer(BufWriter::new(&mut self.0)).begin_nd()?;
        array.extend(values)?;
        array.finish()
    }

    /// Adds one text.
    fn put_text(&mut self, name: &str, text: &str) -> io::Result<()> {
        self.start(name)?;
        // NumPy has no text without a character: an empty one is a blank.
        let text = if text.is_empty() { " " } else { text };
        let dtype = npyz::DType::Plain(format!("<U{}", text.chars().count()).parse().map_err(io::Error::other)?);
        let mut array =
            npyz::WriteOptions::new().dtype(dtype).shape(&[]).writer(BufWriter::new(&mut self.0)).begin_nd()?;
        array.push(text)?;
        array.finish()
    }

    /// Begins an array of doubles of this shape, whose bytes, least significant first, are written to what is returned.
    #[cfg(feature = "report")]
    pub(crate) fn doubles(&mut self, name: &str, shape: &[u64]) -> io::Result<&mut (impl Write + use<W>)> {
        self.start(name)?;
        let options = npyz::WriteOptions::new_header_only().dtype(<f64 as npyz::AutoSerialize>::default_dtype());
        options.shape(shape).writer(&mut self.0).write_header_only()?;
        Ok(&mut self.0)
    }

    /// Ends the zip.
    pub(crate) fn finish(self) -> io::Result<()> {
        let file = self.0.finish().map_err(io::Error::from)?.into_inner();
        if file.has_failed { Err(io::Error::other("what was written before is not whole")) } else { Ok(()) }
    }
}
