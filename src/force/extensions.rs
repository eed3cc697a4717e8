//! Direction and length of every active spring at one configuration, computed once and used by all formulas.

use crate::error::DegenerateSpring;
use crate::parallel::try_pieces;
use crate::spring::Extension;
use crate::system::{Share, System, shares};
use nalgebra::Vector3;

/// n and l of every active spring, in the order of [`System::active_springs`].
#[derive(Debug, Clone)]
pub struct Extensions {
    values: Vec<Extension>,
    /// How sums over springs are shared out.
    shares: Vec<Share>,
}

impl Extensions {
    /// At the given full-length positions.
    ///
    /// # Errors
    /// The first spring whose ends coincide.
    pub fn at(system: &System, positions: &[Vector3<f64>]) -> Result<Self, DegenerateSpring> {
        let extension = |(spring, pair, _): (usize, [usize; 2], _)| {
            let [i, j] = pair;
            Extension::between(&positions[i], &positions[j]).ok_or(DegenerateSpring { spring, pair })
        };
        let values = system.active().map(extension).collect::<Result<_, _>>()?;
        Ok(Self { values, shares: shares(system) })
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
        })
    }

    /// As a slice, in the order of the active springs.
    pub fn as_slice(&self) -> &[Extension] {
        &self.values
    }

    pub(crate) fn shares(&self) -> &[Share] {
        &self.shares
    }

    /// In the order of the active springs.
    pub fn iter(&self) -> std::slice::Iter<'_, Extension> {
        self.values.iter()
    }
}
