//! Both ends of the spectrum of A, and the condition number.
//!
//! Small matrices are diagonalised whole. Large ones are searched from three sides by block Krylov methods:
//!
//! - the largest by products with A in a Lanczos recurrence;
//! - the lowest, and the largest where products do not find it, by solves with `A − σ`, σ beyond the end in question. Products with A, in a
//!   short recurrence, tell where the spectrum ends; that σ lies beyond is proven by a factorization all of whose pivots have
//!   one sign. Where A is positive definite σ = 0 will do for the low end, and even a λ_min far below ‖A‖ is found to many
//!   digits;
//! - the one nearest to zero, which decides about the condition number of an indefinite A, by solves with A itself (`nearest`).
//!
//! Both ends are certified: a Rayleigh quotient never lies outside the spectrum, and a factorization with pivots of one sign proves
//! that the spectrum does not reach half a millionth of ‖A‖ further (nor, where A is definite, a thousandth of λ_min); the upper end of a
//! matrix so large that products do not come that near may reach as much further as they leave open. For every
//! other pair (λ, x) the residual bounds the error: A has an eigenvalue within `‖Ax − λx‖` of λ.
//!
//! What is [known](Known) beforehand spares factorizations: a factor of A, a bound for λ_min, a matrix `T ≥ A`, none of whose eigenvalues
//! lies below that of A, so that one factorization proves where both end.

use super::eigenpair::{Eigenpair, eigenpair};
use super::inertia::Inertia;
use super::search::{Digits, Known, Search, size};
use crate::assembly::SymmetricMatrix;
use crate::error::Result;
use crate::linear::Ldlt;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, Dyn, SymmetricEigen};

/// What is known of a spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// The lowest eigenpairs, ascending.
    pub lowest: Vec<Eigenpair>,
    /// The largest eigenvalue.
    pub largest: f64,
    /// `max|λ|/min|λ|`; infinite where an eigenvalue cannot be told from zero.
    pub condition: f64,
    /// What λ_min lies between, proven; infinite where there is no proof.
    pub smallest_within: [f64; 2],
    /// The same of λ_max.
    pub largest_within: [f64; 2],
}

impl Spectrum {
    /// Of which nothing is known.
    pub(super) fn unknown() -> Self {
        let anywhere = [f64::NEG_INFINITY, f64::INFINITY];
        let (lowest, largest, condition) = (Vec::new(), f64::NAN, f64::NAN);
        Self { lowest, largest, condition, smallest_within: anywhere, largest_within: anywhere }
    }

    /// The lowest eigenvalue; NaN for a matrix of order zero.
    pub fn smallest(&self) -> f64 {
        self.lowest.first().map_or(f64::NAN, |pair| pair.value)
    }

    /// The pairs with a negative eigenvalue.
    pub fn negative(&self) -> &[Eigenpair] {
        &self.lowest[..self.lowest.partition_point(|pair| pair.value < 0.0)]
    }
}

/// Up to this order a matrix is diagonalised whole.
pub(super) const LARGEST_DENSE: usize = 240;

/// The lowest `wanted` eigenpairs (all, for a small matrix), the largest eigenvalue and the condition number. `inertia` is
/// that of A. Where A has up to `wanted` negative eigenvalues, all of them are found.
///
/// # Errors
/// A matrix that is too large to factor.
pub fn spectrum(a: &SymmetricMatrix, inertia: &Inertia, wanted: usize, par: Par, work: &mut Work) -> Result<Spectrum> {
    work.symbolic_factorizations += 1;
    Ok(spectrum_with(&mut Ldlt::analyse(a.pattern(), par)?, a, inertia, wanted, &mut Known::nothing(a), work))
}

/// As [`spectrum`], with a factorization that has been analysed before.
pub(super) fn spectrum_with(
    factorization: &mut Ldlt,
    a: &SymmetricMatrix,
    inertia: &Inertia,
    wanted: usize,
    known: &mut Known<'_>,
    work: &mut Work,
) -> Spectrum {
    let n = a.dofs().len();
    let mut sums = vec![0.0; n];
    let norm = a.norm_inf(&mut sums);
    if n == 0 || !norm.is_finite() {
        return Spectrum::unknown();
    }
    if n <= LARGEST_DENSE
        && let Some(spectrum) = dense(a, inertia, norm)
    {
        // Nothing was factored.
        return spectrum;
    }
    let mut search = Search {
        within: known.within,
        is_factored: known.is_factored,
        ..Search::new(a, known.products, factorization, work)
    };
    let ends = search.ends();
    let (wanted, digits) = (wanted.clamp(1, n), known.digits);
    let low = |search: &mut Search<'_>| search.lowest(inertia.negative, wanted, digits, &ends);
    // What is factored may be of use, and what is not yet may be so afterwards.
    let (lowest, largest) = match known.is_factored || digits == Digits::All {
        true => {
            let lowest = low(&mut search);
            (lowest, search.largest(&ends, known))
        }
        false => {
            let largest = search.largest(&ends, known);
            (low(&mut search), largest)
        }
    };
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    // A quotient has a rounding error of the products.
    let rounding = QUOTIENT * norm;
    let (smallest_within, largest_within) =
        ([search.within[0], smallest + rounding], [largest - rounding, search.within[1]]);
    let nearest = match () {
        () if inertia.zero > 0 => 0.0,
        () if inertia.negative == 0 => smallest,
        () => search.nearest_to_zero(size(&ends)),
    };
    let condition = largest.abs().max(smallest.abs()) / nearest;
    known.is_factored = search.is_factored;
    Spectrum { condition, lowest, largest, smallest_within, largest_within }
}

/// Rounding error of a Rayleigh quotient of a vector of length one, relative to the largest sum of a row: far above that of rows of some
/// hundred entries.
const QUOTIENT: f64 = 1e-13;

pub(super) fn diagonalise(a: &SymmetricMatrix) -> Option<SymmetricEigen<f64, Dyn>> {
    let n = a.dofs().len();
    let mut matrix = DMatrix::zeros(n, n);
    for (row, column, value) in a.iter() {
        matrix[(row, column)] = value;
        matrix[(column, row)] = value;
    }
    SymmetricEigen::try_new(matrix, f64::EPSILON, 100 * n)
}

/// All eigenpairs of a small matrix.
fn dense(a: &SymmetricMatrix, inertia: &Inertia, norm: f64) -> Option<Spectrum> {
    let n = a.dofs().len();
    let eigen = diagonalise(a)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let pair = |&k: &usize| eigenpair(a, eigen.eigenvectors.column(k).as_slice().to_vec());
    let lowest: Vec<Eigenpair> = order.iter().map(pair).collect();
    let sizes = || lowest.iter().map(|pair| pair.value.abs());
    let nearest = if inertia.zero > 0 { 0.0 } else { sizes().fold(f64::INFINITY, f64::min) };
    let (condition, largest) = (sizes().fold(0.0, f64::max) / nearest, lowest.last()?.value);
    // The error of a dense method is a small multiple of n u ‖A‖.
    let rounding = 10.0 * n as f64 * f64::EPSILON * norm;
    let within = |value: f64| [value - rounding, value + rounding];
    let (smallest_within, largest_within) = (within(lowest.first()?.value), within(largest));
    Some(Spectrum { lowest, largest, condition, smallest_within, largest_within })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::smallest_eigenvalue;
    use crate::linear::fixtures::banded;

    fn diagonal(n: usize, value: impl Fn(usize) -> f64) -> SymmetricMatrix {
        banded(n / 3, 0, |row, column| if row == column { value(row) } else { 0.0 })
    }

    fn signs(negative: usize, zero: usize, positive: usize) -> Inertia {
        Inertia { negative, zero, positive, ..Inertia::undecided(0, 0.0) }
    }

    #[test]
    fn nothing_is_known_of_no_matrix() {
        let mut work = Work::default();
        for a in [diagonal(0, |_| 0.0), diagonal(3, |_| f64::INFINITY), diagonal(300, |_| f64::NAN)] {
            let found = spectrum(&a, &signs(0, 0, a.dofs().len()), 1, Par::Seq, &mut work).unwrap();
            assert!(found.lowest.is_empty() && found.largest.is_nan() && found.condition.is_nan());
            assert!(smallest_eigenvalue(&a, Par::Seq, &mut work).unwrap().is_nan());
        }
        assert_eq!((work.factorizations, work.solves), (0, 0));
    }

    /// Zero is not negative.
    #[test]
    fn negative_pairs_are_below_zero() {
        let pair = |value| Eigenpair { value, vector: Vec::new(), residual: 0.0 };
        let found = Spectrum { lowest: [-2.0, -1.0, 0.0, 1.0].map(pair).into(), ..Spectrum::unknown() };
        assert_eq!(found.negative().len(), 2);
    }

    /// Whatever is found, whether a matrix is diagonalised or searched: one that is singular to working precision has no condition number.
    #[test]
    fn a_zero_that_was_counted_makes_the_condition_infinite() {
        let mut work = Work::default();
        for n in [3, 300] {
            let a = diagonal(n, |k| if k == 0 { 2.0 } else { 4.0 });
            for (inertia, condition) in [(signs(0, 0, n), 2.0), (signs(0, 1, n - 1), f64::INFINITY)] {
                let found = spectrum(&a, &inertia, 1, Par::Seq, &mut work).unwrap();
                assert!((found.smallest() - 2.0).abs() < 1e-9 && (found.largest - 4.0).abs() < 1e-9);
                assert!(found.condition == condition || (found.condition - condition).abs() < 1e-9);
            }
        }
    }

    /// A factor of A serves the low end, which is looked for first then. Otherwise the low end is last, so that its factor is left, if a bound
    /// proves what it finds.
    #[test]
    fn what_is_factored_is_used_and_left() {
        let a = diagonal(300, |k| if k == 0 { 2.0 } else { 4.0 });
        let found = |is_factored: bool, digits: Digits, floor: f64| {
            let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
            if is_factored {
                factorization.factor(&a).unwrap();
            }
            let mut work = Work::default();
            let mut known = Known { is_factored, digits, within: [floor, f64::INFINITY], ..Known::nothing(&a) };
            let spectrum = spectrum_with(&mut factorization, &a, &signs(0, 0, 300), 1, &mut known, &mut work);
            assert!((spectrum.smallest() - 2.0).abs() < 1e-6 && (spectrum.largest - 4.0).abs() < 1e-6);
            (work.factorizations, known.is_factored)
        };
        // At zero, below the low end, above the high end; what is known spares one or the other.
        assert_eq!(found(false, Digits::Certified, 0.0), (3, false));
        assert_eq!(found(true, Digits::Certified, 0.0), (2, false));
        assert_eq!(found(false, Digits::Certified, 1.999999), (2, true));
        assert_eq!(found(true, Digits::Certified, 1.999999), (1, false));
        assert_eq!(found(true, Digits::All, 0.0), (2, false));
    }
}
