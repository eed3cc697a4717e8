//! The scene file, key by key. TOML and JSON share it.
//!
//! These types say what a file may contain and how it is written; what the values must fulfil is decided when a
//! [`Scene`] is [built](Scene::build).

use super::{Row, Values};
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::marker::PhantomData;
use std::path::PathBuf;

/// A scene: what a scene file says. SI units; particles and springs are numbered from 0.
///
/// Its dimension is the length of its rows: of the first position, or of gravity where there are no particles, or 3.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The scene's name, also that of its output folder; the file's stem where the file has none.
    #[serde(default, deserialize_with = "name")]
    pub name: String,
    /// The file it was read from: error messages name it, and the mesh is looked for in its folder. Not part of the file.
    #[serde(skip)]
    pub file: Option<PathBuf>,
    /// Gravitational acceleration, in m/s²; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Row>,
    /// The particles.
    #[serde(default, deserialize_with = "table")]
    pub particles: Particles,
    /// The springs.
    #[serde(default, deserialize_with = "table")]
    pub springs: Springs,
    /// A mesh in place of positions and pairs.
    #[serde(default, deserialize_with = "optional_table", skip_serializing_if = "Option::is_none")]
    pub mesh: Option<Mesh>,
    /// Kinematic particles; later entries override earlier ones.
    #[serde(default, deserialize_with = "tables", skip_serializing_if = "Vec::is_empty")]
    pub constraints: Vec<ConstraintEntry>,
    /// Step and length of a run.
    #[serde(default, deserialize_with = "table", skip_serializing_if = "TimeSettings::is_empty")]
    pub time: TimeSettings,
}

/// The table `[particles]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Particles {
    /// x(0), one row per particle, in m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub positions: Vec<Row>,
    /// v(0), one row per particle, in m/s; absent: at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocities: Option<Vec<Row>>,
    /// Masses, in kg; needed where there are particles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masses: Option<Values>,
}

/// The table `[springs]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Springs {
    /// End points (i, j) of every spring.
    #[serde(default, deserialize_with = "pairs", skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<[u32; 2]>,
    /// k, the force per unit strain, in N; needed where there are springs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<Values>,
    /// l0, in m; absent: the distance between the ends' positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest_lengths: Option<Values>,
    /// b, in N·s/m; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping: Option<Values>,
}

/// The table `[mesh]`: vertices become particles, every edge of a face becomes a spring.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// Wavefront OBJ file, relative to the scene file's folder.
    pub file: String,
    /// Length of the mesh's unit, in m; absent: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}

/// One `[[constraints]]` entry. With neither a velocity nor a path, the coordinates are held.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstraintEntry {
    /// The kinematic particles.
    pub particles: Vec<u32>,
    /// The prescribed coordinates; absent: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<Vec<Axis>>,
    /// `x(t) = x(0) + t·velocity`, in m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Row>,
    /// `x(t) = x(0) + offset(t)`.
    #[serde(default, deserialize_with = "optional_table", skip_serializing_if = "Option::is_none")]
    pub path: Option<Path>,
}

/// A piecewise-linear offset, clamped at both ends.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Path {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time, in m.
    pub offsets: Vec<Row>,
}

/// A coordinate axis by its letter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", try_from = "String")]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// All axes, in order.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The letter.
    pub fn letter(self) -> &'static str {
        ["x", "y", "z"][self.index()]
    }
}

impl TryFrom<String> for Axis {
    type Error = String;

    fn try_from(letter: String) -> Result<Self, String> {
        let axis = Self::ALL.into_iter().find(|axis| axis.letter() == letter);
        axis.ok_or_else(|| format!("{letter:?} is not an axis: must be \"x\", \"y\" or \"z\""))
    }
}

/// The table `[time]`; the command line overrides both.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeSettings {
    /// Step, in s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dt: Option<f64>,
    /// Length of the run, in s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration: Option<f64>,
}

impl TimeSettings {
    /// Whether nothing is set.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A name must do as the name of a folder.
fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    match check_name(&name) {
        Ok(()) => Ok(name),
        Err(rule) => Err(de::Error::custom(format!("{name:?} {rule}"))),
    }
}

/// The rule that a name breaks.
pub(super) fn check_name(name: &str) -> Result<(), &'static str> {
    if name.trim().is_empty() {
        return Err("must not be empty");
    }
    if matches!(name, "." | "..") || name.contains(['/', '\\']) || name.chars().any(char::is_control) {
        return Err("must do as a folder's name: no path separators, no control characters, not \".\" or \"..\"");
    }
    Ok(())
}

/// A table by its keys. Derived implementations would also take a list of the values in order.
pub(super) fn table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    struct TableVisitor<T>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for TableVisitor<T> {
        type Value = T;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a table")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(MapAccessDeserializer::new(map))
        }
    }

    deserializer.deserialize_map(TableVisitor(PhantomData))
}

fn optional_table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    table(deserializer).map(Some)
}

fn tables<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    struct Table<T>(T);

    impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            table(deserializer).map(Self)
        }
    }

    Ok(Vec::<Table<T>>::deserialize(deserializer)?.into_iter().map(|Table(entry)| entry).collect())
}

fn pairs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[u32; 2]>, D::Error> {
    /// Unlike serde's arrays this one refuses a third entry in every format.
    struct Pair([u32; 2]);

    struct PairVisitor;

    impl<'de> Visitor<'de> for PairVisitor {
        type Value = Pair;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a pair of particle numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut pair: A) -> Result<Pair, A::Error> {
            let mut entry = |length| pair.next_element()?.ok_or_else(|| de::Error::invalid_length(length, &self));
            let (i, j) = (entry(0)?, entry(1)?);
            match pair.next_element::<de::IgnoredAny>()? {
                None => Ok(Pair([i, j])),
                Some(_) => Err(de::Error::invalid_length(3, &self)),
            }
        }
    }

    impl<'de> Deserialize<'de> for Pair {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            deserializer.deserialize_seq(PairVisitor)
        }
    }

    Ok(Vec::<Pair>::deserialize(deserializer)?.into_iter().map(|Pair(pair)| pair).collect())
}
