//! Assembles a matrix from blocks of your own: here bending elements of three particles, which are no springs.
//!
//! The energy `½ κ ‖x_i − 2 x_j + x_k‖²` of an element has the Hessian `κ wwᵀ ⊗ I` with `w = (1, −2, 1)`.

use nalgebra::Matrix3;
use sprung::DofMap;
use sprung::assembly::{BlockPattern, SymmetricMatrix};
use sprung::linear::Cholesky;
use std::sync::Arc;

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    const PARTICLES: usize = 50;
    let kappa = 3.0;
    let elements: Vec<[usize; 3]> = (0..PARTICLES - 2).map(|i| [i, i + 1, i + 2]).collect();
    let weights = [1.0, -2.0, 1.0];

    // The pattern and the slot of every off-diagonal block, once.
    let dofs = DofMap::unconstrained(PARTICLES);
    let corners = [(0, 1), (0, 2), (1, 2)];
    let pairs = elements.iter().flat_map(|e| corners.map(|(a, b)| [e[a], e[b]]));
    let pattern = Arc::new(BlockPattern::new(&dofs, pairs.clone())?);
    let slots: Vec<_> = pairs.filter_map(|[i, j]| pattern.slot(i, j)).collect();

    // The values, as often as they change: no search, no sort, no allocation.
    let mut matrix = SymmetricMatrix::zeros(pattern.clone());
    for particle in 0..PARTICLES {
        matrix.add_to_diagonal(particle, 1.0);
    }
    for (element, slots) in elements.iter().zip(slots.chunks(3)) {
        for (particle, w) in element.iter().zip(weights) {
            matrix.add_diagonal_block(*particle, &Matrix3::from_diagonal_element(kappa * w * w));
        }
        for (slot, (a, b)) in slots.iter().zip(corners) {
            matrix.add_block(*slot, &Matrix3::from_diagonal_element(kappa * weights[a] * weights[b]));
        }
    }

    let mut cholesky = Cholesky::analyse(&pattern, faer::Par::Seq)?;
    cholesky.factor(&matrix).map_err(|pivot| format!("not positive definite at {}", pivot.dof))?;
    let mut x = vec![1.0; dofs.len()];
    cholesky.solve_in_place(&mut x)?;
    println!("{} entries, x = {:.3} … {:.3}", pattern.entries(), x[0], x[75]);
    Ok(())
}
