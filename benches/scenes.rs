//! The scenes that everything is measured on.

use sprung::scene::Values;
use sprung::{Result, Scene};

/// A cloth of n × n or a lattice of n³ particles at rest, stiffened and shaken: `(k/l0) dt²/m` is 5000 or 4000 at
/// dt = 0.01 s, and every coordinate is moved by up to 3 % of the spacing, so that no spring lies along an axis.
pub fn scene(kind: &str, size: usize) -> Result<Scene> {
    let (mut scene, spacing, stiffness) = match kind {
        "lattice" => (sprung::scene::builtin::lattice(size)?, 0.01, 400.0),
        _ => (sprung::scene::builtin::cloth(size)?, 0.05, 1250.0),
    };
    scene.springs.stiffness = Some(stiffness.into());
    let rest = scene.builder()?;
    let lengths = rest.pairs.iter().map(|pair| {
        let [i, j] = pair.map(|end| rest.positions[end as usize]);
        (i - j).norm()
    });
    scene.springs.rest_lengths = Some(Values::Each(lengths.collect()));
    let mut seed = 1u64;
    let mut uniform = || {
        // Knuth's linear congruential generator; its high bits are good.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        2.0 * (seed >> 11) as f64 / (1u64 << 53) as f64 - 1.0
    };
    for (position, row) in rest.positions.iter().zip(&mut scene.particles.positions) {
        let moved = position.map(|x| x + 0.03 * spacing * uniform());
        *row = <[f64; 3]>::from(moved).into();
    }
    Ok(scene)
}
