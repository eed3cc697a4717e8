//! Every solver on one step's system, against each other and against two independent libraries.

use super::solution::{
    Promise, Residual, Solved, backward_errors, condition_estimate, condition_is_right, indefinite_backward_error,
    largest, solutions_agree,
};
use super::{Check, Claim, Measured, TestCase, U};
use crate::assembly::SymmetricMatrix;
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::integrate::StepMatrices;
use crate::linear::{
    Cholesky, DefinitenessGuarantee, PreconditionerKind, Prepare, SolverChoice, SolverOptions, Tolerance, norm, select,
};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, DVector};
use nalgebra_sparse::CscMatrix;
use nalgebra_sparse::factorization::CscCholesky;

/// Rows up to which dense matrices are used.
const DENSE: usize = 400;

/// All solvers on the system of one step, under `Full` if that is definite, else under `Tension`.
pub(super) fn measure(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt, .. } = case;
    let geometry = SpringGeometry::at(system, &state.positions)?;
    let (option, matrix, b, mut factor) = definite(case)?;
    let operator = SystemOperator::new(system, &geometry, option, Combination::step(*dt));
    let scene = format!("{name}, {}", option.name());
    let a = matrix.to_csc();
    let mut solve = |x: &mut [f64]| factor.substitute(x);

    let mut reference = b.clone();
    solve(&mut reference);
    let reference = Solved { method: "Cholesky", x: &reference, promise: Promise::Stable };
    let mut checks = backward_errors(&a, &b, &reference, &scene)?;

    let tolerance = attainable(&a, &b, reference.x)?;
    let iterated = Promise::Tolerance(tolerance);
    let with = |choice, tolerance| solve_with(&operator, &b, choice, tolerance).map_err(|failure| failure.to_string());
    let right = DVector::from_column_slice(&b);
    let mut solutions = vec![("LDLᵀ", Promise::Stable, with(SolverChoice::Ldlt, 0.0))];
    // This factorization is not blocked.
    if a.nrows() <= 2500 {
        let x = CscCholesky::factor(&a).map(|factor| factor.solve(&right).as_slice().to_vec());
        solutions.push(("nalgebra-sparse's Cholesky", Promise::Stable, x.map_err(|error| error.to_string())));
    }
    if a.nrows() <= DENSE {
        let x = DMatrix::from(&a).cholesky().map(|factor| factor.solve(&right).as_slice().to_vec());
        let x = x.ok_or("the dense matrix is not positive definite".into());
        solutions.push(("dense Cholesky", Promise::Stable, x));
    }
    solutions.push(("CG, matrix-free", iterated, with(SolverChoice::Cg, tolerance)));
    solutions.push(("CG, assembled", iterated, with(SolverChoice::CgAssembled, tolerance)));
    for (method, promise, x) in solutions {
        let x = match x {
            Ok(x) => x,
            Err(reason) => {
                let name = format!("{method} against Cholesky");
                checks.push(Check::new(Claim::Solvers, name, &scene, f64::NAN, 0.0, reason));
                continue;
            }
        };
        let solved = Solved { method, x: &x, promise };
        checks.extend(backward_errors(&a, &b, &solved, &scene)?);
        checks.push(solutions_agree(&a, &b, &solved, &reference, &mut solve, &scene)?);
    }
    if option != Stiffness::Full {
        checks.extend(indefinite_check(case, &geometry)?);
    }
    if a.nrows() <= DENSE {
        checks.push(condition_is_right(&a, condition_estimate(&a, &mut solve), &scene));
    }
    Ok(checks)
}

/// LDLᵀ on the indefinite A of option `Full`: a result that it does not refuse must be a solution.
fn indefinite_check(case: &TestCase, geometry: &SpringGeometry) -> Result<Option<Check>> {
    let TestCase { name, system, state, dt, .. } = case;
    let step = StepMatrices::assemble(system, state, Stiffness::Full, *dt)?;
    let operator = SystemOperator::new(system, geometry, Stiffness::Full, Combination::step(*dt));
    let Ok(x) = solve_with(&operator, &step.b, SolverChoice::Ldlt, 0.0) else { return Ok(None) };
    indefinite_backward_error(&step.a.to_csc(), &step.b, &x, "LDLᵀ", &format!("{name}, full")).map(Some)
}

/// A, b and Cholesky's factor under the first option that makes A positive definite.
fn definite(case: &TestCase) -> Result<(Stiffness, SymmetricMatrix, Vec<f64>, Cholesky)> {
    for option in [Stiffness::Full, Stiffness::Tension] {
        let step = StepMatrices::assemble(&case.system, &case.state, option, case.dt)?;
        let mut factor = Cholesky::analyse(step.a.pattern(), Par::Seq)?;
        if factor.factor(&step.a).is_ok() {
            return Ok((option, step.a, step.b, factor));
        }
    }
    Err(Error::Unsupported("A is not positive definite even without the transverse terms of compressed springs".into()))
}

fn solve_with(operator: &SystemOperator, b: &[f64], solver: SolverChoice, tolerance: f64) -> Measured<Vec<f64>> {
    let preconditioner = Some(PreconditionerKind::BlockJacobi);
    let options =
        SolverOptions { solver, preconditioner, tolerance: Tolerance::Fixed(tolerance), ..SolverOptions::default() };
    let (mut work, mut x) = (Work::default(), vec![0.0; b.len()]);
    let mut solver = select(operator.system(), &options, DefinitenessGuarantee::Definite, &mut work)?;
    solver.prepare(operator, &mut work)?.solve(b, &mut x, &mut work)?;
    Ok(x)
}

/// A tolerance that conjugate gradients can reach: 1e-10, or that of rounding, `100 u ‖|A||x|‖₂/‖b‖₂`.
fn attainable(a: &CscMatrix<f64>, b: &[f64], x: &[f64]) -> Result<f64> {
    let rounding = 100.0 * U * norm(&Residual::new(a, b, x)?.terms) / norm(b);
    Ok(if largest(b) > 0.0 { rounding.max(1e-10) } else { 1e-10 })
}
