//! The error of a run and its warnings, in words.

use sprung::integrate::{ErrorIndicators, Status};
use sprung::output::{ErrorKind, ErrorReport};
use sprung::plan::Plan;

/// The error that a run estimates of itself, and its warnings. A run that broke down says nothing of the motion.
pub fn doubts(plan: &Plan, status: Status, indicators: &ErrorIndicators) -> (Option<ErrorReport>, Vec<String>) {
    if !matches!(status, Status::Completed | Status::Interrupted) {
        return (None, Vec::new());
    }
    let warnings = indicators.warnings(plan.rtol).iter().map(ToString::to_string).collect();
    (indicators.estimate.map(|estimate| ErrorReport { estimate, kind: ErrorKind::Indicator }), warnings)
}
