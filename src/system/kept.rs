//! What is found out of a system that never changes, found once and kept with it: the symbolic factorization of its matrix.

use super::System;
use std::any::Any;
use std::fmt;
use std::sync::OnceLock;

/// Room for one thing of any type, which stays.
#[derive(Default)]
pub(crate) struct Kept(Option<OnceLock<Box<dyn Any + Send + Sync>>>);

impl Kept {
    /// What is kept, if it is of this type.
    pub fn get<T: Any + Send + Sync>(&self) -> Option<&T> {
        self.0.as_ref()?.get()?.downcast_ref()
    }

    /// Keeps something, where there is room.
    pub fn keep<T: Any + Send + Sync>(&self, found: T) {
        if let Some(room) = &self.0 {
            room.get_or_init(|| Box::new(found));
        }
    }
}

/// A copy may become another system, and has no room.
impl Clone for Kept {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl fmt::Debug for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Kept").field("has_room", &self.0.is_some()).finish_non_exhaustive()
    }
}

impl System {
    /// A copy that keeps what is found of it: of several runs of it the first analyses its matrix, and the others know.
    #[must_use]
    pub(crate) fn keeping(&self) -> Self {
        Self { kept: Kept(Some(OnceLock::new())), ..self.clone() }
    }

    /// What was found of this system and stays with it.
    pub(crate) fn kept(&self) -> &Kept {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use crate::system::fixtures::oscillator;

    /// The first thing stays; a copy has no room.
    #[test]
    fn what_is_found_first_is_kept_where_there_is_room() {
        let (system, _) = oscillator();
        let keeping = system.keeping();
        for (system, expected) in [(&system, None), (&keeping, Some(&1u32)), (&keeping.clone(), None)] {
            system.kept().keep(1u32);
            system.kept().keep(2u32);
            assert_eq!((system.kept().get::<u32>(), system.kept().get::<i32>()), (expected, None));
        }
    }
}
