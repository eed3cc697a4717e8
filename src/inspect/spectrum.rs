//! Both ends of the spectrum of A, and the condition number.
//!
//! Small matrices are diagonalised whole. In large ones the ends, and the eigenvalue nearest to zero of an indefinite A, are found by shift-invert
//! Lanczos (`eigen`) and proven by counts of negative pivots.

use super::inertia::Inertia;
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Accuracy, Eigenpair, Pencil, ShiftInvert, eigenpair};
use crate::error::Result;
use crate::linear::Ldlt;
use crate::operator::LinearOperator;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, Dyn, SymmetricEigen};

/// Both ends of a spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// The lowest eigenpairs, ascending.
    pub lowest: Vec<Eigenpair>,
    /// The largest eigenvalue.
    pub largest: f64,
    /// `max|λ|/min|λ|`; infinite where an eigenvalue cannot be told from zero.
    pub condition: f64,
    /// Proven bounds of λ_min; infinite where there is none.
    pub smallest_within: [f64; 2],
    /// Proven bounds of λ_max.
    pub largest_within: [f64; 2],
}

impl Spectrum {
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

pub(super) const LARGEST_DENSE: usize = 240;

/// The lowest `wanted` eigenpairs (all, for a small matrix), the largest eigenvalue and the condition number. `inertia` is that of A.
///
/// # Errors
/// A matrix that is too large to factor.
pub fn spectrum(a: &SymmetricMatrix, inertia: &Inertia, wanted: usize, par: Par, work: &mut Work) -> Result<Spectrum> {
    work.symbolic_factorizations += 1;
    let mut factorization = Ldlt::analyse(a.pattern(), par)?;
    let mut search = ShiftInvert::new(Pencil::of(a), &mut factorization, work);
    Ok(spectrum_with(&mut search, inertia, wanted, Accuracy::FULL))
}

/// As [`spectrum`], by a search that may know that A is factored, and bounds of its spectrum.
pub(super) fn spectrum_with(
    search: &mut ShiftInvert<'_>,
    inertia: &Inertia,
    wanted: usize,
    accuracy: Accuracy,
) -> Spectrum {
    let Pencil { a, .. } = search.pencil;
    let (n, norm) = (a.order(), search.pencil.norm());
    if n == 0 || !norm.is_finite() {
        return Spectrum::unknown();
    }
    if n <= LARGEST_DENSE
        && let Some(spectrum) = dense(a, inertia, norm)
    {
        return spectrum;
    }
    if inertia.is_definite() {
        search.within[0] = search.within[0].max(0.0);
    }
    // The low end uses a factor of A, or leaves one.
    let wanted = wanted.clamp(1, n);
    let (lowest, largest) = if search.is_factored {
        (search.lowest(wanted, accuracy), search.largest())
    } else {
        let largest = search.largest();
        (search.lowest(wanted, accuracy), largest)
    };
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    let rounding = ROUNDING * norm;
    let (smallest_within, largest_within) =
        ([search.within[0], smallest + rounding], [largest - RECURRENCE * norm, search.within[1]]);
    let nearest = match () {
        () if inertia.zero > 0 => 0.0,
        () if inertia.negative == 0 => smallest,
        () => search.nearest_to_zero(),
    };
    let condition = largest.abs().max(smallest.abs()) / nearest;
    Spectrum { condition, lowest, largest, smallest_within, largest_within }
}

/// λ_min alone, in N/m, certified, with an analysed factorization; NaN where A is empty or has entries that are not finite.
pub(super) fn smallest_eigenvalue(factorization: &mut Ldlt, a: &SymmetricMatrix, work: &mut Work) -> f64 {
    let n = a.order();
    if n == 0 || !Pencil::of(a).norm().is_finite() {
        return f64::NAN;
    }
    if n <= LARGEST_DENSE
        && let Some(eigen) = diagonalise(a)
    {
        return eigen.eigenvalues.min();
    }
    let pairs = ShiftInvert::new(Pencil::of(a), factorization, work).lowest(1, Accuracy::CERTIFIED);
    pairs.first().map_or(f64::NAN, |pair| pair.value)
}

/// The rounding error of a Rayleigh quotient relative to ‖A‖, far above that of rows of some hundred entries: curvature below it has no sign.
pub(super) const ROUNDING: f64 = 1e-13;

/// The rounding error of the largest eigenvalue by the recurrence of Lanczos, relative to ‖A‖: that of a thousand products, with room.
const RECURRENCE: f64 = 1e-11;

fn diagonalise(a: &SymmetricMatrix) -> Option<SymmetricEigen<f64, Dyn>> {
    let n = a.order();
    SymmetricEigen::try_new(DMatrix::from(&a.to_csc()), f64::EPSILON, 100 * n)
}

fn dense(a: &SymmetricMatrix, inertia: &Inertia, norm: f64) -> Option<Spectrum> {
    let n = a.order();
    let eigen = diagonalise(a)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let pair = |&k: &usize| eigenpair(&Pencil::of(a), eigen.eigenvectors.column(k).as_slice().to_vec());
    let lowest: Vec<Eigenpair> = order.iter().map(pair).collect();
    let sizes = || lowest.iter().map(|pair| pair.value.abs());
    let nearest = if inertia.zero > 0 { 0.0 } else { sizes().fold(f64::INFINITY, f64::min) };
    let (condition, largest) = (sizes().fold(0.0, f64::max) / nearest, lowest.last()?.value);
    let rounding = 10.0 * n as f64 * f64::EPSILON * norm;
    let within = |value: f64| [value - rounding, value + rounding];
    let (smallest_within, largest_within) = (within(lowest.first()?.value), within(largest));
    Some(Spectrum { lowest, largest, condition, smallest_within, largest_within })
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
            assert!(smallest_eigenvalue(&mut factorization, &a, &mut work).is_nan());
        }
        assert_eq!((work.factorizations, work.solves), (0, 0));
    }

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

    /// A factor of A serves the low end; otherwise that is last and leaves its factor, if a bound proves the eigenvalue.
    #[test]
    fn what_is_factored_is_used_and_left() {
        let a = diagonal(300, |k| if k == 0 { 2.0 } else { 4.0 });
        let found = |is_factored: bool, floor: f64| {
            let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
            if is_factored {
                factorization.factor(&a).unwrap();
            }
            let mut work = Work::default();
            let mut search = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut work);
            (search.is_factored, search.within[0]) = (is_factored, floor);
            let spectrum = spectrum_with(&mut search, &signs(0, 0, 300), 1, Accuracy::CERTIFIED);
            assert!((spectrum.smallest() - 2.0).abs() < 1e-6 && (spectrum.largest - 4.0).abs() < 1e-6);
            let is_factored = search.is_factored;
            (work.factorizations, is_factored)
        };
        // Above the high end, at zero, below the low end; known facts spare the one or the other.
        assert_eq!(found(false, 0.0), (3, false));
        assert_eq!(found(true, 0.0), (2, false));
        assert_eq!(found(false, 1.999999), (2, true));
        assert_eq!(found(true, 1.999999), (1, false));
    }
}
