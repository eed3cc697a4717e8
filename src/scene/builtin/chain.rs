use super::{Kind, gravity, hold, lasting, links};
use crate::error::Result;
use crate::scene::{Particles, Scene, Springs};

/// A chain of `size` links of 5 cm and 10 g, held at one end and let go from the horizontal.
///
/// k = 100 N, so that a link stretches by 0.1 % for each link below it; b = 0.02 N·s/m; for 2 s.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn chain(size: usize) -> Result<Scene> {
    Kind::Chain.check_size(size)?;
    Ok(Scene {
        name: "chain".into(),
        gravity: gravity(),
        particles: Particles {
            positions: (0..=size).map(|i| [i as f64 / 20.0, 0.0, 0.0].into()).collect(),
            masses: Some(0.01.into()),
            ..Particles::default()
        },
        springs: Springs {
            pairs: links(size),
            stiffness: Some(100.0.into()),
            damping: Some(0.02.into()),
            ..Springs::default()
        },
        constraints: vec![hold([0])],
        time: lasting(2.0),
        ..Scene::default()
    })
}
