//! Keys of a scene file that need not be there: gravity in time, loads, drag, and springs of other kinds.

use super::{Row, Values, read};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize as DeriveDeserialize, Serialize};
use std::fmt;

/// `gravity`: one vector, or a path of it.
///
/// # Examples
/// ```
/// use sprung::scene::{Gravity, GravityPath};
///
/// let constant: Gravity = [0.0, -9.81].into();
/// let fading = GravityPath { times: vec![0.0, 1.0], values: vec![[0.0, -9.81].into(), [0.0, 0.0].into()] };
/// assert_eq!((constant.dimension(), Gravity::Path(fading).dimension()), (Some(2), Some(2)));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Gravity {
    /// At all times, in m/s².
    Constant(Row),
    /// Piecewise linear in time, clamped at both ends.
    Path(GravityPath),
}

/// Gravity that changes in time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct GravityPath {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time, in m/s².
    pub values: Vec<Row>,
}

impl Gravity {
    /// How many entries its rows have; none where there are no rows.
    pub fn dimension(&self) -> Option<usize> {
        match self {
            Self::Constant(row) => Some(row.dimension()),
            Self::Path(path) => path.values.first().map(Row::dimension),
        }
    }
}

impl From<Row> for Gravity {
    fn from(row: Row) -> Self {
        Self::Constant(row)
    }
}

impl<const N: usize> From<[f64; N]> for Gravity
where
    Row: From<[f64; N]>,
{
    fn from(row: [f64; N]) -> Self {
        Self::Constant(row.into())
    }
}

impl<'de> Deserialize<'de> for Gravity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct GravityVisitor;

        impl<'de> Visitor<'de> for GravityVisitor {
            type Value = Gravity;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a row of 1, 2 or 3 numbers, or a table of times and values")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, row: A) -> Result<Gravity, A::Error> {
                Row::deserialize(SeqAccessDeserializer::new(row)).map(Gravity::Constant)
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Gravity, A::Error> {
                GravityPath::deserialize(MapAccessDeserializer::new(table)).map(Gravity::Path)
            }
        }

        deserializer.deserialize_any(GravityVisitor)
    }
}

/// One `[[forces]]` entry: a constant load on each of some particles. Loads on one particle add up.
#[derive(Debug, Clone, PartialEq, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// The particles.
    pub particles: Vec<u32>,
    /// The force on each, in N.
    pub value: Row,
}

/// The table `[drag]`: `−c v` on every particle.
#[derive(Debug, Clone, PartialEq, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct Drag {
    /// c, in N·s/m.
    pub coefficient: Values,
}

/// One `[[springs.actuation]]` entry: rest lengths that change in time. Later entries override earlier ones.
#[derive(Debug, Clone, PartialEq, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuationEntry {
    /// The springs.
    pub springs: Vec<u32>,
    /// What their rest lengths are multiplied with.
    #[serde(deserialize_with = "read::table")]
    pub path: FactorPath,
}

/// A piecewise-linear factor, clamped at both ends.
#[derive(Debug, Clone, PartialEq, Default, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct FactorPath {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time.
    pub factors: Vec<f64>,
}

/// One answer for all springs, or one for each.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Flags {
    /// The same for all.
    Uniform(bool),
    /// One for each, in order.
    Each(Vec<bool>),
}

impl<'de> Deserialize<'de> for Flags {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct FlagsVisitor;

        impl<'de> Visitor<'de> for FlagsVisitor {
            type Value = Flags;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true, false or a list of them")
            }

            fn visit_bool<E: de::Error>(self, flag: bool) -> Result<Flags, E> {
                Ok(Flags::Uniform(flag))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Flags, A::Error> {
                let mut flags = Vec::new();
                while let Some(flag) = list.next_element()? {
                    flags.push(flag);
                }
                Ok(Flags::Each(flags))
            }
        }

        deserializer.deserialize_any(FlagsVisitor)
    }
}
