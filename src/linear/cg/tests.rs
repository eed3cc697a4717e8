//! Conjugate gradients on matrices that are known by their products alone, some of which are wrong on purpose.

use super::*;

/// A matrix known by its products.
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

/// A = 2, b = 1, but the product with the first direction is too large by some factor. The recurrence believes it, and the true
/// residual after the first iteration is one minus the factor's inverse: a half goes on, three quarters stagnate.
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

/// With a tolerance that is the true residual after k iterations, k iterations are enough, whatever rounding does to the
/// recurrence: its residual may be a little above the target when the true one is on it. ‖b‖ = 1, so the target is the tolerance.
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
fn negative_curvature_comes_with_its_rayleigh_quotient() {
    let a = Products(2, |w: &[f64], y: &mut [f64]| y.copy_from_slice(&[w[0], -2.0 * w[1]]));
    let report = solve(&a, &[0.0, 3.0], 1e-10, None);
    assert_eq!(report.outcome, CgOutcome::NegativeCurvature { curvature: -18.0, rayleigh_quotient: -2.0 });
    assert_eq!((report.iterations, report.relative_residual), (0, 1.0));
}

/// The same iteration, digit by digit, whatever the size of the right-hand side: products of two numbers of 10⁻¹⁶⁰ or 10¹⁶⁰ would
/// vanish or overflow, and a curvature of zero look like an indefinite matrix.
#[test]
fn the_size_of_the_right_hand_side_does_not_matter() {
    let a =
        Products(3, |w: &[f64], y: &mut [f64]| y.copy_from_slice(&[2.0 * w[0] + w[1], w[0] + 3.0 * w[1], 5.0 * w[2]]));
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

/// A = diag(1, −2), b = (1, 1): the first direction is b itself, and bᵀ A b = −1 proves that A is indefinite.
#[test]
fn the_direction_of_negative_curvature_is_kept() {
    let a = Products(2, |w: &[f64], y: &mut [f64]| y.copy_from_slice(&[w[0], -2.0 * w[1]]));
    let mut method = ConjugateGradient::new(2, 1e-10);
    let report = method.solve(&a, &mut Preconditioner::Identity, &[1.0, 1.0], &mut [0.0; 2]);
    assert!(matches!(report.outcome, CgOutcome::NegativeCurvature { .. }), "{:?}", report.outcome);
    let p = method.direction();
    assert!(p.len() == 2 && p[0] == p[1] && p[0] > 0.0, "{p:?}");
}

/// Vectors that do not fit the matrix, in either direction, are no reason to panic.
#[test]
fn vectors_of_a_wrong_length_are_not_solved_with() {
    let a = Products(3, |w: &[f64], y: &mut [f64]| y.copy_from_slice(w));
    for [order, b, x] in [[3, 2, 3], [3, 3, 4], [3, 0, 0], [2, 3, 3]] {
        let mut method = ConjugateGradient::new(order, 1e-10);
        let report = method.solve(&a, &mut Preconditioner::Identity, &vec![1.0; b], &mut vec![0.0; x]);
        assert_eq!((report.outcome, report.iterations), (CgOutcome::NonFinite, 0), "{order} {b} {x}");
    }
}
