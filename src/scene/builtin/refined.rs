use super::{Kind, builtin};
use crate::error::{Error, Result};
use crate::scene::{Row, Scene, Values};

/// The scene of a kind and its [default size](Kind::default_size), in a mesh of `size`: of the same extent, mass and elasticity.
///
/// With s the ratio of the mesh widths, and in d dimensions (1 for chains, columns and strings, 2 for cloths, 3 for lattices), lengths
/// are as s, masses as s^d, and of springs, which stand for the material around them, the stiffness k as s^(d − 1) and the damping b as
/// s^(d − 2): forces per width, per area, are those of the same strains and strain rates. A mesh of N particles along a side has
/// N − 1 widths; the particles at the edges have full masses, by which it is a little heavier than a continuum.
///
/// # Errors
/// [`Error::Scene`] for a size outside [`Kind::sizes`], for a single particle, and for pendulums and networks, which are no meshes.
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin, refined};
///
/// let width = |scene: &sprung::Scene| scene.particles.positions.last().map(|last| last.as_slice()[0]);
/// let (coarse, fine) = (builtin(Kind::Cloth, 20)?, refined(Kind::Cloth, 39)?);
/// assert_eq!(fine.particles.positions.len(), 39 * 39);
/// assert_eq!(width(&coarse), width(&fine)); // 0.95 m
/// # Ok::<(), sprung::Error>(())
/// ```
pub fn refined(kind: Kind, size: usize) -> Result<Scene> {
    let scene = builtin(kind, size)?;
    // A side of N particles has N − 1 mesh widths, one of N links has N, and N joints are between N + 1.
    let (dimensions, widths): (i32, fn(usize) -> usize) = match kind {
        // It is 1 m long, whatever its size.
        Kind::String => return Ok(scene),
        Kind::Chain => (1, |links| links),
        Kind::Column => (1, |joints| joints + 1),
        Kind::Cloth => (2, |particles| particles - 1),
        Kind::Lattice => (3, |particles| particles - 1),
        Kind::Pendulum | Kind::Network => {
            return Err(Error::Scene(format!("a {} is no mesh that could be refined", kind.name())));
        }
    };
    if widths(size) == 0 {
        return Err(Error::Scene(format!("size {size}: a single particle has no extent")));
    }
    let ratio = widths(kind.default_size()) as f64 / widths(size) as f64;
    Ok(scaled(scene, ratio, dimensions))
}

fn scaled(mut scene: Scene, ratio: f64, dimensions: i32) -> Scene {
    let times = |values: &mut Option<Values>, factor: f64| match values {
        Some(Values::Uniform(value)) => *value *= factor,
        Some(Values::Each(values)) => values.iter_mut().for_each(|value| *value *= factor),
        None => {}
    };
    for row in &mut scene.particles.positions {
        *row = Row::of(&(row.vector() * ratio), row.dimension());
    }
    times(&mut scene.particles.masses, ratio.powi(dimensions));
    times(&mut scene.springs.rest_lengths, ratio);
    times(&mut scene.springs.stiffness, ratio.powi(dimensions - 1));
    times(&mut scene.springs.damping, ratio.powi(dimensions - 2));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mesh twice as fine has the same extent and, but for its faces, where particles stand for whole cells, the same mass and the same energy of a uniform
    /// stretch, `Σ k l0`; a block of twice the size, of the same springs, has not.
    #[test]
    fn a_finer_mesh_is_the_same_material() {
        let [coarse, fine] = [6, 11].map(|size| refined(Kind::Lattice, size).unwrap());
        let larger = builtin(Kind::Lattice, 11).unwrap();
        let figures = |scene: &Scene| {
            let (system, state) = scene.build().unwrap();
            let energy: f64 = system.springs().iter().map(|spring| spring.stiffness * spring.rest_length).sum();
            (*state.positions.last().unwrap(), system.masses().iter().sum::<f64>(), energy)
        };
        let ((corner, mass, energy), (same, fine_mass, fine_energy)) = (figures(&coarse), figures(&fine));
        assert!((corner - same).norm() < 1e-12);
        // 6³ cells stand for 5³ widths, and 11³ for 10³.
        assert!((fine_mass / mass - 1331.0 / 1000.0 / (216.0 / 125.0)).abs() < 1e-9);
        assert!((fine_energy / energy - 1.0).abs() < 0.35, "{energy} {fine_energy}");
        assert!((figures(&larger).0 - corner).norm() > 0.05 && figures(&larger).2 > 2.0 * energy);
    }

    /// Mass, stiffness of a side and extent, by dimension.
    #[test]
    fn materials_stay() {
        for (kind, size, dimensions) in [(Kind::Chain, 40, 1), (Kind::Column, 19, 1), (Kind::Cloth, 39, 2)] {
            let [coarse, fine] = [builtin(kind, kind.default_size()), refined(kind, size)].map(Result::unwrap);
            let number = |values: &Option<Values>| match values {
                Some(Values::Uniform(value)) => *value,
                other => panic!("{other:?}"),
            };
            let ratio = |get: fn(&Scene) -> &Option<Values>| number(get(&fine)) / number(get(&coarse));
            let close =
                |found: f64, power: i32| assert!((found / 0.5f64.powi(power) - 1.0).abs() < 1e-12, "{kind:?} {found}");
            close(ratio(|scene| &scene.particles.masses), dimensions);
            close(ratio(|scene| &scene.springs.stiffness), dimensions - 1);
            close(ratio(|scene| &scene.springs.damping), dimensions - 2);
        }
        assert!(refined(Kind::Pendulum, 3).is_err() && refined(Kind::Network, 50).is_err());
        assert!(refined(Kind::Cloth, 1).is_err() && refined(Kind::Cloth, 0).is_err());
        assert_eq!(refined(Kind::String, 9).unwrap(), builtin(Kind::String, 9).unwrap());
    }
}
