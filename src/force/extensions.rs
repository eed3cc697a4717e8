//! Direction and length of every active spring at one configuration, computed once and used by all formulas.

use crate::error::DegenerateSpring;
use crate::parallel::try_pieces;
use crate::spring::{Extension, Spring};
use crate::system::System;
use nalgebra::Vector3;

/// n and l of every active spring, in the order of [`System::active_springs`].
///
/// # Examples
/// ```
/// use sprung::force::{Extensions, add_elastic_force};
/// use sprung::nalgebra::Vector3;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let extensions = Extensions::at(&system, &state.positions)?;
/// let mut force = vec![Vector3::zeros(); system.particles()];
/// add_elastic_force(&system, &extensions, &mut force);
/// assert_eq!(force[1], Vector3::new(10.0, 0.0, 0.0)); // half its rest length: it pushes with k/2
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Extensions {
    values: Vec<Extension>,
    /// Of a law of the caller's own, its springs at these lengths; empty for the built-in law, whose springs are the same at all.
    tangents: Vec<Spring>,
}

impl Extensions {
    /// At the given full-length positions.
    ///
    /// # Errors
    /// The first spring whose ends coincide.
    pub fn at(system: &System, positions: &[Vector3<f64>]) -> Result<Self, DegenerateSpring> {
        // All at once: a list that grows takes up to three times its memory on the way.
        let mut values = Vec::with_capacity(system.active_springs().len());
        for (spring, pair, _) in system.active() {
            let [i, j] = pair;
            values.push(Extension::between(&positions[i], &positions[j]).ok_or(DegenerateSpring { spring, pair })?);
        }
        let mut extensions = Self { values, tangents: Vec::new() };
        if system.has_spring_law() {
            extensions.tangents = system.active().map(|(.., spring)| *spring).collect();
            extensions.set_tangents(system);
        }
        Ok(extensions)
    }

    /// Recomputes for new positions of the same system, in parallel and without allocating.
    ///
    /// # Errors
    /// As [`at`](Self::at); the extensions are then partly old and partly new.
    pub fn update(&mut self, system: &System, positions: &[Vector3<f64>]) -> Result<(), DegenerateSpring> {
        try_pieces(&mut self.values, &|first, piece| {
            for ((spring, pair, _), at) in system.active_from(first).zip(piece) {
                let [i, j] = pair;
                *at = Extension::between(&positions[i], &positions[j]).ok_or(DegenerateSpring { spring, pair })?;
            }
            Ok(())
        })?;
        self.set_tangents(system);
        Ok(())
    }

    fn set_tangents(&mut self, system: &System) {
        for ((tangent, at), &spring) in self.tangents.iter_mut().zip(&self.values).zip(system.active_springs()) {
            *tangent = system.spring_at(spring as usize, at.length);
        }
    }

    /// As a slice, in the order of the active springs.
    pub fn as_slice(&self) -> &[Extension] {
        &self.values
    }

    /// In the order of the active springs.
    pub fn iter(&self) -> std::slice::Iter<'_, Extension> {
        self.values.iter()
    }

    /// The active springs as they are at their lengths, each with its number, its ends and its extension: the parameters of the built-in
    /// law, or of the [tangent](crate::spring::SpringLaw) of another.
    pub fn springs<'a>(
        &'a self,
        system: &'a System,
    ) -> impl Iterator<Item = ((usize, [usize; 2], &'a Spring), &'a Extension)> + 'a {
        let springs = system.active().zip(&self.values).enumerate();
        springs.map(|(position, ((number, pair, spring), at))| {
            ((number, pair, self.tangents.get(position).unwrap_or(spring)), at)
        })
    }

    /// The springs and extensions of the active springs, from a position on.
    #[inline]
    pub(crate) fn from<'a>(
        &'a self,
        system: &'a System,
        first: usize,
    ) -> impl Iterator<Item = (&'a Spring, &'a Extension)> + 'a {
        let values = self.values.get(first..).unwrap_or_default();
        let springs = (first..).zip(system.active_from(first).zip(values));
        springs.map(|(position, ((.., spring), at))| (self.tangents.get(position).unwrap_or(spring), at))
    }

    /// The spring at a position among the active ones, as it is at its length.
    #[inline]
    pub(crate) fn spring<'a>(&'a self, system: &'a System, position: usize) -> &'a Spring {
        let own = || &system.springs()[system.active_springs()[position] as usize];
        self.tangents.get(position).unwrap_or_else(own)
    }
}
