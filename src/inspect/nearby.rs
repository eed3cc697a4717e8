//! The systems of steps of many lengths, by one factorization.
//!
//! With `s = 1/dt` the matrix of a step is `P(s) = s² M + s C + K`, here with C and K positive semidefinite, so that `P(s) ≥ s² M`. Once `P(s₀)` is
//! factored, every `P(s) x = b` is solved in a space V that grows with all of them: x = V y is the best there is in V (`VᵀP(s)V y = Vᵀb`), and as
//! long as its residual r is too large, `P(s₀)⁻¹ r` joins V. Without damping the space for one s is that of conjugate gradients preconditioned with
//! `P(s₀)`, which needs some twenty vectors for steps four times as long or short; it serves the next s as well, which so needs few or none.
//!
//! Where s is so large that the masses dominate, the blocks of single particles do as well in the place of `P(s₀)`, and nothing is factored.
//!
//! **When it is enough.** The error e has `eᵀP(s)e = rᵀP(s)⁻¹r ≤ rᵀM⁻¹r/s²`, to be held against `xᵀP(s)x = xᵀb`.

use super::space::{Space, Term};
use crate::force::Extensions;
use crate::linear::dot;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::System;
use nalgebra::{Cholesky, DVector};

/// Error in the norm of P(s), relative to the solution.
const TOLERANCE: f64 = 1e-5;

/// Vectors that the space may have: as much work as several factorizations, for matrices of cloths.
const MOST: usize = 40;

/// A space for the steps from one state under one option.
pub(super) struct Nearby<'s> {
    /// M, C and K.
    masses: Vec<f64>,
    damping: Option<SystemOperator<'s>>,
    stiffness: SystemOperator<'s>,
    space: Space,
}

impl<'s> Nearby<'s> {
    /// Of nothing yet. The stiffness under the option must be positive semidefinite.
    pub fn new(system: &'s System, extensions: &Extensions, option: Stiffness) -> Self {
        let operator = |damping, stiffness| {
            SystemOperator::new(system, extensions, option, Combination { mass: 0.0, damping, stiffness })
        };
        let mut masses = vec![0.0; system.dofs().len()];
        for (particle, mass) in system.masses().iter().enumerate() {
            masses[system.dofs().rows(particle)].fill(*mass);
        }
        let is_damped = system.is_damped();
        Self {
            masses,
            damping: is_damped.then(|| operator(-1.0, 0.0)),
            stiffness: operator(0.0, -1.0),
            space: Space::default(),
        }
    }

    /// Solves `P(s) x = b`, b in the place of x, with what `precondition` makes of a residual; whether that was possible. `p` is P(s).
    pub fn solve(
        &mut self,
        s: f64,
        p: &SystemOperator<'_>,
        precondition: &mut dyn FnMut(&mut [f64]),
        x: &mut [f64],
    ) -> bool {
        let b = x.to_vec();
        let mut rest = vec![0.0; b.len()];
        loop {
            let Some(y) = self.best(s, &b) else { return false };
            self.space.combine(&y, x);
            p.apply(x, &mut rest);
            rest.iter_mut().zip(&b).for_each(|(rest, b)| *rest = b - *rest);
            let error: f64 = rest.iter().zip(&self.masses).map(|(r, mass)| r * r / mass).sum();
            let energy = dot(x, &b);
            if !(error.is_finite() && energy.is_finite()) {
                return false;
            }
            if error <= (TOLERANCE * s).powi(2) * energy || error == 0.0 {
                return true;
            }
            if self.space.len() == MOST {
                return false;
            }
            precondition(&mut rest);
            if !self.add(&rest) {
                return false;
            }
        }
    }

    /// y, the best of the space.
    fn best(&self, s: f64, b: &[f64]) -> Option<DVector<f64>> {
        Cholesky::new(self.space.matrix(s)).map(|factored| factored.solve(&self.space.parts(b)))
    }

    /// Adds what is new of a vector; whether anything is.
    fn add(&mut self, vector: &[f64]) -> bool {
        let Self { masses, damping, stiffness, space } = self;
        space.add(vector, |term, v, product| match (term, &*damping) {
            (Term::Mass, _) => product.iter_mut().zip(v).zip(&*masses).for_each(|((p, v), mass)| *p = mass * v),
            (Term::Damping, Some(damping)) => damping.apply(v, product),
            (Term::Damping, None) => product.fill(0.0),
            (Term::Constant, _) => stiffness.apply(v, product),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Nearby;
    use crate::force::Extensions;
    use crate::inspect::fixtures::{pin, pinned};
    use crate::linear::dot;
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::Stiffness;

    /// (s² m + c) x = b by hand: exactly, with what solves exactly, and not at all where squares overflow.
    #[test]
    fn steps_are_solved_for_unless_they_overflow() {
        let (system, state) = pinned(&[pin(2.0, -1.0), pin(1.0, -12.0)]);
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let p = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.5));
        let mut nearby = Nearby::new(&system, &extensions, Stiffness::Tension);
        let mut uses = 0;
        let mut precondition = |r: &mut [f64]| {
            uses += 1;
            r[0] /= 9.0;
            r[1] /= 16.0;
        };
        let mut x = [27.0, 32.0];
        assert!(nearby.solve(2.0, &p, &mut precondition, &mut x));
        assert!((x[0] - 3.0).abs() < 1e-12 && (x[1] - 2.0).abs() < 1e-12 && dot(&x, &x) < 14.0, "{x:?}");
        assert_eq!(uses, 1);
        let mut fresh = Nearby::new(&system, &extensions, Stiffness::Tension);
        let mut unused = |_: &mut [f64]| panic!("a direction that is of no use");
        assert!(!fresh.solve(2.0, &p, &mut unused, &mut [1e200, 0.0]));
    }
}
