//! What is checked: a system at a state, with the step that it is meant to be run with.

use crate::error::Result;
#[cfg(feature = "scene")]
use crate::scene::Scene;
use crate::spring::{Extension, Spring};
use crate::system::{Axes, Constraint, State, System, SystemBuilder};
use nalgebra::Vector3;

/// A system at its initial state, with a step.
///
/// Some properties hold only where nothing is compressed, or held, or moving. A *twin* is the same system with just that
/// changed, so that they can be checked on the masses, springs and shape of any scene.
#[derive(Debug, Clone)]
pub struct TestCase {
    /// The scene's name.
    pub name: String,
    /// The system.
    pub system: System,
    /// Its state at time zero.
    pub state: State,
    /// The step, in s.
    pub dt: f64,
}

/// How much shorter than the springs the rest lengths of a stretched twin are, and how much longer those of a
/// squeezed one: far enough from 1 that no option's transverse term is near zero.
const STRETCH: f64 = 1.25;

impl TestCase {
    /// A scene, built; without a `dt` of its own the step is the [`resolving_step`](Self::resolving_step). Loads, drag, gravity that changes, and that
    /// springs do not push or change their rest lengths, is left out: checks do not judge it.
    ///
    /// # Errors
    /// When the scene cannot be built, or has springs without a rest length, which checks do not judge.
    #[cfg(feature = "scene")]
    pub fn of_scene(scene: &Scene) -> Result<Self> {
        let (system, state) = scene.build()?;
        if let Some(spring) = system.springs().iter().position(|spring| spring.rest_length == 0.0) {
            let what = format!("{}: spring {spring} has no rest length, and checks judge none without", scene.name);
            return Err(crate::error::Error::Unsupported(what));
        }
        let system =
            system.with_behaviour(crate::system::Behaviour::default())?.with_loads(crate::system::Loads::default())?;
        let subject = Self { name: scene.name.clone(), system, state, dt: 0.0 };
        let dt = scene.time.dt.unwrap_or_else(|| subject.resolving_step());
        Ok(Self { dt, ..subject })
    }

    /// A step that resolves every vibration and every decay: `z = ω dt ≤ 1/2` and `(b/m) dt ≤ 1/2` by Gershgorin's bounds
    /// `ω² ≤ max_i 2 Σ ‖K^s‖/m_i`, the sum over the springs at particle i. One second where nothing pulls.
    pub fn resolving_step(&self) -> f64 {
        let mut rates = vec![(0.0, 0.0); self.system.particles()];
        for (_, [i, j], spring) in self.system.active() {
            let (xi, xj) = (&self.state.positions[i], &self.state.positions[j]);
            let length = (xi - xj).norm();
            let stiffness = spring.stiffness / spring.rest_length.min(length);
            for p in [i, j] {
                rates[p].0 += 2.0 * stiffness / self.system.masses()[p];
                rates[p].1 += 2.0 * spring.damping / self.system.masses()[p];
            }
        }
        let fastest = rates.iter().fold(0.0_f64, |rate, (squared, decay)| rate.max(squared.sqrt()).max(*decay));
        if fastest > 0.0 && fastest.is_finite() { 0.5 / fastest } else { 1.0 }
    }

    /// The size of the scene: the largest distance of a coordinate from the particles' mean, in m; 1 for a point.
    pub fn extent(&self) -> f64 {
        let centre = self.centre();
        let extent = self.state.positions.iter().fold(0.0_f64, |extent, x| extent.max((x - centre).amax()));
        if extent > 0.0 { extent } else { 1.0 }
    }

    /// The mean of the particles' positions, in m.
    pub fn centre(&self) -> Vector3<f64> {
        self.state.positions.iter().sum::<Vector3<f64>>() / self.system.particles().max(1) as f64
    }

    /// Without constraints.
    ///
    /// # Errors
    /// None that a valid subject could cause.
    pub fn freed(&self) -> Result<Self> {
        self.twin("freed", |twin| twin.constraints.clear())
    }

    /// At rest everywhere: rest lengths as long as the springs are, no velocities, no gravity, prescribed coordinates held.
    ///
    /// # Errors
    /// None that a valid subject could cause.
    pub fn relaxed(&self) -> Result<Self> {
        self.twin("relaxed", |twin| {
            with_lengths(twin, |_, length| length);
            twin.gravity = Vector3::zeros();
            twin.velocities.fill(Vector3::zeros());
            twin.constraints.iter_mut().for_each(|constraint| constraint.motion = crate::system::Motion::Held);
        })
    }

    /// With every spring stretched: rest lengths at most 0.8 of the lengths.
    ///
    /// # Errors
    /// None that a valid subject could cause.
    pub fn stretched(&self) -> Result<Self> {
        self.twin("stretched", |twin| with_lengths(twin, |spring, length| spring.rest_length.min(length / STRETCH)))
    }

    /// With every spring compressed: rest lengths at least 1.25 times the lengths.
    ///
    /// # Errors
    /// None that a valid subject could cause.
    pub fn squeezed(&self) -> Result<Self> {
        self.twin("squeezed", |twin| with_lengths(twin, |spring, length| spring.rest_length.max(length * STRETCH)))
    }

    /// In three dimensions, with the axes that are not modelled held instead.
    ///
    /// # Errors
    /// None that a valid subject could cause.
    pub fn in_space(&self) -> Result<Self> {
        let absent = Axes::ALL.without(Axes::first(self.system.dimension()));
        self.twin("in space", |twin| {
            twin.dimension = 3;
            twin.constraints.push(Constraint { axes: absent, ..Constraint::hold(0..twin.positions.len()) });
        })
    }

    /// The description that this subject could have been built from.
    fn description(&self) -> SystemBuilder {
        let Self { system, state, .. } = self;
        let prescribed = system.prescribed();
        let mut positions = state.positions.clone();
        let constraint = |(dof, start, motion): (crate::system::Dof, f64, usize)| {
            positions[dof.particle][dof.axis] = start;
            Constraint {
                particles: vec![dof.particle],
                axes: Axes::of(&[dof.axis]),
                motion: prescribed.motions()[motion].clone(),
            }
        };
        let constraints = prescribed.iter().map(constraint).collect();
        SystemBuilder {
            dimension: system.dimension(),
            gravity: system.gravity(),
            positions,
            velocities: state.velocities.clone(),
            masses: system.masses().to_vec(),
            pairs: system.pairs().to_vec(),
            springs: system.springs().to_vec(),
            constraints,
        }
    }

    fn twin(&self, how: &str, change: impl FnOnce(&mut SystemBuilder)) -> Result<Self> {
        let mut description = self.description();
        change(&mut description);
        let (system, state) = description.build()?;
        Ok(Self { name: format!("{}, {how}", self.name), system, state, dt: self.dt })
    }
}

fn with_lengths(twin: &mut SystemBuilder, rest_length: impl Fn(&Spring, f64) -> f64) {
    for (spring, &[i, j]) in twin.springs.iter_mut().zip(&twin.pairs) {
        if let Some(at) = Extension::between(&twin.positions[i as usize], &twin.positions[j as usize]) {
            spring.rest_length = rest_length(spring, at.length);
        }
    }
}

#[cfg(test)]
mod tests;
