//! Debugging definiteness: is A positive definite, which springs spoil it, and which step is safe?

mod inertia;
mod random;

pub use inertia::{Inertia, InertiaCounter, InertiaMethod};
