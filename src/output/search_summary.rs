//! The summary of an answer of a required accuracy.

use super::{ChoiceReport, Effort, EnergyChange, ErrorKind, ErrorReport, Summary};
use crate::accuracy::{AccuracyOptions, Answer, StepControl, Verdict};
use crate::integrate::Status;
use crate::system::System;

impl Summary {
    /// Of an answer to a options. Energies are those that were recorded; the caller says how long the search took, in s, and what
    /// was left out of the system.
    pub fn of_answer<R>(
        scene: String,
        system: &System,
        found: &Answer<R>,
        options: &AccuracyOptions,
        energy: EnergyChange,
        wall_seconds: f64,
    ) -> Self {
        let accuracy = options.accuracy;
        let choice = ChoiceReport::of_answer(found, accuracy, found.reason(accuracy));
        let Answer { configuration, control, state, steps, statistics, solver, verdict, estimated_error, .. } = found;
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
            dt: match control {
                StepControl::Step(dt) => *dt,
                StepControl::Adaptive { .. } => options.duration / (*steps).max(1) as f64,
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
            warnings: found.warnings(accuracy),
            effort: Effort { run: found.cost, total: found.total_cost },
            choice: Some(choice),
            failure: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::run_to_accuracy;
    use crate::integrate::Method;
    use crate::system::fixtures::oscillator;

    /// Steps that follow an estimate have the mean for their length, and steps of one length their length.
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
            let found = run_to_accuracy(&system, &start, &options, &mut (), &|| true).unwrap().unwrap();
            let energy = EnergyChange { initial: 0.0, last: 0.0, balance: Default::default() };
            let summary = Summary::of_answer("s".into(), &system, &found, &options, energy, 0.0);
            assert!(summary.steps > 2);
            assert!((summary.dt * summary.steps as f64 - 3.0).abs() < 1e-12, "{} s", summary.dt);
        }
    }
}
