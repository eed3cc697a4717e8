//! Diagnosis of `A = M/dt² − G/dt − K`: its definiteness, the springs that destroy it, and the steps that are safe.
//!
//! [`Inspection::at`] examines all parts at one state. Each is also available alone:
//!
//! - [`Inertia`]: the signs of the eigenvalues, from a factorization with a measured error;
//! - [`CriticalSteps`], [`RotationLimit`]: the longest step that is definite, stable, or rotates no spring too far;
//! - [`spectrum()`], [`direction`]: the ends of the spectrum, and the springs behind an eigenvector;
//! - [`smallest_set()`]: the springs whose transverse terms must be dropped;
//! - [`Follower`]: the property that a run loses first.
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
mod oracle;
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
pub use spectrum::{Spectrum, spectrum};

#[cfg(test)]
mod critical_tests;
#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod inertia_tests;
#[cfg(test)]
mod tests;
