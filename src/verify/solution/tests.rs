//! Backward errors and bounds of solutions of small systems, worked out by hand.

use super::*;
use crate::verify::fixtures::assert_close;
use crate::verify::random_vector;
use nalgebra::DVector;

/// With x below `b − A x = (0, 1/2, −1/4)` and `|A||x| + |b| = (4, 64.5, 18.25)`; the roots of the diagonal are 2, 4 and 3, the
/// largest product with |x| is 4 · 2 = 8, and the largest sum of a row is 19.
fn system() -> CscMatrix<f64> {
    CscMatrix::from(&DMatrix::from_row_slice(3, 3, &[4.0, -1.0, 0.0, -1.0, 16.0, 2.0, 0.0, 2.0, 9.0]))
}

const X: [f64; 3] = [0.5, 2.0, -1.0];
const B: [f64; 3] = [0.0, 30.0, -5.25];
const NOTHING: [f64; 3] = [0.0; 3];

fn solved<'a>(x: &'a [f64], promise: Promise) -> Solved<'a> {
    Solved { method: "m", x, promise }
}

#[test]
fn backward_errors_by_hand() {
    let checks = backward_errors(&system(), &B, &solved(&X, Promise::Stable), "s").unwrap();
    let names: Vec<&str> = checks.iter().map(|check| check.name.as_str()).collect();
    assert_eq!(names, ["normwise backward error of m", "componentwise backward error of m"]);
    assert_close(checks[0].value, 0.5 / (19.0 * 2.0 + 30.0));
    // The last row is worst: 1/4 of the 24 that elimination passes through, not 1/2 of 64.5.
    assert_close(checks[1].value, 0.25 / 24.0);
    assert!(checks.iter().all(|check| check.bound == 30.0 * U));
    let table: Vec<_> = checks[1].table.iter().map(|entry| (entry.row, entry.analytic, entry.numeric)).collect();
    assert_eq!(table, [(2, -5.0, -5.25), (1, 29.5, 30.0), (0, 0.0, 0.0)]);
    assert_close(indefinite_backward_error(&system(), &B, &X, "m", "s").unwrap().value, 0.5 / 68.0);
}

/// Nothing solves a right-hand side of zeros exactly, though there is nothing to measure it by.
#[test]
fn an_exact_solution_has_no_error() {
    let a = system();
    let checks = backward_errors(&a, &NOTHING, &solved(&NOTHING, Promise::Stable), "s").unwrap();
    assert!(checks.iter().all(|check| check.value == 0.0));
    assert_eq!(indefinite_backward_error(&a, &NOTHING, &NOTHING, "m", "s").unwrap().value, 0.0);
    let checks = backward_errors(&a, &NOTHING, &solved(&NOTHING, Promise::Tolerance(1e-10)), "s").unwrap();
    assert_eq!((checks[0].value, checks[0].bound), (0.0, 1e-10));
    let none = solved(&NOTHING, Promise::Stable);
    let check = solutions_agree(&a, &NOTHING, &none, &none, &mut |_| {}, "s").unwrap();
    assert_eq!((check.value, check.bound), (0.0, 0.0));
}

#[test]
fn the_residual_of_an_iteration_by_hand() {
    let checks = backward_errors(&system(), &B, &solved(&X, Promise::Tolerance(1e-14)), "s").unwrap();
    let b = (900.0 + 5.25 * 5.25_f64).sqrt();
    assert_close(checks[0].value, (0.25 + 0.0625_f64).sqrt() / b);
    assert_close(checks[0].bound, 1e-14 + 30.0 * U * (16.0 + 64.5 * 64.5 + 18.25 * 18.25_f64).sqrt() / b);
}

/// Of the diagonal matrix (4, 16, 1) and its exact solution the stable residuals are 30 u of 16, 64 and 8, twice that for two methods;
/// each iteration adds its tolerance times ‖b‖ = √1029. The last row bounds the difference: its inverse is the largest.
#[test]
fn solutions_differ_by_what_both_methods_promise() {
    let diagonal = [4.0, 16.0, 1.0];
    let a = CscMatrix::from(&DMatrix::from_diagonal(&diagonal.to_vec().into()));
    let b = [2.0, 32.0, -1.0];
    let off = [0.5, 2.5, -1.25];
    let check = |one: Promise, other: Promise| {
        let mut solve = |x: &mut [f64]| x.iter_mut().zip(diagonal).for_each(|(x, d)| *x /= d);
        solutions_agree(&a, &b, &solved(&off, one), &solved(&X, other), &mut solve, "s").unwrap()
    };
    let bound = |iterated: f64| 3.0 * (2.0 * 30.0 * U * 8.0 + iterated) * (1.0 + 3.0 * U) / 2.0;
    let stable = check(Promise::Stable, Promise::Stable);
    assert_eq!(stable.value, 0.25);
    assert_close(stable.bound, bound(0.0));
    assert!(stable.why.ends_with("about 1.6e1"), "{}", stable.why);
    let iterated = check(Promise::Tolerance(1e-15), Promise::Tolerance(3e-15));
    assert_close(iterated.bound, bound(4e-15 * 1029_f64.sqrt()));
}

#[test]
fn sizes_that_do_not_fit_are_errors() {
    let (a, short) = (system(), [0.0; 2]);
    assert!(Residual::new(&a, &B, &short).is_err() && Residual::new(&a, &short, &X).is_err());
    let [x, y] = [&X[..], &short].map(|x| solved(x, Promise::Stable));
    assert!(solutions_agree(&a, &B, &y, &x, &mut |_| {}, "s").is_err());
}

/// The condition number of the diagonal matrix (4, 16, 2) is 16/2. An estimate of half of it is allowed, as it is not a third, and
/// the dense inverse may be off by 10 n u κ.
#[test]
fn a_condition_is_held_to_the_dense_inverse() {
    let a = CscMatrix::from(&DMatrix::from_diagonal(&vec![4.0, 16.0, 2.0].into()));
    let check = |inverse_norm: f64| condition_is_right(&a, 16.0 * inverse_norm, "s");
    let value = |inverse_norm| check(inverse_norm).value;
    let slack = 1.0 + 10.0 * 3.0 * U * 8.0;
    for (inverse_norm, expected) in
        [(0.5, 1.0 / slack), (0.25, 2.0 / 3.0 / slack), (5e-5, 1e4 / 3.0 / slack), (1.0, 2.0 / slack)]
    {
        let value = value(inverse_norm);
        assert!((value / expected - 1.0).abs() < 1e-12, "{value} {expected}");
    }
    // Four times too low is what some matrices do to any estimate of this kind.
    assert!(!check(0.125).is_judged && check(0.25).is_judged);
}

#[test]
fn the_residual_is_exact_where_double_precision_sees_nothing() {
    // 1 − (1 + 2⁻³⁰)(1 − 2⁻³⁰) = 2⁻⁶⁰, which a rounded product loses.
    let e = 2.0_f64.powi(-30);
    let a = CscMatrix::from(&DMatrix::from_element(1, 1, 1.0 + e));
    let residual = Residual::new(&a, &[1.0], &[1.0 - e]).unwrap();
    assert_eq!(residual.values, [2.0_f64.powi(-60)]);
    assert_eq!(1.0 - (1.0 + e) * (1.0 - e), 0.0);
}

/// The estimate of a matrix with weights.
fn estimate(weights: &[f64], a: &DMatrix<f64>) -> f64 {
    one_norm_estimate(weights, &mut |x| {
        let product = a * DVector::from_column_slice(x);
        x.copy_from_slice(product.as_slice());
    })
}

#[test]
fn the_estimate_is_a_lower_bound_within_a_factor_of_three() {
    for seed in 0..40 {
        let n = 1 + seed as usize % 9;
        let half = DMatrix::from_vec(n, n, random_vector(n * n, seed));
        let (symmetric, weights) = (&half + half.transpose(), random_vector(n, 40 + seed));
        let b = DMatrix::from_diagonal(&weights.clone().into()) * &symmetric;
        let exact = b.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
        let found = estimate(&weights, &symmetric);
        assert!(found <= exact * 1.000001 && found >= exact / 3.0, "{found} of {exact}");
    }
    assert!(estimate(&[1.0; 2], &DMatrix::from_element(2, 2, f64::NAN)).is_nan());
    assert_eq!(forward_bound(&[], &mut |_| {}), 0.0);
    assert_eq!(forward_bound(&[0.0], &mut |_| {}), 0.0);
}

/// A matrix that fools the climb: only the alternating vector `(1, −1 − 1/(n − 1), 1 + 2/(n − 1), …)` sees it, of which two thirds over n are the
/// estimate (Higham 1988).
#[test]
fn the_last_vector_alternates() {
    for n in 2..7 {
        let solve = &mut |x: &mut [f64]| x.fill(if x[1] < -0.9 { 90.0 } else { 0.0 });
        assert!((one_norm_estimate(&vec![1.0; n], solve) - 60.0).abs() < 1e-12);
    }
}

/// Three times ‖diag(r) A⁻¹‖₁, a little more for rounding, also where one of the residuals is zero.
#[test]
fn forward_bounds_weigh_the_residual() {
    let halved = |x: &mut [f64]| x.iter_mut().for_each(|x| *x *= 0.5);
    let bound = forward_bound(&[0.0, 8.0, 2.0], &mut { halved });
    assert!(bound > 12.0 && bound < 12.0 * (1.0 + 1e-12), "{bound}");
}
