//! The preconditioned conjugate gradient method.
//!
//! For symmetric positive definite A (Hestenes and Stiefel 1952; notation of Shewchuk 1994): `α = rᵀz/pᵀAp`, `x += α p`, `r −= α A p`, `z = P⁻¹ r`,
//! `β = rᵀz/(rᵀz)_old`, `p = z + β p`. The recurrence's r drifts away from `b − A x`. When it has converged the true residual is computed; if that is
//! still too large, the iteration restarts from it, as long as every restart at least halves it.
//!
//! A right-hand side so small or large that `pᵀAp` would under- or overflow (a motion at rest but for 10⁻¹⁶⁰ m/s) is multiplied by a power of two
//! first, and the solution divided by it: the same iteration, digit by digit.

use super::preconditioner::Preconditioner;
use super::vector::{advance, descend, dot, norm, scaling, subtract};
use crate::interrupt::Interrupt;
use crate::operator::LinearOperator;

/// The end of an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CgOutcome {
    /// The true residual is within the tolerance.
    Converged,
    /// A direction p with `pᵀAp ≤ 0` was met, so A is not positive definite; it is in [`ConjugateGradient::direction`].
    NegativeCurvature {
        /// `pᵀAp`.
        curvature: f64,
        /// `pᵀAp/pᵀp`.
        rayleigh_quotient: f64,
    },
    /// The recurrence has converged, but rounding keeps the true residual above the tolerance.
    Stagnated,
    /// The iteration limit came first.
    IterationLimit,
    /// An infinite or undefined number appeared.
    NonFinite,
    /// A stop was requested.
    Interrupted,
}

/// Outcome, effort and true residual of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CgReport {
    /// The outcome.
    pub outcome: CgOutcome,
    /// Products with A for search directions.
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
    /// Checked in every iteration.
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

    /// The last search direction: the p of [`CgOutcome::NegativeCurvature`].
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
            let [first_residual, relative_residual] = [f64::NAN; 2];
            return CgReport { outcome: CgOutcome::NonFinite, iterations: 0, first_residual, relative_residual };
        }
        let factor = scaling(b);
        x.iter_mut().for_each(|x| *x *= factor);
        self.product.fill(0.0);
        let scale = subtract(factor, b, &self.product, &mut self.residual).sqrt();
        let target = self.tolerance * scale;
        let relative = |residual: f64| if residual == 0.0 { 0.0 } else { residual / scale };
        let mut iterations = 0;
        let mut residual = self.set_true_residual(a, factor, b, x);
        let first_residual = relative(residual);
        let mut last = f64::INFINITY;
        let outcome = loop {
            if !residual.is_finite() {
                break CgOutcome::NonFinite;
            }
            if residual <= target {
                break CgOutcome::Converged;
            }
            if residual > 0.5 * last {
                break CgOutcome::Stagnated;
            }
            last = residual;
            let stop = self.iterate(a, preconditioner, x, target, &mut iterations);
            residual = self.set_true_residual(a, factor, b, x);
            match stop {
                Some(CgOutcome::IterationLimit) if residual <= target => break CgOutcome::Converged,
                Some(outcome) => break outcome,
                None => {}
            }
        };
        x.iter_mut().for_each(|x| *x /= factor);
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
        // With the identity z is r.
        let is_identity = matches!(preconditioner, Preconditioner::Identity);
        let mut rz = if is_identity { dot(r, r) } else { preconditioner.apply(r, z) };
        p.copy_from_slice(if is_identity { r } else { z });
        let mut size = norm(r);
        // Below rounding the recurrence says nothing of the true residual, and would end in underflow.
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

    /// `r = s b − A x`; returns its norm.
    fn set_true_residual(&mut self, a: &impl LinearOperator, s: f64, b: &[f64], x: &[f64]) -> f64 {
        a.apply(x, &mut self.product);
        subtract(s, b, &self.product, &mut self.residual).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matrix by its products.
    struct Products<F>(usize, F);

    impl<F: Fn(&[f64], &mut [f64])> LinearOperator for Products<F> {
        fn order(&self) -> usize {
            self.0
        }

        fn apply(&self, w: &[f64], y: &mut [f64]) {
            self.1(w, y);
        }
    }

    /// Solves from zero, without a preconditioner; with the limit given, or the default.
    fn solve(a: &impl LinearOperator, b: &[f64], tolerance: f64, limit: Option<u64>) -> CgReport {
        let mut method = ConjugateGradient::new(a.order(), tolerance);
        method.iteration_limit = limit.unwrap_or(method.iteration_limit);
        method.solve(a, &mut Preconditioner::Identity, b, &mut vec![0.0; b.len()])
    }

    /// A = diag(1, 3), b = (1, 1): α = 2/4, so that the residual falls from √2 to √2/2, all in numbers that have no rounding.
    #[test]
    fn a_residual_equal_to_the_target_is_small_enough() {
        let a = Products(2, |w: &[f64], y: &mut [f64]| y.copy_from_slice(&[w[0], 3.0 * w[1]]));
        let report = solve(&a, &[1.0, 1.0], 0.5, None);
        assert_eq!((report.outcome, report.iterations, report.relative_residual), (CgOutcome::Converged, 1, 0.5));
        assert_eq!(solve(&a, &[1.0, 1.0], 0.49, None).iterations, 2);
    }

    /// A = 2, b = 1, but the product with the first direction is too large by a factor: the true residual after the first iteration is one minus the
    /// factor's inverse. A half goes on, three quarters stagnate.
    #[test]
    fn restarts_go_on_while_they_halve_the_true_residual() {
        let wrong = |factor: f64| {
            Products(1, move |w: &[f64], y: &mut [f64]| y[0] = if w[0] == 1.0 { 2.0 * factor } else { 2.0 } * w[0])
        };
        let halved = solve(&wrong(2.0), &[1.0], 1e-10, None);
        assert_eq!((halved.outcome, halved.iterations, halved.relative_residual), (CgOutcome::Converged, 2, 0.0));
        let less = solve(&wrong(4.0), &[1.0], 1e-10, None);
        assert_eq!((less.outcome, less.iterations, less.relative_residual), (CgOutcome::Stagnated, 1, 0.75));
    }

    /// With a tolerance that is the true residual after k iterations, k iterations are enough, whatever rounding does to the recurrence: its residual
    /// may be a little above the target when the true one is on it. ‖b‖ = 1, so the target is the tolerance.
    #[test]
    fn the_true_residual_decides_at_the_limit() {
        let chain = |w: &[f64], y: &mut [f64]| {
            for row in 0..w.len() {
                let neighbours = w[row.saturating_sub(1)..w.len().min(row + 2)].iter().sum::<f64>() - w[row];
                y[row] = 2.7 * w[row] - neighbours;
            }
        };
        let a = Products(60, chain);
        let mut b = vec![0.0; 60];
        b[20] = 1.0;
        for limit in 1..25 {
            let stopped = solve(&a, &b, 0.0, Some(limit));
            assert_eq!((stopped.outcome, stopped.iterations), (CgOutcome::IterationLimit, limit));
            let report = solve(&a, &b, stopped.relative_residual, Some(limit));
            assert_eq!((report.outcome, report.iterations), (CgOutcome::Converged, limit));
        }
    }

    /// A = diag(1, −2), b = (0, 3): the first direction is b, its curvature −18 and its Rayleigh quotient the eigenvalue.
    #[test]
    fn negative_curvature_comes_with_its_direction() {
        let a = Products(2, |w: &[f64], y: &mut [f64]| y.copy_from_slice(&[w[0], -2.0 * w[1]]));
        let mut method = ConjugateGradient::new(2, 1e-10);
        let report = method.solve(&a, &mut Preconditioner::Identity, &[0.0, 3.0], &mut [0.0; 2]);
        assert_eq!(report.outcome, CgOutcome::NegativeCurvature { curvature: -18.0, rayleigh_quotient: -2.0 });
        assert_eq!((report.iterations, report.relative_residual), (0, 1.0));
        assert_eq!(method.direction(), [0.0, 3.0]);
    }

    /// The same iteration, digit by digit, whatever the size of the right-hand side: products of two numbers of 10⁻¹⁶⁰ or 10¹⁶⁰ would vanish or
    /// overflow, and a curvature of zero look like an indefinite matrix.
    #[test]
    fn the_size_of_the_right_hand_side_does_not_matter() {
        let a = Products(3, |w: &[f64], y: &mut [f64]| {
            y.copy_from_slice(&[2.0 * w[0] + w[1], w[0] + 3.0 * w[1], 5.0 * w[2]])
        });
        let run = |size: f64| {
            let mut method = ConjugateGradient::new(3, 1e-12);
            let mut x = [0.0, 0.25 * size, 0.0];
            let report = method.solve(&a, &mut Preconditioner::Identity, &[size, -3.0 * size, 0.7 * size], &mut x);
            (report, x.map(|x| x / size))
        };
        let plain = run(1.0);
        assert_eq!(plain.0.outcome, CgOutcome::Converged);
        for exponent in [-1000, -540, -500, 500, 540, 1000] {
            assert_eq!(run(2f64.powi(exponent)), plain, "2^{exponent}");
        }
    }

    #[test]
    fn vectors_of_a_wrong_length_are_not_solved_with() {
        let a = Products(3, |w: &[f64], y: &mut [f64]| y.copy_from_slice(w));
        for [order, b, x] in [[3, 2, 3], [3, 3, 4], [3, 0, 0], [2, 3, 3]] {
            let mut method = ConjugateGradient::new(order, 1e-10);
            let report = method.solve(&a, &mut Preconditioner::Identity, &vec![1.0; b], &mut vec![0.0; x]);
            assert_eq!((report.outcome, report.iterations), (CgOutcome::NonFinite, 0), "{order} {b} {x}");
        }
    }
}
