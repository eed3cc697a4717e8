//! A quick check before all else: whether A is positive definite, and which spring spoils it most.
//!
//! `uᵀAu < 0` proves that A is indefinite, whatever u is. The lowest Ritz vector of a short Lanczos run is such a u
//! wherever λ_min lies visibly below zero, and costs products alone. Where it is none, A is factored: `A = L D Lᵀ` with D > 0 proves that
//! A is positive definite, to rounding; a pivot `d_j < 0` gives `u = L⁻ᵀ e_j/d_j` with `uᵀAu = 1/d_j`. Solves with that factor, a few steps
//! of inverse iteration, bring out the eigenvector nearest to zero, which is the one just lost, or the softest.
//!
//! The springs to blame are those of u. It comes near the eigenvector of λ_min, but is not it: what is found later is more exact.

use super::culprits::{Culprit, Direction, direction};
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Eigenpair, Pencil, eigenpair, probe, unit};
use crate::force::SpringGeometry;
use crate::linear::Ldlt;
use crate::operator::LinearOperator;
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;

/// Whether A is positive definite, and the direction that says most about it so far.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstAnswer {
    /// Whether A is positive definite: by a factorization where it is, by the direction where it is not.
    pub definite: bool,
    /// Whether that is proven. Where A is not factored, see [`Inspection::within`](super::Inspection::within), it may only be that no direction of negative
    /// curvature was found.
    pub is_proven: bool,
    /// u, with `uᵀAu` for its eigenvalue: negative where A is indefinite, a bound for λ_min from above in any case.
    pub direction: Direction,
    /// `‖Au − (uᵀAu) u‖`, in N/m: A has an eigenvalue within this distance of `uᵀAu`.
    pub residual: f64,
}

impl FirstAnswer {
    /// The spring with the largest share of the negative curvature, where there is any.
    pub fn worst(&self) -> Option<&Culprit> {
        self.direction.culprits.first()
    }
}

/// Products of the Lanczos run: a tenth of a factorization or less.
const PRODUCTS: usize = 60;

/// Steps of inverse iteration.
const INVERSE_STEPS: usize = 3;

/// Curvature below which a sign is one, as a part of ‖A‖: products of rows of some hundred entries have errors of 1e-15 of it.
const SIGN: f64 = 1e-13;

/// Answers for A of a system under an option, known by its fastest products too, with a factorization that knows its pattern; `None` where A is empty, has entries that are
/// not finite, or is singular to working precision.
pub(super) fn quick_check(
    system: &System,
    extensions: &SpringGeometry,
    option: Stiffness,
    a: &SymmetricMatrix,
    products: &dyn LinearOperator,
    factorization: &mut Ldlt,
    work: &mut Work,
) -> Option<FirstAnswer> {
    let n = a.order();
    let size = a.norm_inf(&mut vec![0.0; n]);
    if n == 0 || !size.is_finite() {
        return None;
    }
    let answer = |definite: bool, pair: Eigenpair| {
        let direction = direction(system, extensions, option, &pair);
        FirstAnswer { definite, is_proven: true, direction, residual: pair.residual }
    };
    let is_negative = |pair: &Eigenpair| pair.value < -SIGN * size;
    let eigenpair = |u| eigenpair(&Pencil::of(a), u);
    let ends = probe(n, None, PRODUCTS, &mut |x: &[f64], y: &mut [f64]| products.apply(x, y));
    let lowest = ends.map(|[low, _]| eigenpair(low.vector));
    if let Some(pair) = lowest.as_ref().filter(|pair| is_negative(pair)) {
        return Some(answer(false, pair.clone()));
    }
    work.factorizations += 1;
    factorization.factor(a).ok()?;
    let mut u = match lowest {
        Some(pair) => pair.vector,
        None => vec![1.0; n],
    };
    let definite = factorization.is_positive();
    if !definite && !factorization.negative_direction(&mut u) {
        return None;
    }
    let mut best = eigenpair(unit(u)?);
    for _ in 0..INVERSE_STEPS {
        let mut u = best.vector.clone();
        factorization.substitute(&mut u);
        work.solves += 1;
        let next = unit(u).map(eigenpair);
        // Of an indefinite A inverse iteration may go on to an eigenvalue above zero.
        let Some(next) = next.filter(|next| definite && next.value < best.value || !definite && is_negative(next))
        else {
            break;
        };
        best = next;
    }
    (definite == (best.value > 0.0)).then(|| answer(definite, best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::StepMatrices;
    use crate::linear::fixtures::banded;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use faer::Par;
    use std::cell::Cell;

    struct Counted<'a> {
        a: &'a SymmetricMatrix,
        products: Cell<usize>,
    }

    impl LinearOperator for Counted<'_> {
        fn order(&self) -> usize {
            self.a.order()
        }

        fn apply(&self, w: &[f64], y: &mut [f64]) {
            self.products.set(self.products.get() + 1);
            self.a.apply(w, y);
        }
    }

    /// A chain pressed to four fifths of its length, in a plane, at a step for which A is visibly indefinite, one for which only a factorization
    /// tells (λ_min is −10⁻⁹ of ‖A‖), and a safe one: at most one factorization, three solves and sixty products.
    #[test]
    fn it_costs_one_factorization_at_most() {
        let free = 400;
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for p in 0..free + 2 {
            builder.particle([p as f64, 0.0, 0.0], 2.0);
        }
        for p in 0..=free {
            builder.spring(p, p + 1, Spring { stiffness: 50.0, rest_length: 1.25, damping: 0.0 });
        }
        builder.hold(0);
        builder.hold(free + 1);
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        // Across the chain A has 2/dt² − 10 μ, μ up to this.
        let highest = 4.0 * (free as f64 * std::f64::consts::PI / (2.0 * (free + 1) as f64)).sin().powi(2);
        for (inertia, definite, factorizations) in
            [(33.0, false, 0), (10.0 * highest - 1e-7, false, 1), (10.0 * highest + 1e-7, true, 1), (60.0, true, 1)]
        {
            let a = StepMatrices::assemble(&system, &state, Stiffness::Full, (2.0f64 / inertia).sqrt()).unwrap().a;
            let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
            let counted = Counted { a: &a, products: Cell::new(0) };
            let mut work = Work::default();
            let full = Stiffness::Full;
            let first = quick_check(&system, &extensions, full, &a, &counted, &mut factorization, &mut work).unwrap();
            assert_eq!((first.definite, work.factorizations), (definite, factorizations), "{inertia}");
            assert!(work.solves <= INVERSE_STEPS as u64 && counted.products.get() <= PRODUCTS, "{work:?}");
            // What a factorization refuses is bettered by all of them.
            assert!(definite || work.solves == 3 * factorizations, "{work:?}");
            let proven = if definite { factorizations == 1 } else { first.direction.eigenvalue < 0.0 };
            assert!(proven && first.is_proven);
        }
    }

    /// The answer for a diagonal matrix of three rows, its factorizations and solves.
    fn answered(diagonal: [f64; 3]) -> (Option<FirstAnswer>, [u64; 2]) {
        let mut builder = SystemBuilder::new();
        let ends = [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
        builder.spring(ends[0], ends[1], Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(ends[1]);
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = banded(1, 0, |row, column| if row == column { diagonal[row] } else { 0.0 });
        let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
        let mut work = Work::default();
        let full = Stiffness::Full;
        let first = quick_check(&system, &extensions, full, &a, &a, &mut factorization, &mut work);
        (first, [work.factorizations, work.solves])
    }

    /// From 10⁻¹³ of ‖A‖ below zero on products are believed, whatever the size of A; what is nearer to zero a factorization decides, and
    /// one solve says that its direction is the eigenvector.
    #[test]
    fn products_are_believed_beyond_their_rounding() {
        for size in [2f64.powi(-20), 1.0, 2f64.powi(20)] {
            let answer = |lowest: f64| {
                let (first, work) = answered([size * lowest, 0.25 * size, size]);
                let first = first.unwrap();
                assert!(first.is_proven && (first.direction.eigenvalue / (size * lowest) - 1.0).abs() < 1e-2);
                (first.definite, work)
            };
            assert_eq!(answer(-2e-13), (false, [0, 0]), "{size}");
            assert_eq!(answer(-0.5e-13), (false, [1, 1]), "{size}");
            // Of a definite one a second may lower the quotient by its rounding.
            assert!(matches!(answer(0.5e-13), (true, [1, 1 | 2])), "{size}");
        }
    }

    #[test]
    fn nothing_is_answered_of_no_matrix() {
        for diagonal in [[f64::INFINITY, 1.0, 1.0], [f64::NEG_INFINITY, 1.0, 1.0]] {
            assert_eq!(answered(diagonal), (None, [0, 0]));
        }
        let mut builder = SystemBuilder::new();
        let held = builder.particle([0.0; 3], 1.0);
        builder.hold(held);
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = banded(0, 0, |_, _| 0.0);
        let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
        let mut work = Work::default();
        let full = Stiffness::Full;
        assert_eq!(quick_check(&system, &extensions, full, &a, &a, &mut factorization, &mut work), None);
        assert_eq!(work, Work::default());
    }

    #[test]
    fn a_vector_without_a_length_has_no_direction() {
        assert_eq!(unit(vec![3.0, 4.0]), Some(vec![0.6, 0.8]));
        for vector in [vec![], vec![0.0; 3], vec![f64::INFINITY, 1.0], vec![f64::NAN]] {
            assert_eq!(unit(vector), None);
        }
    }
}
