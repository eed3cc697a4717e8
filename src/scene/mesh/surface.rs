//! Formats of faces: Wavefront OBJ, PLY and STL.

use super::cursor::{Cursor, Kind, Order, whole};
use super::{Fault, Raw, place_key};
use std::collections::HashMap;

/// Reads Wavefront OBJ: `v`, `f` and `l`; everything else is skipped.
pub fn read_obj(bytes: &[u8]) -> Result<Raw, Fault> {
    // Comments and names may be in any encoding.
    let text = String::from_utf8_lossy(bytes);
    let mut raw = Raw::new("line", 1);
    // A line is continued behind a backslash at its end.
    let (mut statement, mut begun) = (String::new(), None);
    // Lines end in \n, \r\n or \r.
    let lines = text.split('\n').flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'));
    for (number, line) in (1u32..).zip(lines) {
        let line = line.split('#').next().unwrap_or_default().trim_end();
        let place = *begun.get_or_insert(number);
        if let Some(part) = line.strip_suffix('\\') {
            statement.push_str(part);
            statement.push(' ');
            continue;
        }
        statement.push_str(line);
        add_statement(&mut raw, &statement, place)?;
        statement.clear();
        begun = None;
    }
    if let Some(place) = begun {
        add_statement(&mut raw, &statement, place)?;
    }
    if raw.mesh.vertices.is_empty() {
        return Err(no_mesh(bytes));
    }
    Ok(raw)
}

fn add_statement(raw: &mut Raw, line: &str, place: u32) -> Result<(), Fault> {
    let fault = |message: String| Fault(format!("line {place}: {message}: {:?}", line.trim()));
    let mut words = line.split_whitespace();
    match words.next() {
        Some("v") => {
            let number = |word: &str| word.parse().map_err(|_| fault(format!("{word:?} is no number")));
            let numbers: Vec<f64> = words.map(number).collect::<Result<_, _>>()?;
            // A weight or a colour may follow.
            let (&[x, y, z], 0 | 1 | 3 | 4) =
                numbers.split_first_chunk().map_or((&[0.0; 3], 2), |(x, more)| (x, more.len()))
            else {
                return Err(fault(format!(
                    "a vertex has 3 coordinates, and may have a weight and 3 colours: not {} numbers",
                    numbers.len()
                )));
            };
            raw.add_vertex([x, y, z], format_args!("line {place}"))?;
        }
        Some(kind @ ("f" | "l")) => {
            let count = raw.mesh.vertices.len();
            let corners = words.map(|word| vertex(word, count).map_err(fault)).collect::<Result<Vec<_>, _>>()?;
            if kind == "f" { raw.add_face(&corners, place) } else { raw.add_line(&corners, place) }
        }
        _ => {}
    }
    Ok(())
}

/// The vertex that `7`, `7/1/2` or, counted back from the last of `count`, `-2` names.
fn vertex(word: &str, count: usize) -> Result<u32, String> {
    let number = word.split('/').next().unwrap_or_default();
    let number: i64 = number.parse().map_err(|_| format!("{word:?} names no vertex"))?;
    let index = if number < 0 { count as i64 + number } else { number - 1 };
    match u32::try_from(index) {
        Ok(index) if number != 0 => Ok(index),
        _ => Err(format!("{word:?} names a vertex that there is not")),
    }
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    kind: Kind,
    length: Option<Kind>,
}

/// Reads PLY: `vertex`, `face`, `tristrips` and `edge`, as text and binary.
pub fn read_ply(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut cursor = Cursor::new(bytes);
    let (order, elements) = ply_header(&mut cursor)?;
    let has = |name: &&str| elements.iter().any(|element| element.name == *name && element.count > 0);
    let mut raw = Raw::new(["face", "tristrips", "edge"].into_iter().find(has).unwrap_or("element"), 0);
    for element in &elements {
        let Element { name, count, properties } = element;
        let index = |names: &[&str]| properties.iter().position(|p| names.contains(&p.name.as_str()));
        let required = |property: &str| index(&[property]).ok_or_else(|| Fault(format!("{name} has no {property}")));
        let columns = match name.as_str() {
            "vertex" => vec![required("x")?, required("y")?, index(&["z"]).unwrap_or(usize::MAX)],
            "edge" => vec![required("vertex1")?, required("vertex2")?],
            _ => Vec::new(),
        };
        let corners = index(&["vertex_indices", "vertex_index"]);
        let (mut row, mut list) = (vec![0.0; properties.len()], Vec::new());
        // An element without properties has no data, whatever its count.
        for number in 0..if properties.is_empty() { 0 } else { *count } {
            list.clear();
            for (at, Property { kind, length, .. }) in properties.iter().enumerate() {
                let Some(length) = length else {
                    row[at] = cursor.next(*kind, order)?;
                    continue;
                };
                let length = cursor.next(*length, order)?;
                let wrong = || Fault(format!("{name} {number}: {length} is no number of entries of a list"));
                for _ in 0..whole(length).ok_or_else(wrong)? {
                    let entry = cursor.next(*kind, order)?;
                    if corners == Some(at) {
                        list.push(entry);
                    }
                }
            }
            let place = number.min(u64::from(u32::MAX)) as u32;
            let values: Vec<f64> = columns.iter().map(|&column| row.get(column).copied().unwrap_or(0.0)).collect();
            let vertices = |numbers: &[f64]| -> Result<Vec<u32>, Fault> {
                let missing = |n| Fault(format!("{name} {number}: names vertex {n}, which there is not"));
                numbers.iter().map(|&n| whole(n).ok_or_else(|| missing(n))).collect()
            };
            match name.as_str() {
                "vertex" => raw.add_vertices(&values)?,
                "face" => raw.add_face(&vertices(&list)?, place),
                "tristrips" => {
                    for strip in list.split(|&corner| corner == -1.0) {
                        raw.add_strip(&vertices(strip)?, place);
                    }
                }
                "edge" => raw.add_line(&vertices(&values)?, place),
                _ => {}
            }
        }
    }
    Ok(raw)
}

fn ply_header(cursor: &mut Cursor) -> Result<(Option<Order>, Vec<Element>), Fault> {
    let mut order = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        if cursor.rest().is_empty() {
            return Err(cursor.fault("the header does not end"));
        }
        let line = cursor.line();
        let text = cursor.rest_of_line();
        let wrong = || Fault(format!("line {line}: {text:?} is no line of a PLY header"));
        let kind = |word: &str| Kind::named(word).ok_or_else(wrong);
        let words: Vec<&str> = text.split_whitespace().collect();
        let (entry, length, name) = match words[..] {
            ["ply"] | ["comment" | "obj_info", ..] | [] => continue,
            ["format", format, _] => {
                order = match format {
                    "ascii" => None,
                    "binary_little_endian" => Some(Order::Little),
                    "binary_big_endian" => Some(Order::Big),
                    _ => return Err(wrong()),
                };
                continue;
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong())?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
                continue;
            }
            ["property", "list", length, entry, name] => (kind(entry)?, Some(kind(length)?), name),
            ["property", scalar, name] => (kind(scalar)?, None, name),
            ["end_header"] => return Ok((order, elements)),
            _ => return Err(wrong()),
        };
        let property = Property { name: name.into(), kind: entry, length };
        elements.last_mut().ok_or_else(wrong)?.properties.push(property);
    }
}

/// The number of facets of a binary STL file, and the length of the file with that many.
fn facets_and_length(bytes: &[u8]) -> Option<(f64, f64)> {
    let facets = Kind::U32.number(bytes.get(80..84)?, Order::Little);
    Some((facets, 84.0 + 50.0 * facets))
}

pub fn is_binary_stl(bytes: &[u8]) -> bool {
    facets_and_length(bytes).is_some_and(|(facets, length)| facets > 0.0 && bytes.len() as f64 == length)
}

/// The error for a file of no format. A binary one may be binary STL of the wrong length, which nothing else tells from other files.
fn no_mesh(bytes: &[u8]) -> Fault {
    let none = "is no mesh: neither OBJ (no line begins with v), PLY, STL, VTK nor Gmsh MSH";
    let Some((facets, expected)) = facets_and_length(bytes).filter(|_| bytes.contains(&0)) else {
        return Fault(none.into());
    };
    if facets == 0.0 {
        return Fault(format!("{none}; as binary STL it is empty: it counts 0 facets"));
    }
    let length = bytes.len();
    let state = if (length as f64) < expected { "is truncated" } else { "goes on after its last facet" };
    let facets = if facets == 1.0 { "1 facet needs".into() } else { format!("{facets} facets need") };
    Fault(format!("{none}; as binary STL it {state}: {facets} {expected} bytes, and it has {length}"))
}

/// Corners of STL facets; those at one place are one vertex.
struct Corners {
    raw: Raw,
    known: HashMap<[u64; 3], u32>,
    face: Vec<u32>,
}

impl Corners {
    fn new(unit: &'static str) -> Self {
        Self { raw: Raw::new(unit, 0), known: HashMap::new(), face: Vec::new() }
    }

    fn add(&mut self, x: [f64; 3], place: u32) -> Result<(), Fault> {
        let Self { raw, known, face } = self;
        let number = *known.entry(place_key(x)).or_insert(raw.mesh.vertices.len() as u32);
        if number as usize == raw.mesh.vertices.len() {
            let unit = raw.mesh.unit;
            raw.add_vertex(x, format_args!("{unit} {place}"))?;
        }
        face.push(number);
        Ok(())
    }

    fn end_face(&mut self, place: u32) {
        self.raw.add_face(&self.face, place);
        self.face.clear();
    }
}

pub fn read_binary_stl(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut corners = Corners::new("facet");
    for (facet, bytes) in (0..).zip(bytes.get(84..).unwrap_or_default().chunks_exact(50)) {
        // The normal, and three corners.
        let numbers = bytes.chunks_exact(4).map(|number| Kind::F32.number(number, Order::Little));
        let numbers: Vec<f64> = numbers.skip(3).collect();
        numbers.as_chunks().0.iter().try_for_each(|&corner| corners.add(corner, facet))?;
        corners.end_face(facet);
    }
    Ok(corners.raw)
}

pub fn read_text_stl(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut cursor = Cursor::new(bytes);
    let mut corners = Corners::new("line");
    let mut is_open = false;
    while let Some(word) = cursor.word() {
        let word = word.to_ascii_lowercase();
        match word.as_str() {
            // A name of any words, a normal or `loop` follows.
            "solid" | "endsolid" => {
                is_open = word == "solid";
                cursor.rest_of_line();
            }
            "facet" | "normal" | "outer" => _ = cursor.rest_of_line(),
            "vertex" => corners.add([cursor.number()?, cursor.number()?, cursor.number()?], cursor.line())?,
            "endloop" => match corners.face.len() {
                3 => corners.end_face(cursor.line()),
                count => return Err(cursor.fault(format_args!("a facet has 3 vertices, not {count}"))),
            },
            "endfacet" => {}
            _ => return Err(cursor.fault(format_args!("{word:?} is no word of STL"))),
        }
    }
    if !corners.face.is_empty() {
        return Err(cursor.fault("the last facet does not end"));
    }
    if is_open {
        return Err(cursor.fault("the file ends without endsolid"));
    }
    Ok(corners.raw)
}
