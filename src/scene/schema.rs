//! The scene file, key by key. TOML and JSON share it.
//!
//! These types say what a file may contain and how it is written; what the values must fulfil is decided when a
//! [`Scene`] is [built](Scene::build).

use super::{ActuationEntry, Drag, Flags, ForceEntry, Gravity, Row, Values, read};
use serde::de::{self, Deserializer, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// A scene: what a scene file says. SI units; particles and springs are numbered from 0.
///
/// Its dimension is the length of its rows: of the first position, or of gravity where there are no particles, or 3.
///
/// # Examples
/// ```
/// let text = r#"
///     [particles]
///     positions = [[0, 0, 0], [1, 0, 0]]
///     masses = 1.0
///     [springs]
///     pairs = [[0, 1]]
///     stiffness = 100.0
/// "#;
/// let (system, _) = sprung::Scene::from_toml(text)?.build()?;
/// assert_eq!(system.springs()[0].rest_length, 1.0); // not given: the initial distance
///
/// let wrong = sprung::Scene::from_toml(&text.replace("100.0", "-1.0"))?.build();
/// assert!(wrong.err().is_some_and(|error| error.to_string().contains("springs.stiffness")));
/// # Ok::<(), sprung::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The scene's name, also that of its output folder; the file's stem where the file has none.
    #[serde(default, deserialize_with = "read::name")]
    pub name: String,
    /// The file it was read from: error messages name it, and the mesh is looked for in its folder. Not part of the file.
    #[serde(skip)]
    pub file: Option<PathBuf>,
    /// Gravitational acceleration, in m/s², constant or in time; absent: none.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Gravity>,
    /// The particles.
    #[serde(default, deserialize_with = "read::table")]
    pub particles: Particles,
    /// The springs.
    #[serde(default, deserialize_with = "read::table")]
    pub springs: Springs,
    /// A mesh in place of positions and pairs.
    #[serde(default, deserialize_with = "read::optional_table", skip_serializing_if = "Option::is_none")]
    pub mesh: Option<Mesh>,
    /// Kinematic particles; later entries override earlier ones.
    #[serde(default, deserialize_with = "read::tables", skip_serializing_if = "Vec::is_empty")]
    pub constraints: Vec<ConstraintEntry>,
    /// Constant loads on particles.
    #[serde(default, deserialize_with = "read::tables", skip_serializing_if = "Vec::is_empty")]
    pub forces: Vec<ForceEntry>,
    /// What slows particles down.
    #[serde(default, deserialize_with = "read::optional_table", skip_serializing_if = "Option::is_none")]
    pub drag: Option<Drag>,
    /// Step and length of a run.
    #[serde(default, deserialize_with = "read::table", skip_serializing_if = "TimeSettings::is_empty")]
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
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub velocities: Option<Vec<Row>>,
    /// Masses, in kg; needed where there are particles.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub masses: Option<Values>,
}

/// The table `[springs]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Springs {
    /// End points (i, j) of every spring.
    #[serde(default, deserialize_with = "read::pairs", skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<[u32; 2]>,
    /// k, the force per unit strain, in N, or per metre, in N/m, where the rest length is zero; needed where there are springs.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<Values>,
    /// l0, in m, zero too; absent: the distance between the ends' positions.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub rest_lengths: Option<Values>,
    /// b, in N·s/m; absent: none.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub damping: Option<Values>,
    /// Whether springs do not push; absent: they do.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub tension_only: Option<Flags>,
    /// Rest lengths that change in time.
    #[serde(default, deserialize_with = "read::tables", skip_serializing_if = "Vec::is_empty")]
    pub actuation: Vec<ActuationEntry>,
}

/// The table `[mesh]`: vertices become particles, every edge once becomes a spring.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// OBJ, PLY, STL, VTK or Gmsh MSH file, relative to the scene file's folder; see [`MeshGeometry`](super::MeshGeometry).
    pub file: String,
    /// Length of the mesh's unit, in m; absent: 1.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Vertices no farther apart than this are one, in m; absent: none are joined.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub weld: Option<f64>,
}

/// One `[[constraints]]` entry. With neither a velocity nor a path, the coordinates are held.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstraintEntry {
    /// The kinematic particles.
    pub particles: Vec<u32>,
    /// The prescribed coordinates; absent: all.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub axes: Option<Vec<AxisName>>,
    /// `x(t) = x(0) + t·velocity`, in m/s.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Row>,
    /// `x(t) = x(0) + offset(t)`.
    #[serde(default, deserialize_with = "read::optional_table", skip_serializing_if = "Option::is_none")]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisName {
    /// The first coordinate.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl AxisName {
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

impl<'de> Deserialize<'de> for AxisName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct AxisVisitor;

        impl Visitor<'_> for AxisVisitor {
            type Value = AxisName;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"x\", \"y\" or \"z\"")
            }

            fn visit_str<E: de::Error>(self, letter: &str) -> Result<AxisName, E> {
                let axis = AxisName::ALL.into_iter().find(|axis| axis.letter() == letter);
                axis.ok_or_else(|| E::invalid_value(de::Unexpected::Str(letter), &self))
            }
        }

        deserializer.deserialize_str(AxisVisitor)
    }
}

/// The table `[time]`; the command line overrides both.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeSettings {
    /// Step, in s.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub dt: Option<f64>,
    /// Length of the run, in s.
    #[serde(default, deserialize_with = "read::some", skip_serializing_if = "Option::is_none")]
    pub duration: Option<f64>,
}

impl TimeSettings {
    /// Whether nothing is set.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
