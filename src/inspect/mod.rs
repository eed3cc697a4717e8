//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?

mod critical;
mod family;
mod inertia;
mod random;

pub use critical::{CriticalSteps, LargestStep};
pub use family::Requirement;
pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
