//! Gmsh MSH files, versions 2, 4.0 and 4.1, as text and, but for 4.0, binary.

use super::cursor::{Cursor, Kind, Order};
use super::vtk::add_cell;
use super::{Fault, Raw};
use std::collections::HashMap;

/// Types of elements in Gmsh and in VTK, and their number of corners, which have the same order in both.
const TYPES: [(u32, u32, usize); 8] =
    [(15, 1, 1), (1, 3, 2), (2, 5, 3), (3, 9, 4), (4, 10, 4), (5, 12, 8), (6, 13, 6), (7, 14, 5)];

struct Reader<'a> {
    cursor: Cursor<'a>,
    version: f64,
    /// Of binary files.
    order: Option<Order>,
    /// The type of counts and tags in blocks of version 4.1; 32-bit in version 2.
    size: Kind,
    raw: Raw,
    nodes: HashMap<u64, u32>,
}

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    let (cursor, raw, nodes) = (Cursor::new(bytes), Raw::new("element", 0), HashMap::new());
    let mut reader = Reader { cursor, version: 0.0, order: None, size: Kind::U64, raw, nodes };
    while let Some(word) = reader.cursor.word() {
        match word {
            "$MeshFormat" => reader.format()?,
            "$Nodes" => reader.nodes()?,
            "$Elements" => reader.elements()?,
            "$NOD" | "$ELM" => return Err(reader.cursor.fault("MSH 1 is not read: 2, 4.0 and 4.1 are")),
            section => reader.skip(section)?,
        }
    }
    if reader.version == 0.0 {
        return Err(Fault("is no mesh: it begins as Gmsh MSH does, but has no $MeshFormat".into()));
    }
    Ok(reader.raw)
}

impl Reader<'_> {
    fn format(&mut self) -> Result<(), Fault> {
        self.version = self.cursor.number()?;
        let is_binary = self.cursor.number()? != 0.0;
        let has_short_sizes = self.cursor.number()? == 4.0;
        if !((2.0..3.0).contains(&self.version) || (4.0..4.2).contains(&self.version)) {
            return Err(self.cursor.fault(format_args!("MSH {} is not read: 2, 4.0 and 4.1 are", self.version)));
        }
        self.size = if self.is_version_2() || has_short_sizes { Kind::U32 } else { Kind::U64 };
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

    fn is_version_2(&self) -> bool {
        self.version < 4.0
    }

    fn end(&mut self, word: &str) -> Result<(), Fault> {
        match self.cursor.word() {
            Some(found) if found == word => Ok(()),
            _ => Err(self.cursor.fault(format_args!("{word} is missing"))),
        }
    }

    fn skip(&mut self, section: &str) -> Result<(), Fault> {
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

    /// A 32-bit number, or the next word.
    fn int(&mut self) -> Result<f64, Fault> {
        self.cursor.next(Kind::I32, self.order)
    }

    fn count(&mut self) -> Result<u64, Fault> {
        let number = self.cursor.next(self.size, self.order)?;
        if number.fract() == 0.0 && (0.0..9e15).contains(&number) {
            Ok(number as u64)
        } else {
            Err(self.cursor.fault(format_args!("{number} is no count or number of a node or element")))
        }
    }

    fn int_count(&mut self) -> Result<u32, Fault> {
        let number = self.int()?;
        self.cursor.as_whole(number)
    }

    /// The number at the start of a section: of nodes or elements in version 2, of blocks in version 4, whose other numbers are skipped.
    fn begin_section(&mut self) -> Result<u64, Fault> {
        let count = if self.is_version_2() { Some(self.cursor.whole()?) } else { None };
        if self.order.is_some() {
            self.cursor.rest_of_line();
        }
        if let Some(count) = count {
            return Ok(count.into());
        }
        let blocks = self.count()?;
        for _ in 0..if self.version >= 4.1 { 3 } else { 1 } {
            self.count()?;
        }
        Ok(blocks)
    }

    fn nodes(&mut self) -> Result<(), Fault> {
        let count = self.begin_section()?;
        if self.is_version_2() {
            self.node_block(count)?;
        } else {
            for _ in 0..count {
                // The entity and its dimension.
                self.int()?;
                self.int()?;
                if self.int()? != 0.0 {
                    return Err(self.cursor.fault("nodes with parametric coordinates are not read"));
                }
                let nodes = self.count()?;
                self.node_block(nodes)?;
            }
        }
        self.end("$EndNodes")
    }

    /// Nodes: their tags and then their coordinates in version 4.1, in turns before.
    fn node_block(&mut self, count: u64) -> Result<(), Fault> {
        let first = if self.version >= 4.1 { count } else { 0 };
        let mut tags = (0..first).map(|_| self.count()).collect::<Result<Vec<_>, _>>()?.into_iter();
        for _ in 0..count {
            let tag = tags.next().map_or_else(|| self.count(), Ok)?;
            let mut x = [0.0; 3];
            for x in &mut x {
                *x = self.cursor.next(Kind::F64, self.order)?;
            }
            if self.nodes.insert(tag, self.raw.mesh.vertices.len() as u32).is_some() {
                return Err(self.cursor.fault(format_args!("node {tag} is there twice")));
            }
            self.raw.add_vertex(x, format_args!("node {tag}"))?;
        }
        Ok(())
    }

    fn elements(&mut self) -> Result<(), Fault> {
        let mut left = self.begin_section()?;
        while left > 0 {
            let mut first = None;
            let (kind, here, tags) = match (self.is_version_2(), self.order) {
                (true, None) => {
                    first = Some(self.count()?);
                    (self.int_count()?, 1, self.int_count()?)
                }
                (true, Some(_)) => (self.int_count()?, self.int_count()?.into(), self.int_count()?),
                (false, _) => {
                    self.int()?;
                    self.int()?;
                    (self.int_count()?, self.count()?, 0)
                }
            };
            for _ in 0..here {
                let element = first.map_or_else(|| self.count(), Ok)?;
                for _ in 0..tags {
                    self.int()?;
                }
                self.element(element, kind)?;
            }
            // Version 2 counts elements, version 4 blocks. An empty block must not go on for ever.
            left = left.saturating_sub(if self.is_version_2() { here.max(1) } else { 1 });
        }
        self.end("$EndElements")
    }

    fn element(&mut self, element: u64, kind: u32) -> Result<(), Fault> {
        let Some(&(_, vtk_type, count)) = TYPES.iter().find(|(known, ..)| *known == kind) else {
            let rule = "only elements with straight edges are read";
            return Err(Fault(format!("element {element} is of type {kind}: {rule}")));
        };
        let mut corners = [0; 8];
        for corner in &mut corners[..count] {
            let node = self.count()?;
            let missing = || Fault(format!("element {element} names node {node}, which there is not"));
            *corner = *self.nodes.get(&node).ok_or_else(missing)?;
        }
        add_cell(&mut self.raw, vtk_type, &corners[..count], element.min(u64::from(u32::MAX)) as u32)
    }
}
