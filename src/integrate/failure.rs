//! The failure of a step, and the status of a run.

use crate::error::significant;
use crate::force::DegenerateSpring;
use crate::linear::SolveFailure;
use crate::system::{State, System};
use serde::Serialize;

/// The reason why a step could not be done.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepFailure {
    /// The linear system was not solved to its tolerance.
    #[error(transparent)]
    Solve(#[from] SolveFailure),
    /// The ends of a spring coincide.
    #[error(transparent)]
    DegenerateSpring(#[from] DegenerateSpring),
    /// The nonlinear equations were not solved.
    #[error("Newton's method {reason} after {iterations} iterations at a relative residual of {relative_residual:.3e}")]
    Newton {
        /// Iterations done.
        iterations: u64,
        /// Residual force over the scale of the forces.
        relative_residual: f64,
        /// The reason why it stopped.
        reason: NotSolved,
    },
    /// The error estimate stays above the tolerance.
    #[error("the error estimate stays above the tolerance however short the step")]
    Tolerance,
    /// A step length that is not finite and positive.
    #[error("a step of {0} s cannot be done: it must be finite and positive")]
    StepLength(f64),
    /// A state of another system.
    #[error("the state has {found} positions or velocities, and the system {expected} particles")]
    ForeignState {
        /// Rows of the state.
        found: usize,
        /// Particles of the system.
        expected: usize,
    },
    /// The new state would not be finite.
    #[error("the new positions or velocities are not finite")]
    NonFinite,
    /// The energy of the scene has grown by more than is possible.
    #[error("{} J of energy appeared from nowhere; the motion had {} J to exchange until then", large(*gained), significant(*exchanged, 4))]
    Unstable {
        /// The growth, in J.
        gained: f64,
        /// The energy that the motion had to exchange, in J.
        exchanged: f64,
    },
}

/// The reason why Newton's method stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotSolved {
    /// No step length along the Newton direction makes progress.
    #[error("found no step length that makes progress")]
    LineSearch,
    /// The direction does not descend: the matrix is indefinite, and the policy and solver asked for (`full` by LDLᵀ) accept that.
    #[error("met an indefinite matrix whose direction does not descend")]
    Ascent,
    /// The iteration limit.
    #[error("reached its iteration limit")]
    IterationLimit,
}

/// The end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Status {
    /// It came to its end.
    Completed,
    /// It was asked to stop.
    Interrupted,
    /// A was not positive definite where it must be.
    Indefinite,
    /// A linear or nonlinear solver did not converge, or its solution cannot be trusted.
    NotConverged,
    /// Numbers overflowed or became undefined.
    NonFinite,
    /// The ends of a spring coincide.
    DegenerateSpring,
    /// Energy appeared from nowhere.
    Unstable,
    /// It came to its end, and its accuracy could not be confirmed to be what was asked for.
    Unconfirmed,
}

impl Status {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Interrupted => "interrupted",
            Self::Indefinite => "indefinite",
            Self::NotConverged => "not-converged",
            Self::NonFinite => "non-finite",
            Self::DegenerateSpring => "degenerate-spring",
            Self::Unstable => "unstable",
            Self::Unconfirmed => "unconfirmed",
        }
    }
}

impl StepFailure {
    /// The outcome for all parts of a system: success if every part succeeds, else the failure of one of them. Solvers agree by themselves.
    pub(super) fn of_any(system: &System, here: Result<(), Self>) -> Result<(), Self> {
        let Some(peers) = system.communicator() else { return here };
        // The degenerate spring of the lowest number, as the largest of the negatives; −∞ where there is none.
        let spring = match here {
            Err(Self::DegenerateSpring(DegenerateSpring { spring, .. })) => -(peers.spring(spring) as f64),
            _ => f64::NEG_INFINITY,
        };
        let [failed, lowest] = system.largest([f64::from(u8::from(here.is_err())), spring]);
        if failed == 0.0 {
            return Ok(());
        }
        if lowest == f64::NEG_INFINITY {
            return Err(Self::NonFinite);
        }
        let ends = match here {
            Err(Self::DegenerateSpring(DegenerateSpring { pair, .. })) if spring == lowest => {
                pair.map(|particle| peers.particle(particle) as f64)
            }
            _ => [-1.0; 2],
        };
        let pair = system.largest(ends).map(|particle| particle as usize);
        Err(Self::DegenerateSpring(DegenerateSpring { spring: -lowest as usize, pair }))
    }

    /// [`NonFinite`](Self::NonFinite) where the new state of any part of a system is not finite.
    pub(super) fn unless_finite(system: &System, is_finite: bool) -> Result<(), Self> {
        Self::of_any(system, if is_finite { Ok(()) } else { Err(Self::NonFinite) })
    }

    /// Refuses a state of another system or without a time, and a step length that is not finite and positive.
    pub(super) fn of_arguments(system: &System, state: &State, dt: f64) -> Result<(), Self> {
        let expected = system.particles();
        if let Some(found) =
            [state.positions.len(), state.velocities.len()].into_iter().find(|&found| found != expected)
        {
            return Err(Self::ForeignState { found, expected });
        }
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Self::StepLength(dt));
        }
        if state.time.is_finite() { Ok(()) } else { Err(Self::NonFinite) }
    }

    /// The status of a run that this failure ends.
    pub fn status(&self) -> Status {
        match self {
            Self::Solve(SolveFailure::Indefinite(_)) => Status::Indefinite,
            Self::Solve(SolveFailure::Interrupted) => Status::Interrupted,
            Self::Solve(SolveFailure::NonFinite)
            | Self::NonFinite
            | Self::StepLength(_)
            | Self::ForeignState { .. } => Status::NonFinite,
            Self::DegenerateSpring(_) => Status::DegenerateSpring,
            Self::Unstable { .. } => Status::Unstable,
            Self::Solve(_) | Self::Newton { .. } | Self::Tolerance => Status::NotConverged,
        }
    }
}

/// A number in words that may have overflowed.
fn large(value: f64) -> String {
    if value.is_finite() { significant(value, 4) } else { "more than 1e308".into() }
}

#[cfg(test)]
mod tests {
    use super::{NotSolved, StepFailure};

    #[test]
    fn failures_are_sentences() {
        for (reason, text) in [
            (NotSolved::LineSearch, "found no step length that makes progress"),
            (NotSolved::Ascent, "met an indefinite matrix whose direction does not descend"),
            (NotSolved::IterationLimit, "reached its iteration limit"),
        ] {
            let failure = StepFailure::Newton { iterations: 7, relative_residual: 0.25, reason };
            let expected = format!("Newton's method {text} after 7 iterations at a relative residual of 2.500e-1");
            assert_eq!(failure.to_string(), expected);
        }
        for (gained, text) in [(12.5, "12.5"), (f64::INFINITY, "more than 1e308")] {
            let failure = StepFailure::Unstable { gained, exchanged: 2.0 };
            let expected =
                format!("{text} J of energy appeared from nowhere; the motion had 2 J to exchange until then");
            assert_eq!(failure.to_string(), expected);
        }
    }
}
