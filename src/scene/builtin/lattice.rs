use super::{Kind, gravity, hold, lasting};
use crate::error::Result;
use crate::scene::{Particles, Row, Scene, Springs};

/// A block of `size` × `size` × `size` particles, 1 cm apart, held at its face x = 0: a cantilever of firm jelly that
/// bends under its weight.
///
/// Structural springs join neighbours, others the diagonals of the faces of every cell. All have k = 4 N and
/// b = 0.002 N·s/m; 1000 kg/m³ make 1 g a particle. For 1 s. Particle (i, j, l) has number (i·size + j)·size + l.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn lattice(size: usize) -> Result<Scene> {
    /// Half of the neighbours: the others follow by symmetry.
    const REACH: [[isize; 3]; 9] =
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [0, 1, -1], [1, 0, 1], [1, 0, -1], [1, 1, 0], [1, -1, 0]];
    Kind::Lattice.check_size(size)?;
    let along = |coordinate: usize, by: isize| coordinate.checked_add_signed(by).filter(|&end| end < size);
    let number = |[i, j, l]: [usize; 3]| ((i * size + j) * size + l) as u32;
    let grid = || (0..size * size * size).map(|p| [p / (size * size), p / size % size, p % size]);
    let mut pairs = Vec::with_capacity(9 * size * size * size);
    for at @ [i, j, l] in grid() {
        for [di, dj, dl] in REACH {
            if let (Some(i), Some(j), Some(l)) = (along(i, di), along(j, dj), along(l, dl)) {
                pairs.push([number(at), number([i, j, l])]);
            }
        }
    }
    Ok(Scene {
        name: "lattice".into(),
        gravity: gravity(),
        particles: Particles {
            positions: grid().map(|at| Row::from(at.map(|coordinate| coordinate as f64 / 100.0))).collect(),
            masses: Some(0.001.into()),
            ..Particles::default()
        },
        springs: Springs { pairs, stiffness: Some(4.0.into()), damping: Some(0.002.into()), ..Springs::default() },
        constraints: vec![hold(0..size * size)],
        time: lasting(1.0),
        ..Scene::default()
    })
}
