//! The accuracy of a run by its own estimate, and warnings. The estimate is the [propagated error](crate::integrate::PropagatedError) over the extent
//! of the scene. Energy from nowhere is an error that positions do not show.

use crate::error::significant;
use serde::Serialize;

/// The estimate above which a run of fixed steps warns. Nine in ten estimates are within ten times of the true error (`verification/study.md`), and
/// an error of 30 % must not go unnoticed: a fifteenth of that.
pub const INACCURATE: f64 = 0.02;

/// The indicators of a run up to a state. Lengths are relative to the extent X of the scene at that state, `‖x − centroid‖` over all particles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ErrorIndicators {
    /// X, in m.
    pub extent: f64,
    /// ‖e_x‖/X, the propagated error; `None` where it is not known.
    pub estimate: Option<f64>,
    /// `Σ ‖δ_x‖/X`, the plain sum of local errors.
    pub local_errors: f64,
    /// The time, in s, until which the estimate was below the threshold; `None` where it still is.
    pub predictable_until: Option<f64>,
    /// Energy that the motion exchanged, in J: kinetic at the start, potential released, and work; without the centre of mass of a loose scene.
    pub exchanged: f64,
    /// The largest energy that appeared from nowhere, in J, counted from the lowest imbalance before.
    pub gained: f64,
}

/// A relative error in percent, with one or two digits.
pub fn percent(error: f64) -> String {
    let percent = 100.0 * error;
    match percent {
        0.0 => "0 %".into(),
        _ if percent >= 95.0 => "100 % or more".into(),
        _ if percent >= 9.5 => format!("{percent:.0} %"),
        _ if percent >= 0.095 => format!("{percent:.1} %"),
        _ if percent >= 0.0095 => format!("{percent:.2} %"),
        _ => format!("{percent:.0e} %"),
    }
}

impl ErrorIndicators {
    /// The reasons to doubt a run, for adaptive steps of this tolerance: the error first.
    pub fn warnings(&self, rtol: Option<f64>) -> Vec<String> {
        let Self { estimate, local_errors, exchanged, gained, predictable_until, .. } = *self;
        let mut warnings = Vec::new();
        if let Some(estimate) = estimate.filter(|&estimate| estimate > threshold(rtol)) {
            let mut text = format!("the relative position error at the end is about {}", percent(estimate));
            if let Some(until) = predictable_until.filter(|&until| until > 0.0) {
                text += &format!("; positions are predictable until about {} s", significant(until, 3));
            }
            if local_errors > 0.0 && estimate >= 10.0 * local_errors {
                let magnified = estimate / local_errors;
                text += &format!("; the motion magnifies the errors of its steps {magnified:.0} times");
            }
            warnings.push(text);
        }
        // Within their stability limit explicit methods swing by as much.
        if gained > exchanged {
            let [gained, exchanged] = [gained, exchanged].map(|energy| significant(energy, 3));
            warnings
                .push(format!("{gained} J of energy appeared from nowhere, where the motion exchanged {exchanged} J"));
        }
        warnings
    }
}

/// The estimate above which a run warns: [`INACCURATE`], or five times the tolerance of adaptive steps, which is about the error at the end.
pub fn threshold(rtol: Option<f64>) -> f64 {
    rtol.map_or(INACCURATE, |rtol| 5.0 * rtol)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_one_or_two_digits() {
        let texts = [0.0, 1.234e-7, 1.23e-4, 0.00123, 0.0123, 0.234, 1.9].map(percent);
        assert_eq!(texts, ["0 %", "1e-5 %", "0.01 %", "0.1 %", "1.2 %", "23 %", "100 % or more"]);
    }

    #[test]
    fn one_threshold_holds_for_all_methods() {
        let of = |estimate| ErrorIndicators { estimate, local_errors: 0.001, exchanged: 1.0, ..Default::default() };
        assert!(of(None).warnings(None).is_empty() && of(Some(0.019)).warnings(None).is_empty());
        let text = "the relative position error at the end is about 2.1 %";
        let magnified = "; the motion magnifies the errors of its steps 21 times";
        assert_eq!(of(Some(0.021)).warnings(None), [format!("{text}{magnified}")]);
        let until = ErrorIndicators { local_errors: 0.0, predictable_until: Some(0.25), ..of(Some(0.021)) };
        assert_eq!(until.warnings(None), [format!("{text}; positions are predictable until about 0.25 s")]);
        // Within five tolerances.
        assert!(of(Some(0.049)).warnings(Some(0.01)).is_empty() && of(Some(0.051)).warnings(Some(0.01)).len() == 1);
        let gaining = ErrorIndicators { gained: 1.1, ..of(None) };
        let text = "1.1 J of energy appeared from nowhere, where the motion exchanged 1 J";
        assert_eq!(gaining.warnings(None), [text]);
    }
}
