//! What cannot be solved is reported, with the reason and the place, and never answered silently.
//!
//! On the squeezed twin of the scene, in which every spring wants to buckle, at a step at which A has negative eigenvalues:
//! Cholesky refuses, LDLᵀ counts them and its solution satisfies the equations or is refused, conjugate gradients with a
//! right-hand side that has all modes report a direction whose curvature really is negative. Conjugate gradients also
//! report a limit that is too low, a tolerance that rounding cannot meet and numbers that are not finite; a spring
//! whose ends coincide is named.

use super::definiteness::Factored;
use super::measured::Measured;
use super::reference::{self, dense_step_matrix, field};
use super::{Check, Claim, TestCase, U, Unfinished, worst};
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::integrate::{ImplicitOptions, LinearBackwardEuler, Status, StepFailure, TimeStepper};
use crate::linear::{
    CgOutcome, ConjugateGradient, LdltSolver, Preconditioner, PreconditionerKind, Prepare, SolveFailure, SolverChoice,
    SolverOptions, backward_error, norm,
};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::DVector;

/// About so many springs of a scene are collapsed in turn.
const COLLAPSED: usize = 64;

/// How a thing that must be reported counts: 0 when it was, 1 when it was not.
fn silent(reported: bool) -> f64 {
    if reported { 0.0 } else { 1.0 }
}

/// The shortest step, doubling from the subject's, at which A of the squeezed twin is indefinite beyond rounding.
fn indefinite_step(twin: &TestCase) -> Option<(f64, usize)> {
    (0..24).map(|doubling| twin.dt * f64::from(1 << doubling)).find_map(|dt| {
        let eigenvalues = dense_step_matrix(twin, Stiffness::Full, dt).symmetric_eigenvalues();
        let scale = eigenvalues.amax();
        // Clearly negative: conjugate gradients must meet it before they converge.
        let negative = eigenvalues.iter().filter(|&&value| value < 0.0).count();
        let clear = eigenvalues.iter().any(|&value| value < -1e-3 * scale);
        let told = eigenvalues.iter().all(|value| value.abs() > 1e4 * U * scale);
        (clear && told).then_some((dt, negative))
    })
}

pub(super) fn applies(subject: &TestCase) -> bool {
    let squeezes = || subject.squeezed().ok().and_then(|twin| indefinite_step(&twin)).is_some();
    super::definiteness::is_small(subject) && squeezes()
}

pub(super) fn indefinite(subject: &TestCase) -> Measured {
    let twin = subject.squeezed()?;
    let Some((dt, negative)) = indefinite_step(&twin) else { return Ok(Vec::new()) };
    let system = &twin.system;
    let n = system.dofs().len();
    let dense = dense_step_matrix(&twin, Stiffness::Full, dt);
    let extensions = SpringGeometry::at(system, &twin.state.positions)?;
    let a = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(dt));
    let b = reference::free(system, &field(system));
    let check = |name: &str, value: f64, why: &str| Check::new(Claim::Failure, name, &twin.name, value, 0.0, why);
    let mut checks = Vec::new();

    let matrix = crate::integrate::StepMatrices::assemble(system, &twin.state, Stiffness::Full, dt)?.a;
    let accepted = Factored::new(&twin)?.cholesky.factor(&matrix).is_ok();
    let why = "a Cholesky factorization exists if and only if A is positive definite";
    checks.push(check("Cholesky refuses an indefinite matrix", silent(!accepted), why));

    let mut work = Work::default();
    let mut ldlt = LdltSolver::new(system, Par::Seq, &mut work)?;
    let mut prepared = ldlt.prepare(&a, &mut work)?;
    let counted = prepared.definiteness();
    let told = matches!(counted, crate::linear::Definiteness::Indefinite { negative: found, .. } if found == negative);
    let why = "by Sylvester's law of inertia the signs of D are those of the eigenvalues";
    checks.push(check("LDLᵀ counts the negative eigenvalues", silent(told), why));
    let mut x = vec![0.0; n];
    let value = match prepared.solve(&b, &mut x, &mut work) {
        Ok(_) => {
            let residual = DVector::from_column_slice(&b) - &dense * DVector::from_column_slice(&x);
            backward_error(residual.as_slice(), reference::step_matrix_norm(&twin, &twin.state, dt), &x, &b)
        }
        Err(SolveFailure::Untrusted { .. }) => 0.0,
        Err(failure) => return Err(failure.into()),
    };
    let why =
        "a solution is given only with a backward error of at most 1e-12, whatever rounding does to an unpivoted LDLᵀ";
    checks.push(Check::new(Claim::Failure, "LDLᵀ vouches for its solution", &twin.name, value, 1e-12, why));

    use PreconditionerKind::{BlockJacobi, Jacobi, Multigrid, None};
    for kind in [None, Jacobi, BlockJacobi, Multigrid] {
        let mut preconditioner = Preconditioner::new(kind, system)?;
        preconditioner.set_positions(&twin.state.positions);
        // A diagonal block or coarse matrix that is not definite is found before the first iteration: reported already.
        let reported = match preconditioner.update(&a, &mut Work::default()) {
            Err(_) => true,
            Ok(()) => {
                let mut cg = ConjugateGradient::new(n, 1e-12);
                let report = cg.solve(&a, &mut preconditioner, &b, &mut vec![0.0; n]);
                let p = DVector::from_column_slice(cg.direction());
                matches!(report.outcome, CgOutcome::NegativeCurvature { .. }) && p.dot(&(&dense * &p)) <= 0.0
            }
        };
        let why = "in exact arithmetic n iterations from a right-hand side with all modes meet every eigenvector; pᵀAp is \
                   computed again with formulas that were written a second time";
        let name = format!("conjugate gradients report negative curvature, {kind:?}");
        checks.push(check(&name, silent(reported), why));
    }
    Ok(checks)
}

pub(super) fn has_system(subject: &TestCase) -> bool {
    subject.system.dofs().len() > 1 && !subject.system.active_springs().is_empty()
}

pub(super) fn conjugate_gradients(subject: &TestCase) -> Measured {
    let system = &subject.system;
    let n = system.dofs().len();
    let extensions = SpringGeometry::at(system, &subject.state.positions)?;
    let a = SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(subject.dt));
    let b = reference::free(system, &field(system));
    let mut identity = Preconditioner::Identity;
    let check = |name: &str, value: f64, why: &str| Check::new(Claim::Failure, name, &subject.name, value, 0.0, why);
    let mut checks = Vec::new();

    let mut cg = ConjugateGradient::new(n, 1e-10);
    cg.iteration_limit = 0;
    let report = cg.solve(&a, &mut identity, &b, &mut vec![0.0; n]);
    let why = "no iteration is allowed, and zero is not the solution";
    checks.push(check("iteration limit is reported", silent(report.outcome == CgOutcome::IterationLimit), why));

    // A tolerance far below rounding, which only an exact solution could meet.
    let mut cg = ConjugateGradient::new(n, 1e-30);
    let mut x = vec![0.0; n];
    let report = cg.solve(&a, &mut identity, &b, &mut x);
    let exact = report.outcome == CgOutcome::Converged && report.relative_residual <= 1e-30;
    let gave_up = matches!(report.outcome, CgOutcome::Stagnated | CgOutcome::IterationLimit);
    let why = "a residual of 1e-30 of the right-hand side is below rounding: only an exact solution may claim it";
    checks.push(check("stagnation is reported", silent(exact || gave_up), why));

    let again = true_residual(&a, &b, &x);
    let error = (report.relative_residual / again - 1.0).abs();
    let value = if report.relative_residual == again { 0.0 } else { error };
    let why = "relative: the residual of the solution, computed again with the same product, and not that of the recurrence, \
               which goes on falling where rounding has stopped the solution";
    checks.push(Check::new(Claim::Failure, "the reported residual is the true one", &subject.name, value, 1e-12, why));

    let mut poisoned = b.clone();
    poisoned[n / 2] = f64::NAN;
    let report = ConjugateGradient::new(n, 1e-10).solve(&a, &mut identity, &poisoned, &mut vec![0.0; n]);
    let why = "a right-hand side with a NaN has no solution";
    checks.push(check("NaN is reported", silent(report.outcome == CgOutcome::NonFinite), why));
    Ok(checks)
}

/// `‖b − A x‖/‖b‖`.
fn true_residual(a: &impl LinearOperator, b: &[f64], x: &[f64]) -> f64 {
    let mut product = vec![0.0; b.len()];
    a.apply(x, &mut product);
    let residual: Vec<f64> = b.iter().zip(&product).map(|(b, q)| b - q).collect();
    norm(&residual) / norm(b)
}

/// NaN in a state, and coincident ends: the step fails with the right reason, and the state is as it was.
pub(super) fn broken_states(subject: &TestCase) -> Measured {
    let TestCase { system, state, .. } = subject;
    let mut checks = Vec::new();
    for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled] {
        let (mut fast, mut astray) = (state.clone(), state.clone());
        let dof = system.dofs().dof(0);
        fast.velocities[dof.particle][dof.axis] = f64::NAN;
        astray.positions[seen(system).unwrap_or(dof.particle)][0] = f64::NAN;
        for (what, mut poisoned) in [("velocities", fast), ("positions", astray)] {
            let outcome = stepper(subject, solver)?.step(&mut poisoned, subject.dt);
            let reported = outcome.is_err_and(|failure| failure.status() == Status::NonFinite);
            let name = format!("a NaN in the {what} is reported, {solver:?}");
            let why = "a step from a state that is not finite must fail as such";
            checks.push(Check::new(Claim::Failure, name, &subject.name, silent(reported), 0.0, why));
        }
    }
    let mut stepper = stepper(subject, SolverChoice::Cg)?;
    let apart = system.active_springs().len().div_ceil(COLLAPSED);
    let wrong = system.active().step_by(apart).map(|(spring, pair, _)| named(subject, &mut stepper, spring, pair));
    let value = worst(wrong);
    let why = "a spring of length zero has no direction: the step must name it, or one that shares both places, and leave the \
               state as it was";
    checks.push(Check::new(Claim::Failure, "degenerate springs are named", &subject.name, value, 0.0, why));
    Ok(checks)
}

/// A particle that can move, at a spring: a NaN among its coordinates is in the matrix too.
fn seen(system: &System) -> Option<usize> {
    system.active().find_map(|(_, pair, _)| pair.into_iter().find(|&p| !system.dofs().rows(p).is_empty()))
}

fn stepper(subject: &TestCase, solver: SolverChoice) -> Result<LinearBackwardEuler<'_>, Unfinished> {
    let linear = SolverOptions { solver, ..SolverOptions::default() };
    let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
    Ok(LinearBackwardEuler::new(&subject.system, &subject.state, &options)?)
}

/// Puts the second end of a spring on the first: 0 if the step then fails by naming a spring between the two places.
fn named(subject: &TestCase, stepper: &mut LinearBackwardEuler, spring: usize, [i, j]: [usize; 2]) -> f64 {
    let mut collapsed = subject.state.clone();
    collapsed.positions[j] = collapsed.positions[i];
    let before = collapsed.clone();
    let outcome = stepper.step(&mut collapsed, subject.dt);
    let right = |found: DegenerateSpring| {
        let [a, b] = found.pair.map(|p| before.positions[p]);
        a == b && found.pair == subject.system.pair(found.spring) && found.spring <= spring
    };
    let named = matches!(outcome, Err(StepFailure::DegenerateSpring(found)) if right(found));
    silent(named && collapsed == before)
}

#[cfg(test)]
mod tests;
