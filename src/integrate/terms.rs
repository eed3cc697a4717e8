//! Which transverse terms the matrix of a solve has.
//!
//! ```text
//! an option          that one, whatever the matrix turns out to be
//! on demand          all ─► all but a few ─► none of compressed springs
//! whole              all, and an indefinite matrix is refused
//! ```
//!
//! An arrow is a matrix that was found to be indefinite.

use super::{Statistics, StiffnessPolicy};
use crate::linear::{Definiteness, Evidence, SolveFailure};
use crate::spring::Stiffness;

/// The terms of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Terms {
    /// Those of an option.
    Of(Stiffness),
    /// All but those that a [`Regularization`](super::Regularization) drops.
    Softened,
    /// All, in a matrix whose definiteness its caller sees to.
    Whole,
}

/// The terms at hand, and what may come after them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Choice {
    policy: StiffnessPolicy,
    terms: Terms,
    /// Transverse terms that the on-demand policy has dropped.
    pub dropped: usize,
    definiteness: Definiteness,
}

impl Choice {
    /// What a policy begins with.
    pub fn first(policy: StiffnessPolicy) -> Self {
        let first = if let StiffnessPolicy::Always(option) = policy { option } else { Stiffness::Full };
        Self { policy, terms: Terms::Of(first), dropped: 0, definiteness: Definiteness::Unknown }
    }

    /// All terms, and no matrix that is not positive definite.
    pub fn whole() -> Self {
        Self { terms: Terms::Whole, ..Self::first(StiffnessPolicy::OnDemand) }
    }

    pub fn terms(&self) -> Terms {
        self.terms
    }

    /// What replaces a matrix that turns out to be indefinite, if the policy allows: first the few terms that may be enough,
    /// then, should rounding have spoilt that, all that can be.
    pub fn softer(&self) -> Option<Self> {
        let terms = match (self.policy, self.terms) {
            (StiffnessPolicy::OnDemand, Terms::Of(Stiffness::Full)) => Terms::Softened,
            (StiffnessPolicy::OnDemand, Terms::Softened) => Terms::Of(Stiffness::Tension),
            _ => return None,
        };
        Some(Self { terms, ..*self })
    }

    /// Takes note of what preparing the matrix has proved.
    ///
    /// # Errors
    /// An indefinite matrix where the policy does not take one.
    pub fn accept(&mut self, definiteness: Definiteness) -> Result<(), SolveFailure> {
        self.definiteness = definiteness;
        match definiteness {
            Definiteness::Indefinite { dof, .. } if self.policy == StiffnessPolicy::OnDemand => {
                Err(SolveFailure::Indefinite(Evidence::Pivot(dof)))
            }
            _ => Ok(()),
        }
    }

    /// Counts a solve with this matrix.
    pub fn count(&self, statistics: &mut Statistics) {
        let is_whole = matches!(self.terms, Terms::Of(Stiffness::Full) | Terms::Whole);
        if self.policy == StiffnessPolicy::OnDemand && !is_whole {
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
    use super::{Choice, Terms};
    use crate::integrate::StiffnessPolicy;
    use crate::linear::Definiteness;
    use crate::spring::Stiffness;
    use crate::system::Dof;

    #[test]
    fn on_demand_ends_with_all_compressed_springs_softened() {
        let first = Choice::first(StiffnessPolicy::OnDemand);
        let softened = first.softer().unwrap();
        let tension = softened.softer().unwrap();
        let expected = [Terms::Of(Stiffness::Full), Terms::Softened, Terms::Of(Stiffness::Tension)];
        assert_eq!([first, softened, tension].map(|choice| choice.terms()), expected);
        for last in [tension, Choice::whole(), Choice::first(Stiffness::Full.into())] {
            assert!(last.softer().is_none(), "{last:?}");
        }
    }

    /// Only an option takes an indefinite matrix for what it is.
    #[test]
    fn indefinite_matrices_are_refused_but_under_an_option() {
        let found = Definiteness::Indefinite { negative: 1, dof: Dof { particle: 0, axis: 0 } };
        for (mut choice, is_accepted) in [
            (Choice::first(Stiffness::Full.into()), true),
            (Choice::first(StiffnessPolicy::OnDemand), false),
            (Choice::whole(), false),
        ] {
            assert_eq!(choice.accept(found).is_ok(), is_accepted, "{choice:?}");
            assert!(choice.accept(Definiteness::Positive).is_ok());
        }
    }
}
