//! The accuracy to which the equations of a step are worth solving: a small part of the error in time that the step makes anyway.
//!
//! A step solves `A x = b` with `A = M/τ² + S`, x being a displacement or a correction of one. Where S is positive semidefinite, as in
//! regularized matrices, `M^½ A⁻¹ M^½ ⪯ τ² I`, and a solution with the residual r has the error e,
//!
//! ```text
//! ‖e‖_M ≤ τ² ‖r‖_{M⁻¹} ≤ τ² ‖r‖₂/√m_min,      ‖e‖_M = √(eᵀ M e).
//! ```
//!
//! With E the error in time of the step, a displacement, the solution is accurate enough at `‖r‖₂ ≤ θ ‖E‖_M √m_min/τ²`, θ = 10⁻⁴: even if the errors
//! of all steps had the same sign they would add a ten-thousandth to the error of the run. The E of the last step stands for that of the next;
//! afterwards a solution with an error of more than θ' = 10⁻³ of E is improved. The first step of a run, and a step without an error, is solved to
//! [`Tolerance::STRICT`]. No residual is larger than θ ‖b‖₂. Where compressed springs make S indefinite and A still definite, the bound is not
//! proven.

use super::{free_square, sum_of_all};
use crate::linear::Tolerance;
use crate::system::System;
use nalgebra::Vector3;

/// θ, and θ'.
const SHARE: f64 = 1e-4;
const LARGEST_SHARE: f64 = 1e-3;

/// The errors of steps, and the tolerances that follow for solvers.
#[derive(Debug, Clone)]
pub(super) struct LinearTolerance {
    pub is_adaptive: bool,
    /// The smallest relative residual that is asked for.
    pub strictest: f64,
    /// √m_min over free particles, in √kg.
    root_mass: f64,
    /// ‖E‖_M of the last step, in m √kg; `None` where it is not known.
    error: Option<f64>,
    /// The last relative residual asked for.
    last: f64,
}

impl LinearTolerance {
    pub fn new(system: &System, tolerance: Tolerance) -> Self {
        let [lightest, _] = system.free_masses();
        let strictest = tolerance.strictest();
        let is_adaptive = tolerance == Tolerance::Adaptive;
        Self { is_adaptive, strictest, root_mass: lightest.sqrt(), error: None, last: strictest }
    }

    /// Records ‖E‖_M of a step, in m √kg.
    pub fn record(&mut self, error: f64) {
        self.error = Some(error);
    }

    /// The relative residual for a right-hand side of norm b, in N, and a matrix with `inertia` = 1/τ² of M, in 1/s².
    pub fn next(&mut self, b: f64, inertia: f64) -> f64 {
        let wanted = self.error.map_or(0.0, |error| SHARE * error * self.root_mass * inertia / b);
        // NaN where b and the error are zero.
        let is_coarser = self.is_adaptive && wanted > self.strictest;
        self.last = if is_coarser { wanted.min(SHARE).max(self.strictest) } else { self.strictest };
        self.last
    }

    /// The part of a residual, in N, that a better solution could remove: none where the strictest tolerance was asked for.
    pub fn improvable(&self, residual: f64) -> f64 {
        if self.last > self.strictest { residual } else { 0.0 }
    }

    /// True if [improvable](Self::improvable) residuals of at most this norm, in N, are small enough for a step with the error ‖E‖_M.
    pub fn suffices(&self, residual: f64, inertia: f64, error: f64) -> bool {
        // Where nothing moves the bound is NaN.
        residual == 0.0 || residual <= LARGEST_SHARE * error * self.root_mass * inertia
    }
}

/// `√(dᵀ M d)` over free coordinates, of all parts of a system together.
pub(super) fn mass_norm(system: &System, d: impl Fn(usize) -> Vector3<f64>) -> f64 {
    sum_of_all(system, |p| system.masses()[p] * free_square(system, p, &d(p))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::fixtures::tethered;

    /// The free particle has 4 kg: 10⁻⁴ · 3 m √kg · 2 √kg · 5/s² over 8 N.
    #[test]
    fn a_share_of_the_error_is_asked_for() {
        let (system, _) = tethered(1.0, 4.0, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        assert_eq!(mass_norm(&system, |_| Vector3::new(0.0, 3.0, 4.0)), 10.0);
        let mut tolerance = LinearTolerance::new(&system, Tolerance::Adaptive);
        assert_eq!(tolerance.next(8.0, 5.0), 1e-10);
        assert_eq!(tolerance.improvable(7.0), 0.0);
        tolerance.record(3.0);
        let expected = SHARE * 3.0 * 2.0 * 5.0 / 80.0;
        assert!((tolerance.next(80.0, 5.0) - expected).abs() < 1e-12 * expected);
        assert_eq!(tolerance.improvable(7.0), 7.0);
        // Never cruder than the share of the right-hand side, nor finer than the last digit asked for.
        assert_eq!(tolerance.next(1e-3, 5.0), SHARE);
        assert_eq!(tolerance.next(1e12, 5.0), 1e-10);
        assert_eq!(tolerance.next(0.0, 5.0), SHARE);
        tolerance.record(0.0);
        assert_eq!((tolerance.next(8.0, 5.0), tolerance.next(0.0, 5.0)), (1e-10, 1e-10));
        tolerance.strictest = 1e-7;
        assert_eq!(tolerance.next(8.0, 5.0), 1e-7);

        let mut fixed = LinearTolerance::new(&system, Tolerance::Fixed(1e-5));
        fixed.record(1e9);
        assert_eq!((fixed.next(1.0, 1.0), fixed.is_adaptive), (1e-5, false));

        let largest = LARGEST_SHARE * 3.0 * 2.0 * 5.0;
        assert!(tolerance.suffices(0.0, 5.0, f64::NAN) && !tolerance.suffices(1.0, 5.0, f64::NAN));
        assert!(tolerance.suffices(0.99 * largest, 5.0, 3.0) && !tolerance.suffices(1.01 * largest, 5.0, 3.0));
    }
}
