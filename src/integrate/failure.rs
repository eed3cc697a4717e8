//! Why a step could not be done, and the status that a run ends with.

use crate::force::DegenerateSpring;
use crate::linear::SolveFailure;
use crate::system::{State, System};
use serde::Serialize;

/// Why a step could not be done.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepFailure {
    /// The linear system has no solution that can be vouched for.
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
        /// What stopped it.
        reason: NotSolved,
    },
    /// The error estimate stays above the tolerance.
    #[error("the error estimate stays above the tolerance however short the step")]
    Tolerance,
    /// The step's length.
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
    /// The energy of the scene has grown by more than it can have.
    #[error("{} J of energy appeared from nowhere; the motion had {exchanged:.3e} J to exchange until then", large(*gained, 3))]
    Unstable {
        /// By how much it has grown, in J.
        gained: f64,
        /// What the motion had to exchange, in J.
        exchanged: f64,
    },
}

/// What stopped Newton's method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NotSolved {
    /// No step length along the Newton direction makes progress.
    LineSearch,
    /// The direction does not descend: the matrix is indefinite, and a policy and a solver that take it as it is (`full` by LDLᵀ)
    /// were asked for.
    Ascent,
    /// The iteration limit.
    IterationLimit,
}

impl std::fmt::Display for NotSolved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::LineSearch => "found no step length that makes progress",
            Self::Ascent => "met an indefinite matrix whose direction does not descend",
            Self::IterationLimit => "reached its iteration limit",
        })
    }
}

/// How a run ended.
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
    /// The outcome of all parts of a system: done where it is done in each of them, else a failure that one of them met. Solvers
    /// agree by themselves.
    pub(super) fn of_any(system: &System, here: Result<(), Self>) -> Result<(), Self> {
        let Some(peers) = system.communicator() else { return here };
        // The spring of the lowest number, by the largest of the opposites; no spring is −∞.
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

    /// Refuses a step that is no step of a system.
    pub(super) fn of_arguments(system: &System, state: &State, dt: f64) -> Result<(), Self> {
        let expected = system.particles();
        if let Some(found) =
            [state.positions.len(), state.velocities.len()].into_iter().find(|&found| found != expected)
        {
            return Err(Self::ForeignState { found, expected });
        }
        if dt.is_finite() && dt > 0.0 { Ok(()) } else { Err(Self::StepLength(dt)) }
    }

    /// The status of a run that this failure ends.
    pub fn status(&self) -> Status {
        match self {
            Self::Solve(SolveFailure::Indefinite(_)) => Status::Indefinite,
            Self::Solve(
                SolveFailure::NotConverged { .. }
                | SolveFailure::Untrusted { .. }
                | SolveFailure::Unprepared
                | SolveFailure::WrongLength { .. },
            ) => Status::NotConverged,
            Self::Solve(SolveFailure::NonFinite)
            | Self::NonFinite
            | Self::StepLength(_)
            | Self::ForeignState { .. } => Status::NonFinite,
            Self::Solve(SolveFailure::Interrupted) => Status::Interrupted,
            Self::DegenerateSpring(_) => Status::DegenerateSpring,
            Self::Newton { .. } | Self::Tolerance => Status::NotConverged,
            Self::Unstable { .. } => Status::Unstable,
        }
    }
}
/// A number for people that may have grown beyond all numbers.
pub(super) fn large(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$e}") } else { "more than 1e308".into() }
}

#[cfg(test)]
mod tests {
    use super::{NotSolved, StepFailure};

    #[test]
    fn failures_are_sentences() {
        let newton = |reason| StepFailure::Newton { iterations: 7, relative_residual: 0.25, reason };
        for (failure, text) in [
            (
                newton(NotSolved::LineSearch),
                "Newton's method found no step length that makes progress after 7 iterations at a relative residual of 2.500e-1",
            ),
            (
                newton(NotSolved::Ascent),
                "Newton's method met an indefinite matrix whose direction does not descend after 7 iterations at a relative \
                 residual of 2.500e-1",
            ),
            (
                newton(NotSolved::IterationLimit),
                "Newton's method reached its iteration limit after 7 iterations at a relative residual of 2.500e-1",
            ),
            (
                StepFailure::Unstable { gained: 12.5, exchanged: 2.0 },
                "1.250e1 J of energy appeared from nowhere; the motion had 2.000e0 J to exchange until then",
            ),
            (
                StepFailure::Unstable { gained: f64::INFINITY, exchanged: 2.0 },
                "more than 1e308 J of energy appeared from nowhere; the motion had 2.000e0 J to exchange until then",
            ),
        ] {
            assert_eq!(failure.to_string(), text);
        }
    }
}
