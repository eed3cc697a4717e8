//! The systems of steps of many lengths, by one factorization.
//!
//! With `s = 1/dt` the matrix of a step is `P(s) = s² M + s C + K`, here with C and K positive semidefinite, so that `P(s) ≥ s² M`. Once `P(s₀)` is
//! factored, every `P(s) x = b` is solved in a space V that grows with all of them: x = V y is the best there is in V (`VᵀP(s)V y = Vᵀb`), and as
//! long as its residual r is too large, `P(s₀)⁻¹ r` joins V. Without damping the space for one s is that of conjugate gradients preconditioned with
//! `P(s₀)`, which needs some twenty vectors for steps four times as long or short; it serves the next s as well, which so needs few or none.
//!
//! **When it is enough.** The error e has `eᵀP(s)e = rᵀP(s)⁻¹r ≤ rᵀM⁻¹r/s²`, to be held against `xᵀP(s)x = xᵀb`.

use crate::force::Extensions;
use crate::linear::{Ldlt, dot, norm};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Error in the norm of P(s), relative to the solution.
const TOLERANCE: f64 = 1e-5;

/// Vectors that the space may have: as much work as several factorizations, for matrices of cloths.
const MOST: usize = 40;

/// What is left of a vector that is already in the space, relatively.
const NOTHING: f64 = 1e-10;

/// A space for the steps from one state under one option.
pub(super) struct Nearby<'s> {
    /// M, C and K.
    masses: Vec<f64>,
    damping: Option<SystemOperator<'s>>,
    stiffness: SystemOperator<'s>,
    basis: Vec<Vec<f64>>,
    /// `VᵀMV`, `VᵀCV` and `VᵀKV`, by columns as they came.
    projected: [Vec<Vec<f64>>; 3],
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
        let is_damped = system.active().any(|(_, _, spring)| spring.damping > 0.0);
        Self {
            masses,
            damping: is_damped.then(|| operator(-1.0, 0.0)),
            stiffness: operator(0.0, -1.0),
            basis: Vec::new(),
            projected: [const { Vec::new() }; 3],
        }
    }

    /// Solves `P(s) x = b`, b in the place of x, with the factorization of some `P(s₀)`; whether that was possible. `p` is P(s).
    pub fn solve(
        &mut self,
        s: f64,
        p: &SystemOperator<'_>,
        factorization: &mut Ldlt,
        x: &mut [f64],
        work: &mut Work,
    ) -> bool {
        let b = x.to_vec();
        let mut rest = vec![0.0; b.len()];
        loop {
            let Some(y) = self.best(s, &b) else { return false };
            x.fill(0.0);
            for (v, y) in self.basis.iter().zip(y.iter()) {
                x.iter_mut().zip(v).for_each(|(x, v)| *x += y * v);
            }
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
            work.solves += 1;
            factorization.solve_in_place(&mut rest);
            if self.basis.len() == MOST || !self.add(&rest) {
                return false;
            }
        }
    }

    /// y, the best of the space.
    fn best(&self, s: f64, b: &[f64]) -> Option<DVector<f64>> {
        let size = self.basis.len();
        let [m, c, k] = &self.projected;
        let entry = |row: usize, column: usize| {
            let (row, column) = (row.min(column), row.max(column));
            s * s * m[column][row] + s * c[column][row] + k[column][row]
        };
        if size == 0 {
            return Some(DVector::zeros(0));
        }
        let right = DVector::from_fn(size, |row, _| dot(&self.basis[row], b));
        Cholesky::new(DMatrix::from_fn(size, size, entry)).map(|factored| factored.solve(&right))
    }

    /// Adds what is new of a vector; whether anything is.
    fn add(&mut self, vector: &[f64]) -> bool {
        let mut v = vector.to_vec();
        let length = norm(&v);
        for _ in 0..2 {
            for other in &self.basis {
                let part = dot(other, &v);
                v.iter_mut().zip(other).for_each(|(v, other)| *v -= part * other);
            }
        }
        let left = norm(&v);
        if left.is_nan() || left <= NOTHING * length {
            return false;
        }
        v.iter_mut().for_each(|v| *v /= left);
        self.basis.push(v);
        let Some(v) = self.basis.last() else { return false };
        let mut product = vec![0.0; v.len()];
        let column = |product: &[f64]| -> Vec<f64> { self.basis.iter().map(|u| dot(u, product)).collect() };
        product.iter_mut().zip(v).zip(&self.masses).for_each(|((p, v), mass)| *p = mass * v);
        let m = column(&product);
        let c = match &self.damping {
            Some(damping) => {
                damping.apply(v, &mut product);
                column(&product)
            }
            None => vec![0.0; m.len()],
        };
        self.stiffness.apply(v, &mut product);
        let k = column(&product);
        self.projected.iter_mut().zip([m, c, k]).for_each(|(columns, new)| columns.push(new));
        true
    }
}
