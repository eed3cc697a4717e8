//! Forces of the caller's own.

use super::StateView;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Debug;

/// Derivatives of the force on one particle by the position and the velocity of the same particle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivatives {
    /// ∂f/∂x, in N/m.
    pub stiffness: Matrix3<f64>,
    /// ∂f/∂v, in N·s/m.
    pub damping: Matrix3<f64>,
}

/// A force on particles that comes from outside: wind, a hand, a floor, another program; see
/// [`System::with_external_force`](crate::System::with_external_force).
///
/// It may depend on time, positions and velocities. Where it hands out its [derivatives](Self::add_derivatives) their symmetric parts enter the
/// matrices beside those of springs, so a stiff force does not bound the step: K gets ∂f/∂x, of which `tension` and `axial` keep what is negative
/// semidefinite, and G gets ∂f/∂v. Without them what changes much over one step bounds the step as with an explicit method; the order of a
/// method remains, but `rodas4`, whose order hangs on the exact Jacobian, refuses it. Runs count its work with that of moving constraints.
///
/// # Examples
/// A floor that pushes back with 1 kN/m:
///
/// ```
/// use sprung::nalgebra::Vector3;
/// use sprung::system::{Derivatives, ExternalForce, StateView};
///
/// #[derive(Debug)]
/// struct Floor;
///
/// impl ExternalForce for Floor {
///     fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
///         for (f, x) in force.iter_mut().zip(at.positions) {
///             f.y -= 1e3 * x.y.min(0.0);
///         }
///     }
///
///     fn has_derivatives(&self) -> bool {
///         true
///     }
///
///     fn add_derivatives(&self, at: &StateView<'_>, derivatives: &mut [Derivatives]) {
///         for (derivatives, x) in derivatives.iter_mut().zip(at.positions) {
///             if x.y < 0.0 {
///                 derivatives.stiffness[(1, 1)] -= 1e3;
///             }
///         }
///     }
/// }
/// ```
pub trait ExternalForce: Debug + Send + Sync {
    /// Adds the force on every particle, in N; both slices of `at` and `force` have one entry for each.
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]);

    /// Whether [`add_derivatives`](Self::add_derivatives) and [`add_rate`](Self::add_rate) say all that there is to say; a force that couples
    /// particles cannot.
    fn has_derivatives(&self) -> bool {
        false
    }

    /// Adds ∂f/∂x and ∂f/∂v of every particle. Where they are not symmetric, as those of a magnetic field, `rodas4` loses its order.
    fn add_derivatives(&self, _: &StateView<'_>, _: &mut [Derivatives]) {}

    /// Adds ∂f/∂t at fixed positions and velocities, in N/s: nothing where the force does not depend on time itself.
    fn add_rate(&self, _: &StateView<'_>, _: &mut [Vector3<f64>]) {}
}
