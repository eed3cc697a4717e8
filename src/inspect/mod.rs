//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?

mod critical;
mod family;
mod inertia;
mod krylov;
mod random;
mod spectrum;

pub use critical::{CriticalSteps, LargestStep};
pub use family::Requirement;
pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
pub use spectrum::{Eigenpair, Spectrum, spectrum};
