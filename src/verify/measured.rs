//! What a family of checks hands back: the checks, or why they could not be carried out.

use super::Check;
use crate::error::Error;
use crate::force::DegenerateSpring;
use crate::integrate::StepFailure;
use crate::linear::SolveFailure;

/// The checks of a family, or why they could not be carried out.
pub(super) type Measured = Result<Vec<Check>, Unfinished>;

/// Why a check could not be carried out.
#[derive(Debug, thiserror::Error)]
pub(super) enum Unfinished {
    #[error(transparent)]
    Input(#[from] Error),
    #[error(transparent)]
    Step(#[from] StepFailure),
    #[error(transparent)]
    Solve(#[from] SolveFailure),
    #[error(transparent)]
    Degenerate(#[from] DegenerateSpring),
}

impl Unfinished {
    /// Whether a step or a solver has reported that it cannot do what was asked, as it should where the numbers of a scene do not allow it:
    /// then nothing is wrong, and nothing is known either. Whatever else prevents a check counts as failed.
    pub fn is_reported(&self) -> bool {
        matches!(self, Self::Step(_) | Self::Solve(_))
    }
}
