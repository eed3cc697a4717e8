//! PLY: `vertex`, `face`, `tristrips` and `edge`, as text and binary.

use super::cursor::{Cursor, Kind, Order, whole};
use super::raw::{Fault, Raw};

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    kind: Kind,
    /// Of a list, how its length is stored.
    length: Option<Kind>,
}

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut cursor = Cursor::new(bytes);
    let (order, elements) = header(&mut cursor)?;
    let mut raw = Raw::new("element", 0);
    for element in &elements {
        let index = |names: &[&str]| element.properties.iter().position(|p| names.contains(&p.name.as_str()));
        let mut row = vec![0.0; element.properties.len()];
        let mut list = Vec::new();
        let corners = index(&["vertex_indices", "vertex_index"]);
        let needed =
            |names: &[&str]| index(names).ok_or_else(|| Fault(format!("{} has no {}", element.name, names[0])));
        let (axes, ends) = match element.name.as_str() {
            "vertex" => ([needed(&["x"])?, needed(&["y"])?, index(&["z"]).unwrap_or(usize::MAX)], [0; 2]),
            "edge" => ([0; 3], [needed(&["vertex1"])?, needed(&["vertex2"])?]),
            _ => ([0; 3], [0; 2]),
        };
        // What has no properties has no data, however often.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        for number in 0..count {
            list.clear();
            for (at, property) in element.properties.iter().enumerate() {
                let mut next = |kind| match order {
                    Some(order) => cursor.binary(kind, order),
                    None => cursor.number(),
                };
                match property.length {
                    None => row[at] = next(property.kind)?,
                    Some(length) => {
                        let length = next(length)?;
                        let length = whole(length).ok_or_else(|| {
                            Fault(format!("{} {number}: {length} is no number of entries of a list", element.name))
                        })?;
                        for _ in 0..length {
                            let entry = next(property.kind)?;
                            if corners == Some(at) {
                                list.push(entry);
                            }
                        }
                    }
                }
            }
            let place = number.min(u64::from(u32::MAX)) as u32;
            let vertices = |numbers: &[f64]| -> Option<Vec<u32>> { numbers.iter().map(|&n| whole(n)).collect() };
            let broken = || broken(element, number);
            match element.name.as_str() {
                "vertex" => raw.add_vertex(axes.map(|axis| row.get(axis).copied().unwrap_or(0.0))),
                "face" => raw.add_face(&vertices(&list).ok_or_else(broken)?, place),
                "tristrips" => {
                    for strip in list.split(|&corner| corner == -1.0) {
                        raw.add_strip(&vertices(strip).ok_or_else(broken)?, place);
                    }
                }
                "edge" => raw.add_line(&vertices(&ends.map(|end| row[end])).ok_or_else(broken)?, place),
                _ => {}
            }
        }
    }
    Ok(raw)
}

fn broken(element: &Element, number: u64) -> Fault {
    Fault(format!("{} {number}: names a vertex that there is not", element.name))
}

fn header(cursor: &mut Cursor) -> Result<(Option<Order>, Vec<Element>), Fault> {
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
        match words[..] {
            ["ply"] | ["comment" | "obj_info", ..] | [] => {}
            ["format", "ascii", _] => order = None,
            ["format", "binary_little_endian", _] => order = Some(Order::Little),
            ["format", "binary_big_endian", _] => order = Some(Order::Big),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong())?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", length, entry, name] => {
                let property = Property { name: name.into(), kind: kind(entry)?, length: Some(kind(length)?) };
                elements.last_mut().ok_or_else(wrong)?.properties.push(property);
            }
            ["property", scalar, name] => {
                let property = Property { name: name.into(), kind: kind(scalar)?, length: None };
                elements.last_mut().ok_or_else(wrong)?.properties.push(property);
            }
            ["end_header"] => return Ok((order, elements)),
            _ => return Err(wrong()),
        }
    }
}
