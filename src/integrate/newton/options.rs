//! What callers may choose.

use crate::error::Invalid;

/// When Newton's method is done, and when it gives up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonOptions {
    /// Converged at `‖r‖ ≤ tolerance·s`, s the norm of the magnitudes of the forces that balance in r (and never
    /// below what rounding the positions does to r).
    pub tolerance: f64,
    /// The most iterations a step may take.
    pub iteration_limit: u64,
}

impl NewtonOptions {
    /// What every stepper checks.
    ///
    /// # Errors
    /// [`Invalid`] for a tolerance that is negative or not finite.
    pub fn check(&self) -> Result<(), Invalid> {
        if self.tolerance.is_finite() && self.tolerance >= 0.0 {
            return Ok(());
        }
        Err(Invalid::new("newton.tolerance", self.tolerance, "must be finite and not negative"))
    }
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { tolerance: 1e-10, iteration_limit: 200 }
    }
}
