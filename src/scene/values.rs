//! The values of a scene file: names, vectors, tables, and quantities of every particle or spring.

use nalgebra::Vector3;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, Deserialize, Deserializer, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// One, two or three numbers, stored in place so that a long list of rows is one block of memory.
#[derive(Clone, Copy, PartialEq)]
pub struct Row {
    dimension: u8,
    entries: [f64; 3],
}

impl Row {
    /// The first `dimension` components of a vector, at least one and at most three.
    pub fn of(vector: &Vector3<f64>, dimension: usize) -> Self {
        Self::of_numbers(&vector.as_slice()[..dimension.clamp(1, 3)])
    }

    /// 1, 2 or 3 numbers.
    pub(super) fn of_numbers(numbers: &[f64]) -> Self {
        let mut entries = [0.0; 3];
        entries[..numbers.len()].copy_from_slice(numbers);
        Self { dimension: numbers.len() as u8, entries }
    }

    /// The numbers: 1, 2 or 3 of them.
    pub fn as_slice(&self) -> &[f64] {
        &self.entries[..self.dimension()]
    }

    /// The number of entries: 1, 2 or 3.
    pub fn dimension(&self) -> usize {
        usize::from(self.dimension)
    }

    /// As a 3-vector, with zeros along the absent axes.
    pub fn vector(&self) -> Vector3<f64> {
        self.entries.into()
    }
}

impl<const N: usize> From<[f64; N]> for Row {
    fn from(row: [f64; N]) -> Self {
        const { assert!(N >= 1 && N <= 3, "a row has 1, 2 or 3 numbers") };
        Self::of_numbers(&row)
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
        let (entries, dimension) = short_list(deserializer, 1, "a row of 1, 2 or 3 numbers")?;
        Ok(Self { dimension: dimension as u8, entries })
    }
}

/// A list of pairs. serde's own arrays accept a third entry in some formats.
pub fn pairs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[u32; 2]>, D::Error> {
    struct Pair([u32; 2]);

    impl<'de> Deserialize<'de> for Pair {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            short_list(deserializer, 2, "a pair of particle numbers").map(|(pair, _)| Self(pair))
        }
    }

    Ok(Vec::<Pair>::deserialize(deserializer)?.into_iter().map(|Pair(pair)| pair).collect())
}

/// Reads a list of `least` to N entries in place; returns them with their number.
fn short_list<'de, D: Deserializer<'de>, T: Deserialize<'de> + Copy + Default, const N: usize>(
    deserializer: D,
    least: usize,
    expected: &'static str,
) -> Result<([T; N], usize), D::Error> {
    struct ListVisitor<T, const N: usize> {
        least: usize,
        expected: &'static str,
        of: PhantomData<T>,
    }

    impl<'de, T: Deserialize<'de> + Copy + Default, const N: usize> Visitor<'de> for ListVisitor<T, N> {
        type Value = ([T; N], usize);

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.expected)
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
            let (mut entries, mut count) = ([T::default(); N], 0);
            while let Some(entry) = list.next_element()? {
                *entries.get_mut(count).ok_or_else(|| de::Error::invalid_length(N + 1, &self))? = entry;
                count += 1;
            }
            if count < self.least { Err(de::Error::invalid_length(count, &self)) } else { Ok((entries, count)) }
        }
    }

    deserializer.deserialize_seq(ListVisitor { least, expected, of: PhantomData })
}

/// One value for all particles or springs, or one for each.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum PerItem<T> {
    /// The same for all.
    Uniform(T),
    /// One for each, in order.
    Each(Vec<T>),
}

/// One number for all particles or springs, or one for each.
pub type Values = PerItem<f64>;

/// One flag for all springs, or one for each.
pub type Flags = PerItem<bool>;

impl Values {
    /// The shorter of the two forms: one number when all are equal to the bit.
    pub fn collect(values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().collect();
        match values.as_slice() {
            [first, rest @ ..] if rest.iter().all(|value| value.to_bits() == first.to_bits()) => Self::Uniform(*first),
            _ => Self::Each(values),
        }
    }

    /// The value of an item; NaN where the list is too short.
    pub(super) fn get(&self, index: usize) -> f64 {
        match self {
            Self::Uniform(value) => *value,
            Self::Each(values) => values.get(index).copied().unwrap_or(f64::NAN),
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

impl<'de> Deserialize<'de> for Values {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PerItemVisitor("a number or a list of numbers", PhantomData))
    }
}

impl<'de> Deserialize<'de> for Flags {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PerItemVisitor("true, false or a list of them", PhantomData))
    }
}

struct PerItemVisitor<T>(&'static str, PhantomData<T>);

impl<T> PerItemVisitor<T> {
    fn uniform<'de, E: de::Error>(
        self,
        value: impl IntoDeserializer<'de, E>,
        found: Unexpected<'_>,
    ) -> Result<PerItem<T>, E>
    where
        T: Deserialize<'de>,
    {
        let value = T::deserialize(value.into_deserializer());
        value.map(PerItem::Uniform).map_err(|_| E::invalid_type(found, &self.0))
    }
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for PerItemVisitor<T> {
    type Value = PerItem<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }

    fn visit_bool<E: de::Error>(self, value: bool) -> Result<PerItem<T>, E> {
        self.uniform(value, Unexpected::Bool(value))
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<PerItem<T>, E> {
        self.uniform(value, Unexpected::Float(value))
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<PerItem<T>, E> {
        self.uniform(value, Unexpected::Signed(value))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<PerItem<T>, E> {
        self.uniform(value, Unexpected::Unsigned(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<PerItem<T>, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(list)).map(PerItem::Each)
    }
}

/// A name that can be the name of a folder.
pub fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    match check_name(&name) {
        Ok(()) => Ok(name),
        Err(rule) => Err(de::Error::custom(format!("{name:?} {rule}"))),
    }
}

pub fn check_name(name: &str) -> Result<(), &'static str> {
    if name.trim().is_empty() {
        return Err("must not be empty");
    }
    if matches!(name, "." | "..") || name.contains(['/', '\\']) || name.chars().any(char::is_control) {
        return Err("must do as a folder's name: no path separators, no control characters, not \".\" or \"..\"");
    }
    Ok(())
}

/// An optional value that is present. Null is rejected: programs write it for NaN.
pub fn some<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// A table by its keys. Derived implementations also accept a list of the values in order.
struct Table<T>(T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
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

        deserializer.deserialize_map(TableVisitor(PhantomData)).map(Self)
    }
}

pub fn table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    Table::deserialize(deserializer).map(|Table(table)| table)
}

pub fn optional_table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    table(deserializer).map(Some)
}

pub fn tables<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    Ok(Vec::<Table<T>>::deserialize(deserializer)?.into_iter().map(|Table(entry)| entry).collect())
}

#[cfg(test)]
mod tests {
    use super::Values;

    #[test]
    fn one_number_stands_for_equal_bits() {
        assert_eq!(Values::collect([2.0, 2.0]), Values::Uniform(2.0));
        assert_eq!(Values::collect([2.0, 3.0]), Values::Each(vec![2.0, 3.0]));
        assert!(matches!(Values::collect([0.0, -0.0]), Values::Each(_)));
        assert_eq!(Values::collect([]), Values::Each(vec![]));
    }
}
