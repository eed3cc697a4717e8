//! What callers may choose.

use crate::error::Invalid;

/// When Newton's method is done, and when it gives up.
///
/// # Examples
/// ```
/// use sprung::integrate::{BackwardEuler, ImplicitOptions, NewtonOptions, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let newton = NewtonOptions { tolerance: 1e-12, ..NewtonOptions::default() };
/// let mut stepper = BackwardEuler::new(&system, &state, &ImplicitOptions::default(), newton)?;
/// stepper.step(&mut state, 0.01)?;
/// let newton = NewtonOptions { tolerance: -1.0, ..newton };
/// assert!(BackwardEuler::new(&system, &state, &ImplicitOptions::default(), newton).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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

#[cfg(test)]
mod tests {
    use super::NewtonOptions;

    #[test]
    fn tolerances_are_finite_and_not_negative() {
        for (tolerance, is_right) in
            [(0.0, true), (1e-3, true), (-1e-300, false), (f64::INFINITY, false), (f64::NAN, false)]
        {
            let options = NewtonOptions { tolerance, ..NewtonOptions::default() };
            assert_eq!(options.check().is_ok(), is_right, "{tolerance}");
        }
    }
}
