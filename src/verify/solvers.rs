//! Every solver on one step's system, against each other and against two independent libraries.

use super::TestCase;
use super::check::Check;
use super::claim::Claim;
use super::condition::Condition;
use super::force_error::U;
use super::measured::Measured;
use super::products::{products_agree, refill_is_fresh};
use super::residual::{Residual, largest};
use super::solution::{
    Promise, Solved, backward_errors, condition_is_right, indefinite_backward_error, solutions_agree, tolerance_is_met,
};
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::integrate::StepMatrices;
use crate::linear::{Cholesky, PreconditionerKind, Prepare, SolverChoice, SolverOptions, Tolerance, select};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, DVector};
use nalgebra_sparse::CscMatrix;
use nalgebra_sparse::factorization::CscCholesky;
use std::sync::Arc;

/// Rows up to which nalgebra-sparse, which is not blocked, factors in a moment.
const SPARSE_LIMIT: usize = 2500;

/// Rows up to which dense matrices are used.
const DENSE_LIMIT: usize = 400;

/// Products and refill of A, for every option.
///
/// The refilled matrix held other values before: those of twice the step under another option.
pub(super) fn assembly(subject: &TestCase) -> Measured {
    let TestCase { name, system, state, dt } = subject;
    let extensions = SpringGeometry::at(system, &state.positions)?;
    let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let scene = format!("{name}, {}", option.name());
        let before = if option == Stiffness::Full { Stiffness::Axial } else { Stiffness::Full };
        let before = SystemOperator::new(system, &extensions, before, Combination::step(2.0 * dt));
        let operator = SystemOperator::new(system, &extensions, option, Combination::step(*dt));
        let mut matrix = SystemMatrix::assemble(pattern.clone(), &before);
        matrix.refill(&operator);
        checks.push(products_agree(&operator, matrix.matrix(), &scene));
        checks.push(refill_is_fresh(&operator, matrix.matrix(), &scene));
        // K alone, where no mass hides what springs cancel.
        let stiffness = SystemOperator::new(system, &extensions, option, Combination::STIFFNESS);
        matrix.refill(&stiffness);
        checks.push(products_agree(&stiffness, matrix.matrix(), &format!("{scene}, K")));
    }
    Ok(checks)
}

/// All solvers on the system of one step.
///
/// Under `Full` if that is definite, else under `Tension`. Backward errors of both factorizations, the residuals of
/// conjugate gradients matrix-free and assembled, their agreement within what the condition allows, and on small scenes
/// that with nalgebra-sparse's Cholesky and a dense one, and the condition estimate itself.
pub(super) fn solvers(subject: &TestCase) -> Measured {
    let TestCase { name, system, state, dt } = subject;
    let dt = *dt;
    let extensions = SpringGeometry::at(system, &state.positions)?;
    let (option, matrix, b, mut factor) = definite(system, state, dt)?;
    let operator = SystemOperator::new(system, &extensions, option, Combination::step(dt));
    let scene = format!("{name}, {}", option.name());
    let a = matrix.to_csc();
    let mut solve = |x: &mut [f64]| factor.substitute(x);

    let mut reference = b.clone();
    solve(&mut reference);
    let reference = Solved { method: "Cholesky", x: &reference, promise: Promise::Stable };
    let mut checks = backward_errors(&a, &b, &reference, &scene);

    let failed = |method: &str, reason: String| {
        Check::new(Claim::Solvers, format!("{method} against Cholesky"), &scene, f64::NAN, 0.0, reason)
    };
    let direct = [("LDLᵀ", solve_with(system, &operator, &b, SolverChoice::Ldlt, 0.0))];
    let independent = [("nalgebra-sparse's Cholesky", sparse(&a, &b)), ("dense Cholesky", dense(&a, &b))];
    let independent = independent.into_iter().filter_map(|(method, x)| x.map(|x| (method, x)));
    for (method, x) in direct.into_iter().chain(independent) {
        match x {
            Ok(x) => {
                let solved = Solved { method, x: &x, promise: Promise::Stable };
                checks.extend(backward_errors(&a, &b, &solved, &scene));
                checks.push(solutions_agree(&a, &b, &solved, &reference, &mut solve, &scene));
            }
            Err(reason) => checks.push(failed(method, reason)),
        }
    }
    let tolerance = attainable(&a, &b, reference.x);
    let iterations = [("CG, matrix-free", SolverChoice::Cg), ("CG, assembled", SolverChoice::CgAssembled)];
    for (method, choice) in iterations {
        match solve_with(system, &operator, &b, choice, tolerance) {
            Ok(x) => {
                let solved = Solved { method, x: &x, promise: Promise::Tolerance(tolerance) };
                checks.push(tolerance_is_met(&a, &b, &x, tolerance, method, &scene));
                checks.push(solutions_agree(&a, &b, &solved, &reference, &mut solve, &scene));
            }
            Err(reason) => checks.push(failed(method, reason)),
        }
    }
    if option != Stiffness::Full {
        checks.extend(indefinite_check(system, state, dt, &format!("{name}, full"))?);
    }
    if a.nrows() <= DENSE_LIMIT {
        checks.push(condition_is_right(&a, &Condition::estimate(&a, &mut solve), &scene));
    }
    Ok(checks)
}

/// LDLᵀ on the indefinite A of option `Full`: what it does not refuse must be a solution.
fn indefinite_check(system: &System, state: &State, dt: f64, scene: &str) -> Result<Option<Check>> {
    let extensions = SpringGeometry::at(system, &state.positions)?;
    let step = StepMatrices::assemble(system, state, Stiffness::Full, dt)?;
    let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(dt));
    let solved = solve_with(system, &operator, &step.b, SolverChoice::Ldlt, 0.0);
    Ok(solved.ok().map(|x| indefinite_backward_error(&step.a.to_csc(), &step.b, &x, "LDLᵀ", scene)))
}

/// A, b and Cholesky's factor under the first option that makes A positive definite.
fn definite(system: &System, state: &State, dt: f64) -> Result<(Stiffness, SymmetricMatrix, Vec<f64>, Cholesky)> {
    for option in [Stiffness::Full, Stiffness::Tension] {
        let step = StepMatrices::assemble(system, state, option, dt)?;
        let mut factor = Cholesky::analyse(step.a.pattern(), Par::Seq)?;
        if factor.factor(&step.a).is_ok() {
            return Ok((option, step.a, step.b, factor));
        }
    }
    Err(Error::Unsupported("A is not positive definite even without the transverse terms of compressed springs".into()))
}

fn options(solver: SolverChoice, tolerance: f64) -> SolverOptions {
    let preconditioner = Some(PreconditionerKind::BlockJacobi);
    SolverOptions { solver, preconditioner, tolerance: Tolerance::Fixed(tolerance), ..SolverOptions::default() }
}

fn solve_with(
    system: &System,
    operator: &SystemOperator,
    b: &[f64],
    solver: SolverChoice,
    tolerance: f64,
) -> Result<Vec<f64>, String> {
    let options = options(solver, tolerance);
    let mut work = Work::default();
    let mut solver = select(system, &options, crate::linear::DefinitenessGuarantee::Definite, &mut work)
        .map_err(|error| error.to_string())?;
    let mut x = vec![0.0; b.len()];
    let prepared = solver.prepare(operator, &mut work);
    prepared.and_then(|mut solver| solver.solve(b, &mut x, &mut work)).map_err(|failure| failure.to_string())?;
    Ok(x)
}

/// The tolerance to ask of conjugate gradients: 1e-10, or what rounding lets them reach, `100 u ‖|A||x|‖₂/‖b‖₂`.
fn attainable(a: &CscMatrix<f64>, b: &[f64], x: &[f64]) -> f64 {
    let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let rounding = Residual::new(a, b, x).map_or(0.0, |residual| 100.0 * U * norm(&residual.terms) / norm(b));
    if largest(b) > 0.0 { rounding.max(1e-10) } else { 1e-10 }
}

type Attempt = Option<Result<Vec<f64>, String>>;

fn sparse(a: &CscMatrix<f64>, b: &[f64]) -> Attempt {
    (a.nrows() <= SPARSE_LIMIT).then(|| {
        let factor = CscCholesky::factor(a).map_err(|error| error.to_string())?;
        Ok(factor.solve(&DVector::from_column_slice(b)).as_slice().to_vec())
    })
}

fn dense(a: &CscMatrix<f64>, b: &[f64]) -> Attempt {
    (a.nrows() <= DENSE_LIMIT).then(|| {
        let factor = DMatrix::from(a).cholesky().ok_or("the dense matrix is not positive definite")?;
        Ok(factor.solve(&DVector::from_column_slice(b)).as_slice().to_vec())
    })
}
