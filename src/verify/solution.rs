//! A computed solution of `A x = b`: how far A and b would have to be changed for it to be exact, and how far it may be
//! from the true one.

use super::check::{Check, worst};
use super::claim::Claim;
use super::condition::{Condition, ESTIMATE_FACTOR, forward_bound};
use super::force_error::U;
use super::residual::{Residual, largest, norm_inf};
use super::verdict::{TABLE_ROWS, WorstEntries};
use nalgebra::DMatrix;
use nalgebra_sparse::CscMatrix;

/// What a method promises of the residual of its solutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Promise {
    /// A factorization of a positive definite A: 30 u in each component of what its own intermediate products may be.
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

const WRONG_SIZE: &str = "A, b and x do not fit each other";

/// The normwise and the componentwise backward error of a solution by a factorization.
///
/// Rigal and Gaches (1967): `‖r‖/(‖A‖ ‖x‖ + ‖b‖)` in the maximum norm. Oettli and Prager (1964): the largest
/// `|r_i|/(|A||x| + |b|)_i`, where elimination passes through more than that, relative to what it passes through. The
/// residual is computed in twice the usual precision. Sees any error of the solution that matters against rounding of A
/// and b: permuted, stopped early, solved in 32 bits, another matrix; is blind to a wrong A.
pub fn backward_errors(a: &CscMatrix<f64>, b: &[f64], solved: &Solved, scene: &str) -> Vec<Check> {
    let name = |kind: &str| format!("{kind} backward error of {}", solved.method);
    let check = |kind: &str, value, bound, why: &str| Check::new(Claim::Solvers, name(kind), scene, value, bound, why);
    let Some(residual) = Residual::new(a, b, solved.x) else {
        return vec![check("normwise", f64::NAN, 30.0 * U, WRONG_SIZE)];
    };
    let size = norm_inf(a) * largest(solved.x) + largest(b);
    let r = largest(&residual.values);
    let normwise = if r == 0.0 { 0.0 } else { r / size };
    let allowed = stable_residual(a, solved.x, &residual);
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for (row, (r, allowed)) in residual.values.iter().zip(&allowed).enumerate() {
        entries.compare(row, None, b[row] - r, b[row], *allowed);
    }
    let mut componentwise = 0.0;
    for (r, allowed) in residual.values.iter().zip(&allowed).filter(|(r, _)| **r != 0.0) {
        componentwise = worst([componentwise, 30.0 * U * r.abs() / allowed]);
    }
    let normwise_why = "30 u: a stable factorization solves a system whose A is off by a few roundings (Higham 2002, theorem 10.4; the \
        constant grows with the length of sums in theory, hardly in practice)";
    let componentwise_why = "30 u of (|A||x| + |b|)_i, or of √a_ii √a_jj |x_j| with the largest j where that is more: what elimination passes \
        through row i, as (|L||Lᵀ|)_ij ≤ √a_ii √a_jj by Cauchy and Schwarz";
    vec![
        check("normwise", normwise, 30.0 * U, normwise_why),
        check("componentwise", componentwise, 30.0 * U, componentwise_why)
            .with_table(entries.into_table(|entry| entry)),
    ]
}

/// The normwise backward error of a solution with an indefinite A, which an unpivoted LDLᵀ may lose any number of
/// digits of.
///
/// Sees a solution that should have been refused; is blind to a wrong A.
pub fn indefinite_backward_error(a: &CscMatrix<f64>, b: &[f64], x: &[f64], method: &str, scene: &str) -> Check {
    let name = format!("normwise backward error of {method}, A indefinite");
    let check = |value, why: &str| Check::new(Claim::Solvers, name.clone(), scene, value, 1e-12, why);
    let Some(residual) = Residual::new(a, b, x) else {
        return check(f64::NAN, WRONG_SIZE);
    };
    let size = norm_inf(a) * largest(x) + largest(b);
    let r = largest(&residual.values);
    let why = "the level above which the solver refuses its own solution, a hundred times below the tolerance of conjugate gradients: \
        no analysis bounds the growth of an unpivoted LDLᵀ";
    check(if r == 0.0 { 0.0 } else { r / size }, why)
}

/// The residual that a stable factorization may leave: `30 u max((|A||x| + |b|)_i, √a_ii max_j √a_jj |x_j|)`.
fn stable_residual(a: &CscMatrix<f64>, x: &[f64], residual: &Residual) -> Vec<f64> {
    let mut roots = vec![0.0; a.nrows()];
    a.triplet_iter().filter(|(row, column, _)| row == column).for_each(|(row, _, v)| roots[row] = v.abs().sqrt());
    let reach = worst(roots.iter().zip(x).map(|(root, x)| root * x.abs()).chain([0.0]));
    residual.terms.iter().zip(&roots).map(|(terms, root)| 30.0 * U * worst([*terms, root * reach])).collect()
}

/// The relative residual of an iteration's solution, recomputed in twice the usual precision, against the tolerance
/// that it was given.
///
/// Sees an iteration that stopped early or trusted its recurrence; is blind to a wrong A.
pub fn tolerance_is_met(a: &CscMatrix<f64>, b: &[f64], x: &[f64], tolerance: f64, method: &str, scene: &str) -> Check {
    let name = format!("relative residual of {method}");
    let check = |value, bound, why: &str| Check::new(Claim::Solvers, name.clone(), scene, value, bound, why);
    let Some(residual) = Residual::new(a, b, x) else {
        return check(f64::NAN, tolerance, WRONG_SIZE);
    };
    let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let r = norm(&residual.values);
    let relative = if r == 0.0 { 0.0 } else { r / norm(b) };
    let bound = tolerance + 30.0 * U * norm(&residual.terms) / norm(b).max(f64::MIN_POSITIVE);
    check(
        relative,
        bound,
        "the tolerance asked for, and 30 u |A||x| for the residual that the method itself computes in 64 bits",
    )
}

/// Compares two solutions of one system with what the condition of A allows.
///
/// `solve` is `x ← A⁻¹ x`, used for the estimate alone. Value: `‖x − x_ref‖∞/‖x_ref‖∞`; bound: `‖ |A⁻¹| (r + r_ref)
/// ‖∞/‖x_ref‖∞` with the residuals that the two methods promise, not those they have. Sees a solution that is worse
/// than promised, in a direction that matters; is blind to what both have wrong.
pub fn solutions_agree(
    a: &CscMatrix<f64>,
    b: &[f64],
    solved: &Solved,
    reference: &Solved,
    solve: &mut dyn FnMut(&mut [f64]),
    scene: &str,
) -> Check {
    let name = format!("{} against {}", solved.method, reference.method);
    let check = |value, bound, why: String| Check::new(Claim::Solvers, name.clone(), scene, value, bound, why);
    let residual = Residual::new(a, b, reference.x).filter(|_| solved.x.len() == reference.x.len());
    let Some(residual) = residual else {
        return check(f64::NAN, 0.0, WRONG_SIZE.into());
    };
    let stable = stable_residual(a, reference.x, &residual);
    let norm_b = b.iter().map(|b| b * b).sum::<f64>().sqrt();
    let promised = |promise| match promise {
        Promise::Stable => 0.0,
        Promise::Tolerance(tolerance) => tolerance * norm_b,
    };
    let iterated = promised(solved.promise) + promised(reference.promise);
    let allowed: Vec<f64> = stable.iter().map(|stable| 2.0 * stable + iterated).collect();
    let size = largest(reference.x);
    let difference = worst(solved.x.iter().zip(reference.x).map(|(x, y)| (x - y).abs()).chain([0.0]));
    let relative = |value: f64| if value == 0.0 { 0.0 } else { value / size };
    let condition = Condition::estimate(a, solve).number();
    let bound = relative(forward_bound(&allowed, solve));
    let why = format!(
        "|A⁻¹| times the residuals that both methods promise, by an estimate from below, times {ESTIMATE_FACTOR}; \
         the condition number is about {condition:.1e}"
    );
    check(relative(difference), bound, why)
}

/// An estimate below this part of the condition number is wrong, and not only fooled.
const LEAST_RATIO: f64 = 1e-3;

/// Holds a condition estimate to the exact condition number, by a dense inverse: for small matrices.
///
/// Value: how far `ln(estimate/exact)` is from the interval that theory gives, `[−ln 3, 0]`, beside rounding. Sees a
/// wrong norm or a solver that is not A's; is blind to nothing on the matrix that it is given.
pub fn condition_is_right(a: &CscMatrix<f64>, estimate: &Condition, scene: &str) -> Check {
    let name = "condition estimate against the dense inverse";
    let dense = DMatrix::from(a);
    // By elimination: the formulas of cofactors for small matrices lose κ² u.
    let inverse = dense.clone().lu().try_inverse();
    let off = |inverse: &DMatrix<f64>| (&dense * inverse - DMatrix::identity(a.nrows(), a.nrows())).amax();
    if inverse.as_ref().is_none_or(|inverse| off(inverse) > 1e-3) {
        let reason = "the dense inverse that the estimate is held to is lost in rounding";
        return Check::not_judged(Claim::Solvers, name, scene, reason);
    }
    let exact = inverse.map_or(f64::NAN, |inverse| {
        norm_inf(a) * worst(inverse.column_iter().map(|column| column.iter().map(|v| v.abs()).sum()))
    });
    let ratio = estimate.number() / exact;
    // The dense inverse itself has a relative error of about n u κ.
    let slack = 1.0 + 10.0 * a.nrows() as f64 * U * exact;
    let value = worst([ratio / slack, 1.0 / (ratio * ESTIMATE_FACTOR * slack)]);
    if value > 1.0 && ratio < 1.0 && ratio > LEAST_RATIO {
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

#[cfg(test)]
mod tests;
