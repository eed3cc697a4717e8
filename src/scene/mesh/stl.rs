//! STL, as text and binary. Its facets have corners, not vertices: those at one place are one vertex.

use super::cursor::{Cursor, Kind, Order};
use super::raw::{Fault, Raw};
use std::collections::HashMap;

/// Bytes before the first facet of a binary file, and of a facet.
const HEADER: usize = 84;
const FACET: usize = 50;

/// Whether the file is as long as its number of facets says.
pub fn is_binary(bytes: &[u8]) -> bool {
    let facets = bytes.get(80..HEADER).map(|count| Kind::U32.number(count, Order::Little));
    facets.is_some_and(|facets| facets > 0.0 && bytes.len() as f64 == HEADER as f64 + FACET as f64 * facets)
}

/// Corners that become vertices.
struct Corners {
    raw: Raw,
    known: HashMap<[u64; 3], u32>,
    face: Vec<u32>,
}

impl Corners {
    fn new(unit: &'static str) -> Self {
        Self { raw: Raw::new(unit, 0), known: HashMap::new(), face: Vec::new() }
    }

    fn add(&mut self, x: [f64; 3]) {
        let Self { raw, known, face } = self;
        // Zero has two signs, and one place.
        let vertex = *known.entry(x.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
            raw.add_vertex(x);
            raw.vertices() as u32 - 1
        });
        face.push(vertex);
    }

    fn end_face(&mut self, place: u32) {
        self.raw.add_face(&self.face, place);
        self.face.clear();
    }
}

pub fn read_binary(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut corners = Corners::new("facet");
    for (facet, bytes) in (0..).zip(bytes.get(HEADER..).unwrap_or_default().chunks_exact(FACET)) {
        let mut numbers = bytes.chunks_exact(4).skip(3).map(|number| Kind::F32.number(number, Order::Little));
        for _ in 0..3 {
            corners.add(std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN)));
        }
        corners.end_face(facet);
    }
    Ok(corners.raw)
}

pub fn read_text(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut cursor = Cursor::new(bytes);
    let mut corners = Corners::new("line");
    while let Some(word) = cursor.word() {
        match word.to_ascii_lowercase().as_str() {
            // Behind them stands a name, of any words.
            "solid" | "endsolid" => _ = cursor.rest_of_line(),
            "facet" | "normal" | "outer" => _ = cursor.rest_of_line(),
            "vertex" => {
                let x = [cursor.number()?, cursor.number()?, cursor.number()?];
                corners.add(x);
            }
            "endloop" => corners.end_face(cursor.line()),
            "endfacet" => {}
            _ => return Err(cursor.fault(format_args!("{word:?} is no word of STL"))),
        }
    }
    if !corners.face.is_empty() {
        return Err(cursor.fault("the last facet does not end"));
    }
    Ok(corners.raw)
}
