//! How exactly conjugate gradients solve.

use crate::error::Invalid;

/// How exactly a step's equations are solved by a method that iterates.
///
/// # Examples
/// ```
/// use sprung::linear::Tolerance;
///
/// assert!(Tolerance::Fixed(1e-8).check().is_ok());
/// assert!(Tolerance::Fixed(0.0).check().is_err());
/// assert_eq!(Tolerance::Adaptive.strictest(), 1e-10);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// `‖b − A x‖ ≤ tolerance·‖b‖`.
    Fixed(f64),
    /// As exactly as the motion needs: a ten-thousandth of the error in time that a step makes anyway, and never more exactly than
    /// [`STRICT`](Self::STRICT). Steppers that cannot tell their error solve that exactly.
    Adaptive,
}

impl Tolerance {
    /// Where nothing is known of the motion, and for solvers that are to be compared digit by digit.
    pub const STRICT: f64 = 1e-10;

    /// The smallest relative residual that is asked for.
    pub fn strictest(self) -> f64 {
        match self {
            Self::Fixed(tolerance) => tolerance,
            Self::Adaptive => Self::STRICT,
        }
    }

    /// What every stepper checks: a tolerance that can be reached, and that asks for something.
    ///
    /// # Errors
    /// [`Invalid`] for a tolerance that does not lie between 0 and 1.
    pub fn check(self) -> Result<(), Invalid> {
        let strictest = self.strictest();
        if strictest > 0.0 && strictest < 1.0 {
            return Ok(());
        }
        Err(Invalid::new("tolerance", strictest, "must lie between 0 and 1"))
    }
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::Fixed(Self::STRICT)
    }
}

#[cfg(test)]
mod tests {
    use super::Tolerance;
    use crate::linear::SolverOptions;

    /// Neither all of b nor nothing of it may be left; where the motion decides there is nothing to refuse.
    #[test]
    fn tolerances_lie_between_nothing_and_all() {
        for (tolerance, is_fine) in
            [(0.0, false), (1.0, false), (-1e-3, false), (f64::NAN, false), (2.0, false), (1e-300, true), (0.999, true)]
        {
            assert_eq!(Tolerance::Fixed(tolerance).check().is_ok(), is_fine, "{tolerance}");
            let options = SolverOptions::default().with_tolerance(tolerance).ok().map(|options| options.tolerance);
            assert_eq!(options, is_fine.then_some(Tolerance::Fixed(tolerance)), "{tolerance}");
        }
        assert!(Tolerance::Adaptive.check().is_ok());
    }
}
