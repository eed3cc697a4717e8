//! Runs that must be the same to the bit: the same run twice, with one thread and with two, in a plane and in space.
//!
//! A planar scene has the same degrees of freedom as its twin in space with the third axis held, hence the same matrices,
//! the same operations and the same rounding.

use super::measured::Measured;
use super::runs::{Way, differences, direct};
use super::{Check, Claim, TestCase, Unfinished};
use crate::error::Error;
use crate::integrate::{Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use faer::Par;

const STEPS: usize = 10;

pub(super) fn is_flat(subject: &TestCase) -> bool {
    subject.system.dimension() < 3
}

/// A planar or one-dimensional scene against its twin in space.
pub(super) fn in_space(subject: &TestCase) -> Measured {
    let twin = subject.in_space()?;
    let mut checks = Vec::new();
    for way in Way::of(subject) {
        let dt = way.step(subject);
        let flat = way.run(subject, direct(), dt, STEPS)?;
        let spatial = way.run(&twin, direct(), dt, STEPS)?;
        let why = "the degrees of freedom are the same, so every operation is: not one bit may differ";
        let name = format!("same in space with the other axes held, {}", way.name());
        checks.push(Check::new(Claim::Constraints, name, &subject.name, differences(&flat, &spatial), 0.0, why));
    }
    Ok(checks)
}

/// The same run twice, and by two threads.
pub(super) fn repeated(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    let why = "nothing but the scene and the options decides a result: not one bit may differ";
    for way in Way::of(subject) {
        let dt = way.step(subject);
        let run = || way.run(subject, SolverOptions::default(), dt, STEPS);
        let name = format!("same run twice, {}", way.name());
        checks.push(Check::new(Claim::Solvers, name, &subject.name, differences(&run()?, &run()?), 0.0, why));
    }
    for (solver, name) in [(SolverChoice::Llt, "Cholesky"), (SolverChoice::Ldlt, "LDLᵀ"), (SolverChoice::Cg, "CG")] {
        let way = Way { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::OnDemand };
        let run = |threads| with_threads(threads, || way.run(subject, in_two(solver), subject.dt, STEPS));
        let value = differences(&run(1)?, &run(2)?);
        let name = format!("same with one thread and two, {name}");
        checks.push(Check::new(Claim::Solvers, name, &subject.name, value, 0.0, why));
    }
    Ok(checks)
}

/// How a factorization is split is an option; how many threads work on the parts must not matter.
fn in_two(solver: SolverChoice) -> SolverOptions {
    SolverOptions { solver, par: Par::rayon(2), ..SolverOptions::default() }
}

/// Computes in a pool of so many threads.
fn with_threads<T: Send>(
    threads: usize,
    compute: impl FnOnce() -> Result<T, Unfinished> + Send,
) -> Result<T, Unfinished> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| Error::Unsupported(format!("no pool of {threads} threads: {error}")))?;
    pool.install(compute)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solvers_work_in_two_parts() {
        for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg] {
            assert_eq!((in_two(solver).solver, in_two(solver).par), (solver, Par::rayon(2)));
        }
    }
}
