use super::{Kind, hold, lasting, links};
use crate::error::Result;
use crate::scene::{Particles, Scene, Springs, Values};
use std::f64::consts::PI;

/// A string of `size` particles in the plane, stretched by 10 % between two held ends and struck in its lowest mode.
///
/// It is 1 m long with 10 g/m and k = 10 N, which makes a tension of 1 N and waves of 10 m/s: a period of 0.2 s. There
/// is no gravity and no damping. The initial velocity is 0.5 m/s·sin(πs) across the string, which takes it
/// 16 mm aside. For two periods.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn string(size: usize) -> Result<Scene> {
    Kind::String.check_size(size)?;
    let last = size + 1;
    let links_per_metre = last as f64;
    let speed = |i| match i {
        0 => 0.0,
        i if i == last => 0.0,
        i => 0.5 * (PI * i as f64 / links_per_metre).sin(),
    };
    Ok(Scene {
        name: "string".into(),
        particles: Particles {
            positions: (0..=last).map(|i| [i as f64 / links_per_metre, 0.0].into()).collect(),
            velocities: Some((0..=last).map(|i| [0.0, speed(i)].into()).collect()),
            masses: Some(Values::Uniform(0.01 / links_per_metre)),
        },
        springs: Springs {
            pairs: links(last),
            stiffness: Some(10.0.into()),
            rest_lengths: Some(Values::Uniform(1.0 / (1.1 * links_per_metre))),
            ..Springs::default()
        },
        constraints: vec![hold([0, last])],
        time: lasting(0.4),
        ..Scene::default()
    })
}

#[cfg(test)]
mod tests {
    /// The held ends are at rest to the last bit, and the middle is the fastest.
    #[test]
    fn the_ends_are_at_rest() {
        let velocities = super::string(5).unwrap().particles.velocities.unwrap();
        let speeds: Vec<f64> = velocities.iter().map(|row| row.as_slice()[1]).collect();
        assert_eq!([speeds[0], speeds[3], speeds[6]], [0.0, 0.5, 0.0]);
    }
}
