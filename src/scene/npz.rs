//! Scenes as NumPy arrays: large lists as the bytes they are, read at the speed of the disk.
//!
//! An `.npz` file is a zip of `.npy` arrays, as `numpy.savez` writes them. An array has the name of its key, with a dot between table and key, any real type, or
//! for pairs any of whole numbers, and C or Fortran order; everything small is JSON text with the same keys as a [scene file](super::Scene), in an array
//! `scene`. A key that is in the text too, or an array of another name, is rejected. The guide has an example (`large-scenes.md`).

use super::{Particles, Row, Scene, Springs, Values};
use crate::error::{Error, Result};
use crate::memory;
use npyz::{DType, NpyFile, Order, TypeChar, TypeStr, WriterBuilder};
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::ops::RangeInclusive;
use std::path::Path;
use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

const TEXT: &str = "scene";

/// The arrays of rows and pairs, then those of one number for all or one for each.
const ARRAYS: [&str; 7] = [
    "particles.positions",
    "particles.velocities",
    "springs.pairs",
    "particles.masses",
    "springs.stiffness",
    "springs.rest_lengths",
    "springs.damping",
];

/// Reads a scene from arrays, and its text with `parse`; errors call the file `name`.
pub(super) fn read(file: impl Read + Seek, name: &Path, parse: fn(&str) -> Result<Scene, String>) -> Result<Scene> {
    let wrong = |message: String| Error::Format { file: name.into(), message };
    let mut zip = ZipArchive::new(file).map_err(|error| wrong(error.to_string()))?;
    let text = match zip.index_for_name(&format!("{TEXT}.npy")) {
        Some(index) => {
            open(&mut zip, index).and_then(Array::text).map_err(|message| wrong(format!("{TEXT}: {message}")))?
        }
        None => "{}".to_owned(),
    };
    let mut scene = parse(&text).map_err(|message| wrong(format!("{TEXT}: {message}")))?;
    for index in 0..zip.len() {
        let size = zip.by_index_raw(index).map_or(0, |entry| entry.size());
        // The numbers as stored and as rows of three.
        memory::ensure(size.saturating_mul(6), "the scene file")?;
        let name = match zip.name_for_index(index) {
            Some(Ok(name)) => name.strip_suffix(".npy").unwrap_or(&name).to_owned(),
            _ => return Err(wrong(format!("the name of array {index} is not text"))),
        };
        if name != TEXT {
            let filled = open(&mut zip, index).and_then(|array| scene.fill(&name, array));
            filled.map_err(|message| wrong(format!("{name}: {message}")))?;
        }
    }
    Ok(scene)
}

impl Scene {
    fn fill<R: Read>(&mut self, name: &str, array: Array<R>) -> Result<(), String> {
        let Self { particles, springs, .. } = self;
        match name {
            "particles.positions" if particles.positions.is_empty() => particles.positions = array.rows()?,
            "particles.velocities" if particles.velocities.is_none() => particles.velocities = Some(array.rows()?),
            "springs.pairs" if springs.pairs.is_empty() => springs.pairs = array.pairs()?,
            "particles.masses" if particles.masses.is_none() => particles.masses = Some(array.values()?),
            "springs.stiffness" if springs.stiffness.is_none() => springs.stiffness = Some(array.values()?),
            "springs.rest_lengths" if springs.rest_lengths.is_none() => springs.rest_lengths = Some(array.values()?),
            "springs.damping" if springs.damping.is_none() => springs.damping = Some(array.values()?),
            name if ARRAYS.contains(&name) => {
                return Err(format!("is given twice, by an array and in the text of {TEXT}"));
            }
            _ => return Err(format!("is no array of a scene; those are {}", ARRAYS.join(", "))),
        }
        Ok(())
    }

    /// Writes the scene as arrays, in the format that [`load`](Self::load) reads from a file that ends in `.npz`, to the bit:
    /// `particles.positions`, `particles.velocities`, `particles.masses`, `springs.pairs`, `springs.stiffness`,
    /// `springs.rest_lengths`, `springs.damping`, and everything else as JSON text in `scene`.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_npz(&self, file: impl Write) -> io::Result<()> {
        let mut npz = NpzWriter::new(file);
        let Springs { pairs, tension_only, actuation, .. } = &self.springs;
        let springs =
            Springs { tension_only: tension_only.clone(), actuation: actuation.clone(), ..Springs::default() };
        let mut rest = Self {
            name: self.name.clone(),
            gravity: self.gravity.clone(),
            mesh: self.mesh.clone(),
            constraints: self.constraints.clone(),
            forces: self.forces.clone(),
            drag: self.drag.clone(),
            springs,
            time: self.time,
            ..Self::default()
        };
        let Particles { positions, velocities, masses } = &self.particles;
        if !npz.put_rows("particles.positions", positions)? {
            rest.particles.positions.clone_from(positions);
        }
        if !npz.put_rows("particles.velocities", velocities.as_deref().unwrap_or_default())? {
            rest.particles.velocities.clone_from(velocities);
        }
        if !pairs.is_empty() {
            npz.put("springs.pairs", &[pairs.len(), 2], pairs.iter().flatten().copied())?;
        }
        let Springs { stiffness, rest_lengths, damping, .. } = &self.springs;
        for (name, values) in ARRAYS[3..].iter().zip([masses, stiffness, rest_lengths, damping]) {
            match values {
                Some(Values::Uniform(value)) => npz.put(name, &[], [*value].into_iter())?,
                Some(Values::Each(values)) => npz.put(name, &[values.len()], values.iter().copied())?,
                None => {}
            }
        }
        npz.put_text(TEXT, &rest.to_json())?;
        npz.finish()
    }
}

struct Array<R: Read>(NpyFile<R>);

/// Opens an array of the zip. Its header is checked before npyz parses it, and the bytes it promises must be there.
fn open<R: Read + Seek>(zip: &mut ZipArchive<R>, index: usize) -> Result<Array<impl Read + use<'_, R>>, String> {
    // NumPy's headers of plain arrays are shorter, and a long one has room for deep nesting.
    const HEADER: usize = 1024;
    let mut entry = zip.by_index(index).map_err(|error| error.to_string())?;
    let size = entry.size();
    let mut start = vec![0; 12];
    entry.read_exact(&mut start).map_err(|error| error.to_string())?;
    let (header, before) = match *start.as_slice() {
        [.., 1, _, a, b, _, _] => (u16::from_le_bytes([a, b]).into(), 10),
        [.., a, b, c, d] => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
        _ => (0, 0),
    };
    if header > HEADER {
        return Err(format!("has a header of {header} bytes, more than the {HEADER} of a plain array"));
    }
    start.resize((before + header).max(12), 0);
    entry.read_exact(start.get_mut(12..).unwrap_or_default()).map_err(|error| error.to_string())?;
    // npyz multiplies the lengths unchecked; with as many digits in all their product fits 64 bits.
    if start.iter().filter(|byte| byte.is_ascii_digit()).count() > 18 {
        return Err("speaks of more numbers than there can be".into());
    }
    let npy = NpyFile::new(io::Cursor::new(start).chain(BufReader::with_capacity(1 << 18, entry)));
    let array = Array(npy.map_err(|error| error.to_string())?);
    let bytes = array.plain_type().and_then(|plain| plain.num_bytes());
    let count = array.0.shape().iter().try_fold(1_u64, |product, &length| product.checked_mul(length));
    match bytes.zip(count).and_then(|(bytes, count)| count.checked_mul(bytes as u64)) {
        Some(needed) if needed <= size => Ok(array),
        Some(needed) => Err(format!("speaks of {needed} bytes where there are {size}")),
        None => Err("is not an array of plain numbers".into()),
    }
}

impl<R: Read> Array<R> {
    fn plain_type(&self) -> Option<TypeStr> {
        match self.0.dtype() {
            DType::Plain(plain) => Some(plain),
            _ => None,
        }
    }

    fn kind(&self) -> Option<(TypeChar, u64)> {
        self.plain_type().map(|plain| (plain.type_char(), plain.size_field()))
    }

    fn wrong_shape(&self, expected: &str) -> String {
        let lengths: Vec<String> = self.0.shape().iter().map(u64::to_string).collect();
        format!("has the shape ({}), {expected}", lengths.join(", "))
    }

    fn numbers(self) -> Result<Vec<f64>, String> {
        let (kind, npy) = (self.kind(), self.0);
        match kind {
            Some((TypeChar::Float, 8)) => collect(npy, |x: f64| x),
            Some((TypeChar::Float, 4)) => collect(npy, |x: f32| x.into()),
            Some((TypeChar::Int, 8)) => collect(npy, |x: i64| x as f64),
            Some((TypeChar::Int, 4)) => collect(npy, |x: i32| x.into()),
            Some((TypeChar::Int, 2)) => collect(npy, |x: i16| x.into()),
            Some((TypeChar::Int, 1)) => collect(npy, |x: i8| x.into()),
            Some((TypeChar::Uint, 8)) => collect(npy, |x: u64| x as f64),
            Some((TypeChar::Uint, 4)) => collect(npy, |x: u32| x.into()),
            Some((TypeChar::Uint, 2)) => collect(npy, |x: u16| x.into()),
            Some((TypeChar::Uint, 1)) => collect(npy, |x: u8| x.into()),
            _ => Err(format!("has type {}, not one of real numbers", npy.dtype().descr())),
        }
    }

    /// The numbers by rows, with the width of a row, in any of `widths`.
    fn table(self, widths: RangeInclusive<u64>, expected: &str) -> Result<(usize, Vec<f64>), String> {
        let [rows, width] = match *self.0.shape() {
            [rows, width] if widths.contains(&width) => [rows, width].map(|length| length as usize),
            _ => return Err(self.wrong_shape(&format!("not one row of {expected} for each"))),
        };
        let order = self.0.order();
        let numbers = self.numbers()?;
        if order == Order::C {
            return Ok((width, numbers));
        }
        let by_row = (0..rows).flat_map(|row| (0..width).map(move |column| (row, column)));
        let by_row = by_row.filter_map(|(row, column)| numbers.get(column * rows + row).copied());
        Ok((width, by_row.collect()))
    }

    fn rows(self) -> Result<Vec<Row>, String> {
        let (dimension, numbers) = self.table(1..=3, "1 to 3 numbers")?;
        Ok(numbers.chunks_exact(dimension).map(Row::of_numbers).collect())
    }

    fn pairs(self) -> Result<Vec<[u32; 2]>, String> {
        if !matches!(self.kind(), Some((TypeChar::Int | TypeChar::Uint, _))) {
            return Err(format!("has type {}, not one of whole numbers", self.0.dtype().descr()));
        }
        let (_, numbers) = self.table(2..=2, "2 numbers")?;
        let number = |index: usize, x: f64| match x {
            // Whole, because the type is; what fits 32 bits is exact.
            0.0..=4_294_967_295.0 => Ok(x as u32),
            _ => Err(format!("entry {index} is {x}, not the number of a particle")),
        };
        let (ends, _) = numbers.as_chunks::<2>();
        ends.iter().enumerate().map(|(index, &[i, j])| Ok([number(index, i)?, number(index, j)?])).collect()
    }

    fn values(self) -> Result<Values, String> {
        match self.0.shape().len() {
            0 => self.numbers()?.first().map(|&value| Values::Uniform(value)).ok_or_else(|| "is empty".to_owned()),
            1 => Ok(Values::Each(self.numbers()?)),
            _ => Err(self.wrong_shape("neither one number nor a list")),
        }
    }

    fn text(self) -> Result<String, String> {
        let texts = match self.kind() {
            Some((TypeChar::UnicodeStr, _)) => self.0.into_vec::<String>().map_err(|error| error.to_string())?,
            _ => Vec::new(),
        };
        texts.into_iter().next().ok_or_else(|| "must be text".to_owned())
    }
}

fn collect<T: npyz::Deserialize, R: Read>(npy: NpyFile<R>, to: impl Fn(T) -> f64) -> Result<Vec<f64>, String> {
    let numbers = npy.data::<T>().map_err(|error| error.to_string())?;
    numbers.map(|number| number.map(&to)).collect::<io::Result<_>>().map_err(|error| error.to_string())
}

/// A writer that reports its first failure only: the zip, when dropped, would otherwise print to stderr that it could not be completed.
pub(crate) struct FailsOnce<W>(Option<W>);

impl<W: Write> Write for FailsOnce<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(file) = &mut self.0 {
            file.write_all(bytes).inspect_err(|_| self.0 = None)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.as_mut().map_or(Ok(()), W::flush)
    }
}

pub(crate) struct NpzWriter<W: Write>(ZipWriter<StreamWriter<FailsOnce<W>>>);

impl<W: Write> NpzWriter<W> {
    pub(crate) fn new(file: W) -> Self {
        Self(ZipWriter::new_stream(FailsOnce(Some(file))))
    }

    /// Begins an array. Sizes are 64-bit, and the date is constant: equal values give equal files.
    fn start(&mut self, name: &str) -> io::Result<()> {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        let options = options.large_file(true).last_modified_time(DateTime::default());
        self.0.start_file(format!("{name}.npy"), options).map_err(io::Error::from)
    }

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

    /// Adds rows of one length as an array; `false` where there are none or their lengths differ.
    fn put_rows(&mut self, name: &str, rows: &[Row]) -> io::Result<bool> {
        let Some(dimension) = rows.first().map(Row::dimension) else { return Ok(false) };
        if rows.iter().any(|row| row.dimension() != dimension) {
            return Ok(false);
        }
        self.put(name, &[rows.len(), dimension], rows.iter().flat_map(Row::as_slice).copied())?;
        Ok(true)
    }

    fn put_text(&mut self, name: &str, text: &str) -> io::Result<()> {
        self.start(name)?;
        // NumPy has no text without a character.
        let text = if text.is_empty() { " " } else { text };
        let dtype = DType::Plain(format!("<U{}", text.chars().count()).parse().map_err(io::Error::other)?);
        let options = npyz::WriteOptions::new().dtype(dtype).shape(&[]);
        let mut array = options.writer(BufWriter::new(&mut self.0)).begin_nd()?;
        array.push(text)?;
        array.finish()
    }

    /// Begins an array of doubles of this shape, whose little-endian bytes are written to what is returned.
    #[cfg(feature = "report")]
    pub(crate) fn doubles(&mut self, name: &str, shape: &[u64]) -> io::Result<&mut (impl Write + use<W>)> {
        self.start(name)?;
        let options = npyz::WriteOptions::new_header_only().dtype(<f64 as npyz::AutoSerialize>::default_dtype());
        options.shape(shape).writer(&mut self.0).write_header_only()?;
        Ok(&mut self.0)
    }

    pub(crate) fn finish(self) -> io::Result<()> {
        let FailsOnce(file) = self.0.finish().map_err(io::Error::from)?.into_inner();
        file.map(drop).ok_or_else(|| io::Error::other("an earlier write failed"))
    }
}

#[cfg(test)]
mod tests {
    use super::NpzWriter;
    use crate::scene::{Scene, Values};
    use std::io::{Cursor, Write};
    use zip::ZipArchive;

    const NET: &str = r#"{
        "name": "net", "gravity": [0.5, -9.81],
        "particles": {"positions": [[0, 0], [1, 0]], "velocities": [[0, 0], [0, 2.5]], "masses": [1, 3]},
        "springs": {"pairs": [[0, 1]], "stiffness": 100, "rest_lengths": [0.9]},
        "constraints": [{"particles": [0]}],
        "time": {"dt": 0.01, "duration": 2}
    }"#;

    fn written(scene: &Scene) -> Vec<u8> {
        let mut bytes = Vec::new();
        scene.write_npz(&mut bytes).unwrap();
        bytes
    }

    /// Rows of one length are an array; those of two lengths are in the text.
    #[test]
    fn large_lists_are_arrays() {
        let scene = Scene::from_json(NET).unwrap();
        let has = |bytes: &[u8], name: &str| {
            ZipArchive::new(Cursor::new(bytes)).unwrap().index_for_name(&format!("{name}.npy")).is_some()
        };
        let bytes = written(&scene);
        assert!(super::ARRAYS[..6].iter().all(|name| has(&bytes, name)));
        assert_eq!(Scene::from_npz(Cursor::new(&bytes)).unwrap(), scene);
        let mut uneven = scene;
        uneven.particles.positions[1] = [1.0, 0.0, 0.0].into();
        assert!(!has(&written(&uneven), "particles.positions"));
    }

    #[test]
    fn masses_may_be_of_any_real_type() {
        fn masses<T: npyz::AutoSerialize>(values: [T; 2]) -> Option<Values> {
            let mut bytes = Vec::new();
            let mut npz = NpzWriter::new(&mut bytes);
            npz.put("particles.masses", &[2], values.into_iter()).unwrap();
            npz.finish().unwrap();
            Scene::from_npz(Cursor::new(&bytes)).unwrap().particles.masses
        }
        let floats = [masses([3.0, 7.0]), masses([3f32, 7.0])];
        let signed = [masses([3i64, 7]), masses([3i32, 7]), masses([3i16, 7]), masses([3i8, 7])];
        let unsigned = [masses([3u64, 7]), masses([3u32, 7]), masses([3u16, 7]), masses([3u8, 7])];
        for found in floats.into_iter().chain(signed).chain(unsigned) {
            assert_eq!(found, Some(Values::Each(vec![3.0, 7.0])));
        }
    }

    /// A writer with room for so many bytes.
    struct Limited(usize);

    impl Write for Limited {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len()).ok_or(std::io::ErrorKind::StorageFull)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn files_are_whole_or_an_error() {
        let scene = Scene::from_json(NET).unwrap();
        let length = written(&scene).len();
        scene.write_npz(Limited(length)).unwrap();
        assert!(scene.write_npz(Limited(length - 1)).is_err());
        assert!(scene.write_npz(Limited(10)).is_err());
    }
}
