//! The summary of a run, from what the run knows.

use super::{ChoiceReport, Effort, EnergyChange, ErrorReport, FailureReport, Summary};
use crate::integrate::{Monitor, Outcome, Schedule, Statistics, TimeStepper};
use crate::linear::{CostModel, LinearSolver};
use crate::plan::Plan;
use crate::system::{State, System};

/// A run that has ended, however it did.
pub struct Ran<'a> {
    /// The scene's name.
    pub scene: String,
    /// The system that was run.
    pub system: &'a System,
    /// How it was run.
    pub plan: &'a Plan,
    /// With which steps, or records.
    pub schedule: &'a Schedule,
    /// The method.
    pub stepper: &'a dyn TimeStepper,
    /// What accompanied it.
    pub monitor: &'a Monitor<'a>,
    /// How it ended.
    pub outcome: &'a Outcome,
    /// What it did, all its parts together.
    pub statistics: Statistics,
    /// The last good state.
    pub state: &'a State,
    /// Elapsed time, in s.
    pub wall_seconds: f64,
    /// How wrong it is about.
    pub error: Option<ErrorReport>,
    /// What makes it doubtful, in words.
    pub warnings: Vec<String>,
    /// What the program chose.
    pub choice: Option<ChoiceReport>,
}

impl Ran<'_> {
    /// Everything about it.
    pub fn summary(self) -> Summary {
        let Self { system, plan, stepper, monitor, outcome, statistics, state, .. } = self;
        let solver = stepper.linear_solver();
        let factor = solver.and_then(LinearSolver::factor);
        let effort = CostModel::of(system).cost(&statistics.work, factor.map(|factor| factor.size));
        Summary {
            scene: self.scene,
            status: outcome.status(),
            method: stepper.name(),
            stiffness: plan.configuration.stiffness(),
            solver: solver.map_or("none", LinearSolver::name),
            preconditioner: solver.and_then(LinearSolver::preconditioner).unwrap_or("none"),
            solver_choice: solver.and_then(LinearSolver::choice),
            dt: self.schedule.dt(),
            steps: outcome.steps,
            time: state.time,
            particles: system.particles(),
            springs: system.springs().len(),
            dofs: system.dofs().len(),
            wall_seconds: self.wall_seconds,
            statistics,
            factor,
            energy: EnergyChange::between(&monitor.initial(), &monitor.energy(), monitor.balance()),
            error: self.error,
            warnings: self.warnings,
            effort: Effort { run: effort, total: effort },
            choice: self.choice,
            failure: FailureReport::of(outcome, state.time),
        }
    }
}
