//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?
//!
//! [`Inspection::at`] answers everything at one state. Its parts stand on their own: [`Inertia`] counts signs of eigenvalues
//! from a factorization whose error is measured, [`CriticalSteps`] finds the largest definite and the largest stable step,
//! [`Turning`] the largest that turns no spring too far, [`Follower`] what a run loses first, [`spectrum()`] the ends of the
//! spectrum, [`direction`] the springs behind an eigenvector, [`smallest_set()`] the springs whose transverse terms must go.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `definiteness`.

mod along;
mod analysed;
mod choice;
mod critical;
mod culprits;
mod eigenpair;
mod estimate;
mod estimated;
mod family;
mod first;
mod follow;
mod inertia;
mod inspection;
mod inspector;
mod krylov;
mod lanczos;
mod leaps;
mod left_out;
mod lobpcg;
mod nearby;
mod nearest;
mod necessary;
mod picture;
mod random;
mod search;
mod smallest;
mod smallest_set;
mod space;
mod spectrum;
mod turning;

pub use along::{DefinitenessWatch, Loss};
pub use choice::Minimality;
pub use critical::{CriticalSteps, LargestStep};
pub use culprits::{Cluster, Culprit, Direction, Mover, clusters, direction};
pub use eigenpair::Eigenpair;
pub use family::Property;
pub use first::FirstAnswer;
pub use follow::{FirstLosses, Follower, Gain, Passed};
pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
pub use inspection::{Inspection, OptionInspection};
pub use left_out::{AFFORDABLE, LeftOut, Part, Why};
pub use picture::Pictures;
pub use smallest::smallest_eigenvalue;
pub use smallest_set::{DropSet, smallest_set};
pub use spectrum::{Spectrum, spectrum};
pub use turning::{MOST_BRAKED, MOST_STRETCHED, Turn, Turning};

#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod tests;
