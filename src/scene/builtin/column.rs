use super::{Kind, gravity, hold, lasting, links};
use crate::error::Result;
use crate::scene::{Particles, Scene, Springs};

/// A column of `size` joints between two held ends, its links compressed by 5 %: it buckles into a zigzag.
///
/// The links are 9.5 cm long and 10 cm at rest, with k = 1000 N and b = 1 N·s/m; a joint has 0.1 kg. Nothing braces it
/// sideways: each joint is 0.1 mm off the axis, alternately in x and in −x, so that buckling does not wait for rounding.
///
/// With c = k (1/l − 1/l0) = 526 N/m the matrix with the whole stiffness is definite up to about
/// dt = sqrt(m/(c (2 + 2 cos(π/(size + 1))))) ≥ 6.9 ms and indefinite beyond. For 0.5 s.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn column(size: usize) -> Result<Scene> {
    Kind::Column.check_size(size)?;
    let last = size + 1;
    let sideways = |i| match i {
        0 => 0.0,
        i if i == last => 0.0,
        i if i % 2 == 0 => -0.0001,
        _ => 0.0001,
    };
    Ok(Scene {
        name: "column".into(),
        gravity: gravity(),
        particles: Particles {
            positions: (0..=last).map(|i| [sideways(i), 19.0 * i as f64 / 200.0, 0.0].into()).collect(),
            masses: Some(0.1.into()),
            ..Particles::default()
        },
        springs: Springs {
            pairs: links(last),
            stiffness: Some(1000.0.into()),
            rest_lengths: Some(0.1.into()),
            damping: Some(1.0.into()),
            ..Springs::default()
        },
        constraints: vec![hold([0, last])],
        time: lasting(0.5),
        ..Scene::default()
    })
}
