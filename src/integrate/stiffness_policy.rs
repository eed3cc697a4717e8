//! The transverse terms in the matrix of a solve: the caller's policy, and the state of a matrix under it.
//!
//! ```text
//! an option          that option, definite or not
//! on demand          all ─► all but a few ─► none of compressed springs
//! progressive        all ─► none of compressed springs at large residuals, and so on ─► none of compressed springs
//! whole              all, and an indefinite matrix is refused
//! ```
//!
//! An arrow stands for a matrix that was found indefinite.

use super::Statistics;
use crate::linear::{Definiteness, DefinitenessGuarantee, Evidence, SolveFailure};
use crate::spring::Stiffness;

/// The stiffness that enters the matrix of each solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StiffnessPolicy {
    /// The same option in every solve.
    Always(Stiffness),
    /// `Full` while A is positive definite; in solves where it is not, a [`Regularization`](super::Regularization) drops few transverse terms.
    /// [`Bdf2`](super::Bdf2), whose result does not depend on the matrix, takes the transverse terms of tensions that last.
    OnDemand,
    /// `Full` while A is positive definite; otherwise `Tension` for the springs at particles with a large residual, see `progressive`. For Newton's
    /// method; a linearised step is its first iteration. Source: Fernández-Fernández, Löschner and Bender, Computer Graphics Forum 45(2), 2026.
    Progressive,
}

impl StiffnessPolicy {
    /// Every policy.
    pub const ALL: [Self; 6] = [
        Self::OnDemand,
        Self::Progressive,
        Self::Always(Stiffness::Full),
        Self::Always(Stiffness::Tension),
        Self::Always(Stiffness::Axial),
        Self::Always(Stiffness::Absolute),
    ];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Always(option) => option.name(),
            Self::OnDemand => "on-demand",
            Self::Progressive => "progressive",
        }
    }

    pub(super) fn guarantee(self) -> DefinitenessGuarantee {
        match self {
            Self::Always(Stiffness::Full) => DefinitenessGuarantee::Unknown,
            Self::Always(_) => DefinitenessGuarantee::Definite,
            Self::OnDemand | Self::Progressive => DefinitenessGuarantee::RegularizedDefinite,
        }
    }
}

impl From<Stiffness> for StiffnessPolicy {
    fn from(option: Stiffness) -> Self {
        Self::Always(option)
    }
}

/// The transverse terms of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Terms {
    /// The terms of an option.
    Of(Stiffness),
    /// All but those that a [`Regularization`](super::Regularization) drops.
    Regularized,
    /// All but those that a [`Projection`](super::progressive::Projection) drops.
    Projected,
}

/// The terms of the current matrix, and its definiteness.
#[derive(Debug, Clone, Copy)]
pub(super) struct StiffnessState {
    /// `None` for all terms in a matrix that is refused where it is indefinite.
    policy: Option<StiffnessPolicy>,
    pub terms: Terms,
    /// Transverse terms of compressed springs that are dropped, or under `absolute` mirrored.
    pub dropped: usize,
    definiteness: Definiteness,
}

impl StiffnessState {
    /// The state in which a policy starts.
    pub fn first(policy: StiffnessPolicy) -> Self {
        let terms = match policy {
            StiffnessPolicy::Always(option) => Terms::Of(option),
            StiffnessPolicy::OnDemand => Terms::Of(Stiffness::Full),
            StiffnessPolicy::Progressive => Terms::Projected,
        };
        Self { policy: Some(policy), terms, dropped: 0, definiteness: Definiteness::Unknown }
    }

    /// All terms; indefinite matrices are refused.
    pub fn whole() -> Self {
        Self { policy: None, ..Self::first(Stiffness::Full.into()) }
    }

    /// An option holds, definite or not.
    fn is_option(&self) -> bool {
        matches!(self.policy, Some(StiffnessPolicy::Always(_)))
    }

    /// The replacement for an indefinite matrix, where the policy has one.
    pub fn softer(&self) -> Option<Self> {
        let terms = match (self.policy?, self.terms) {
            (StiffnessPolicy::OnDemand, Terms::Of(Stiffness::Full)) => Terms::Regularized,
            (StiffnessPolicy::OnDemand, Terms::Regularized) | (StiffnessPolicy::Progressive, Terms::Projected) => {
                Terms::Of(Stiffness::Tension)
            }
            _ => return None,
        };
        Some(Self { terms, ..*self })
    }

    /// Records what preparing the matrix has proved.
    ///
    /// # Errors
    /// An indefinite matrix, except under an option.
    pub fn accept(&mut self, definiteness: Definiteness) -> Result<(), SolveFailure> {
        self.definiteness = definiteness;
        match definiteness {
            Definiteness::Indefinite { dof, .. } if !self.is_option() => {
                Err(SolveFailure::Indefinite(Evidence::Pivot(dof)))
            }
            _ => Ok(()),
        }
    }

    /// Counts a solve with this matrix.
    pub fn count(&self, statistics: &mut Statistics) {
        let is_whole = match self.terms {
            Terms::Of(option) => option == Stiffness::Full,
            Terms::Projected => self.dropped == 0,
            Terms::Regularized => false,
        };
        if !self.is_option() && !is_whole {
            statistics.softened_solves += 1;
            statistics.dropped_terms += self.dropped as u64;
        }
        if let Definiteness::Indefinite { .. } = self.definiteness {
            statistics.indefinite_solves += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::Dof;

    #[test]
    fn policies_have_their_names() {
        let names = ["on-demand", "progressive", "full", "tension", "axial", "absolute"];
        assert_eq!(StiffnessPolicy::ALL.map(StiffnessPolicy::name), names);
    }

    #[test]
    fn on_demand_ends_without_terms_of_compressed_springs() {
        let first = StiffnessState::first(StiffnessPolicy::OnDemand);
        let regularized = first.softer().unwrap();
        let tension = regularized.softer().unwrap();
        let expected = [Terms::Of(Stiffness::Full), Terms::Regularized, Terms::Of(Stiffness::Tension)];
        assert_eq!([first, regularized, tension].map(|state| state.terms), expected);
        let projected = StiffnessState::first(StiffnessPolicy::Progressive);
        assert_eq!([projected, projected.softer().unwrap()].map(|state| state.terms), [Terms::Projected, expected[2]]);
        for last in [tension, StiffnessState::whole(), StiffnessState::first(Stiffness::Full.into())] {
            assert!(last.softer().is_none(), "{last:?}");
        }
    }

    #[test]
    fn indefinite_matrices_are_refused_except_under_an_option() {
        let found = Definiteness::Indefinite { negative: 1, dof: Dof { particle: 0, axis: 0 } };
        for (mut state, is_accepted) in [
            (StiffnessState::first(Stiffness::Full.into()), true),
            (StiffnessState::first(StiffnessPolicy::OnDemand), false),
            (StiffnessState::first(StiffnessPolicy::Progressive), false),
            (StiffnessState::whole(), false),
        ] {
            assert_eq!(state.accept(found).is_ok(), is_accepted, "{state:?}");
            assert!(state.accept(Definiteness::Positive).is_ok());
        }
    }
}
