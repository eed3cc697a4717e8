//! A quantity of every particle or spring: one number for all, or a list.

use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::{Serialize, Serializer};
use std::fmt;

/// One number for all particles or springs, or one for each.
///
/// # Examples
/// ```
/// use sprung::scene::Values;
///
/// // One number for all, or one for each; equal ones are kept as one.
/// assert_eq!(Values::collect([2.0, 2.0, 2.0]), Values::Uniform(2.0));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// The same for all.
    Uniform(f64),
    /// One for each, in order.
    Each(Vec<f64>),
}

impl Values {
    /// The shorter of the two forms: one number when all are equal to the bit.
    pub fn collect(values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().collect();
        match values.as_slice() {
            [first, rest @ ..] if rest.iter().all(|value| value.to_bits() == first.to_bits()) => Self::Uniform(*first),
            _ => Self::Each(values),
        }
    }
}

impl From<f64> for Values {
    fn from(value: f64) -> Self {
        Self::Uniform(value)
    }
}

impl From<Vec<f64>> for Values {
    fn from(values: Vec<f64>) -> Self {
        Self::Each(values)
    }
}

impl Serialize for Values {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Uniform(value) => value.serialize(serializer),
            Self::Each(values) => values.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Values {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValuesVisitor)
    }
}

struct ValuesVisitor;

impl<'de> Visitor<'de> for ValuesVisitor {
    type Value = Values;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or a list of numbers")
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Values, E> {
        Ok(Values::Uniform(value))
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Values, E> {
        Ok(Values::Uniform(value as f64))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Values, E> {
        Ok(Values::Uniform(value as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Values, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            values.push(value);
        }
        Ok(Values::Each(values))
    }
}
