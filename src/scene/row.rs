//! A vector as a scene file has it: as many numbers as the scene has dimensions.

use nalgebra::Vector3;
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::{Serialize, Serializer};
use std::fmt;

/// One, two or three numbers, stored in place so that a long list of rows is one block of memory.
#[derive(Clone, Copy, PartialEq)]
pub struct Row {
    dimension: u8,
    entries: [f64; 3],
}

impl Row {
    /// The first `dimension` components of a vector, at least one and at most three.
    pub fn of(vector: &Vector3<f64>, dimension: usize) -> Self {
        let dimension = dimension.clamp(1, 3);
        let mut entries = [0.0; 3];
        entries[..dimension].copy_from_slice(&vector.as_slice()[..dimension]);
        Self { dimension: dimension as u8, entries }
    }

    /// The numbers: 1, 2 or 3 of them.
    pub fn as_slice(&self) -> &[f64] {
        &self.entries[..usize::from(self.dimension)]
    }

    /// How many numbers there are: 1, 2 or 3.
    pub fn dimension(&self) -> usize {
        usize::from(self.dimension)
    }

    /// As a 3-vector, with zeros along the absent axes.
    pub fn vector(&self) -> Vector3<f64> {
        self.entries.into()
    }
}

impl From<[f64; 1]> for Row {
    fn from([x]: [f64; 1]) -> Self {
        Self { dimension: 1, entries: [x, 0.0, 0.0] }
    }
}

impl From<[f64; 2]> for Row {
    fn from([x, y]: [f64; 2]) -> Self {
        Self { dimension: 2, entries: [x, y, 0.0] }
    }
}

impl From<[f64; 3]> for Row {
    fn from(entries: [f64; 3]) -> Self {
        Self { dimension: 3, entries }
    }
}

impl fmt::Debug for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_slice().fmt(f)
    }
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_slice().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Row {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(RowVisitor)
    }
}

struct RowVisitor;

impl<'de> Visitor<'de> for RowVisitor {
    type Value = Row;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a row of 1, 2 or 3 numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut row: A) -> Result<Row, A::Error> {
        let mut entries = [0.0; 3];
        let mut dimension = 0;
        while let Some(number) = row.next_element()? {
            match entries.get_mut(usize::from(dimension)) {
                Some(entry) => *entry = number,
                None => return Err(de::Error::invalid_length(4, &self)),
            }
            dimension += 1;
        }
        match dimension {
            0 => Err(de::Error::invalid_length(0, &self)),
            _ => Ok(Row { dimension, entries }),
        }
    }
}
