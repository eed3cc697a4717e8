//! VTK XML files, of unstructured grids and polygons: numbers as text, in base64 or appended, compressed by zlib or not.

use super::cursor::{Kind, Order};
use super::vtk::{Cells, indices};
use super::{Fault, Raw};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use flate2::read::ZlibDecoder;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::io::Read;

struct Storage<'a> {
    order: Order,
    header: Kind,
    is_compressed: bool,
    appended: &'a [u8],
    is_raw: bool,
}

struct Array<'a> {
    parent: String,
    element: BytesStart<'a>,
    text: String,
}

impl Array<'_> {
    fn attribute(&self, name: &str) -> String {
        attribute(&self.element, name).unwrap_or_default()
    }
}

#[derive(Default)]
struct Piece<'a> {
    element: Option<BytesStart<'a>>,
    arrays: Vec<Array<'a>>,
}

impl Piece<'_> {
    /// Rejects a number of points or cells other than that of the arrays.
    fn check_count(&self, name: &str, found: usize) -> Result<(), Fault> {
        match self.element.as_ref().and_then(|element| attribute(element, name)) {
            Some(given) if given.trim().parse() != Ok(found) => {
                Err(Fault(format!("{name} is {given}, and its arrays have {found}")))
            }
            _ => Ok(()),
        }
    }
}

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    // Appended data need not be XML.
    let cut = find(bytes, b"<AppendedData").unwrap_or(bytes.len());
    let (xml, tail) = bytes.split_at(cut);
    let opening = tail.get(..find(tail, b">").unwrap_or(0)).unwrap_or_default();
    let appended = find(tail, b"_").and_then(|start| tail.get(start + 1..)).unwrap_or_default();
    let mut storage = Storage {
        order: Order::Little,
        header: Kind::U32,
        is_compressed: false,
        appended,
        is_raw: find(opening, b"raw").is_some(),
    };
    let mut raw = Raw::new("cell", 0);
    let mut reader = Reader::from_reader(xml);
    reader.config_mut().expand_empty_elements = true;
    let (mut parents, mut piece) = (Vec::<String>::new(), Piece::default());
    let mut is_vtk = false;
    loop {
        match reader.read_event().map_err(|error| Fault(format!("is no XML: {error}")))? {
            Event::Start(element) => {
                let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
                match name.as_str() {
                    "VTKFile" => {
                        is_vtk = true;
                        storage.begin(&element)?;
                    }
                    "Piece" => piece.element = Some(element),
                    "DataArray" => {
                        let parent = parents.last().cloned().unwrap_or_default();
                        piece.arrays.push(Array { parent, element, text: String::new() });
                    }
                    _ => {}
                }
                parents.push(name);
            }
            Event::Text(text) if parents.last().is_some_and(|parent| parent == "DataArray") => {
                if let Some(array) = piece.arrays.last_mut() {
                    array.text.push_str(&String::from_utf8_lossy(&text));
                }
            }
            Event::End(element) => {
                parents.pop();
                if element.name().as_ref() == b"Piece" {
                    add_piece(&mut raw, &storage, &std::mem::take(&mut piece))?;
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    if !is_vtk {
        return Err(Fault("is no mesh: XML, but no VTKFile".into()));
    }
    Ok(raw)
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    bytes.windows(wanted.len()).position(|window| window == wanted)
}

fn attribute(element: &BytesStart, name: &str) -> Option<String> {
    let attribute = element.try_get_attribute(name).ok()??;
    Some(String::from_utf8_lossy(&attribute.value).into_owned())
}

fn add_piece(raw: &mut Raw, storage: &Storage, piece: &Piece) -> Result<(), Fault> {
    // The vertices of a piece are numbered from zero.
    let before = raw.mesh.vertices.len() as u32;
    let numbers = |parent: &str, name: &str| {
        let has_name = |array: &&Array| name.is_empty() || array.attribute("Name") == name;
        let array = piece.arrays.iter().filter(|array| array.parent == parent).find(has_name);
        array.map(|array| storage.numbers(array)).transpose()
    };
    if let Some(points) = numbers("Points", "")? {
        piece.check_count("NumberOfPoints", points.len() / 3)?;
        raw.add_vertices(&points)?;
    }
    let cells = |parent: &str, counted: &str| -> Result<Option<Cells>, Fault> {
        let (Some(corners), Some(ends)) = (numbers(parent, "connectivity")?, numbers(parent, "offsets")?) else {
            return Ok(None);
        };
        let corners = indices(&corners)?.into_iter().map(|corner| corner.saturating_add(before)).collect();
        piece.check_count(counted, ends.len())?;
        Ok(Some(Cells { corners, ends: indices(&ends)? }))
    };
    if let (Some(cells), Some(types)) = (cells("Cells", "NumberOfCells")?, numbers("Cells", "types")?) {
        cells.add_typed(raw, &types)?;
    }
    cells("Lines", "NumberOfLines")?.unwrap_or_default().add(raw, Raw::add_line);
    cells("Polys", "NumberOfPolys")?.unwrap_or_default().add(raw, Raw::add_face);
    cells("Strips", "NumberOfStrips")?.unwrap_or_default().add(raw, Raw::add_strip);
    Ok(())
}

impl Storage<'_> {
    fn begin(&mut self, element: &BytesStart) -> Result<(), Fault> {
        let kind = attribute(element, "type").unwrap_or_default();
        if !matches!(kind.as_str(), "UnstructuredGrid" | "PolyData") {
            return Err(Fault(format!("{kind:?} is no data set with cells: UnstructuredGrid and PolyData are read")));
        }
        if attribute(element, "byte_order").as_deref() == Some("BigEndian") {
            self.order = Order::Big;
        }
        self.header = attribute(element, "header_type").and_then(|name| Kind::named(&name)).unwrap_or(Kind::U32);
        self.is_compressed = match attribute(element, "compressor").as_deref() {
            None => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => return Err(Fault(format!("is compressed by {other}: only vtkZLibDataCompressor is read"))),
        };
        Ok(())
    }

    fn numbers(&self, array: &Array) -> Result<Vec<f64>, Fault> {
        let wrong = |what: &str| Fault(format!("the array {:?} of {} {what}", array.attribute("Name"), array.parent));
        let kind = Kind::named(&array.attribute("type")).ok_or_else(|| wrong("has no type of numbers"))?;
        let bytes = match array.attribute("format").as_str() {
            "ascii" => {
                let number = |word: &str| word.parse().map_err(|_| wrong("has a word that is no number"));
                return array.text.split_whitespace().map(number).collect();
            }
            "binary" => decoded(array.text.as_bytes()),
            "appended" => {
                let offset: usize = array.attribute("offset").parse().unwrap_or(0);
                let appended = self.appended.get(offset..).ok_or_else(|| wrong("begins behind the file's end"))?;
                if self.is_raw { Some(appended.to_vec()) } else { decoded(appended) }
            }
            _ => None,
        };
        let bytes = bytes.and_then(|bytes| self.unpacked(&bytes)).ok_or_else(|| wrong("cannot be decoded"))?;
        Ok(bytes.chunks_exact(kind.size()).map(|bytes| kind.number(bytes, self.order)).collect())
    }

    /// The data after their length, or after those of their compressed blocks.
    fn unpacked(&self, bytes: &[u8]) -> Option<Vec<u8>> {
        let size = self.header.size();
        let mut lengths = bytes.chunks_exact(size).map(|bytes| self.header.number(bytes, self.order));
        if !self.is_compressed {
            let length = lengths.next()? as usize;
            return bytes.get(size..size.checked_add(length)?).map(<[u8]>::to_vec);
        }
        let [blocks, whole, last] = [lengths.next()? as usize, lengths.next()? as usize, lengths.next()? as usize];
        let mut at = blocks.checked_add(3)?.checked_mul(size)?;
        let mut unpacked = Vec::new();
        for block in 0..blocks {
            let end = at.checked_add(lengths.next()? as usize)?;
            let room = if block + 1 == blocks && last > 0 { last } else { whole };
            let decoder = ZlibDecoder::new(bytes.get(at..end)?);
            decoder.take(room as u64).read_to_end(&mut unpacked).ok()?;
            at = end;
        }
        Some(unpacked)
    }
}

/// The bytes of base64 text: one or more pieces, each padded to four characters.
fn decoded(text: &[u8]) -> Option<Vec<u8>> {
    let is_base64 = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/' | b'=');
    let spaced = text.iter().copied().filter(|byte| !byte.is_ascii_whitespace());
    let mut text: Vec<u8> = spaced.take_while(is_base64).collect();
    text.truncate(text.len() / 4 * 4);
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    for piece in text.chunk_by(|&before, &after| before != b'=' || after == b'=') {
        BASE64_STANDARD.decode_vec(piece, &mut bytes).ok()?;
    }
    Some(bytes)
}
