//! What may look on while a method goes through all springs.

use crate::error::DegenerateSpring;
use crate::system::{StateView, System};
use nalgebra::Vector3;

/// An account of the springs that goes over them after every step, or, where a method evaluates forces at the end of its steps,
/// along with that.
pub trait SpringVisitor {
    /// Whether it can compute the forces of this system, on this thread.
    fn computes_forces(&self, system: &System) -> bool;

    /// As [`set_total_force`](crate::force::set_total_force) and then [`see`](Self::see), to the bit, in one pass, but for the forces on
    /// particles that are fixed: whatever they are, nothing follows.
    ///
    /// # Errors
    /// A spring whose ends coincide.
    fn set_force(&mut self, at: &StateView<'_>, dt: f64, force: &mut [Vector3<f64>]) -> Result<(), DegenerateSpring>;

    /// Goes over the springs at the end of a step of dt seconds, with velocities of the method's own.
    fn see(&mut self, at: &StateView<'_>, dt: f64);
}
