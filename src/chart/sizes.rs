//! Factorization or conjugate gradients? One step on ready scenes of growing size.

use crate::accuracy::{Configuration, trial};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, Schedule, Status, StiffnessPolicy};
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
    /// Mean time of a step, set-up left out, in s.
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

/// Grows cloths and lattices until a quarter of the time is left for none.
pub(super) fn study(deadline: Instant) -> Result<Vec<SizeRun>> {
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
                let configuration = Configuration { method: Method::LinearBackwardEuler, options };
                let setup = trial(&system, &state, &configuration, &Schedule::steps(0.01, 0), None)?.wall;
                let run = trial(&system, &state, &configuration, &Schedule::steps(0.01, STEPS), Some(deadline))?;
                if run.status != Status::Completed {
                    continue;
                }
                runs.push(SizeRun {
                    kind: kind.name(),
                    dofs: system.dofs().len(),
                    solver: run.solver,
                    seconds_per_step: run.wall.saturating_sub(setup).as_secs_f64() / STEPS as f64,
                    setup_seconds: setup.as_secs_f64(),
                    work: run.statistics.work,
                    steps: run.steps,
                });
                // The next size has four to ten times the work.
                if Instant::now() + 10 * clock.elapsed() < deadline {
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
