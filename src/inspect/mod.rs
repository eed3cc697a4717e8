//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?
//!
//! [`Inspection::at`] answers everything at one state. Its parts stand on their own: [`Inertia`] counts signs of eigenvalues
//! from a factorization whose error is measured, [`CriticalSteps`] finds the largest definite and the largest stable step,
//! [`RotationLimit`] the largest that rotates no spring too far, [`Follower`] the property that a run loses first, [`spectrum()`]
//! the ends of the spectrum, [`direction`] the springs behind an eigenvector, [`smallest_set()`] the springs whose transverse
//! terms must go.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `definiteness`.

mod critical;
mod culprits;
mod estimate;
mod follow;
mod inertia;
mod inspection;
mod inspector;
mod necessary;
mod picture;
mod rotation_limit;
mod smallest_set;
mod spectrum;

pub use crate::eigen::Eigenpair;
pub use critical::{CriticalSteps, LargestStep, Property};
pub use culprits::{Cluster, Culprit, Direction, Mover, clusters, direction};
pub use follow::{DefinitenessWatch, FirstLosses, Follower, Gain, Loss, Passed};
pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
pub use inspection::{FirstAnswer, Inspection, OptionInspection, Part, SkipReason, Skipped};
pub use inspector::AFFORDABLE;
pub use picture::Pictures;
pub use rotation_limit::{MOST_BRAKED, MOST_STRETCHED, RotationLimit, Turn};
pub use smallest_set::{DropSet, Minimality, smallest_set};
pub use spectrum::{Spectrum, smallest_eigenvalue, spectrum};

#[cfg(test)]
mod critical_tests;
#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod inertia_tests;
#[cfg(test)]
mod tests;
