//! What a run says of its own accuracy, and when it warns.
//!
//! The estimate is the [propagated error](crate::integrate::PropagatedError) over the extent of the scene. One threshold holds for all methods. The
//! energy balance sees what the error of positions does not: energy from nowhere.

use serde::Serialize;

/// The estimate above which a run of fixed steps is called inaccurate. Estimates are within ten times of the truth in nine runs of ten, and a run that is wrong by
/// 30 %, a picture of another motion, is not to be silent: a fifteenth of that.
pub const INACCURATE: f64 = 0.02;

/// Tolerances above which an adaptive run is called inaccurate: `rtol` promises about the error at the end, within five times.
const WITHIN: f64 = 5.0;

/// Energy gained, in units of what the motion exchanged, from which it is reported: explicit methods swing by as much within their limits of
/// stability (symplectic Euler with hω = 1 by a third of it, with 1.5 by more than all of it).
const GAINED: f64 = 1.0;

/// Figures of a run up to a state. Lengths are relative to the extent X of the scene at that state, `‖x − centroid‖` over all particles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ErrorIndicators {
    /// Steps.
    pub steps: u64,
    /// Length of the run, in s.
    pub duration: f64,
    /// X, in m.
    pub extent: f64,
    /// ‖e_x‖/X, the propagated error; `None` where it is not known.
    pub estimate: Option<f64>,
    /// `Σ ‖δ_x‖/X`, the plain sum of local errors.
    pub local_errors: f64,
    /// What linearised steps left out over what they balanced, see [`PropagatedError::left_out`](crate::integrate::PropagatedError::left_out).
    pub left_out: f64,
    /// The time, in s, until which the estimate was below the threshold; `None` where it still is.
    pub predictable_until: Option<f64>,
    /// Energy that the motion exchanged, in J: the kinetic energy it started with, what it released, and what it was given; without that of
    /// the centre of mass where nothing holds the scene.
    pub exchanged: f64,
    /// The most that appeared from nowhere, in J, from the lowest imbalance before, above rounding.
    pub gained: f64,
    /// What the method took away by the end, in J; negative where it gave. Without the centre of mass where nothing holds the scene.
    pub lost: f64,
}

/// What makes a run doubtful.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The relative position error at the end is large.
    Inaccurate {
        /// About that.
        estimate: f64,
        /// The time, in s, until which positions are predictable to the threshold.
        until: Option<f64>,
        /// By how much the motion magnified the local errors of the steps.
        magnified: f64,
    },
    /// Energy appeared from nowhere, in J, where the motion exchanged so much.
    Gained {
        /// Appeared.
        gained: f64,
        /// Exchanged.
        exchanged: f64,
    },
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Inaccurate { estimate, until, magnified } => {
                write!(f, "the relative position error at the end is about {}", percent(estimate))?;
                if let Some(until) = until.filter(|until| *until > 0.0) {
                    write!(f, "; positions are predictable until about {until:.3} s")?;
                }
                if magnified >= 10.0 {
                    write!(f, "; the motion magnifies the errors of its steps {magnified:.0} times")?;
                }
                Ok(())
            }
            Self::Gained { gained, exchanged } => write!(
                f,
                "{gained:.2e} J of energy appeared from nowhere, where the motion exchanged {exchanged:.2e} J"
            ),
        }
    }
}

/// A relative error for people: one or two digits, in percent.
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
    /// Whether the estimate is above what is right for a run, of steps that keep to a relative tolerance where one is given.
    pub fn is_inaccurate(&self, rtol: Option<f64>) -> bool {
        self.estimate.is_some_and(|estimate| estimate > threshold(rtol))
    }

    /// What makes a run doubtful, the error first.
    pub fn warnings(&self, rtol: Option<f64>) -> Vec<Warning> {
        let Self { estimate, local_errors, exchanged, gained, predictable_until: until, .. } = *self;
        let inaccurate = estimate.filter(|_| self.is_inaccurate(rtol)).map(|estimate| Warning::Inaccurate {
            estimate,
            until,
            magnified: if local_errors > 0.0 { estimate / local_errors } else { 1.0 },
        });
        let gains = (gained > GAINED * exchanged).then_some(Warning::Gained { gained, exchanged });
        inaccurate.into_iter().chain(gains).collect()
    }
}

/// The estimate above which a run is called inaccurate.
pub fn threshold(rtol: Option<f64>) -> f64 {
    rtol.map_or(INACCURATE, |rtol| WITHIN * rtol)
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
        let [Warning::Inaccurate { magnified, .. }] = of(Some(0.021)).warnings(None)[..] else { panic!() };
        assert!((magnified - 21.0).abs() < 1e-9);
        // Within five tolerances.
        assert!(of(Some(0.049)).warnings(Some(0.01)).is_empty() && of(Some(0.051)).is_inaccurate(Some(0.01)));
        let gaining = ErrorIndicators { gained: 1.1, ..of(None) };
        assert_eq!(gaining.warnings(None), [Warning::Gained { gained: 1.1, exchanged: 1.0 }]);
    }
}
