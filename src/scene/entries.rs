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

    /// Every form reads what it wrote, and so does a snapshot of the system, whose curves go on from its time.
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
            (
                "particles = [1, 2]",
                "particles = [1, 3]",
                "forces[0].particles[1] = 3: names a particle that does not exist (there are 3)",
            ),
            ("[0.1, 0.2, 0.3]", "[0.1, -0.2, 0.3]", "drag.coefficient[1] = -0.2: must be finite and not negative"),
            (
                "[0.1, 0.2, 0.3]",
                "[0.1]",
                "drag.coefficient = a list of 1: must have one entry for each of the 3 particles",
            ),
            (
                "[false, true]",
                "[true]",
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
            (
                "times = [0, 2]",
                "times = [0]",
                "gravity.values = a list of 2: must have one entry for each of the 1 times",
            ),
            (
                "[0, 0]] }",
                "[nan, 0]] }",
                "gravity.values[1] = [NaN, 0.0, 0.0]: must be finite, at most 1e150 in size, and zero along axes that are not modelled",
            ),
            ("rest_lengths = [0, 0.5]", "", "springs.pairs[0] = [0, 1]: is a spring of zero current length"),
            ("[0, 0.5]", "[0, -0.5]", "springs.rest_lengths[1] = -0.5: must be finite and not negative"),
        ] {
            let text = EVERY_KEY.replacen(from, to, 1);
            assert_ne!(text, EVERY_KEY, "{from}");
            let message = Scene::from_toml(&text).unwrap().build().unwrap_err().to_string();
            assert_eq!(message, expected);
        }
    }
}
