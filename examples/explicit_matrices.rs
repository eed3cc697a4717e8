//! Gets A, M, G, K and b of a step as real sparse matrices, for faer and for nalgebra-sparse, and solves with both.

use faer::prelude::*;
use nalgebra_sparse::factorization::CscCholesky;
use sprung::Stiffness;
use sprung::integrate::StepMatrices;
use sprung::scene::builtin;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, state) = builtin::lattice(4)?.build()?;
    let StepMatrices { a, g, k, b, .. } = StepMatrices::assemble(&system, &state, Stiffness::Tension, 0.01)?;
    println!("A is {0} × {0}; stored entries of A, G and K:", b.len());
    println!("{} {} {}", a.values().len(), g.values().len(), k.values().len());

    // faer: a view of the stored lower triangle, nothing copied.
    let factor = a.as_faer().sp_cholesky(faer::Side::Lower).map_err(|error| format!("{error:?}"))?;
    let x = factor.solve(faer::ColRef::from_slice(&b));

    // nalgebra-sparse: both triangles by one call.
    let csc = a.to_csc();
    let y = CscCholesky::factor(&csc).map_err(|error| error.to_string())?.solve(&nalgebra::DVector::from_vec(b));

    let difference = (0..x.nrows()).map(|row| (x[row] - y[(row, 0)]).abs()).fold(0.0, f64::max);
    println!("largest difference between the two solutions: {difference:.1e} m");

    // Every row is a particle and an axis.
    println!("row 10 is {}", system.dofs().dof(10));
    Ok(())
}
