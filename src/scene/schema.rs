//! The scene file, key by key. TOML and JSON share it.
//!
//! The types define what a file may contain; the values are checked when a [`Scene`] is [built](Scene::build).

use super::values::{name, optional_table, pairs, some, table, tables};
use super::{Flags, Row, Values};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// The contents of a scene file. SI units; particles and springs are numbered from 0.
///
/// Its dimension is the length of its rows: of the first position, of gravity where there are no particles, or 3.
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
    #[serde(default, deserialize_with = "name")]
    pub name: String,
    /// The file it was read from, for error messages and the folder of its mesh. Not part of the file.
    #[serde(skip)]
    pub file: Option<PathBuf>,
    /// Gravitational acceleration, in m/s², constant or in time; absent: none.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Gravity>,
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
    /// Constant loads on particles.
    #[serde(default, deserialize_with = "tables", skip_serializing_if = "Vec::is_empty")]
    pub forces: Vec<ForceEntry>,
    /// Viscous drag on every particle.
    #[serde(default, deserialize_with = "optional_table", skip_serializing_if = "Option::is_none")]
    pub drag: Option<Drag>,
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
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub velocities: Option<Vec<Row>>,
    /// Masses, in kg; required where there are particles.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub masses: Option<Values>,
}

/// The table `[springs]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Springs {
    /// End points (i, j) of every spring.
    #[serde(default, deserialize_with = "pairs", skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<[u32; 2]>,
    /// k, the force per unit strain, in N, or per metre, in N/m, where the rest length is zero; required where there are springs.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<Values>,
    /// l0, in m, may be zero; absent: the initial distance of the ends.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub rest_lengths: Option<Values>,
    /// b, in N·s/m; absent: none.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub damping: Option<Values>,
    /// Springs that do not push; absent: none.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub tension_only: Option<Flags>,
    /// Rest lengths that change in time.
    #[serde(default, deserialize_with = "tables", skip_serializing_if = "Vec::is_empty")]
    pub actuation: Vec<ActuationEntry>,
}

/// The table `[mesh]`: vertices become particles, every edge once becomes a spring.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// OBJ, PLY, STL, VTK or Gmsh MSH file, relative to the scene file's folder; see [`MeshGeometry`](super::MeshGeometry).
    pub file: String,
    /// Length of the mesh's unit, in m; absent: 1.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Vertices no farther apart than this are joined, in m; absent: none are.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub weld: Option<f64>,
}

/// One `[[constraints]]` entry. With neither a velocity nor a path, the coordinates are held.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstraintEntry {
    /// The kinematic particles.
    pub particles: Vec<u32>,
    /// The prescribed coordinates; absent: all.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub axes: Option<Vec<AxisName>>,
    /// `x(t) = x(0) + t·velocity`, in m/s.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
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
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub dt: Option<f64>,
    /// Length of the run, in s.
    #[serde(default, deserialize_with = "some", skip_serializing_if = "Option::is_none")]
    pub duration: Option<f64>,
}

impl TimeSettings {
    /// Whether nothing is set.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// `gravity`: one vector, or a path of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Gravity {
    /// At all times, in m/s².
    Constant(Row),
    /// Piecewise linear in time, clamped at both ends.
    Path(GravityPath),
}

/// Gravity that changes in time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GravityPath {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time, in m/s².
    pub values: Vec<Row>,
}

impl Gravity {
    /// The number of entries of its rows; `None` where there are no rows.
    pub fn dimension(&self) -> Option<usize> {
        match self {
            Self::Constant(row) => Some(row.dimension()),
            Self::Path(path) => path.values.first().map(Row::dimension),
        }
    }
}

impl<T: Into<Row>> From<T> for Gravity {
    fn from(row: T) -> Self {
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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// The particles.
    pub particles: Vec<u32>,
    /// The force on each, in N.
    pub value: Row,
}

/// The table `[drag]`: `−c v` on every particle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drag {
    /// c, in N·s/m.
    pub coefficient: Values,
}

/// One `[[springs.actuation]]` entry: rest lengths that change in time. Later entries override earlier ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuationEntry {
    /// The springs.
    pub springs: Vec<u32>,
    /// The factor of their rest lengths.
    #[serde(deserialize_with = "table")]
    pub path: FactorPath,
}

/// A piecewise-linear factor, clamped at both ends.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactorPath {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time.
    pub factors: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use crate::scene::Scene;
    use std::io::Cursor;

    const EVERY_KEY: &str = r#"
        name = "every key"
        gravity = { times = [0, 2], values = [[0, -9.81], [0, 0]] }
        [particles]
        positions = [[0, 0], [0, 0], [1, 0]]
        masses = 1.0
        [springs]
        pairs = [[0, 1], [1, 2]]
        stiffness = [10, 20]
        rest_lengths = [0, 0.5]
        tension_only = [false, true]
        [[springs.actuation]]
        springs = [1]
        path = { times = [0, 1], factors = [1.0, 0.7] }
        [[constraints]]
        particles = [0]
        [[forces]]
        particles = [1, 2]
        value = [0, -100.0]
        [[forces]]
        particles = [2]
        value = [1, 1]
        [drag]
        coefficient = [0.1, 0.2, 0.3]
    "#;

    /// Every format reads back what it wrote, and so does a snapshot of the system, whose curves go on from its time.
    #[test]
    fn every_key_is_written_and_read() {
        let scene = Scene::from_toml(EVERY_KEY).unwrap();
        assert_eq!(Scene::from_toml(&scene.to_toml()).unwrap(), scene, "{}", scene.to_toml());
        assert_eq!(Scene::from_json(&scene.to_json()).unwrap(), scene);
        let mut file = Vec::new();
        scene.write_npz(&mut file).unwrap();
        assert_eq!(Scene::from_npz(Cursor::new(file)).unwrap(), scene);
        let (system, mut state) = scene.build().unwrap();
        assert_eq!(system.loads().forces[2].as_slice(), [1.0, -99.0, 0.0]);
        assert_eq!((system.loads().drag[1], system.gravity().y), (0.2, -9.81));
        state.time = 0.5;
        let (again, _) = Scene::snapshot("later", &system, &state).build().unwrap();
        assert_eq!(again.loads().forces, system.loads().forces);
        assert_eq!(again.behaviour().tension_only, [false, true]);
        let curves =
            [again.loads().gravity.clone().unwrap().times, again.behaviour().actuation[0].factors.times.clone()];
        assert_eq!(curves, [vec![-0.5, 1.5], vec![-0.5, 0.5]]);
    }

    #[test]
    fn wrong_entries_are_named() {
        for (from, to, expected) in [
            ("[0, -100.0]", "[0]", "forces[0].value = [0.0]: must have length 2, as the scene's other rows"),
            ("[1, 2]\n", "[1, 3]\n", "forces[0].particles[1] = 3: names a particle that does not exist (there are 3)"),
            ("[0.1, 0.2, 0.3]", "[0.1, -0.2, 0.3]", "drag.coefficient[1] = -0.2: must be finite and not negative"),
            ("0.1, 0.2, 0.3", "1", "drag.coefficient = a list of 1: must have one entry for each of the 3 particles"),
            (
                "false, true",
                "true",
                "springs.tension_only = a list of 1: must have one entry for each of the 2 springs",
            ),
            ("springs = [1]", "springs = [0]", "springs.actuation[0].springs[0] = 0: has no rest length to change"),
            (
                "springs = [1]",
                "springs = [2]",
                "springs.actuation[0].springs[0] = 2: names a spring that does not exist (there are 2)",
            ),
            (
                "[1.0, 0.7]",
                "[1.0, 0.0]",
                "springs.actuation[0].path.factors[1] = 0: must be finite and positive, and so must the rest lengths that it makes",
            ),
            ("[0, 1], factors", "[1, 1], factors", "springs.actuation[0].path.times[1] = 1: times must increase"),
            ("times = [0, 2]", "times = [0]", "gravity.values = a list of 2: must have one entry for the only time"),
            (
                "[0, 0]] }",
                "[nan, 0]] }",
                "gravity.values[1] = [NaN, 0.0, 0.0]: must be finite, at most 1e150 in size, and zero along axes that are not modelled",
            ),
            ("rest_lengths = [0, 0.5]", "", "springs.pairs[0] = [0, 1]: is a spring of zero current length"),
        ] {
            let text = EVERY_KEY.replacen(from, to, 1);
            assert_ne!(text, EVERY_KEY, "{from}");
            let message = Scene::from_toml(&text).unwrap().build().unwrap_err().to_string();
            assert_eq!(message, expected);
        }
    }
}
