//! The scenes that the program carries to verify itself on, and configurations that are hard on a Jacobian.

use super::TestCase;
use crate::error::Result;
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, SystemBuilder};
use nalgebra::Vector3;

/// Between them: compression, tension and prestress; loads, slack springs and springs without a rest length; held, led and partly held particles; one, two and three axes; free
/// and disconnected parts; equilibria; stiff and ill-conditioned systems.
#[cfg(feature = "scene")]
const SCENES: [&str; 15] = [
    include_str!("scenes/buckled_column.toml"),
    include_str!("scenes/cables.toml"),
    include_str!("scenes/compressed_chain.toml"),
    include_str!("scenes/disconnected.toml"),
    include_str!("scenes/hanging_chain.toml"),
    include_str!("scenes/ill_conditioned.toml"),
    include_str!("scenes/moving_anchor.toml"),
    include_str!("scenes/one_dimensional.toml"),
    include_str!("scenes/packed_strip.toml"),
    include_str!("scenes/parallel_springs.toml"),
    include_str!("scenes/planar_truss.toml"),
    include_str!("scenes/stiff_pendulum.toml"),
    include_str!("scenes/taut_string.toml"),
    include_str!("scenes/tetrahedron.toml"),
    include_str!("scenes/two_springs.toml"),
];

/// The built-in scenes, and the [`hard_states`].
///
/// # Errors
/// None: the suite builds every one of them.
#[cfg(feature = "scene")]
pub fn built_in() -> Result<Vec<TestCase>> {
    let scenes = SCENES.iter().map(|text| TestCase::of_scene(&crate::scene::Scene::from_toml(text)?));
    scenes.chain(hard_states()?.into_iter().map(Ok)).collect()
}

/// The strain and the place of a hard state.
struct Regime {
    name: &'static str,
    /// l/l0 of every spring, about.
    stretch: f64,
    /// Length of a typical spring, in m.
    scale: f64,
    /// Distance from the origin, in m.
    distance: f64,
    /// Factor by which one particle is drawn towards its neighbour.
    collapse: f64,
    /// Whether it lies beside that along an axis: the components of the transverse term along this axis are then zero.
    aligned: bool,
}

const ORDINARY: Regime = Regime { name: "", stretch: 1.0, scale: 1.0, distance: 0.0, collapse: 1.0, aligned: false };

const REGIMES: [Regime; 9] = [
    Regime { name: "compressed to 0.4 of rest", stretch: 0.4, ..ORDINARY },
    Regime { name: "stretched to 2.5 of rest", stretch: 2.5, ..ORDINARY },
    Regime { name: "within 1e-9 of rest", stretch: 1.0 + 1e-9, ..ORDINARY },
    Regime { name: "one spring collapsed to 1e-5", collapse: 1e-5, ..ORDINARY },
    Regime { name: "one spring collapsed to 1e-5 along an axis", collapse: 1e-5, aligned: true, ..ORDINARY },
    Regime { name: "1e6 m from the origin", stretch: 1.3, distance: 1e6, ..ORDINARY },
    Regime { name: "size 1e-6 m", stretch: 0.8, scale: 1e-6, ..ORDINARY },
    Regime { name: "size 1e6 m", stretch: 1.2, scale: 1e6, ..ORDINARY },
    Regime { name: "size 1e-3 m at 1e3 m", stretch: 0.9, scale: 1e-3, distance: 1e3, ..ORDINARY },
];

/// A tetrahedron with a fifth particle, one particle held and another free along two axes, all values unequal, in
/// nine regimes of strain, place and scale, with steps that resolve their vibrations.
///
/// # Errors
/// None in practice: every value follows the rules.
pub fn hard_states() -> Result<Vec<TestCase>> {
    REGIMES.iter().map(Regime::build).collect()
}

impl Regime {
    fn build(&self) -> Result<TestCase> {
        let shape = [[0.0, 0.0, 0.0], [1.1, 0.13, -0.21], [0.37, 0.93, 0.11], [0.41, 0.32, 0.97], [1.21, 1.13, 0.83]];
        let mut points = shape.map(Vector3::from);
        let gap = if self.aligned { Vector3::x() } else { points[4] - points[3] };
        points[4] = points[3] + gap * self.collapse;
        let centre = Vector3::new(0.6, -0.64, 0.48) * self.distance;
        let mut builder = SystemBuilder::new();
        for (p, point) in points.iter().enumerate() {
            builder.particle((point * self.scale + centre).into(), 0.4 + 0.31 * p as f64);
        }
        let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [3, 1], [2, 3], [3, 4], [4, 1]];
        for (s, [i, j]) in pairs.into_iter().enumerate() {
            let length = (builder.positions[i] - builder.positions[j]).norm();
            // Unequal strains of one kind: the excess over rest varies by half.
            let stretch = 1.0 + (self.stretch - 1.0) * (1.0 - 0.07 * s as f64);
            let rest_length = if self.collapse < 1.0 { 0.8 + 0.06 * s as f64 } else { length / stretch };
            builder.spring(i, j, Spring { stiffness: 40.0 + 37.0 * s as f64, rest_length, damping: 0.3 * s as f64 });
        }
        for (p, v) in builder.velocities.iter_mut().enumerate() {
            *v = Vector3::new(0.3 * p as f64, -0.2, 0.11 * (p * p) as f64) * self.scale;
        }
        builder.hold(0);
        builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[1]), motion: Motion::Held });
        let (system, state) = builder.build()?;
        let case = TestCase { name: self.name.into(), system, state, dt: 0.0, loaded: None };
        Ok(TestCase { dt: case.resolving_step(), ..case })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine regimes of five particles with masses of 0.4, 0.71, … kg, the first particle in the direction (15, −16, 12)/25.
    #[test]
    fn hard_states_have_the_distance_in_their_name() {
        let states = hard_states().unwrap();
        assert_eq!((states.len(), states[5].name.as_str()), (9, "1e6 m from the origin"));
        for TestCase { name, system, state, .. } in &states {
            for (p, mass) in [0.4, 0.71, 1.02, 1.33, 1.64].into_iter().enumerate() {
                assert!((system.masses()[p] - mass).abs() < 1e-15, "{name}");
            }
            let distances = [("1e6 m from", 1e6), ("at 1e3 m", 1e3)];
            let distance =
                distances.iter().find(|(words, _)| name.contains(words)).map_or(0.0, |&(_, distance)| distance);
            let expected = Vector3::new(0.6, -0.64, 0.48) * distance;
            assert!((state.positions[0] - expected).amax() <= 1e-15 * distance, "{name}");
        }
    }
}
