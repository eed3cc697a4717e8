//! From arrays to a [`Scene`]; nothing in a file is believed before it is looked at.

use super::TEXT;
use crate::error::{Error, Result};
use crate::memory;
use crate::scene::{Row, Scene, Values};
use nalgebra::Vector3;
use npyz::{DType, NpyFile, Order, TypeChar};
use std::io::{self, BufReader, Read, Seek};
use std::ops::RangeInclusive;
use std::path::Path;
use zip::ZipArchive;

/// Longer headers than this are not NumPy's of plain arrays, and the nesting that a longer one has room for is deep.
const HEADER: usize = 1024;
/// The lengths of a shape with as many digits in all have a product that fits 64 bits; the parser multiplies them unasked.
const DIGITS: usize = 18;
/// Bytes that reading holds at most for a byte of an array: the numbers as they are and as rows of three.
const SHARE: u64 = 6;

/// Reads a scene of arrays from a file of this name; `parse` reads the text.
///
/// # Errors
/// [`Error::Format`] with the array's name for one that is not as described above, [`Error::TooLarge`].
pub fn read(file: impl Read + Seek, name: &Path, parse: fn(&str) -> Result<Scene, String>) -> Result<Scene> {
    let wrong = |message: String| Error::Format { file: name.into(), message };
    let mut zip = ZipArchive::new(file).map_err(|error| wrong(error.to_string()))?;
    let text = match zip.index_for_name(&format!("{TEXT}.npy")) {
        Some(index) => {
            array(&mut zip, index).and_then(Array::text).map_err(|message| wrong(format!("{TEXT}: {message}")))?
        }
        None => "{}".to_owned(),
    };
    let mut scene = parse(&text).map_err(|message| wrong(format!("{TEXT}: {message}")))?;
    for index in 0..zip.len() {
        let size = zip.by_index_raw(index).map_or(0, |entry| entry.size());
        memory::ensure(size.saturating_mul(SHARE), "the scene file")?;
        let name = match zip.name_for_index(index) {
            Some(Ok(name)) => name.strip_suffix(".npy").unwrap_or(&name).to_owned(),
            _ => return Err(wrong(format!("the name of array {index} is not text"))),
        };
        if name != TEXT {
            let filled = array(&mut zip, index).and_then(|array| scene.fill(&name, array));
            filled.map_err(|message| wrong(format!("{name}: {message}")))?;
        }
    }
    Ok(scene)
}

impl Scene {
    /// Puts an array where its name says.
    fn fill<R: Read>(&mut self, name: &str, array: Array<R>) -> Result<(), String> {
        let (particles, springs) = (&mut self.particles, &mut self.springs);
        match name {
            "particles.positions" => {
                absent(particles.positions.is_empty())?;
                particles.positions = array.rows()?;
            }
            "particles.velocities" => {
                absent(particles.velocities.is_none())?;
                particles.velocities = Some(array.rows()?);
            }
            "springs.pairs" => {
                absent(springs.pairs.is_empty())?;
                springs.pairs = array.pairs()?;
            }
            _ => {
                let values = match name {
                    "particles.masses" => &mut particles.masses,
                    "springs.stiffness" => &mut springs.stiffness,
                    "springs.rest_lengths" => &mut springs.rest_lengths,
                    "springs.damping" => &mut springs.damping,
                    _ => return Err(format!("is no array of a scene; those are {}", ARRAYS.join(", "))),
                };
                absent(values.is_none())?;
                *values = Some(array.values()?);
            }
        }
        Ok(())
    }
}

/// Every array of numbers that a scene may have.
const ARRAYS: [&str; 7] = [
    "particles.positions",
    "particles.velocities",
    "particles.masses",
    "springs.pairs",
    "springs.stiffness",
    "springs.rest_lengths",
    "springs.damping",
];

fn absent(is_absent: bool) -> Result<(), String> {
    if is_absent { Ok(()) } else { Err(format!("is given twice, by an array and in the text of {TEXT}")) }
}

/// An array whose header has been read.
struct Array<R: Read> {
    npy: NpyFile<R>,
}

/// Opens an array of the zip. Its header is looked at before a parser is given it, and the numbers it speaks of must be there.
fn array<R: Read + Seek>(zip: &mut ZipArchive<R>, index: usize) -> Result<Array<impl Read + use<'_, R>>, String> {
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
    if start.iter().filter(|byte| byte.is_ascii_digit()).count() > DIGITS {
        return Err("speaks of more numbers than there can be".into());
    }
    let npy = NpyFile::new(io::Cursor::new(start).chain(BufReader::with_capacity(1 << 18, entry)));
    let npy = npy.map_err(|error| error.to_string())?;
    let bytes = match npy.dtype() {
        DType::Plain(of) => of.num_bytes(),
        _ => None,
    };
    let count = npy.shape().iter().try_fold(1_u64, |product, &length| product.checked_mul(length));
    let needed = bytes.zip(count).and_then(|(bytes, count)| count.checked_mul(bytes as u64));
    match needed {
        Some(needed) if needed <= size => Ok(Array { npy }),
        Some(needed) => Err(format!("speaks of {needed} bytes where there are {size}")),
        None => Err("is not an array of plain numbers".into()),
    }
}

impl<R: Read> Array<R> {
    fn kind(&self) -> Option<(TypeChar, u64)> {
        match self.npy.dtype() {
            DType::Plain(of) => Some((of.type_char(), of.size_field())),
            _ => None,
        }
    }

    fn shape(&self) -> String {
        let lengths: Vec<String> = self.npy.shape().iter().map(u64::to_string).collect();
        format!("({})", lengths.join(", "))
    }

    /// The numbers as they lie there.
    fn numbers(self) -> Result<Vec<f64>, String> {
        let (kind, npy) = (self.kind(), self.npy);
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

    /// The numbers by rows of `width`, whatever the order in the file; the shape must be (any, width).
    fn table(self, widths: RangeInclusive<usize>) -> Result<(usize, Vec<f64>), String> {
        let shape = self.shape();
        let (rows, width) = match *self.npy.shape() {
            [rows, width] if widths.contains(&(width as usize)) => (rows as usize, width as usize),
            _ => return Err(format!("has the shape {shape}, not one row of {} for each", describe(&widths))),
        };
        let order = self.npy.order();
        let numbers = self.numbers()?;
        if order == Order::C {
            return Ok((width, numbers));
        }
        let by_row = (0..rows).flat_map(|row| (0..width).map(move |column| (row, column)));
        let by_row = by_row.filter_map(|(row, column)| numbers.get(column * rows + row).copied());
        Ok((width, by_row.collect()))
    }

    fn rows(self) -> Result<Vec<Row>, String> {
        let (dimension, numbers) = self.table(1..=3)?;
        let row = |entries: &[f64]| {
            Row::of(&Vector3::from_fn(|axis, _| entries.get(axis).copied().unwrap_or(0.0)), dimension)
        };
        Ok(numbers.chunks_exact(dimension).map(row).collect())
    }

    fn pairs(self) -> Result<Vec<[u32; 2]>, String> {
        if !matches!(self.kind(), Some((TypeChar::Int | TypeChar::Uint, _))) {
            return Err(format!("has type {}, not one of whole numbers", self.npy.dtype().descr()));
        }
        let (_, numbers) = self.table(2..=2)?;
        let number = |index: usize, x: f64| match x {
            // Whole, because the type is; what fits 32 bits is exact.
            0.0..=4_294_967_295.0 => Ok(x as u32),
            _ => Err(format!("entry {index} is {x}, not the number of a particle")),
        };
        let pair = |(index, ends): (usize, &[f64])| match *ends {
            [i, j] => Ok([number(index, i)?, number(index, j)?]),
            _ => Err("is not a list of pairs".to_owned()),
        };
        numbers.chunks_exact(2).enumerate().map(pair).collect()
    }

    fn values(self) -> Result<Values, String> {
        match self.npy.shape().len() {
            0 => self.numbers()?.first().map(|&value| Values::Uniform(value)).ok_or_else(|| "is empty".to_owned()),
            1 => Ok(Values::Each(self.numbers()?)),
            _ => Err(format!("has the shape {}, neither one number nor a list", self.shape())),
        }
    }

    fn text(self) -> Result<String, String> {
        let texts = match self.kind() {
            Some((TypeChar::UnicodeStr, _)) => self.npy.into_vec::<String>().map_err(|error| error.to_string())?,
            _ => return Err("must be text".into()),
        };
        texts.into_iter().next().ok_or_else(|| "must be text".to_owned())
    }
}

fn collect<T: npyz::Deserialize, R: Read>(npy: NpyFile<R>, to: impl Fn(T) -> f64) -> Result<Vec<f64>, String> {
    let numbers = npy.data::<T>().map_err(|error| error.to_string())?;
    numbers.map(|number| number.map(&to)).collect::<io::Result<_>>().map_err(|error| error.to_string())
}

fn describe(widths: &RangeInclusive<usize>) -> String {
    let (least, most) = (widths.start(), widths.end());
    if least == most { format!("{least} numbers") } else { format!("{least} to {most} numbers") }
}
