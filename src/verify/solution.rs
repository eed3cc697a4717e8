//! A computed solution of `A x = b`: the change of A and b that would make it exact, and its distance from the true one.
//!
//! In double precision the residual of a good solution is all rounding. Products and sums are therefore split without
//! error into a number and its rounding error (two-sum by Knuth, two-product with a fused multiply-add), and the errors are
//! added up beside: as if computed in 106 bits and rounded once (Ogita, Rump and Oishi 2005).

use super::{Check, Claim, U, UNITS, WorstEntries, ratio, worst};
use crate::error::{Result, check_length};
use crate::linear::norm;
use nalgebra::DMatrix;
use nalgebra_sparse::CscMatrix;

/// The largest factor by which the condition estimate is too low in practice (Higham 2002, §15).
const ESTIMATE_FACTOR: f64 = 3.0;

/// The residual that a method promises of its solutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Promise {
    /// A factorization of a positive definite A: 30 u of the largest intermediate products in each component.
    Stable,
    /// An iteration that stops at `‖b − A x‖₂ ≤ tolerance·‖b‖₂`.
    Tolerance(f64),
}

/// A solution with the name of the method that computed it and what that method promises.
#[derive(Debug, Clone, Copy)]
pub struct Solved<'a> {
    /// The method's name in checks.
    pub method: &'a str,
    /// x.
    pub x: &'a [f64],
    /// The promise.
    pub promise: Promise,
}

/// The backward errors of a solution: by a factorization the normwise and the componentwise one, by an iteration the relative residual, which is held
/// to its tolerance.
///
/// Rigal and Gaches (1967): `‖r‖/(‖A‖ ‖x‖ + ‖b‖)` in the maximum norm. Oettli and Prager (1964): the largest `|r_i|/(|A||x| + |b|)_i`, relative to
/// the intermediate values of elimination where these are larger. The residual is computed in twice the usual precision. Sees any error of the
/// solution that matters against rounding of A and b: permuted, stopped early, solved in 32 bits, another matrix; is blind to a wrong A.
///
/// # Errors
/// Sizes that do not fit each other.
pub fn backward_errors(a: &CscMatrix<f64>, b: &[f64], solved: &Solved, scene: &str) -> Result<Vec<Check>> {
    let residual = Residual::new(a, b, solved.x)?;
    if let Promise::Tolerance(tolerance) = solved.promise {
        let value = ratio(norm(&residual.values), norm(b));
        let bound = tolerance + UNITS * U * norm(&residual.terms) / norm(b).max(f64::MIN_POSITIVE);
        let why = "the given tolerance, and 30 u |A||x| for the residual that the method itself computes in 64 bits";
        let name = format!("relative residual of {}", solved.method);
        return Ok(vec![Check::new(Claim::Solvers, name, scene, value, bound, why)]);
    }
    let normwise = normwise(a, b, solved.x, &residual);
    let allowed = stable_residual(a, solved.x, &residual);
    let mut entries = WorstEntries::new();
    for (row, (r, allowed)) in residual.values.iter().zip(&allowed).enumerate() {
        entries.compare(row, None, b[row] - r, b[row], *allowed);
    }
    let wrong = residual.values.iter().zip(&allowed).filter(|(r, _)| **r != 0.0);
    let componentwise = worst(wrong.map(|(r, allowed)| UNITS * U * r.abs() / allowed).chain([0.0]));
    let normwise_why = "30 u: a stable factorization solves a system whose A is off by a few roundings (Higham 2002, theorem 10.4; the \
        constant grows with the length of sums in theory, hardly in practice)";
    let componentwise_why = "30 u of (|A||x| + |b|)_i, or of √a_ii √a_jj |x_j| with the largest j where that is more: what elimination passes \
        through row i, as (|L||Lᵀ|)_ij ≤ √a_ii √a_jj by Cauchy and Schwarz";
    let check = |kind: &str, value, why: &str| {
        Check::new(Claim::Solvers, format!("{kind} backward error of {}", solved.method), scene, value, UNITS * U, why)
    };
    let table = entries.into_table(|entry| entry);
    let componentwise = check("componentwise", componentwise, componentwise_why).with_table(table);
    Ok(vec![check("normwise", normwise, normwise_why), componentwise])
}

/// The normwise backward error of a solution with an indefinite A, which an unpivoted LDLᵀ may lose any number of digits of.
///
/// Sees a solution that should have been refused; is blind to a wrong A.
///
/// # Errors
/// Sizes that do not fit each other.
pub fn indefinite_backward_error(a: &CscMatrix<f64>, b: &[f64], x: &[f64], method: &str, scene: &str) -> Result<Check> {
    let value = normwise(a, b, x, &Residual::new(a, b, x)?);
    let name = format!("normwise backward error of {method}, A indefinite");
    let why = "the level above which the solver refuses its own solution, a hundred times below the tolerance of conjugate gradients: \
        no analysis bounds the growth of an unpivoted LDLᵀ";
    Ok(Check::new(Claim::Solvers, name, scene, value, 1e-12, why))
}

/// `‖r‖/(‖A‖ ‖x‖ + ‖b‖)` in the maximum norm.
fn normwise(a: &CscMatrix<f64>, b: &[f64], x: &[f64], residual: &Residual) -> f64 {
    ratio(largest(&residual.values), norm_inf(a) * largest(x) + largest(b))
}

/// The residual that a stable factorization may leave: `30 u max((|A||x| + |b|)_i, √a_ii max_j √a_jj |x_j|)`.
fn stable_residual(a: &CscMatrix<f64>, x: &[f64], residual: &Residual) -> Vec<f64> {
    let mut roots = vec![0.0; a.nrows()];
    a.triplet_iter().filter(|(row, column, _)| row == column).for_each(|(row, _, v)| roots[row] = v.abs().sqrt());
    let most = worst(roots.iter().zip(x).map(|(root, x)| root * x.abs()).chain([0.0]));
    residual.terms.iter().zip(&roots).map(|(terms, root)| UNITS * U * worst([*terms, root * most])).collect()
}

/// Compares two solutions of one system, whose difference the condition of A bounds.
///
/// `solve` is `x ← A⁻¹ x`, used for the estimate alone. Value: `‖x − x_ref‖∞/‖x_ref‖∞`; bound: `‖ |A⁻¹| (r + r_ref)
/// ‖∞/‖x_ref‖∞` with the residuals that the two methods promise, not those they have. Sees a solution that is worse
/// than promised, in a direction that matters; is blind to faults of both.
///
/// # Errors
/// Sizes that do not fit each other.
pub fn solutions_agree(
    a: &CscMatrix<f64>,
    b: &[f64],
    solved: &Solved,
    reference: &Solved,
    solve: &mut dyn FnMut(&mut [f64]),
    scene: &str,
) -> Result<Check> {
    check_length("solution", solved.x.len(), reference.x.len())?;
    let residual = Residual::new(a, b, reference.x)?;
    let stable = stable_residual(a, reference.x, &residual);
    let promised = |promise| match promise {
        Promise::Stable => 0.0,
        Promise::Tolerance(tolerance) => tolerance * norm(b),
    };
    let iterated = promised(solved.promise) + promised(reference.promise);
    let allowed: Vec<f64> = stable.iter().map(|stable| 2.0 * stable + iterated).collect();
    let size = largest(reference.x);
    let difference = worst(solved.x.iter().zip(reference.x).map(|(x, y)| (x - y).abs()).chain([0.0]));
    let condition = condition_estimate(a, solve);
    let bound = ratio(forward_bound(&allowed, solve), size);
    let why = format!(
        "|A⁻¹| times the residuals that both methods promise, by an estimate from below, times {ESTIMATE_FACTOR}; \
         the condition number is about {condition:.1e}"
    );
    let name = format!("{} against {}", solved.method, reference.method);
    Ok(Check::new(Claim::Solvers, name, scene, ratio(difference, size), bound, why))
}

/// Holds a [`condition_estimate`] to the exact condition number, by a dense inverse: for small matrices.
///
/// Value: the larger of `estimate/exact` and `exact/(3 estimate)`, beside rounding. Sees a wrong norm or a solver that is
/// not A's; is blind to nothing on the matrix that it is given.
pub fn condition_is_right(a: &CscMatrix<f64>, estimate: f64, scene: &str) -> Check {
    let name = "condition estimate against the dense inverse";
    let dense = DMatrix::from(a);
    // By elimination: the formulas of cofactors for small matrices lose κ² u.
    let inverse = dense.clone().lu().try_inverse();
    let off = |inverse: &DMatrix<f64>| (&dense * inverse - DMatrix::identity(a.nrows(), a.nrows())).amax();
    if inverse.as_ref().is_none_or(|inverse| off(inverse) > 1e-3) {
        let reason = "the dense inverse that the estimate is compared with is lost in rounding";
        return Check::not_judged(Claim::Solvers, name, scene, reason);
    }
    let exact = inverse.map_or(f64::NAN, |inverse| {
        norm_inf(a) * worst(inverse.column_iter().map(|column| column.iter().map(|v| v.abs()).sum()))
    });
    let ratio = estimate / exact;
    // The dense inverse itself has a relative error of about n u κ.
    let slack = 1.0 + 10.0 * a.nrows() as f64 * U * exact;
    let value = worst([ratio / slack, 1.0 / (ratio * ESTIMATE_FACTOR * slack)]);
    // Matrices that fool the climb are rare and lose little; below a thousandth the estimate is wrong.
    if value > 1.0 && ratio < 1.0 && ratio > 1e-3 {
        let reason = format!(
            "the estimate is {:.1} times too low: there are matrices that fool its climb (Higham 2002, §15)",
            1.0 / ratio
        );
        return Check::not_judged(Claim::Solvers, name, scene, reason);
    }
    let why = format!(
        "1 means an estimate of κ = {exact:.3e} that is not above it and at most {ESTIMATE_FACTOR} times below (Higham 2002, §15), but \
         for the rounding 10 n u κ of the dense inverse"
    );
    Check::new(Claim::Solvers, name, scene, value, 1.0, why)
}

/// Estimates the 1-norm `‖B‖₁ = max ‖B x‖₁/‖x‖₁` of `B = diag(w) A⁻¹` with a symmetric A, known by its solves `x ← A⁻¹ x`: always a lower bound,
/// nearly always within a factor of 3 (Hager 1984, Higham 1988).
///
/// A climb over the corners `± e_j` of the unit ball: the gradient `Bᵀ sign(B x)` of ‖B x‖₁ points to the next one. A last
/// vector of alternating signs catches matrices that are built to fool the climb.
fn one_norm_estimate(weights: &[f64], solve: &mut dyn FnMut(&mut [f64])) -> f64 {
    let order = weights.len();
    let weigh = |x: &mut [f64]| x.iter_mut().zip(weights).for_each(|(x, weight)| *x *= weight);
    // B x in place of x, and its norm.
    let product = |solve: &mut dyn FnMut(&mut [f64]), x: &mut [f64]| {
        solve(x);
        weigh(x);
        x.iter().map(|x| x.abs()).sum::<f64>()
    };
    let n = order as f64;
    let mut x = vec![1.0 / n; order];
    let mut estimate = product(solve, &mut x);
    let mut last = usize::MAX;
    for _ in 0..5 {
        x.iter_mut().for_each(|x| *x = if *x < 0.0 { -1.0 } else { 1.0 });
        weigh(&mut x);
        solve(&mut x);
        let steepest = (0..order).max_by(|&a, &b| x[a].abs().total_cmp(&x[b].abs()));
        let Some(steepest) = steepest.filter(|&index| index != last) else { break };
        last = steepest;
        x.fill(0.0);
        x[steepest] = 1.0;
        let next = product(solve, &mut x);
        if next <= estimate {
            break;
        }
        estimate = next;
    }
    for (i, x) in x.iter_mut().enumerate() {
        let size = 1.0 + i as f64 / (n - 1.0).max(1.0);
        *x = if i % 2 == 0 { size } else { -size };
    }
    let alternating = product(solve, &mut x);
    worst([estimate, 2.0 * alternating / (3.0 * n)])
}

/// The condition number `κ = ‖A‖₁ ‖A⁻¹‖₁` of a symmetric matrix, estimated from below with about five solves `x ← A⁻¹ x`.
pub fn condition_estimate(a: &CscMatrix<f64>, solve: &mut dyn FnMut(&mut [f64])) -> f64 {
    norm_inf(a) * one_norm_estimate(&vec![1.0; a.ncols()], solve)
}

/// Bound of `‖δx‖∞` for the solution of `A x = b` with a residual of at most `residual` in each component: `‖ |A⁻¹| r
/// ‖∞`, estimated as the 1-norm of `diag(r) A⁻¹`, times 3 as the estimate is from below.
///
/// Unlike `κ(A)` times the relative residual it is sharp with badly scaled rows.
fn forward_bound(residual: &[f64], solve: &mut dyn FnMut(&mut [f64])) -> f64 {
    if largest(residual) == 0.0 {
        return 0.0;
    }
    let estimate = one_norm_estimate(residual, solve);
    ESTIMATE_FACTOR * estimate * (1.0 + residual.len() as f64 * U)
}

/// `b − A x` and `|A| |x| + |b|`.
#[derive(Debug, Clone)]
pub(super) struct Residual {
    pub values: Vec<f64>,
    pub terms: Vec<f64>,
}

impl Residual {
    pub fn new(a: &CscMatrix<f64>, b: &[f64], x: &[f64]) -> Result<Self> {
        check_length("right-hand side", b.len(), a.nrows())?;
        check_length("solution", x.len(), a.ncols())?;
        let mut sums: Vec<(f64, f64)> = b.iter().map(|&b| (b, 0.0)).collect();
        let mut terms: Vec<f64> = b.iter().map(|b| b.abs()).collect();
        for (row, column, &value) in a.triplet_iter() {
            let product = value * x[column];
            let product_error = value.mul_add(x[column], -product);
            let (sum, low) = &mut sums[row];
            let (next, sum_error) = two_sum(*sum, -product);
            *sum = next;
            *low += sum_error - product_error;
            terms[row] += product.abs();
        }
        Ok(Self { values: sums.into_iter().map(|(sum, low)| sum + low).collect(), terms })
    }
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// The largest magnitude; NaN if there is one, zero for an empty vector.
pub(super) fn largest(values: &[f64]) -> f64 {
    worst(values.iter().map(|value| value.abs()).chain([0.0]))
}

pub(super) fn norm_inf(a: &CscMatrix<f64>) -> f64 {
    let mut sums = vec![0.0; a.nrows()];
    a.triplet_iter().for_each(|(row, _, value)| sums[row] += value.abs());
    largest(&sums)
}

#[cfg(test)]
mod tests;
