//! How exactly should conjugate gradients solve? Tolerance against error and time.

use super::Deadline;
use super::sweep::{Bench, Run};
use crate::accuracy::{Configuration, StepControl};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions, Tolerance};
use std::time::Duration;

/// Runs of one method and step by conjugate gradients at tolerances from coarse to fine, the loosest first.
pub(super) fn study(bench: &Bench<'_>, method: Method, dt: f64, deadline: Deadline) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for exponent in 1..=6 {
        let tolerance = 10f64.powi(-2 * exponent);
        let linear = SolverOptions {
            solver: SolverChoice::Cg,
            tolerance: Tolerance::Fixed(tolerance),
            ..SolverOptions::default()
        };
        let options = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, linear };
        match bench.measure(&Configuration { method, options }, StepControl::Step(dt), deadline)? {
            Some(run) => runs.push(run),
            None => break,
        }
    }
    Ok(runs)
}

/// The share of a budget that the study of one method may take.
pub(super) fn share(budget: Duration) -> Duration {
    budget / 20
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_study_has_a_twentieth_of_the_time() {
        assert_eq!(share(Duration::from_secs(60)), Duration::from_secs(3));
    }
}
