//! How exactly the equations of a step are worth solving: to a small part of the error in time that the step makes anyway.
//!
//! A step solves `A x = b` with `A = M/τ² + S`, x being a displacement or a correction of one. Where S is positive semidefinite, as
//! it is for matrices that are made so, `M^½ A⁻¹ M^½ ⪯ τ² I`, and a solution with the residual r is off by
//!
//! ```text
//! ‖e‖_M ≤ τ² ‖r‖_{M⁻¹} ≤ τ² ‖r‖₂/√m_min,      ‖e‖_M = √(eᵀ M e).
//! ```
//!
//! With E the error in time of the step, a displacement, it is exact enough at
//!
//! ```text
//! ‖r‖₂ ≤ θ ‖E‖_M √m_min/τ²,      θ = 10⁻⁴:
//! ```
//!
//! even if all steps erred to the same side they would add a ten-thousandth to what is wrong anyway. E is known when the step is done. As
//! motion is smooth the E of the last step stands for it; afterwards it is looked at, and a solution that is off by more than θ' = 10⁻³ of
//! it is improved. The first step of a run is solved to the last digit asked for, [`Tolerance::STRICT`], and so is a step without an error; no
//! residual is larger than θ ‖b‖₂, however large the last step's error was.
//!
//! Where the full stiffness of pressed springs makes S indefinite and A still definite, the bound is not proven.
//!
//! (Own derivation; "inexact" Newton methods choose their tolerances likewise, see [`Forcing`](super::forcing::Forcing).)

use crate::linear::Tolerance;
use crate::system::System;
use nalgebra::Vector3;

/// Of the error in time, what the linear solver may add.
const SHARE: f64 = 1e-4;

/// What it may turn out to have added before a solution is improved.
const MOST: f64 = 1e-3;

/// What is known of the errors of steps, and what follows for solvers.
#[derive(Debug, Clone)]
pub(super) struct LinearTolerance {
    /// Whether errors are of use.
    follows: bool,
    /// The smallest relative residual that is asked for.
    strictest: f64,
    /// √m_min over free particles, in √kg.
    lightest: f64,
    /// ‖E‖_M of the last step, in m √kg; `None` where it is not known.
    error: Option<f64>,
    /// The relative residual asked for last.
    asked: f64,
}

impl LinearTolerance {
    /// Nothing known.
    pub fn new(system: &System, tolerance: Tolerance) -> Self {
        let [lightest, _] = system.free_masses();
        let strictest = tolerance.strictest();
        Self {
            follows: tolerance == Tolerance::Adaptive,
            strictest,
            lightest: lightest.sqrt(),
            error: None,
            asked: strictest,
        }
    }

    /// Whether errors are of use.
    pub fn follows(&self) -> bool {
        self.follows
    }

    /// The smallest relative residual that is asked for.
    pub fn strictest(&self) -> f64 {
        self.strictest
    }

    /// Makes this the smallest relative residual that is asked for, unless it is larger already.
    pub fn never_below(&mut self, residual: f64) {
        self.strictest = self.strictest.max(residual);
    }

    /// Takes note of ‖E‖_M of a step, in m √kg.
    pub fn learn(&mut self, error: f64) {
        self.error = Some(error);
    }

    /// The relative residual to ask for: of a right-hand side of norm b, in N, with a matrix that has `inertia` = 1/τ² of M, in 1/s².
    pub fn ask(&mut self, b: f64, inertia: f64) -> f64 {
        let wanted = self.error.map_or(0.0, |error| SHARE * error * self.lightest * inertia / b);
        // Not a number where there is nothing to solve for.
        let is_cruder = self.follows && wanted > self.strictest;
        self.asked = if is_cruder { wanted.min(SHARE).max(self.strictest) } else { self.strictest };
        self.asked
    }

    /// What an improved solution could take of this residual, in N: nothing where it was solved to the last digit asked for.
    pub fn improvable(&self, residual: f64) -> f64 {
        if self.asked > self.strictest { residual } else { 0.0 }
    }

    /// Whether solutions with [improvable](Self::improvable) residuals of at most this norm, in N, are as exact as a step with the error ‖E‖_M deserves.
    pub fn suffices(&self, residual: f64, inertia: f64, error: f64) -> bool {
        // Where nothing moves the bound is not a number.
        residual == 0.0 || residual <= MOST * error * self.lightest * inertia
    }
}

/// `√(dᵀ M d)` over free coordinates, of all parts of a system together.
pub(super) fn mass_norm(system: &System, d: impl Fn(usize) -> Vector3<f64>) -> f64 {
    let dofs = system.dofs();
    let own = system.masses().iter().enumerate().take(system.own_particles());
    let squares = own.map(|(p, mass)| {
        let d = d(p);
        mass * dofs.free_axes(p).iter().map(|axis| d[axis] * d[axis]).sum::<f64>()
    });
    let [square] = system.total([squares.sum()]);
    square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::{LinearTolerance, MOST, SHARE, mass_norm};
    use crate::assembly::{SpringPattern, SystemMatrix};
    use crate::force::SpringGeometry;
    use crate::linear::{Cholesky, Tolerance};
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::{Spring, Stiffness};
    use crate::system::{State, System, SystemBuilder};
    use faer::Par;
    use nalgebra::Vector3;
    use std::sync::Arc;

    /// A chain of five particles of 1, 4, 9, … kg, the first held.
    fn chain() -> (System, State) {
        let mut builder = SystemBuilder::new();
        for i in 0..5 {
            let i = f64::from(i);
            builder.particle([i, 0.1 * i * i, 0.0], (i + 1.0) * (i + 1.0));
        }
        for i in 0..4 {
            builder.spring(i, i + 1, Spring { stiffness: 50.0, rest_length: 0.9, damping: 0.0 });
        }
        builder.hold(0);
        builder.build().unwrap()
    }

    /// The lightest free particle has 4 kg: 10⁻⁴ · 3 m √kg · 2 √kg · 5/s² over 8 N.
    #[test]
    fn a_share_of_the_error_is_asked_for() {
        let (system, _) = chain();
        let mut exactness = LinearTolerance::new(&system, Tolerance::Adaptive);
        assert_eq!(exactness.ask(8.0, 5.0), 1e-10);
        assert_eq!(exactness.improvable(7.0), 0.0);
        exactness.learn(3.0);
        let expected = SHARE * 3.0 * 2.0 * 5.0 / 80.0;
        assert!((exactness.ask(80.0, 5.0) - expected).abs() < 1e-12 * expected);
        assert_eq!(exactness.improvable(7.0), 7.0);
        // Never cruder than the share of the right-hand side, nor finer than the last digit asked for.
        assert_eq!(exactness.ask(1e-3, 5.0), SHARE);
        assert_eq!(exactness.ask(1e12, 5.0), 1e-10);
        assert_eq!(exactness.ask(0.0, 5.0), SHARE);
        exactness.learn(0.0);
        assert_eq!((exactness.ask(8.0, 5.0), exactness.ask(0.0, 5.0)), (1e-10, 1e-10));
        exactness.never_below(1e-7);
        assert_eq!((exactness.ask(8.0, 5.0), exactness.strictest()), (1e-7, 1e-7));

        let most = MOST * 3.0 * 2.0 * 5.0;
        assert!(exactness.suffices(0.0, 5.0, f64::NAN) && !exactness.suffices(1.0, 5.0, f64::NAN));
        assert!(exactness.suffices(0.99 * most, 5.0, 3.0) && !exactness.suffices(1.01 * most, 5.0, 3.0));
    }

    #[test]
    fn a_fixed_tolerance_stays() {
        let (system, _) = chain();
        let mut exactness = LinearTolerance::new(&system, Tolerance::Fixed(1e-5));
        exactness.learn(1e9);
        assert_eq!((exactness.ask(1.0, 1.0), exactness.follows()), (1e-5, false));
    }

    /// ‖A⁻¹ r‖_M ≤ τ² ‖r‖₂/√m_min, whatever the residual, and nearly as much for soft springs and a residual at the lightest particle.
    #[test]
    fn residuals_bound_errors() {
        let (system, state) = chain();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        for (tau, tight) in [(1e-3, 0.99), (0.1, 0.5), (10.0, 0.0)] {
            let combination = Combination::step(tau);
            let operator = SystemOperator::new(&system, &extensions, Stiffness::Tension, combination);
            let mut matrix = SystemMatrix::try_zeros(Arc::new(SpringPattern::of_stiffness(&system).unwrap())).unwrap();
            matrix.refill(&operator);
            let mut factor = Cholesky::analyse(matrix.matrix().pattern(), Par::Seq).unwrap();
            factor.factor(matrix.matrix()).unwrap();
            for dof in 0..12 {
                let mut error = vec![0.0; 12];
                error[dof] = 1.0;
                factor.substitute(&mut error);
                let mut displacement = vec![Vector3::zeros(); 5];
                system.dofs().scatter(&error, &mut displacement);
                let norm = mass_norm(&system, |p| displacement[p]);
                let bound = tau * tau / 2.0;
                assert!(norm <= bound * (1.0 + 1e-12), "{tau} {dof}: {norm} {bound}");
                assert!(dof >= 3 || norm >= tight * bound, "{tau} {dof}: {norm} {bound}");
            }
        }
    }
}
