//! The summary of an answer of a required accuracy.

use super::{ChoiceReport, Effort, EnergyChange, ErrorKind, ErrorReport, Summary};
use crate::accuracy::{Answer, Pace, Requirement, Verdict};
use crate::integrate::Status;
use crate::system::System;

impl Summary {
    /// Of an answer to a requirement. Energies are those that were recorded; the caller says how long the search took, in s, and what
    /// was left out of the system.
    pub fn of_answer<R>(
        scene: String,
        system: &System,
        found: &Answer<R>,
        requirement: &Requirement,
        energy: EnergyChange,
        wall_seconds: f64,
        reductions: Vec<String>,
    ) -> Self {
        let accuracy = requirement.accuracy;
        let choice = ChoiceReport::of_answer(found, accuracy, found.reason(accuracy));
        let Answer { configuration, pace, state, steps, statistics, solver, verdict, estimated_error, .. } = found;
        let (status, kind) = match verdict {
            Verdict::Confirmed => (Status::Completed, ErrorKind::Confirmed),
            Verdict::Unconfirmed(_) => (Status::Unconfirmed, ErrorKind::Indicator),
            Verdict::Interrupted => (Status::Interrupted, ErrorKind::Indicator),
        };
        Self {
            scene,
            status,
            method: configuration.method.name(),
            stiffness: configuration.stiffness(),
            solver: solver.name,
            preconditioner: solver.preconditioner,
            solver_choice: solver.choice.clone(),
            dt: match pace {
                Pace::Step(dt) => *dt,
                Pace::Adaptive { .. } => requirement.duration / (*steps).max(1) as f64,
            },
            steps: *steps,
            time: state.time,
            particles: system.particles(),
            springs: system.springs().len(),
            dofs: system.dofs().len(),
            wall_seconds,
            statistics: *statistics,
            factor: solver.factor,
            energy,
            error: estimated_error.map(|estimate| ErrorReport { estimate, kind }),
            warnings: found.doubt(accuracy).into_iter().collect(),
            effort: Effort { run: found.cost, total: found.total_cost },
            choice: Some(choice),
            reductions,
            failure: None,
        }
    }
}
