//! The system of a step by the factorization of another: conjugate gradients, preconditioned with the factor at hand.
//!
//! With `s = 1/dt` the matrix of a step is `P(s) = s² M + s C + K`, here with C and K positive semidefinite. Once `P(s₀)` is factored, the eigenvalues
//! of `P(s₀)⁻¹P(s)` lie between 1 and `(s/s₀)²`, so that a step four times as long or short takes some twenty solves (Hestenes and Stiefel 1952).
//!
//! **When it is enough.** The error e has `eᵀP(s)e = rᵀP(s)⁻¹r ≤ rᵀM⁻¹r/s²`, to be held against `xᵀP(s)x = xᵀb`.

use crate::linear::dot;
use crate::operator::LinearOperator;

/// Error in the norm of P(s), relative to the solution.
const TOLERANCE: f64 = 1e-5;

/// Iterations at most: as much work as several factorizations, for matrices of cloths.
const MOST: usize = 40;

/// Solves `P(s) x = b`, b in the place of x, with what `precondition` makes of a residual; whether that was possible. `masses` is the diagonal of M.
pub(super) fn solve(
    p: &dyn LinearOperator,
    s: f64,
    masses: &[f64],
    precondition: &mut dyn FnMut(&mut [f64]),
    x: &mut [f64],
) -> bool {
    let b = x.to_vec();
    let mut rest = b.clone();
    x.fill(0.0);
    let (mut direction, mut product) = (vec![0.0; b.len()], vec![0.0; b.len()]);
    let mut before = f64::INFINITY;
    for iteration in 0..=MOST {
        let error: f64 = rest.iter().zip(masses).map(|(r, mass)| r * r / mass).sum();
        let energy = dot(x, &b);
        if !(error.is_finite() && energy.is_finite()) {
            return false;
        }
        if error <= (TOLERANCE * s).powi(2) * energy || error == 0.0 {
            return true;
        }
        if iteration == MOST {
            break;
        }
        let mut z = rest.clone();
        precondition(&mut z);
        let now = dot(&rest, &z);
        let beta = now / before;
        direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + beta * *d);
        p.apply(&direction, &mut product);
        let alpha = now / dot(&direction, &product);
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += alpha * d);
        rest.iter_mut().zip(&product).for_each(|(r, p)| *r -= alpha * p);
        before = now;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::solve;
    use crate::force::SpringGeometry;
    use crate::inspect::fixtures::{pin, pinned};
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::Stiffness;

    /// (s² m + c) x = b by hand: exactly, with what solves exactly or nearly, and not at all where squares overflow.
    #[test]
    fn steps_are_solved_for_unless_they_overflow() {
        let (system, state) = pinned(&[pin(2.0, -1.0), pin(1.0, -12.0)]);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let p = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.5));
        for (diagonal, most) in [([9.0, 16.0], 1), ([8.0, 4.0], 2)] {
            let mut uses = 0;
            let mut precondition = |r: &mut [f64]| {
                uses += 1;
                r.iter_mut().zip(diagonal).for_each(|(r, diagonal)| *r /= diagonal);
            };
            let mut x = [27.0, 32.0];
            assert!(solve(&p, 2.0, &[2.0, 1.0], &mut precondition, &mut x));
            assert!((x[0] - 3.0).abs() < 1e-12 && (x[1] - 2.0).abs() < 1e-12, "{x:?}");
            assert_eq!(uses, most);
        }
        let mut unused = |_: &mut [f64]| panic!("a direction that is of no use");
        assert!(!solve(&p, 2.0, &[2.0, 1.0], &mut unused, &mut [1e200, 0.0]));
    }
}
