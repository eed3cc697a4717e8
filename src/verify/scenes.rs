//! The scenes that the program carries to verify itself on.

use super::TestCase;
use crate::error::Result;
use crate::scene::Scene;

/// Between them: compression, tension and prestress; held, led and partly held particles; one, two and three axes; free
/// and disconnected parts; equilibria; stiff and ill-conditioned systems.
const SCENES: [&str; 14] = [
    include_str!("scenes/buckled_column.toml"),
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

/// The built-in scenes, and the hard states of the Jacobian's checks with a step that resolves their vibrations.
///
/// # Errors
/// None: the suite builds every one of them.
pub fn built_in() -> Result<Vec<TestCase>> {
    let scenes = SCENES.iter().map(|text| TestCase::of_scene(&Scene::from_toml(text)?));
    let hard = super::hard_states()?.into_iter().map(|(name, system, state)| {
        let subject = TestCase { name: name.into(), system, state, dt: 0.0 };
        let dt = subject.resolving_step();
        Ok(TestCase { dt, ..subject })
    });
    scenes.chain(hard).collect()
}
