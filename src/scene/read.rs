//! How the keys of a scene file are read where serde's own way would accept too much.

use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// A name must do as the name of a folder.
pub fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    match check_name(&name) {
        Ok(()) => Ok(name),
        Err(rule) => Err(de::Error::custom(format!("{name:?} {rule}"))),
    }
}

/// The rule that a name breaks.
pub fn check_name(name: &str) -> Result<(), &'static str> {
    if name.trim().is_empty() {
        return Err("must not be empty");
    }
    if matches!(name, "." | "..") || name.contains(['/', '\\']) || name.chars().any(char::is_control) {
        return Err("must do as a folder's name: no path separators, no control characters, not \".\" or \"..\"");
    }
    Ok(())
}

/// An optional value that is there. A null is refused: it is what programs write for NaN.
pub fn some<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// A table by its keys. Derived implementations would also take a list of the values in order.
pub fn table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
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

/// A table that is there.
pub fn optional_table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    table(deserializer).map(Some)
}

/// A list of tables.
pub fn tables<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    struct Table<T>(T);

    impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            table(deserializer).map(Self)
        }
    }

    Ok(Vec::<Table<T>>::deserialize(deserializer)?.into_iter().map(|Table(entry)| entry).collect())
}

/// A list of pairs.
pub fn pairs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[u32; 2]>, D::Error> {
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
