//! What a run says of its own error, and what to do about it.

use sprung::integrate::{Figures, Method, Status, Warning};
use sprung::output::{ErrorKind, ErrorReport};
use sprung::plan::Plan;

/// How wrong a run is about, and what makes it doubtful, in words. A run that broke down says nothing of the motion.
pub fn doubts(plan: &Plan, status: Status, figures: &Figures) -> (Option<ErrorReport>, Vec<String>) {
    let method = plan.configuration.method;
    if !matches!(status, Status::Completed | Status::Interrupted) {
        return (None, Vec::new());
    }
    let mut warnings: Vec<String> = figures.warnings(method, plan.rtol).iter().map(text).collect();
    if let Some(first) = warnings.first_mut() {
        *first = format!("{first}: {}", advice(plan));
    }
    let report = |estimate| ErrorReport { estimate, kind: ErrorKind::Indicator };
    (figures.estimate(method).map(report), warnings)
}

/// A warning, with what to do about it where that hangs on nothing else.
fn text(warning: &Warning) -> String {
    match warning {
        Warning::Magnified(_) => format!("{warning}: --accuracy says until when positions are predictable"),
        _ => warning.to_string(),
    }
}

/// What to do about a run that is wrong.
pub fn advice(plan: &Plan) -> &'static str {
    match (plan.rtol, plan.configuration.method) {
        (Some(_), _) => "try a smaller --rtol",
        (None, Method::Bdf2) => "leave out --dt (and the scene's dt), or make it shorter",
        (None, method) if method.estimates_errors() => "leave out --dt (and the scene's dt), or try --method bdf2",
        (None, method) if method.is_implicit() => {
            "leave out --dt (and the scene's dt) and --method, or try --method bdf2"
        }
        (None, _) => "make --dt (or the scene's dt) shorter, or leave it out with --method",
    }
}
