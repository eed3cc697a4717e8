//! Systems that cannot be solved are reported, with the reason and the place, and never answered silently.
//!
//! Indefinite systems are those of the squeezed twin of the scene, in which every spring wants to buckle.

use super::definiteness::is_small;
use super::reference::{self, dense_step_matrix, field};
use super::{Check, Claim, Measured, TestCase, U, ratio, reduce};
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::integrate::{ImplicitOptions, LinearBackwardEuler, Status, StepFailure, StepMatrices, TimeStepper};
use crate::linear::{
    CgOutcome, Cholesky, ConjugateGradient, Definiteness, LdltSolver, Preconditioner, PreconditionerKind, Prepare,
    SolveFailure, SolverChoice, SolverOptions, backward_error, norm,
};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::DVector;

fn reported(case: &TestCase, name: impl Into<String>, is_reported: bool, why: &str) -> Check {
    Check::new(Claim::Failure, name, &case.name, if is_reported { 0.0 } else { 1.0 }, 0.0, why)
}

/// The shortest step, doubling from the scene's, at which A of the squeezed twin is clearly indefinite, and the number of negative eigenvalues.
fn indefinite_step(twin: &TestCase) -> Option<(f64, usize)> {
    (0..24).map(|doubling| twin.dt * f64::from(1 << doubling)).find_map(|dt| {
        let eigenvalues = dense_step_matrix(twin, Stiffness::Full, dt).symmetric_eigenvalues();
        let scale = eigenvalues.amax();
        // Clearly negative: conjugate gradients must meet it before they converge.
        let is_clear = eigenvalues.iter().any(|&value| value < -1e-3 * scale);
        let have_signs = eigenvalues.iter().all(|value| value.abs() > 1e4 * U * scale);
        let negative = eigenvalues.iter().filter(|&&value| value < 0.0).count();
        (is_clear && have_signs).then_some((dt, negative))
    })
}

pub(super) fn applies(case: &TestCase) -> bool {
    is_small(case) && case.squeezed().ok().and_then(|twin| indefinite_step(&twin)).is_some()
}

pub(super) fn indefinite(case: &TestCase) -> Measured {
    let twin = case.squeezed()?;
    let Some((dt, negative)) = indefinite_step(&twin) else { return Ok(Vec::new()) };
    let system = &twin.system;
    let n = system.dofs().len();
    let dense = dense_step_matrix(&twin, Stiffness::Full, dt);
    let geometry = SpringGeometry::at(system, &twin.state.positions)?;
    let a = SystemOperator::new(system, &geometry, Stiffness::Full, Combination::step(dt));
    let b = reduce(system, &field(system));

    let matrix = StepMatrices::assemble(system, &twin.state, Stiffness::Full, dt)?.a;
    let refused = Cholesky::analyse(matrix.pattern(), Par::Seq)?.factor(&matrix).is_err();
    let why = "a Cholesky factorization exists if and only if A is positive definite";
    let mut checks = vec![reported(&twin, "Cholesky refuses an indefinite matrix", refused, why)];

    let mut work = Work::default();
    let mut ldlt = LdltSolver::new(system, Par::Seq, &mut work)?;
    let mut prepared = ldlt.prepare(&a, &mut work)?;
    let counted = matches!(prepared.definiteness(), Definiteness::Indefinite { negative: n, .. } if n == negative);
    let why = "by Sylvester's law of inertia the signs of D are those of the eigenvalues";
    checks.push(reported(&twin, "LDLᵀ counts the negative eigenvalues", counted, why));
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
        // A diagonal block or coarse matrix that is not definite is reported before the first iteration.
        let is_reported = preconditioner.update(&a, &mut Work::default()).is_err() || {
            let mut cg = ConjugateGradient::new(n, 1e-12);
            let report = cg.solve(&a, &mut preconditioner, &b, &mut vec![0.0; n]);
            let p = DVector::from_column_slice(cg.direction());
            matches!(report.outcome, CgOutcome::NegativeCurvature { .. }) && p.dot(&(&dense * &p)) <= 0.0
        };
        let why = "in exact arithmetic n iterations from a right-hand side with all modes meet every eigenvector; pᵀAp is \
                   computed again with formulas that were written a second time";
        let name = format!("conjugate gradients report negative curvature, {kind:?}");
        checks.push(reported(&twin, name, is_reported, why));
    }
    Ok(checks)
}

pub(super) fn conjugate_gradients(case: &TestCase) -> Measured {
    let system = &case.system;
    let n = system.dofs().len();
    let geometry = SpringGeometry::at(system, &case.state.positions)?;
    let a = SystemOperator::new(system, &geometry, Stiffness::Tension, Combination::step(case.dt));
    let b = reduce(system, &field(system));
    let solve = |tolerance, limit: Option<u64>, b: &[f64], x: &mut [f64]| {
        let mut cg = ConjugateGradient::new(n, tolerance);
        cg.iteration_limit = limit.unwrap_or(cg.iteration_limit);
        cg.solve(&a, &mut Preconditioner::Identity, b, x)
    };
    let mut x = vec![0.0; n];
    let stopped = solve(1e-10, Some(0), &b, &mut x).outcome == CgOutcome::IterationLimit;
    let why = "no iteration is allowed, and zero is not the solution";
    let mut checks = vec![reported(case, "iteration limit is reported", stopped, why)];

    x.fill(0.0);
    let report = solve(1e-30, None, &b, &mut x);
    let exact = report.outcome == CgOutcome::Converged && report.relative_residual <= 1e-30;
    let gave_up = matches!(report.outcome, CgOutcome::Stagnated | CgOutcome::IterationLimit);
    let why = "a residual of 1e-30 of the right-hand side is below rounding: only an exact solution may claim it";
    checks.push(reported(case, "stagnation is reported", exact || gave_up, why));

    let mut product = vec![0.0; n];
    a.apply(&x, &mut product);
    let residual = norm(&b.iter().zip(&product).map(|(b, q)| b - q).collect::<Vec<_>>()) / norm(&b);
    let value = ratio((report.relative_residual - residual).abs(), residual);
    let why = "relative: the residual of the solution, computed again with the same product, and not that of the recurrence, \
               which goes on falling where rounding has stopped the solution";
    checks.push(Check::new(Claim::Failure, "the reported residual is the true one", &case.name, value, 1e-12, why));

    let mut poisoned = b.clone();
    poisoned[n / 2] = f64::NAN;
    x.fill(0.0);
    let refused = solve(1e-10, None, &poisoned, &mut x).outcome == CgOutcome::NonFinite;
    checks.push(reported(case, "NaN is reported", refused, "a right-hand side with a NaN has no solution"));
    Ok(checks)
}

pub(super) fn broken_states(case: &TestCase) -> Measured {
    let TestCase { system, state, .. } = case;
    let mut checks = Vec::new();
    for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled] {
        let (mut velocities, mut positions) = (state.clone(), state.clone());
        let dof = system.dofs().dof(0);
        velocities.velocities[dof.particle][dof.axis] = f64::NAN;
        positions.positions[pulled_particle(system).unwrap_or(dof.particle)][0] = f64::NAN;
        for (what, mut poisoned) in [("velocities", velocities), ("positions", positions)] {
            let outcome = stepper(case, solver)?.step(&mut poisoned, case.dt);
            let is_reported = outcome.is_err_and(|failure| failure.status() == Status::NonFinite);
            let name = format!("a NaN in the {what} is reported, {solver:?}");
            checks.push(reported(case, name, is_reported, "a step from a state that is not finite must fail as such"));
        }
    }
    let mut stepper = stepper(case, SolverChoice::Cg)?;
    // Without a rest length a spring needs no direction.
    let directed = || system.active().filter(|(.., spring)| spring.rest_length > 0.0);
    // About so many are collapsed in turn.
    let stride = directed().count().div_ceil(64).max(1);
    let mut collapsed = directed().step_by(stride);
    let all_named = collapsed.all(|(spring, pair, _)| is_named(case, &mut stepper, spring, pair));
    let why = "a spring of length zero has no direction: the step must name it, or one that shares both places, and leave the state as it was";
    checks.push(reported(case, "degenerate springs are named", all_named, why));
    Ok(checks)
}

/// A particle that can move, at a spring: a NaN among its coordinates is in the matrix too.
fn pulled_particle(system: &System) -> Option<usize> {
    system.active().find_map(|(_, pair, _)| pair.into_iter().find(|&p| !system.dofs().rows(p).is_empty()))
}

fn stepper(case: &TestCase, solver: SolverChoice) -> Measured<LinearBackwardEuler<'_>> {
    let linear = SolverOptions { solver, ..SolverOptions::default() };
    let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
    Ok(LinearBackwardEuler::new(&case.system, &case.state, &options)?)
}

/// Whether, with the second end of a spring put on the first, the step fails by naming a spring between the two places.
fn is_named(case: &TestCase, stepper: &mut LinearBackwardEuler, spring: usize, [i, j]: [usize; 2]) -> bool {
    let mut collapsed = case.state.clone();
    collapsed.positions[j] = collapsed.positions[i];
    let before = collapsed.clone();
    let outcome = stepper.step(&mut collapsed, case.dt);
    let is_right = |found: DegenerateSpring| {
        let [a, b] = found.pair.map(|p| before.positions[p]);
        a == b && found.pair == case.system.pair(found.spring) && found.spring <= spring
    };
    matches!(outcome, Err(StepFailure::DegenerateSpring(found)) if is_right(found)) && collapsed == before
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use crate::verify::fixtures::{case, pair};

    /// On a spring of k = 100 N that is pushed from 4 m to 1 m A is 1/dt² + 25 N/m along it, and twice 1/dt² − 75 N/m across.
    fn pushed(dt: f64) -> TestCase {
        pair(4.0, dt)
    }

    /// Positive at 0.1 s, −50 N/m at twice that. An eigenvalue near zero, relative to the largest, is not clearly negative.
    #[test]
    fn the_first_step_that_is_clearly_indefinite_is_found() {
        assert_eq!(indefinite_step(&pushed(0.1)), Some((0.2, 2)));
        assert_eq!(indefinite_step(&pushed(0.2)), Some((0.2, 2)));
        for across in [0.05_f64, -0.05] {
            let dt = 1.0 / (75.0 + across).sqrt();
            assert_eq!(indefinite_step(&pushed(dt)), Some((2.0 * dt, 2)));
        }
        assert_eq!(indefinite_step(&pushed(0.1).relaxed().unwrap()), None);
        assert!(applies(&pushed(0.1)) && indefinite(&pushed(0.1)).unwrap().iter().all(Check::passed));
        // Across one spring A is 10⁻¹² N/m at 0.1 s, which is nothing beside 133 N/m along it; across the other it is negative.
        let mut builder = SystemBuilder::new();
        for (y, stiffness) in [(0.0, (100.0 - 1e-12) / 0.75), (9.0, 200.0)] {
            let (anchor, bob) = (builder.particle([0.0, y, 0.0], 1.0), builder.particle([1.0, y, 0.0], 1.0));
            builder.spring(anchor, bob, Spring { stiffness, rest_length: 4.0, damping: 0.0 });
            builder.hold(anchor);
        }
        assert_eq!(indefinite_step(&case(builder, 0.1)), Some((0.2, 4)));
    }

    /// Every solver has its turn, on a particle that can move.
    #[test]
    fn states_are_broken_for_the_given_solver() {
        let case = pushed(0.1);
        for (solver, name) in [(SolverChoice::Llt, "llt"), (SolverChoice::Ldlt, "ldlt"), (SolverChoice::Cg, "cg")] {
            let stepper = stepper(&case, solver).unwrap();
            assert_eq!(stepper.linear_solver().map(|solver| solver.name()), Some(name));
        }
        assert_eq!(pulled_particle(&case.system), Some(1));
        let mut builder = SystemBuilder::new();
        (0..3).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        assert_eq!(pulled_particle(&builder.clone().build().unwrap().0), None);
        builder.spring(1, 2, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(1);
        assert_eq!(pulled_particle(&builder.build().unwrap().0), Some(2));
    }
}
