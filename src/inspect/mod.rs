//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?
//!
//! [`Inspection::at`] answers everything at one state. Its parts stand on their own: [`Inertia`] counts signs of eigenvalues
//! from a factorization whose error is measured, [`CriticalSteps`] finds the largest definite and the largest stable step,
//! [`RotationLimit`] the largest that turns no spring too far, [`Follower`] what a run loses first, [`spectrum()`] the ends of the
//! spectrum, [`direction`] the springs behind an eigenvector, [`smallest_set()`] the springs whose transverse terms must go.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `definiteness`.

mod bracket_search;
mod critical;
mod culprits;
mod definiteness_watch;
mod estimate;
mod follow;
mod greedy_selection;
mod inertia;
mod inspection;
mod inspector;
mod matrix_pencil;
mod necessary;
mod picture;
mod quick_check;
mod rotation_limit;
mod shifted_solves;
mod skipped;
mod smallest_set;
mod spectrum;

pub use crate::eigen::Eigenpair;
pub use critical::{CriticalSteps, LargestStep};
pub use culprits::{Cluster, Culprit, Direction, Mover, clusters, direction};
pub use definiteness_watch::{DefinitenessWatch, Loss};
pub use follow::{FirstLosses, Follower, Gain, Passed};
pub use greedy_selection::Minimality;
pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
pub use inspection::{Inspection, OptionInspection};
pub use matrix_pencil::Property;
pub use picture::Pictures;
pub use quick_check::FirstAnswer;
pub use rotation_limit::{MOST_BRAKED, MOST_STRETCHED, RotationLimit, Turn};
pub use skipped::{AFFORDABLE, Part, SkipReason, Skipped};
pub use smallest_set::{DropSet, smallest_set};
pub use spectrum::{Spectrum, smallest_eigenvalue, spectrum};

#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod tests;
