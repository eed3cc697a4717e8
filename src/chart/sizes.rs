//! Factorization or conjugate gradients? One step on ready scenes of growing size.

use super::Deadline;
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::scene::{Kind, builtin};
use crate::spring::Stiffness;
use crate::work::Work;
use faer::Par;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Time of a step by one solver on one scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeRun {
    /// The ready scene's kind.
    pub kind: &'static str,
    /// Its free degrees of freedom.
    pub dofs: usize,
    /// The linear solver.
    pub solver: &'static str,
    /// The shortest time of a step, set-up left out, in s.
    pub seconds_per_step: f64,
    /// Time of set-up: pattern, ordering, symbolic factorization, in s.
    pub setup_seconds: f64,
    /// Work of all steps.
    pub work: Work,
    /// Steps.
    pub steps: u64,
}

/// Steps of each run.
const STEPS: u64 = 4;

/// Their length, in s: 5000 for (k/l0)·dt²/m on the cloth, so that the matrix is far from M/dt².
const DT: f64 = 0.01;

/// Grows cloths and lattices as long as the next one fits into the time.
pub(super) fn study(deadline: Deadline) -> Result<Vec<SizeRun>> {
    let mut runs = Vec::new();
    for (kind, sizes) in [(Kind::Cloth, [6, 12, 24, 48, 96]), (Kind::Lattice, [3, 5, 8, 12, 18])] {
        let mut solvers = vec![SolverChoice::Llt, SolverChoice::Cg, SolverChoice::CgAssembled];
        for size in sizes {
            let (system, state) = builtin(kind, size)?.build()?;
            let mut affordable = Vec::new();
            for &solver in &solvers {
                let clock = Instant::now();
                let linear = SolverOptions { solver, par: Par::Seq, ..SolverOptions::default() };
                let options = ImplicitOptions { stiffness: StiffnessPolicy::Always(Stiffness::Tension), linear };
                let mut stepper = Method::LinearBackwardEuler.stepper(&system, &state, &options)?;
                let setup = clock.elapsed();
                let mut moving = state.clone();
                let mut shortest = None;
                for _ in 0..STEPS {
                    let step = Instant::now();
                    if stepper.step(&mut moving, DT).is_err() {
                        break;
                    }
                    shortest = Some(shortest.map_or(step.elapsed(), |other: Duration| other.min(step.elapsed())));
                }
                let Some(shortest) = shortest else { continue };
                runs.push(SizeRun {
                    kind: kind.name(),
                    dofs: system.dofs().len(),
                    solver: stepper.linear_solver().map_or("none", |solver| solver.name()),
                    seconds_per_step: shortest.as_secs_f64(),
                    setup_seconds: setup.as_secs_f64(),
                    work: stepper.statistics().work,
                    steps: STEPS,
                });
                // The next size has four to ten times the work.
                if deadline.allows(10 * clock.elapsed()) {
                    affordable.push(solver);
                }
            }
            solvers = affordable;
        }
    }
    Ok(runs)
}

/// The share of a budget that this study may take, at most so many seconds.
pub(super) fn share(budget: Duration) -> Duration {
    (budget / 8).min(Duration::from_secs(10))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without time for more the smallest scenes of both kinds, by every solver: 36 particles, two held, and 27, nine held.
    #[test]
    fn the_smallest_sizes_are_measured_in_any_case() {
        let runs = study(Deadline::from(Instant::now())).unwrap();
        let found: Vec<_> = runs.iter().map(|run| (run.kind, run.dofs, run.solver, run.steps)).collect();
        let of = |kind: Kind, dofs| ["llt", "cg", "cg-assembled"].map(|solver| (kind.name(), dofs, solver, 4));
        assert_eq!(found, [of(Kind::Cloth, 102), of(Kind::Lattice, 54)].concat());
        for run in runs {
            assert!(run.seconds_per_step > 0.0 && run.work.solves == 4, "{run:?}");
        }
    }

    #[test]
    fn an_eighth_of_the_time_is_for_sizes_and_ten_seconds_at_most() {
        let seconds = |budget| share(Duration::from_secs(budget)).as_secs_f64();
        assert_eq!([8, 79, 80, 800].map(seconds), [1.0, 9.875, 10.0, 10.0]);
    }
}
