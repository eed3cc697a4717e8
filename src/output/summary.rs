//! `summary.json`: the results of a run and how it ended.

use super::AtomicFile;
use crate::accuracy::{AccuracyOptions, Answer, StepControl, Verdict};
use crate::error::Result;
use crate::integrate::{Balance, Monitor, Outcome, RunFailure, Schedule, Statistics, Status, TimeStepper};
use crate::linear::{CostModel, FactorReport, LinearSolver};
use crate::plan::Plan;
use crate::system::{State, System};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// The results of a run and how it ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The scene's name.
    pub scene: String,
    /// How the run ended.
    pub status: Status,
    /// The method's name.
    pub method: &'static str,
    /// The stiffness policy's name; `none` for a method without matrices.
    pub stiffness: &'static str,
    /// The linear solver really used; `none` for a method without matrices.
    pub solver: &'static str,
    /// The preconditioner really used; `none` where there is none.
    pub preconditioner: &'static str,
    /// The reason for this solver, where the program chose it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver_choice: Option<String>,
    /// Time step, in s; the last step may have been shorter.
    pub dt: f64,
    /// Steps done.
    pub steps: u64,
    /// Time reached, in s.
    pub time: f64,
    /// Number of particles.
    pub particles: usize,
    /// Number of springs.
    pub springs: usize,
    /// Number of free degrees of freedom.
    pub dofs: usize,
    /// Elapsed time from the set-up of the method to the last step, in s.
    pub wall_seconds: f64,
    /// `work`, `max_relative_residual`, and the number of solves with an indefinite A.
    #[serde(flatten)]
    pub statistics: Statistics,
    /// Size and time of the factorization of A, for a direct solver.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor: Option<FactorReport>,
    /// Total energy at both ends of the run, and its balance.
    pub energy: EnergyChange,
    /// The estimated error of the positions at the end.
    pub error: Option<ErrorReport>,
    /// Reasons to doubt the result.
    pub warnings: Vec<String>,
    /// Cost in force evaluations.
    pub effort: Effort,
    /// The reason for this method and step, where the program chose them.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub choice: Option<ChoiceReport>,
    /// The failure that ended the run, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<FailureReport>,
}

impl Summary {
    /// Writes the summary as JSON.
    pub fn write(&self, target: impl Into<PathBuf>) -> Result<()> {
        AtomicFile::write_indented_json(target, self)
    }

    /// The summary of an answer of a required accuracy, with the recorded energies and the duration of the search, in s.
    pub fn of_answer<R>(
        scene: String,
        system: &System,
        found: &Answer<R>,
        options: &AccuracyOptions,
        energy: EnergyChange,
        wall_seconds: f64,
    ) -> Self {
        let accuracy = options.accuracy;
        let Answer { configuration, control, state, steps, statistics, solver, verdict, estimated_error, .. } = found;
        let (status, kind) = match verdict {
            Verdict::Confirmed => (Status::Completed, ErrorKind::Confirmed),
            Verdict::Unconfirmed(_) => (Status::Unconfirmed, ErrorKind::Indicator),
            Verdict::Interrupted => (Status::Interrupted, ErrorKind::Indicator),
        };
        let warnings = found.warnings(accuracy);
        let (dt, rtol) = match *control {
            StepControl::Step(dt) => (dt, None),
            StepControl::Adaptive { rtol, .. } => (options.duration / (*steps).max(1) as f64, Some(rtol)),
        };
        // The verdict is the first of them.
        let message = warnings.first().filter(|_| status != Status::Completed);
        Self {
            scene,
            status,
            method: configuration.method.name(),
            stiffness: configuration.stiffness(),
            solver: solver.name,
            preconditioner: solver.preconditioner,
            solver_choice: solver.choice.clone(),
            dt,
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
            failure: message.map(|why| FailureReport { step: *steps, time: state.time, message: why.clone() }),
            warnings,
            effort: Effort { run: found.cost, total: found.total_cost },
            choice: Some(ChoiceReport {
                reason: found.reason(accuracy),
                accuracy: Some(accuracy),
                estimated_error: *estimated_error,
                rtol,
                runs: Some(found.runs),
            }),
        }
    }
}

/// A run that has ended, successfully or not.
pub struct RunRecord<'a> {
    /// The scene's name.
    pub scene: String,
    /// The system that was run.
    pub system: &'a System,
    /// Its method and options.
    pub plan: &'a Plan,
    /// Its steps, or records.
    pub schedule: &'a Schedule,
    /// The method.
    pub stepper: &'a dyn TimeStepper,
    /// Its monitor.
    pub monitor: &'a Monitor<'a>,
    /// Its outcome.
    pub outcome: &'a Outcome,
    /// Its work, all parts together.
    pub statistics: Statistics,
    /// The last good state.
    pub state: &'a State,
    /// Elapsed time, in s.
    pub wall_seconds: f64,
    /// The choices of the program.
    pub choice: Option<ChoiceReport>,
}

impl RunRecord<'_> {
    /// Its summary. A run that broke down has neither an estimated error nor warnings.
    pub fn summary(self) -> Summary {
        let Self { system, plan, stepper, monitor, outcome, statistics, state, .. } = self;
        let solver = stepper.linear_solver();
        let factor = solver.and_then(LinearSolver::factor);
        let has_result = matches!(outcome.status(), Status::Completed | Status::Interrupted);
        let indicators = has_result.then(|| monitor.indicators(state));
        let estimate = indicators.as_ref().and_then(|indicators| indicators.estimate);
        let warnings = indicators.map(|indicators| indicators.warnings(plan.rtol)).unwrap_or_default();
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
            energy: EnergyChange::of(monitor),
            error: estimate.map(|estimate| ErrorReport { estimate, kind: ErrorKind::Indicator }),
            warnings: warnings.iter().map(ToString::to_string).collect(),
            effort: Effort { run: effort, total: effort },
            choice: self.choice,
            failure: FailureReport::of(outcome, state.time),
        }
    }
}

/// The choices of the program and their reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChoiceReport {
    /// The reason, in one line.
    pub reason: String,
    /// The required accuracy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Estimated relative position error of the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_error: Option<f64>,
    /// Tolerance of adaptive steps, where they were chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rtol: Option<f64>,
    /// Number of runs, the returned one included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub runs: Option<u32>,
}

impl ChoiceReport {
    /// The report on a plan, whose tolerance may be there for want of a dt; `None` where the user chose everything.
    pub fn of_plan(plan: &Plan, has_no_dt: bool) -> Option<Self> {
        let why = if has_no_dt { "no dt is given: " } else { "" };
        let steps = plan.rtol.map(|rtol| format!("{why}adaptive steps, rtol {rtol:e}"));
        let reasons: Vec<String> = steps.into_iter().chain(plan.reason.clone()).collect();
        let reason = reasons.join("; ");
        let report = Self { reason, accuracy: None, estimated_error: None, rtol: plan.rtol, runs: None };
        (!reasons.is_empty()).then_some(report)
    }
}

/// Total energy at both ends of a run and its balance, in J. Numbers that are not finite are written as null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EnergyChange {
    /// At the start.
    pub initial: f64,
    /// At the last good state.
    #[serde(rename = "final")]
    pub last: f64,
    /// Work from outside, dissipation, and the rest.
    #[serde(flatten)]
    pub balance: Balance,
}

impl EnergyChange {
    /// The change from the start of a run to the state that its monitor has entered last.
    pub fn of(monitor: &Monitor<'_>) -> Self {
        Self { initial: monitor.initial().total(), last: monitor.energy().total(), balance: monitor.balance() }
    }
}

/// The estimated error of the positions at the end of a run, a [`relative_position_error`](crate::accuracy::relative_position_error).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorReport {
    /// The estimate; finite.
    pub estimate: f64,
    /// Its source.
    pub kind: ErrorKind,
}

/// The source of an error estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorKind {
    /// The propagated error of the run itself, see [`PropagatedError`](crate::integrate::PropagatedError): within about a factor of ten.
    Indicator,
    /// Independent runs agree, and so does the propagated error.
    Confirmed,
}

/// The cost of a result, in force evaluations of the scene: the time of the work over the time of one evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Effort {
    /// The returned run.
    pub run: f64,
    /// All runs, and the search.
    pub total: f64,
}

/// The failure that ended a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FailureReport {
    /// The failed step, from 1; of an answer that is not confirmed, the last.
    pub step: u64,
    /// The time of the last good state, in s.
    pub time: f64,
    /// The reason.
    pub message: String,
}

impl FailureReport {
    /// The report on a run that failed or was stopped; `time` is that of its last good state.
    pub fn of(outcome: &Outcome, time: f64) -> Option<Self> {
        let (step, time, message) = match &outcome.end {
            Err(RunFailure { step, time, failure }) => (*step, *time, failure.to_string()),
            Ok(ControlFlow::Continue(())) => return None,
            Ok(ControlFlow::Break(())) => (outcome.steps + 1, time, "asked to stop".into()),
        };
        Some(Self { step, time, message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::run_to_accuracy;
    use crate::integrate::Method;
    use crate::system::fixtures::oscillator;

    /// A run that was stopped after ten steps failed in the eleventh.
    #[test]
    fn a_stopped_run_reports_its_step() {
        let outcome = |flow| Outcome { steps: 10, end: Ok(flow) };
        assert_eq!(FailureReport::of(&outcome(ControlFlow::Continue(())), 2.5), None);
        let report = FailureReport::of(&outcome(ControlFlow::Break(())), 2.5);
        assert_eq!(report, Some(FailureReport { step: 11, time: 2.5, message: "asked to stop".into() }));
    }

    /// Adaptive steps report their mean length, fixed steps their length; an answer that is not confirmed says why.
    #[test]
    fn answers_have_a_step() {
        let (system, start) = oscillator();
        for method in [Method::Dop853, Method::Verlet] {
            let options = AccuracyOptions {
                accuracy: 1e-3,
                duration: 3.0,
                interval: 1.0,
                par: faer::Par::Seq,
                method: Some(method),
                stiffness: None,
                solver: None,
            };
            let mut found = run_to_accuracy(&system, &start, &options, &mut (), &|| true).unwrap().unwrap();
            let energy = EnergyChange { initial: 0.0, last: 0.0, balance: Default::default() };
            let summary = Summary::of_answer("s".into(), &system, &found, &options, energy, 0.0);
            assert!(summary.steps > 2 && summary.failure.is_none());
            assert!((summary.dt * summary.steps as f64 - 3.0).abs() < 1e-12, "{} s", summary.dt);
            found.verdict = Verdict::Interrupted;
            let failure = Summary::of_answer("s".into(), &system, &found, &options, energy, 0.0).failure.unwrap();
            assert!(failure.step == summary.steps && failure.message.starts_with("interrupted"), "{failure:?}");
        }
    }
}
