//! The scenes: stiff and soft, damped and not, held, moved and free, of one particle to two thousand.

use crate::Failure;
use sprung::scene::{Kind, Scene, builtin};
use std::path::Path;

/// Whole frames of 1/60 s, so that simulators which count in frames can follow.
const FRAME: f64 = 1.0 / 60.0;

/// A scene, and for how long it is predictable: longer, chains whip and cloths fold.
pub struct TestCase {
    pub scene: Scene,
    /// What it is, for the page.
    pub words: &'static str,
    pub frames: u32,
}

impl TestCase {
    /// In s.
    pub fn duration(&self) -> f64 {
        f64::from(self.frames) * FRAME
    }
}

/// All ten, small ones first.
pub fn all(verification: &Path) -> Result<Vec<TestCase>, Failure> {
    let load = |name: &str| Scene::load(verification.join("../src/verify/scenes").join(name));
    let subject = |scene, frames, words| TestCase { scene, words, frames };
    Ok(vec![
        subject(
            load("stiff_pendulum.toml")?,
            120,
            "one particle on a rod that vibrates a hundred times as fast as it swings, undamped",
        ),
        subject(
            load("moving_anchor.toml")?,
            120,
            "a damped double pendulum between two anchors that move, one along a path with kinks",
        ),
        subject(load("tetrahedron.toml")?, 120, "four free particles, soft and damped, tumbling"),
        subject(load("taut_string.toml")?, 120, "seven particles between two walls, stretched by half"),
        subject(builtin(Kind::Column, 9)?, 9, "nine joints pressed together by 5 %: it buckles"),
        subject(builtin(Kind::Chain, 20)?, 30, "twenty links let go from the horizontal"),
        subject(builtin(Kind::Cloth, 6)?, 12, "6 × 6 stiff particles that begin to swing down"),
        subject(builtin(Kind::Network, 60)?, 30, "60 particles in a random network, all values unequal"),
        subject(builtin(Kind::Lattice, 10)?, 12, "a block of 10³ particles, held at one face"),
        subject(Scene::load(verification.join("scenes/bunny.toml"))?, 20, "a mesh of 1839 particles, so damped that damping is what is stiff"),
    ])
}
