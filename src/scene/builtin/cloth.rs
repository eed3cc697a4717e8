use super::{Kind, gravity, hold, lasting};
use crate::error::Result;
use crate::scene::{Particles, Row, Scene, Springs};

/// A square cloth of `size` × `size` particles, 5 cm apart, that swings down from two corners.
///
/// Structural springs join neighbours, shear springs the diagonals, bend springs every second particle. All are of
/// the same thread, k = 1250 N, with b = 0.05 N·s/m; 0.2 kg/m² make 0.5 g a particle. For 2 s; (k/l0)·dt²/m is
/// 5000 for the structural springs and steps of 10 ms. Particle (row, column) has number row·size + column.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a size outside [`Kind::sizes`].
pub fn cloth(size: usize) -> Result<Scene> {
    Kind::Cloth.check_size(size)?;
    let particle = |row: usize, column: usize| (row < size && column < size).then_some(row * size + column);
    let grid = || (0..size).flat_map(|row| (0..size).map(move |column| (row, column)));
    let mut pairs = Vec::with_capacity(6 * size * size);
    for (row, column) in grid() {
        let structural_and_bend = [1, 2].map(|reach| [(row, column + reach), (row + reach, column)]);
        for (end_row, end_column) in structural_and_bend.into_iter().flatten() {
            pairs.extend(join(particle(row, column), particle(end_row, end_column)));
        }
        pairs.extend(join(particle(row, column), particle(row + 1, column + 1)));
        pairs.extend(join(particle(row, column + 1), particle(row + 1, column)));
    }
    let position = |(row, column)| Row::from([column as f64 / 20.0, 0.0, row as f64 / 20.0]);
    Ok(Scene {
        name: "cloth".into(),
        gravity: gravity(),
        particles: Particles {
            positions: grid().map(position).collect(),
            masses: Some(0.0005.into()),
            ..Particles::default()
        },
        springs: Springs { pairs, stiffness: Some(1250.0.into()), damping: Some(0.05.into()), ..Springs::default() },
        constraints: vec![hold(if size > 1 { vec![0, size - 1] } else { vec![0] })],
        time: lasting(2.0),
        ..Scene::default()
    })
}

fn join(i: Option<usize>, j: Option<usize>) -> Option<[u32; 2]> {
    i.zip(j).map(|(i, j)| [i as u32, j as u32])
}
