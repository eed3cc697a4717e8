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
    for (particle, row) in scene.particles.positions.iter_mut().enumerate() {
        let mut position = rest.positions[particle];
        for axis in 0..3 {
            // Multiples of the golden ratio, modulo 1, spread evenly.
            let uniform = ((3 * particle + axis) as f64 * 0.618_033_988_749_895).fract();
            position[axis] += 0.06 * spacing * (uniform - 0.5);
        }
        *row = <[f64; 3]>::from(position).into();
    }
    Ok(scene)
}
