//! Directions and lengths of all active springs at one configuration, and the derivatives of external forces there.

use crate::error::DegenerateSpring;
use crate::parallel::try_pieces;
use crate::spring::{Extension, LawValues, Spring};
use crate::system::{Derivatives, State, StateView, System};
use nalgebra::{Matrix3, Vector3};

/// Positions, with time and velocities if known. Positions alone stand for a system at rest at time zero.
#[derive(Debug, Clone, Copy)]
pub struct Configuration<'a> {
    time: f64,
    positions: &'a [Vector3<f64>],
    velocities: Option<&'a [Vector3<f64>]>,
}

impl<'a, P: AsRef<[Vector3<f64>]> + ?Sized> From<&'a P> for Configuration<'a> {
    fn from(positions: &'a P) -> Self {
        Self { time: 0.0, positions: positions.as_ref(), velocities: None }
    }
}

impl<'a> From<&StateView<'a>> for Configuration<'a> {
    fn from(at: &StateView<'a>) -> Self {
        Self { time: at.time, positions: at.positions, velocities: Some(at.velocities) }
    }
}

impl<'a> From<&'a State> for Configuration<'a> {
    fn from(state: &'a State) -> Self {
        (&state.moment()).into()
    }
}

impl<'a> Configuration<'a> {
    /// x, one row per particle, in m.
    pub fn positions(&self) -> &'a [Vector3<f64>] {
        self.positions
    }
}

/// Direction n and length l of every active spring, in the order of [`System::active_springs`].
#[derive(Debug, Clone)]
pub struct SpringGeometry {
    values: Vec<Extension>,
    /// The parameters of springs at these lengths and this time; empty where they are constant.
    tangents: Vec<Spring>,
    /// The values of a law that is evaluated for all springs at once.
    law: LawValues,
    /// The symmetric parts of the derivatives of external forces, one for every particle; empty if there are none.
    external: Vec<Derivatives>,
}

impl SpringGeometry {
    /// The geometry at a state, a view of one, or positions.
    ///
    /// # Errors
    /// The first spring with coincident ends that needs a direction.
    pub fn at<'a>(system: &System, at: impl Into<Configuration<'a>>) -> Result<Self, DegenerateSpring> {
        let mut geometry = Self {
            values: vec![Extension::COLLAPSED; system.active_springs().len()],
            tangents: Vec::new(),
            law: LawValues::default(),
            external: Vec::new(),
        };
        if system.has_spring_law() {
            geometry.tangents = system.active().map(|(.., spring)| *spring).collect();
        }
        if system.has_external_derivatives() {
            geometry.external = vec![Derivatives::default(); system.particles()];
        }
        geometry.update(system, at)?;
        Ok(geometry)
    }

    /// Recomputes for a new configuration of the same system, in parallel and without allocating.
    ///
    /// # Errors
    /// As [`at`](Self::at); the geometry is then partly updated.
    pub fn update<'a>(&mut self, system: &System, at: impl Into<Configuration<'a>>) -> Result<(), DegenerateSpring> {
        let at = at.into();
        try_pieces(&mut self.values, &|first, piece| {
            for ((spring, pair, _), target) in system.active_from(first).zip(piece) {
                let [i, j] = pair;
                let extension = system.extension(spring, &at.positions[i], &at.positions[j]);
                *target = extension.ok_or(DegenerateSpring { spring, pair })?;
            }
            Ok(())
        })?;
        self.set_tangents(system, &at);
        self.set_external(system, &at);
        Ok(())
    }

    fn set_tangents(&mut self, system: &System, at: &Configuration) {
        if self.tangents.is_empty() {
            return;
        }
        self.law = system.law_values(at.positions, at.time);
        let (law, time) = (&self.law, at.time);
        for ((tangent, at), &spring) in self.tangents.iter_mut().zip(&self.values).zip(system.active_springs()) {
            *tangent = system.spring_with(law, spring as usize, at.length, time);
        }
    }

    fn set_external(&mut self, system: &System, at: &Configuration) {
        if self.external.is_empty() {
            return;
        }
        self.external.fill(Derivatives::default());
        let at_rest = if at.velocities.is_none() { vec![Vector3::zeros(); at.positions.len()] } else { Vec::new() };
        let velocities = at.velocities.unwrap_or(&at_rest);
        let view = StateView { time: at.time, positions: at.positions, velocities };
        for (derivatives, drag) in self.external.iter_mut().zip(&system.loads().drag) {
            derivatives.damping -= Matrix3::from_diagonal_element(*drag);
        }
        system.external_forces().for_each(|force| force.add_derivatives(&view, &mut self.external));
        for Derivatives { stiffness, damping } in &mut self.external {
            (*stiffness, *damping) = (symmetric(stiffness), symmetric(damping));
        }
    }

    /// The values of a law that is evaluated for all springs at once.
    pub(crate) fn law(&self) -> &LawValues {
        &self.law
    }

    /// The symmetric parts of the derivatives of external forces, one for every particle; empty if there are none.
    pub fn external(&self) -> &[Derivatives] {
        &self.external
    }

    /// The extensions, in the order of the active springs.
    pub fn as_slice(&self) -> &[Extension] {
        &self.values
    }

    /// An iterator over the extensions, in the order of the active springs.
    pub fn iter(&self) -> std::slice::Iter<'_, Extension> {
        self.values.iter()
    }

    /// The active springs, each with its index, ends, parameters (those of the [tangent](crate::spring::SpringLaw) of a custom law) and extension.
    pub fn springs<'a>(
        &'a self,
        system: &'a System,
    ) -> impl Iterator<Item = ((usize, [usize; 2], &'a Spring), &'a Extension)> + 'a {
        let springs = system.active().zip(&self.values).enumerate();
        springs.map(|(position, ((number, pair, spring), at))| {
            ((number, pair, self.tangents.get(position).unwrap_or(spring)), at)
        })
    }

    /// The number of active springs that are shorter than at rest.
    pub(crate) fn compressed(&self, system: &System) -> usize {
        self.springs(system).filter(|((_, _, spring), at)| spring.is_compressed(at)).count()
    }

    /// Parameters and extensions of the active springs from position `first` on.
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

    #[inline]
    pub(crate) fn spring<'a>(&'a self, system: &'a System, position: usize) -> &'a Spring {
        let own = || &system.springs()[system.active_springs()[position] as usize];
        self.tangents.get(position).unwrap_or_else(own)
    }
}

fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    (matrix + matrix.transpose()) * 0.5
}
