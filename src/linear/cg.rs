//! The preconditioned conjugate gradient method, with an outcome for every way it can end.
//!
//! For symmetric positive definite A (Hestenes and Stiefel 1952; notation of Shewchuk 1994):
//! `α = rᵀz/pᵀAp`, `x += α p`, `r −= α A p`, `z = P⁻¹ r`, `β = rᵀz/(rᵀz)_old`, `p = z + β p`.
//! The recurrence's r drifts away from `b − A x`. When it says "converged" the true residual is computed; if that is
//! still too large, the iteration restarts from it, as long as this at least halves it from one restart to the next.
//!
//! A right-hand side so small or large that `pᵀAp` would under- or overflow (a motion that has come to rest but for 10⁻¹⁶⁰ m/s)
//! is multiplied by a power of two first, and the solution divided by it: the same iteration, digit by digit.

use super::norms::{dot, norm, scaling};
use super::preconditioner::Preconditioner;
use super::vector::{advance, descend, subtract};
use crate::interrupt::Interrupt;
use crate::operator::LinearOperator;

/// How conjugate gradients ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CgOutcome {
    /// The true residual is within the tolerance.
    Converged,
    /// A direction p with `pᵀAp ≤ 0` was met, so A is not positive definite; it is in
    /// [`ConjugateGradient::direction`].
    NegativeCurvature {
        /// `pᵀAp`.
        curvature: f64,
        /// `pᵀAp/pᵀp`.
        rayleigh_quotient: f64,
    },
    /// The true residual stays above the tolerance although the recurrence has converged: rounding is in the way.
    Stagnated,
    /// The iteration limit came first.
    IterationLimit,
    /// An infinite or undefined number appeared.
    NonFinite,
    /// It was asked to stop.
    Interrupted,
}

/// Outcome, effort and true residual of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CgReport {
    /// How it ended.
    pub outcome: CgOutcome,
    /// Products with A made for search directions; the iteration in which an outcome was met.
    pub iterations: u64,
    /// `‖b − A x‖/‖b‖` of the first guess.
    pub first_residual: f64,
    /// `‖b − A x‖/‖b‖`, recomputed from x at the end; zero for b = 0 and x = 0.
    pub relative_residual: f64,
}

/// The method's parameters and its four work vectors.
///
/// # Examples
/// ```
/// use sprung::linear::{ConjugateGradient, Preconditioner};
/// use sprung::operator::LinearOperator;
///
/// /// A matrix known by its products: 2 on the diagonal, −1 beside it.
/// struct Chain(usize);
///
/// impl LinearOperator for Chain {
///     fn order(&self) -> usize {
///         self.0
///     }
///
///     fn apply(&self, w: &[f64], y: &mut [f64]) {
///         for i in 0..self.0 {
///             let beside = |j: usize| w.get(j).copied().unwrap_or(0.0);
///             y[i] = 2.0 * w[i] - beside(i.wrapping_sub(1)) - beside(i + 1);
///         }
///     }
/// }
///
/// let mut method = ConjugateGradient::new(3, 1e-12);
/// let mut x = vec![0.0; 3];
/// method.solve(&Chain(3), &mut Preconditioner::Identity, &[1.0, 0.0, 1.0], &mut x);
/// assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-9));
/// ```
#[derive(Debug, Clone)]
pub struct ConjugateGradient {
    /// Stops at `‖b − A x‖ ≤ tolerance·‖b‖`.
    pub tolerance: f64,
    /// The most iterations a solve may take.
    pub iteration_limit: u64,
    /// A request to stop is looked at in every iteration.
    pub interrupt: Interrupt,
    residual: Vec<f64>,
    preconditioned: Vec<f64>,
    direction: Vec<f64>,
    product: Vec<f64>,
}

impl ConjugateGradient {
    /// For matrices of order n. The default limit of 10 n + 100 is far beyond the n that exact arithmetic needs.
    pub fn new(order: usize, tolerance: f64) -> Self {
        let zeros = || vec![0.0; order];
        Self {
            tolerance,
            iteration_limit: 10 * order as u64 + 100,
            interrupt: Interrupt::NEVER,
            residual: zeros(),
            preconditioned: zeros(),
            direction: zeros(),
            product: zeros(),
        }
    }

    /// The last search direction: after [`CgOutcome::NegativeCurvature`] the p that proves it.
    pub fn direction(&self) -> &[f64] {
        &self.direction
    }

    /// Solves `A x = b` starting from the given x. Vectors that do not fit end as [`NonFinite`](CgOutcome::NonFinite).
    pub fn solve(
        &mut self,
        a: &impl LinearOperator,
        preconditioner: &mut Preconditioner,
        b: &[f64],
        x: &mut [f64],
    ) -> CgReport {
        if [b.len(), x.len(), a.order()] != [self.residual.len(); 3] {
            let nothing = f64::NAN;
            return CgReport {
                outcome: CgOutcome::NonFinite,
                iterations: 0,
                first_residual: nothing,
                relative_residual: nothing,
            };
        }
        let factor = scaling(b);
        if factor != 1.0 {
            x.iter_mut().for_each(|x| *x *= factor);
        }
        self.product.fill(0.0);
        let size = if factor == 1.0 { norm(b) } else { subtract(factor, b, &self.product, &mut self.residual).sqrt() };
        let report = self.solve_scaled(a, preconditioner, &Scaled { factor, b, norm: size }, x);
        if factor != 1.0 {
            x.iter_mut().for_each(|x| *x /= factor);
        }
        report
    }

    fn solve_scaled(
        &mut self,
        a: &impl LinearOperator,
        preconditioner: &mut Preconditioner,
        b: &Scaled,
        x: &mut [f64],
    ) -> CgReport {
        let scale = b.norm;
        let target = self.tolerance * scale;
        let mut iterations = 0;
        let mut residual = self.set_true_residual(a, b, x);
        let relative = |residual: f64| if residual == 0.0 { 0.0 } else { residual / scale };
        let first_residual = relative(residual);
        let mut last = f64::INFINITY;
        let outcome = loop {
            if !residual.is_finite() {
                break CgOutcome::NonFinite;
            }
            if residual <= target {
                break CgOutcome::Converged;
            }
            // A restart that does not at least halve the true residual has come to the end of the digits.
            if residual > 0.5 * last {
                break CgOutcome::Stagnated;
            }
            last = residual;
            let stop = self.iterate(a, preconditioner, x, target, &mut iterations);
            residual = self.set_true_residual(a, b, x);
            match stop {
                Some(CgOutcome::IterationLimit) if residual <= target => break CgOutcome::Converged,
                Some(outcome) => break outcome,
                None => {}
            }
        };
        CgReport { outcome, iterations, first_residual, relative_residual: relative(residual) }
    }

    /// Iterates from the residual until its recurrence reaches the target (`None`) or something stops it.
    fn iterate(
        &mut self,
        a: &impl LinearOperator,
        preconditioner: &mut Preconditioner,
        x: &mut [f64],
        target: f64,
        iterations: &mut u64,
    ) -> Option<CgOutcome> {
        let Self { residual: r, preconditioned: z, direction: p, product: q, interrupt, iteration_limit, .. } = self;
        // With the identity z is r, and need not be made.
        let is_identity = matches!(preconditioner, Preconditioner::Identity);
        let mut rz = if is_identity { dot(r, r) } else { preconditioner.apply(r, z) };
        p.copy_from_slice(if is_identity { r } else { z });
        let mut size = norm(r);
        // Further down than rounding the recurrence knows nothing of the true residual, and would end in underflow.
        let floor = target.max(f64::EPSILON * size);
        while size > floor {
            if *iterations >= *iteration_limit {
                return Some(CgOutcome::IterationLimit);
            }
            if interrupt.is_requested() {
                return Some(CgOutcome::Interrupted);
            }
            a.apply(p, q);
            let curvature = dot(p, q);
            if !curvature.is_finite() {
                return Some(CgOutcome::NonFinite);
            }
            if curvature <= 0.0 {
                return Some(CgOutcome::NegativeCurvature { curvature, rayleigh_quotient: curvature / dot(p, p) });
            }
            *iterations += 1;
            let alpha = rz / curvature;
            let squares = descend(alpha, q, r);
            size = squares.sqrt();
            let next = if is_identity { squares } else { preconditioner.apply(r, z) };
            let beta = next / rz;
            rz = next;
            advance(alpha, beta, if is_identity { r } else { z }, p, x);
        }
        None
    }

    /// `r = b − A x`; returns its norm. The search direction is left alone: it may be asked for.
    fn set_true_residual(&mut self, a: &impl LinearOperator, b: &Scaled, x: &[f64]) -> f64 {
        a.apply(x, &mut self.product);
        subtract(b.factor, b.b, &self.product, &mut self.residual).sqrt()
    }
}

/// A right-hand side times a factor, and its norm.
struct Scaled<'a> {
    factor: f64,
    b: &'a [f64],
    norm: f64,
}

#[cfg(test)]
mod tests;
