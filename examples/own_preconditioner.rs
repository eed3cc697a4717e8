//! Hands a preconditioner of your own to conjugate gradients: here symmetric Gauss–Seidel.
//!
//! With `A = L + D + Lᵀ` it is `P = (D + L) D⁻¹ (D + L)ᵀ`: one solve with each triangle, both by the columns of the lower one.

use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
use sprung::linear::{CgSolver, CustomPreconditioner, PreconditionerKind, SolveFailure, SolverOptions};
use sprung::operator::SystemOperator;
use sprung::scene::{Kind, builtin};
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::sync::Arc;

#[derive(Debug)]
struct GaussSeidel {
    matrix: SystemMatrix,
}

impl GaussSeidel {
    fn new(system: &System) -> sprung::Result<Self> {
        Ok(Self { matrix: SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?)) })
    }
}

impl CustomPreconditioner for GaussSeidel {
    fn name(&self) -> &'static str {
        "gauss-seidel"
    }

    fn update(&mut self, a: &SystemOperator, _: &mut Work) -> Result<(), SolveFailure> {
        self.matrix.refill(a);
        Ok(())
    }

    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let lower = self.matrix.matrix().as_faer();
        // A column holds its diagonal entry first, then those below.
        let column = |j: usize| lower.row_idx_of_col(j).zip(lower.val_of_col(j).iter().copied());
        z.copy_from_slice(r);
        for j in 0..z.len() {
            let mut entries = column(j);
            let Some((_, diagonal)) = entries.next() else { continue };
            let y = z[j] / diagonal;
            entries.for_each(|(i, l)| z[i] -= l * y);
            // D y, which the other triangle starts from, is what stands there already.
        }
        for j in (0..z.len()).rev() {
            let mut entries = column(j);
            let Some((_, diagonal)) = entries.next() else { continue };
            let below: f64 = entries.map(|(i, l)| l * z[i]).sum();
            z[j] = (z[j] - below) / diagonal;
        }
    }
}

/// Steps a system; returns the iterations and the end.
fn run(system: &System, start: &State, solver: CgSolver) -> Result<(u64, State), Box<dyn std::error::Error>> {
    // Solves to the last digit are to be compared.
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear: SolverOptions::default() };
    let mut stepper = LinearBackwardEuler::with_solver(system, start, &options, Box::new(solver))?;
    let mut state = start.clone();
    for _ in 0..10 {
        stepper.step(&mut state, 0.02)?;
    }
    Ok((stepper.statistics().work.cg_iterations, state))
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, start) = builtin(Kind::Network, 300)?.build()?;
    let own = CgSolver::with_preconditioner(&system, Box::new(GaussSeidel::new(&system)?), 1e-10);
    let (iterations, a) = run(&system, &start, own)?;
    let jacobi = CgSolver::matrix_free(&system, PreconditionerKind::BlockJacobi, 1e-10)?;
    let (with_jacobi, b) = run(&system, &start, jacobi)?;
    let apart = a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    println!("{iterations} iterations instead of {with_jacobi} with block Jacobi, {apart:.1e} m apart");
    assert!(iterations < with_jacobi && apart < 1e-6);
    Ok(())
}
