//! Which stiffness matrices have, by name.

use crate::linear::DefinitenessGuarantee;
use crate::spring::Stiffness;

/// Which stiffness enters the matrix of each solve.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::integrate::StiffnessPolicy;
///
/// let policy = StiffnessPolicy::from(Stiffness::Axial);
/// assert_eq!((policy.name(), StiffnessPolicy::OnDemand.name()), ("axial", "on-demand"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StiffnessPolicy {
    /// The same option in every solve.
    Always(Stiffness),
    /// `Full` while A is positive definite; in the solves where it is not, transverse terms are dropped, as few as a
    /// condition without factorizations can promise to be enough, see [`Regularization`](super::Regularization). With a factorization "is not" is proven;
    /// with conjugate gradients it means that negative curvature was met. [`Bdf2`](super::Bdf2), whose result does not hang on the
    /// matrix, takes the transverse terms of tensions that last.
    OnDemand,
}

impl StiffnessPolicy {
    /// Every policy.
    pub const ALL: [Self; 4] = [
        Self::OnDemand,
        Self::Always(Stiffness::Full),
        Self::Always(Stiffness::Tension),
        Self::Always(Stiffness::Axial),
    ];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Always(option) => option.name(),
            Self::OnDemand => "on-demand",
        }
    }

    /// What it says of every matrix.
    pub(super) fn assurance(self) -> DefinitenessGuarantee {
        match self {
            Self::Always(Stiffness::Full) => DefinitenessGuarantee::Unknown,
            Self::Always(Stiffness::Tension | Stiffness::Axial) => DefinitenessGuarantee::Definite,
            Self::OnDemand => DefinitenessGuarantee::RegularizedDefinite,
        }
    }
}

impl From<Stiffness> for StiffnessPolicy {
    fn from(option: Stiffness) -> Self {
        Self::Always(option)
    }
}

#[cfg(test)]
mod tests {
    use super::StiffnessPolicy;

    #[test]
    fn policies_go_by_their_names() {
        assert_eq!(StiffnessPolicy::ALL.map(StiffnessPolicy::name), ["on-demand", "full", "tension", "axial"]);
    }
}
