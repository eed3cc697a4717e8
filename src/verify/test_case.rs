//! A system at a state, with the step that it is meant to be run with, and variations of it.

use crate::error::Result;
#[cfg(feature = "scene")]
use crate::scene::Scene;
use crate::spring::{Extension, Spring};
use crate::system::{Axes, Behaviour, Constraint, Loads, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;

/// A system at its initial state, with a step.
///
/// Some properties hold only where nothing is compressed, or held, or moving. A *twin* is the same system with that changed, so that they can be
/// checked on the masses, springs and shape of any scene. Twins of a valid system can always be made.
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
    /// The system with its loads, drag, gravity in time, tension-only springs and changing rest lengths, if it has any. `system` is without them.
    pub loaded: Option<System>,
}

/// Ratio of lengths and rest lengths in a stretched or squeezed twin: no option's transverse term is near zero.
const STRETCH: f64 = 1.25;

impl TestCase {
    /// A system at a state; without a `dt` the step is the [`resolving_step`](Self::resolving_step). Loads, drag, changing
    /// gravity, slack springs and changing rest lengths have checks of their own; all others leave them out.
    pub fn new(name: impl Into<String>, system: System, state: State, dt: Option<f64>) -> Result<Self> {
        let is_loaded = !(system.behaviour().is_empty() && system.loads().is_empty());
        let loaded = is_loaded.then(|| system.clone());
        let system = system.with_behaviour(Behaviour::default())?.with_loads(Loads::default())?;
        let case = Self { name: name.into(), system, state, dt: 0.0, loaded };
        let dt = dt.unwrap_or_else(|| case.resolving_step());
        Ok(Self { dt, ..case })
    }

    /// As [`new`](Self::new), of a scene with its step.
    ///
    /// # Errors
    /// When the scene cannot be built.
    #[cfg(feature = "scene")]
    pub fn of_scene(scene: &Scene) -> Result<Self> {
        let (system, state) = scene.build()?;
        Self::new(&scene.name, system, state, scene.time.dt)
    }

    /// A step that resolves every vibration and every decay: `z = ω dt ≤ 1/2` and `(b/m) dt ≤ 1/2` by Gershgorin's bounds
    /// `ω² ≤ max_i 2 Σ ‖K^s‖/m_i`, the sum over the springs at particle i. One second where nothing pulls.
    pub fn resolving_step(&self) -> f64 {
        let mut rates = vec![(0.0, 0.0); self.system.particles()];
        for (_, [i, j], spring) in self.system.active() {
            let length = (self.state.positions[i] - self.state.positions[j]).norm();
            let stiffness = if spring.rest_length > 0.0 {
                spring.stiffness / spring.rest_length.min(length)
            } else {
                spring.stiffness
            };
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
    pub fn freed(&self) -> Result<Self> {
        self.twin("freed", |twin| twin.constraints.clear())
    }

    /// At rest: rest lengths equal to the lengths, no velocities, no gravity, prescribed coordinates held.
    pub fn relaxed(&self) -> Result<Self> {
        self.twin("relaxed", |twin| {
            with_lengths(twin, |_, length| length);
            twin.gravity = Vector3::zeros();
            twin.velocities.fill(Vector3::zeros());
            twin.constraints.iter_mut().for_each(|constraint| constraint.motion = Motion::Held);
        })
    }

    /// With every spring stretched: rest lengths at most 0.8 of the lengths, none where there is none.
    pub fn stretched(&self) -> Result<Self> {
        self.twin("stretched", |twin| with_lengths(twin, |spring, length| spring.rest_length.min(length / STRETCH)))
    }

    /// With every spring compressed: rest lengths at least 1.25 times the lengths.
    pub fn squeezed(&self) -> Result<Self> {
        self.twin("squeezed", |twin| with_lengths(twin, |spring, length| spring.rest_length.max(length * STRETCH)))
    }

    /// In three dimensions, with the axes that are not modelled held instead.
    pub fn in_space(&self) -> Result<Self> {
        let absent = Axes::ALL.without(Axes::first(self.system.dimension()));
        self.twin("in space", |twin| {
            twin.dimension = 3;
            twin.constraints.push(Constraint { axes: absent, ..Constraint::hold(0..twin.positions.len()) });
        })
    }

    pub(super) fn description(&self) -> SystemBuilder {
        let Self { system, state, .. } = self;
        let prescribed = system.prescribed();
        let mut positions = state.positions.clone();
        let mut constraints = Vec::new();
        for (dof, start, motion) in prescribed.iter() {
            positions[dof.particle][dof.axis] = start;
            let (particles, axes) = (vec![dof.particle], Axes::of(&[dof.axis]));
            constraints.push(Constraint { particles, axes, motion: prescribed.motions()[motion].clone() });
        }
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

    fn twin(&self, suffix: &str, change: impl FnOnce(&mut SystemBuilder)) -> Result<Self> {
        let mut description = self.description();
        change(&mut description);
        let (system, state) = description.build()?;
        Ok(Self { name: format!("{}, {suffix}", self.name), system, state, dt: self.dt, loaded: None })
    }
}

fn with_lengths(twin: &mut SystemBuilder, rest_length: impl Fn(&Spring, f64) -> f64) {
    for (spring, &[i, j]) in twin.springs.iter_mut().zip(&twin.pairs) {
        if let Some(at) = Extension::between(&twin.positions[i as usize], &twin.positions[j as usize]) {
            let rest_length = rest_length(spring, at.length);
            // A spring that is given a rest length keeps its stiffness along itself.
            if spring.rest_length == 0.0 && rest_length > 0.0 {
                spring.stiffness *= rest_length;
            }
            spring.rest_length = rest_length;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Actuation, Curve};
    use crate::verify::fixtures::{case, line};

    fn spring(stiffness: f64, rest_length: f64, damping: f64) -> Spring {
        Spring { stiffness, rest_length, damping }
    }

    /// Particles at x = 1, 4 and 9 m of the plane, joined by these springs; the first held, the last one led along x.
    fn row(springs: [Spring; 2]) -> TestCase {
        let mut builder = SystemBuilder { dimension: 2, springs: springs.to_vec(), ..line() };
        builder.velocities[1] = Vector3::new(0.5, -1.0, 0.0);
        builder.hold(0);
        let motion = Motion::Velocity(Vector3::new(2.0, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
        case(builder, 0.1)
    }

    /// The springs are 3 and 5 m long. The stiffness of each is k over the shorter of length and rest length: 12/3 and 6/3 N/m, together
    /// 6 N/m at the particle of 1 kg, so ω² ≤ 12. The decay there is `2 (b₁ + b₂)/m` per second.
    #[test]
    fn a_step_resolves_vibrations_and_decays() {
        let step = |b: f64| row([spring(12.0, 4.0, b), spring(6.0, 3.0, 2.0 * b)]).resolving_step();
        assert!((step(0.125) - 0.5 / 12f64.sqrt()).abs() < 1e-15);
        assert!((step(2.0) - 0.5 / 12.0).abs() < 1e-15);
        let row = row([spring(8.0, 1.0, 0.0), spring(6.0, 12.0, 0.0)]);
        assert!((row.resolving_step() - 0.5 / 18.4f64.sqrt()).abs() < 1e-15);
        assert_eq!((row.centre(), row.extent()), (Vector3::new(14.0 / 3.0, 0.0, 0.0), 9.0 - 14.0 / 3.0));
        // Between coincident particles no step is short enough.
        let mut collapsed = row;
        collapsed.state.positions[1] = collapsed.state.positions[0];
        assert_eq!(collapsed.resolving_step(), 1.0);
    }

    /// Nothing is left of what most checks do not judge, kinks in time included: they cut the steps of some methods.
    #[test]
    fn loads_and_behaviour_are_set_apart() {
        let plain = row([spring(8.0, 4.0, 0.125), spring(6.0, 3.0, 0.25)]);
        let curve = |values| Curve { times: vec![0.25, 0.5], values };
        let gravity = Some(Curve { times: vec![0.1, 0.2], values: vec![plain.system.gravity(), Vector3::x()] });
        let loads = Loads { forces: vec![Vector3::x(); 3], drag: vec![0.5; 3], gravity };
        let actuation = vec![Actuation { springs: vec![0], factors: curve(vec![1.0, 2.0]) }];
        let behaviour = Behaviour { tension_only: vec![true; 2], actuation };
        let system = plain.system.clone().with_loads(loads).unwrap().with_behaviour(behaviour).unwrap();
        let case = TestCase::new("row", system, plain.state.clone(), None).unwrap();
        assert!(case.system.loads().is_empty() && case.system.behaviour().is_empty());
        assert!(case.loaded.is_some_and(|system| !system.loads().is_empty()) && plain.loaded.is_none());
        assert!(case.system.prescribed().kinks().is_empty() && case.system.gravity() == plain.system.gravity());
        assert_eq!((case.name.as_str(), case.dt), ("row", plain.resolving_step()));
    }

    #[test]
    fn twins_differ_in_what_they_are_named_after() {
        let row = row([spring(8.0, 3.0, 0.25), spring(6.0, 3.0, 0.0)]);
        let lengths = |twin: &TestCase| twin.system.springs().iter().map(|s| s.rest_length).collect::<Vec<_>>();
        assert_eq!(lengths(&row.relaxed().unwrap()), [3.0, 5.0]);
        assert_eq!(lengths(&row.stretched().unwrap()), [2.4, 3.0]);
        assert_eq!(lengths(&row.squeezed().unwrap()), [3.75, 6.25]);
        for twin in [row.stretched().unwrap(), row.squeezed().unwrap()] {
            assert_eq!((twin.state, twin.dt, twin.system.dofs().len()), (row.state.clone(), 0.1, 3));
            assert_eq!((twin.system.masses(), twin.system.gravity()), (row.system.masses(), row.system.gravity()));
            let springs: Vec<_> = twin.system.springs().iter().map(|s| (s.stiffness, s.damping)).collect();
            assert_eq!(springs, [(8.0, 0.25), (6.0, 0.0)]);
        }
        let freed = row.freed().unwrap();
        assert_eq!((freed.name.as_str(), freed.system.dofs().len()), ("case, freed", 6));
        let relaxed = row.relaxed().unwrap();
        assert!(relaxed.state.velocities.iter().all(|v| v.norm() == 0.0) && relaxed.system.gravity().norm() == 0.0);
        assert!(!relaxed.system.prescribed().moves() && relaxed.system.dofs().len() == 3);
        let space = row.in_space().unwrap();
        assert_eq!((space.system.dimension(), space.system.dofs().len()), (3, 3));
        assert_eq!(space.state, row.state);
    }

    /// The step is the scene's own, or one that resolves its vibrations.
    #[cfg(feature = "scene")]
    #[test]
    fn a_scene_has_a_step_of_its_own_or_one_that_resolves_it() {
        let text = include_str!("scenes/two_springs.toml");
        let mut scene = crate::scene::Scene::from_toml(text).unwrap();
        scene.time.dt = Some(0.0625);
        assert_eq!(TestCase::of_scene(&scene).unwrap().dt, 0.0625);
        scene.time.dt = None;
        let case = TestCase::of_scene(&scene).unwrap();
        assert!(case.dt > 0.0 && case.dt == case.resolving_step());
    }
}
