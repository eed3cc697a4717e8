//! The eigenvalue of an indefinite A that is nearest to zero, which decides about its condition number.
//!
//! `A⁻²` has the eigenvalues 1/λ², so the largest of these is looked for, by solves with A applied twice. A pivot of an indefinite A may
//! almost vanish though no eigenvalue does, and solves are worth nothing then; so they are tried on a random vector first. The
//! pivots of `A − σ`, a little beside A, do not vanish in the same place. Its solves are refined to those of A,
//! `y ← y + (A − σ)⁻¹ (x − A y)`, which leaves the part `|σ/(λ − σ)|` of the difference along every eigenvector each time.

use super::krylov::Krylov;
use super::random::gaussian;
use super::search::{CERTIFIED_TOLERANCE, LARGE, Search, TOLERANCE};
use crate::assembly::SymmetricMatrix;
use crate::linear::{Ldlt, norm};
use crate::operator::LinearOperator;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// How well a factorization must solve with A, relative to the right-hand side: a hundredth of [`TOLERANCE`].
const SOLVED: f64 = 1e-7;

/// The same relative to ‖A‖ times the solution: nothing in double precision solves much better.
const STABLE: f64 = 1e-13;

/// How far beside A the matrix is that is factored where a pivot vanishes, relative to ‖A‖: the root of the rounding error, so that a
/// pivot of that size costs half of the digits. And how often its solves are refined.
const BESIDE: f64 = 1e-8;
const REFINEMENTS: usize = 3;

/// Steps of the search at most: four times as many as at an end of the spectrum, for no shift can be moved nearer here.
const LONGEST: usize = 80;

impl Search<'_> {
    /// The smallest |λ|; zero where nothing can be factored. `size` is ‖A‖, nearly.
    pub fn nearest_to_zero(&mut self, size: f64) -> f64 {
        let Some(refinements) = self.factor_for_solves(size) else { return 0.0 };
        let Self { a, factorization, work, .. } = self;
        let n = a.dofs().len();
        let mut rest = Vec::new();
        let mut solve = |x: &[f64], y: &mut [f64]| {
            y.copy_from_slice(x);
            for _ in 0..2 {
                rest.clear();
                rest.extend_from_slice(y);
                work.solves += (1 + refinements as u64) * (x.len() / n) as u64;
                factorization.substitute_columns(n, y);
                (0..refinements).for_each(|_| refine(a, factorization, &rest, y));
            }
        };
        // The root of the value: half of the digits that are found are enough for those that are told.
        let tolerance = if n < LARGE { TOLERANCE } else { CERTIFIED_TOLERANCE };
        let pairs = Krylov::new(n, 1, &mut solve).iterate(tolerance, LONGEST, &mut solve);
        pairs.first().map_or(f64::NAN, |pair| pair.value.abs().sqrt().recip())
    }

    /// Factors A, or a matrix a little beside it where that does not solve with A, and returns how often solves are to be refined.
    fn factor_for_solves(&mut self, size: f64) -> Option<usize> {
        self.is_factored = false;
        let mut probe = vec![0.0; self.n()];
        gaussian(&mut Xoshiro256PlusPlus::seed_from_u64(1), &mut probe);
        for (shift, refinements) in [(0.0, 0), (BESIDE * size, REFINEMENTS), (-BESIDE * size, REFINEMENTS)] {
            let mut shifted = self.a.clone();
            shifted.shift(-shift);
            self.work.factorizations += 1;
            if self.factorization.factor(&shifted).is_err() {
                continue;
            }
            let mut solution = probe.clone();
            self.work.solves += 1 + refinements as u64;
            self.factorization.substitute_columns(self.n(), &mut solution);
            (0..refinements).for_each(|_| refine(self.a, self.factorization, &probe, &mut solution));
            let allowed = f64::max(SOLVED * norm(&probe), STABLE * size * norm(&solution));
            if norm(&left(self.a, &probe, &solution)) <= allowed {
                return Some(refinements);
            }
        }
        // Neither: A has an eigenvalue so near to zero that nothing solves with it. It is found all the same, if not to many digits.
        self.work.factorizations += 1;
        self.factorization.factor(self.a).is_ok().then_some(0)
    }
}

/// `X − A·Y`, by columns.
fn left(a: &SymmetricMatrix, x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = a.dofs().len();
    let mut product = vec![0.0; x.len()];
    y.chunks_exact(n).zip(product.chunks_exact_mut(n)).for_each(|(y, product)| a.apply(y, product));
    x.iter().zip(&product).map(|(x, product)| x - product).collect()
}

/// Adds to Y what solves for `X − A·Y`.
fn refine(a: &SymmetricMatrix, factorization: &mut Ldlt, x: &[f64], y: &mut [f64]) {
    let mut rest = left(a, x, y);
    factorization.substitute_columns(a.dofs().len(), &mut rest);
    y.iter_mut().zip(&rest).for_each(|(y, rest)| *y += rest);
}
