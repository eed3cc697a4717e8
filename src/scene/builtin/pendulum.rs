use super::{GRAVITY, Kind, hold, lasting, links};
use crate::error::Result;
use crate::scene::{Particles, Scene, Springs};

/// A pendulum of `size` bobs in the plane, let go from the horizontal: one bob is the simple pendulum, two the double one.
///
/// The rods are 1 m long with k = 10⁴ N and undamped, a bob has 1 kg: the axial mode of one bob, ω = sqrt(k/(l0 m)) =
/// 100 rad/s, is 32 times as fast as the swing, sqrt(g/l) = 3.1 rad/s. For 4 s.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn pendulum(size: usize) -> Result<Scene> {
    Kind::Pendulum.check_size(size)?;
    let [x, y, _] = GRAVITY;
    Ok(Scene {
        name: "pendulum".into(),
        gravity: Some([x, y].into()),
        particles: Particles {
            positions: (0..=size).map(|i| [i as f64, 0.0].into()).collect(),
            masses: Some(1.0.into()),
            ..Particles::default()
        },
        springs: Springs { pairs: links(size), stiffness: Some(10_000.0.into()), ..Springs::default() },
        constraints: vec![hold([0])],
        time: lasting(4.0),
        ..Scene::default()
    })
}
