//! Forces of the caller's own.

use super::Moment;
use nalgebra::Vector3;
use std::fmt::Debug;

/// A force on particles that comes from outside: wind, a hand, another program; see
/// [`System::with_external_force`](crate::System::with_external_force).
///
/// It may depend on time, positions and velocities. Its derivatives enter no matrix, so what changes much over one step bounds the
/// step as with an explicit method; the order of a method remains. `rodas4`, whose order hangs on the exact Jacobian, takes none.
/// Runs count its work with that of moving constraints.
///
/// # Examples
/// ```
/// use sprung::nalgebra::Vector3;
/// use sprung::system::{ExternalForce, Moment};
///
/// /// Air at rest that slows every particle down.
/// #[derive(Debug)]
/// struct Air {
///     /// In N·s/m.
///     drag: f64,
/// }
///
/// impl ExternalForce for Air {
///     fn add(&self, at: &Moment<'_>, force: &mut [Vector3<f64>]) {
///         for (f, v) in force.iter_mut().zip(at.velocities) {
///             *f -= v * self.drag;
///         }
///     }
/// }
/// ```
pub trait ExternalForce: Debug + Send + Sync {
    /// Adds the force on every particle, in N; both slices of `at` and `force` have one entry for each.
    fn add(&self, at: &Moment<'_>, force: &mut [Vector3<f64>]);
}
