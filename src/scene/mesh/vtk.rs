//! Legacy VTK files, of unstructured grids and polygons, as text and binary, versions 1 to 5.

use super::cursor::{Cursor, Kind, Order, whole};
use super::{Fault, Raw};

/// Cells as consecutive corners, and the end of each.
#[derive(Debug, Default)]
pub struct Cells {
    pub corners: Vec<u32>,
    pub ends: Vec<u32>,
}

impl Cells {
    fn each(&self) -> impl Iterator<Item = (u32, &[u32])> {
        let starts = std::iter::once(&0).chain(&self.ends);
        let cells = starts.zip(&self.ends).map(|(start, end)| self.corners.get(*start as usize..*end as usize));
        (0..).zip(cells.map(Option::unwrap_or_default))
    }

    pub fn add(&self, raw: &mut Raw, add: fn(&mut Raw, &[u32], u32)) {
        self.each().for_each(|(number, corners)| add(raw, corners, number));
    }

    pub fn add_typed(&self, raw: &mut Raw, types: &[f64]) -> Result<(), Fault> {
        if types.len() != self.ends.len() {
            let [cells, types] = [(self.ends.len(), "cell"), (types.len(), "type")]
                .map(|(n, noun)| format!("{n} {noun}{}", if n == 1 { "" } else { "s" }));
            return Err(Fault(format!("has {cells} and {types}")));
        }
        self.each()
            .zip(types)
            .try_for_each(|((number, corners), &kind)| add_cell(raw, whole(kind).unwrap_or(u32::MAX), corners, number))
    }
}

/// The edges of solid elements between their corners.
const TETRAHEDRON: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
const HEXAHEDRON: &[[usize; 2]] =
    &[[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];
const WEDGE: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]];
const PYRAMID: &[[usize; 2]] = &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]];

pub fn add_cell(raw: &mut Raw, kind: u32, corners: &[u32], number: u32) -> Result<(), Fault> {
    let count = match kind {
        5 => 3,
        8..=10 => 4,
        11 | 12 => 8,
        13 => 6,
        14 => 5,
        _ => corners.len(),
    };
    if corners.len() != count {
        return Err(Fault(format!("cell {number} of type {kind} has {} corners in place of {count}", corners.len())));
    }
    let reordered = |order: &[usize]| -> Vec<u32> { order.iter().filter_map(|&at| corners.get(at).copied()).collect() };
    match kind {
        1 | 2 => {}
        3 | 4 => raw.add_line(corners, number),
        5 | 7 | 9 => raw.add_face(corners, number),
        6 => raw.add_strip(corners, number),
        8 => raw.add_face(&reordered(&[0, 1, 3, 2]), number),
        10 => raw.add_solid(corners, TETRAHEDRON, number),
        11 => raw.add_solid(&reordered(&[0, 1, 3, 2, 4, 5, 7, 6]), HEXAHEDRON, number),
        12 => raw.add_solid(corners, HEXAHEDRON, number),
        13 => raw.add_solid(corners, WEDGE, number),
        14 => raw.add_solid(corners, PYRAMID, number),
        _ => return Err(Fault(format!("cell {number} is of type {kind}: only cells with straight edges are read"))),
    }
    Ok(())
}

pub fn indices(numbers: &[f64]) -> Result<Vec<u32>, Fault> {
    let index = |&number: &f64| whole(number).ok_or_else(|| Fault(format!("{number} is the number of no vertex")));
    numbers.iter().map(index).collect()
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    is_binary: bool,
    has_offsets: bool,
}

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut cursor = Cursor::new(bytes);
    let version = cursor.rest_of_line().rsplit(' ').next().and_then(|word| word.trim().parse::<f64>().ok());
    cursor.rest_of_line();
    let is_binary = match cursor.word().map(str::to_ascii_uppercase).as_deref() {
        Some("ASCII") => false,
        Some("BINARY") => true,
        _ => return Err(cursor.fault("neither ASCII nor BINARY")),
    };
    let mut reader = Reader { cursor, is_binary, has_offsets: version.is_some_and(|version| version >= 5.0) };
    let mut raw = Raw::new("cell", 0);
    let mut cells = Cells::default();
    while let Some(word) = reader.cursor.word() {
        match word.to_ascii_uppercase().as_str() {
            "DATASET" => {
                let kind = reader.cursor.word().unwrap_or_default().to_ascii_uppercase();
                if !matches!(kind.as_str(), "UNSTRUCTURED_GRID" | "POLYDATA") {
                    return Err(reader.cursor.fault(format_args!(
                        "{kind:?} is no data set with cells: UNSTRUCTURED_GRID and POLYDATA are read"
                    )));
                }
            }
            "POINTS" => {
                let count = reader.cursor.whole()? as usize;
                let kind = reader.kind()?;
                let numbers = reader.numbers(kind, count.saturating_mul(3))?;
                raw.add_vertices(&numbers)?;
            }
            "CELLS" => cells = reader.cells()?,
            "CELL_TYPES" => {
                let count = reader.cursor.whole()? as usize;
                let types = reader.numbers(Kind::I32, count)?;
                cells.add_typed(&mut raw, &types)?;
            }
            "LINES" => reader.cells()?.add(&mut raw, Raw::add_line),
            "POLYGONS" => reader.cells()?.add(&mut raw, Raw::add_face),
            "TRIANGLE_STRIPS" => reader.cells()?.add(&mut raw, Raw::add_strip),
            "VERTICES" => drop(reader.cells()?),
            "METADATA" => {
                // Up to an empty line.
                reader.cursor.rest_of_line();
                while !reader.cursor.rest_of_line().trim().is_empty() {}
            }
            "FIELD" => reader.skip_field()?,
            // Attributes come last.
            "POINT_DATA" | "CELL_DATA" => break,
            _ => return Err(reader.cursor.fault(format_args!("{word:?} is no word of VTK"))),
        }
    }
    Ok(raw)
}

impl Reader<'_> {
    fn kind(&mut self) -> Result<Kind, Fault> {
        let word = self.cursor.word().unwrap_or_default();
        Kind::named(word).ok_or_else(|| self.cursor.fault(format_args!("{word:?} is no type of numbers")))
    }

    fn numbers(&mut self, kind: Kind, count: usize) -> Result<Vec<f64>, Fault> {
        if !self.is_binary {
            return (0..count).map(|_| self.cursor.number()).collect();
        }
        self.cursor.rest_of_line();
        let bytes = self.cursor.take(count.saturating_mul(kind.size()))?;
        Ok(bytes.chunks_exact(kind.size()).map(|bytes| kind.number(bytes, Order::Big)).collect())
    }

    fn cells(&mut self) -> Result<Cells, Fault> {
        let [count, size] = [self.cursor.whole()? as usize, self.cursor.whole()? as usize];
        if self.has_offsets {
            let [ends, corners] =
                [("OFFSETS", count), ("CONNECTIVITY", size)].map(|(name, count)| match self.cursor.word() {
                    Some(word) if word.eq_ignore_ascii_case(name) => {
                        let kind = self.kind()?;
                        indices(&self.numbers(kind, count)?)
                    }
                    _ => Err(self.cursor.fault(format_args!("{name} is missing"))),
                });
            return Ok(Cells { corners: corners?, ends: ends?.into_iter().skip(1).collect() });
        }
        let numbers = self.numbers(Kind::I32, size)?;
        let mut cells = Cells::default();
        let mut rest = numbers.as_slice();
        while let [length, others @ ..] = rest {
            let corners = whole(*length).and_then(|length| others.split_at_checked(length as usize));
            let (corners, others) =
                corners.ok_or_else(|| self.cursor.fault("a cell is longer than the list of cells"))?;
            cells.corners.extend(indices(corners)?);
            cells.ends.push(cells.corners.len() as u32);
            rest = others;
        }
        if cells.ends.len() != count {
            return Err(self.cursor.fault(format_args!("{} cells in place of {count}", cells.ends.len())));
        }
        Ok(cells)
    }

    /// `FIELD name n`, and n times `name components tuples type` with their numbers.
    fn skip_field(&mut self) -> Result<(), Fault> {
        self.cursor.word();
        for _ in 0..self.cursor.whole()? {
            self.cursor.word();
            let count = f64::from(self.cursor.whole()?) * f64::from(self.cursor.whole()?);
            let kind = self.kind()?;
            self.numbers(kind, count as usize)?;
        }
        Ok(())
    }
}
