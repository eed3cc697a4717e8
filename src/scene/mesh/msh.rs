//! Gmsh MSH files, versions 2, 4.0 and 4.1, as text and, but for 4.0, binary.

use super::cursor::{Cursor, Kind, Order, whole};
use super::raw::{Fault, HEXAHEDRON, PYRAMID, Raw, TETRAHEDRON, WEDGE};
use std::collections::HashMap;

struct Reader<'a> {
    cursor: Cursor<'a>,
    version: f64,
    /// Of binary files.
    order: Option<Order>,
    /// Of sizes in binary files of version 4.1.
    size: Kind,
    raw: Raw,
    /// Nodes by their tags.
    nodes: HashMap<u64, u32>,
    corners: Vec<u32>,
}

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let cursor = Cursor::new(bytes);
    let raw = Raw::new("element", 0);
    let (nodes, corners) = (HashMap::new(), Vec::new());
    let mut reader = Reader { cursor, version: 0.0, order: None, size: Kind::U64, raw, nodes, corners };
    while let Some(word) = reader.cursor.word() {
        match word {
            "$MeshFormat" => reader.format()?,
            "$Nodes" if reader.version >= 4.1 => reader.nodes_of_blocks()?,
            "$Nodes" if reader.version >= 4.0 => reader.nodes_of_entities()?,
            "$Nodes" => reader.node_list()?,
            "$Elements" if reader.version >= 4.0 => reader.elements_of_blocks()?,
            "$Elements" => reader.element_list()?,
            section => reader.pass(section)?,
        }
    }
    if reader.version == 0.0 {
        return Err(Fault("is no mesh: it begins as Gmsh MSH does, but has no $MeshFormat".into()));
    }
    Ok(reader.raw)
}

/// Corners of an element by its type, if it is one with straight edges.
fn corners_of(kind: u32) -> Option<usize> {
    Some(match kind {
        15 => 1,
        1 => 2,
        2 => 3,
        3 | 4 => 4,
        7 => 5,
        6 => 6,
        5 => 8,
        _ => return None,
    })
}

impl Reader<'_> {
    fn format(&mut self) -> Result<(), Fault> {
        self.version = self.cursor.number()?;
        let is_binary = self.cursor.number()? != 0.0;
        self.size = if self.cursor.number()? == 4.0 { Kind::U32 } else { Kind::U64 };
        if !((2.0..3.0).contains(&self.version) || (4.0..4.2).contains(&self.version)) {
            return Err(self.cursor.fault(format_args!("MSH {} is not read: 2, 4.0 and 4.1 are", self.version)));
        }
        if is_binary {
            if self.version == 4.0 {
                return Err(self.cursor.fault("MSH 4.0 is read as text only"));
            }
            self.cursor.rest_of_line();
            let one = self.cursor.take(4)?;
            self.order = Some(if one.first() == Some(&1) { Order::Little } else { Order::Big });
        }
        self.end("$EndMeshFormat")
    }

    fn end(&mut self, word: &str) -> Result<(), Fault> {
        match self.cursor.word() {
            Some(found) if found == word => Ok(()),
            _ => Err(self.cursor.fault(format_args!("{word} is missing"))),
        }
    }

    /// Passes over a section that says nothing of nodes and elements.
    fn pass(&mut self, section: &str) -> Result<(), Fault> {
        let Some(name) = section.strip_prefix('$') else {
            return Err(self.cursor.fault(format_args!("{section:?} where a section should begin")));
        };
        let end = format!("$End{name}");
        while !self.cursor.rest().is_empty() {
            if self.cursor.rest_of_line().trim() == end {
                return Ok(());
            }
        }
        Err(self.cursor.fault(format_args!("{end} is missing")))
    }

    /// The next number of a kind, or the next word.
    fn next(&mut self, kind: Kind) -> Result<f64, Fault> {
        match self.order {
            Some(order) => self.cursor.binary(kind, order),
            None => self.cursor.number(),
        }
    }

    fn count(&mut self, kind: Kind) -> Result<u64, Fault> {
        let number = self.next(kind)?;
        // Tags may be any numbers; what counts is at most a number of bytes.
        let is_whole = number.fract() == 0.0 && (0.0..9e15).contains(&number);
        if is_whole {
            Ok(number as u64)
        } else {
            Err(self.cursor.fault(format_args!("{number} is no number of anything")))
        }
    }

    fn begin_section(&mut self) {
        if self.order.is_some() {
            self.cursor.rest_of_line();
        }
    }

    fn place(&mut self) -> Result<[f64; 3], Fault> {
        Ok([self.next(Kind::F64)?, self.next(Kind::F64)?, self.next(Kind::F64)?])
    }

    fn add_node(&mut self, tag: u64, x: [f64; 3]) -> Result<(), Fault> {
        let number = self.raw.vertices() as u32;
        self.raw.add_vertex(x);
        match self.nodes.insert(tag, number) {
            None => Ok(()),
            Some(_) => Err(self.cursor.fault(format_args!("node {tag} is there twice"))),
        }
    }

    fn node_list(&mut self) -> Result<(), Fault> {
        let count = self.cursor.whole()?;
        self.begin_section();
        for _ in 0..count {
            let tag = self.count(Kind::I32)?;
            let x = self.place()?;
            self.add_node(tag, x)?;
        }
        self.end("$EndNodes")
    }

    fn nodes_of_entities(&mut self) -> Result<(), Fault> {
        let blocks = self.cursor.whole()?;
        self.cursor.whole()?;
        for _ in 0..blocks {
            self.cursor.number()?;
            self.cursor.number()?;
            let parametric = self.cursor.whole()?;
            self.refuse_parametric(f64::from(parametric))?;
            for _ in 0..self.cursor.whole()? {
                let tag = self.count(Kind::U64)?;
                let x = self.place()?;
                self.add_node(tag, x)?;
            }
        }
        self.end("$EndNodes")
    }

    fn refuse_parametric(&self, parametric: f64) -> Result<(), Fault> {
        if parametric == 0.0 {
            Ok(())
        } else {
            Err(self.cursor.fault("nodes with parametric coordinates are not read"))
        }
    }

    fn nodes_of_blocks(&mut self) -> Result<(), Fault> {
        self.begin_section();
        let size = self.size;
        let blocks = self.count(size)?;
        for _ in 0..3 {
            self.count(size)?;
        }
        let mut tags = Vec::new();
        for _ in 0..blocks {
            self.next(Kind::I32)?;
            self.next(Kind::I32)?;
            let parametric = self.next(Kind::I32)?;
            self.refuse_parametric(parametric)?;
            tags.clear();
            for _ in 0..self.count(size)? {
                tags.push(self.count(size)?);
            }
            for &tag in &tags {
                let x = self.place()?;
                self.add_node(tag, x)?;
            }
        }
        self.end("$EndNodes")
    }

    fn element_list(&mut self) -> Result<(), Fault> {
        let count = self.cursor.whole()?;
        self.begin_section();
        let mut left = count;
        while left > 0 {
            if self.order.is_none() {
                let element = self.count(Kind::I32)?;
                let kind = self.count(Kind::I32)?;
                for _ in 0..self.count(Kind::I32)? {
                    self.next(Kind::I32)?;
                }
                self.element(element, kind, Kind::I32)?;
                left -= 1;
                continue;
            }
            let (kind, here, tags) = (self.count(Kind::I32)?, self.count(Kind::I32)?, self.count(Kind::I32)?);
            for _ in 0..here {
                let element = self.count(Kind::I32)?;
                for _ in 0..tags {
                    self.next(Kind::I32)?;
                }
                self.element(element, kind, Kind::I32)?;
            }
            // A block of none would go on for ever.
            left = left.saturating_sub(here.clamp(1, u64::from(u32::MAX)) as u32);
        }
        self.end("$EndElements")
    }

    fn elements_of_blocks(&mut self) -> Result<(), Fault> {
        self.begin_section();
        let size = self.size;
        let blocks = self.count(size)?;
        for _ in 0..if self.version >= 4.1 { 3 } else { 1 } {
            self.count(size)?;
        }
        for _ in 0..blocks {
            self.next(Kind::I32)?;
            self.next(Kind::I32)?;
            let kind = self.count(Kind::I32)?;
            for _ in 0..self.count(size)? {
                let element = self.count(size)?;
                self.element(element, kind, size)?;
            }
        }
        self.end("$EndElements")
    }

    /// The corners of an element behind its number.
    fn element(&mut self, element: u64, kind: u64, tag: Kind) -> Result<(), Fault> {
        let kind = whole(kind as f64).unwrap_or(u32::MAX);
        let Some(count) = corners_of(kind) else {
            return Err(Fault(format!(
                "element {element} is of type {kind}: only elements with straight edges are read"
            )));
        };
        self.corners.clear();
        for _ in 0..count {
            let node = self.count(tag)?;
            let vertex = self.nodes.get(&node);
            let vertex =
                vertex.ok_or_else(|| Fault(format!("element {element} names node {node}, which there is not")))?;
            self.corners.push(*vertex);
        }
        let (raw, corners, place) = (&mut self.raw, &self.corners, element.min(u64::from(u32::MAX)) as u32);
        match kind {
            1 => raw.add_line(corners, place),
            2 | 3 => raw.add_face(corners, place),
            4 => raw.add_solid(corners, TETRAHEDRON, place),
            5 => raw.add_solid(corners, HEXAHEDRON, place),
            6 => raw.add_solid(corners, WEDGE, place),
            7 => raw.add_solid(corners, PYRAMID, place),
            // A point.
            _ => {}
        }
        Ok(())
    }
}
