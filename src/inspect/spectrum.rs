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
//! that the spectrum does not reach half a millionth of ‖A‖ further (nor, where A is definite, a thousandth of λ_min). For every
//! other pair (λ, x) the residual bounds the error: A has an eigenvalue within `‖Ax − λx‖` of λ.

use super::inertia::Inertia;
use super::krylov::{Krylov, Ritz};
use super::lanczos::{End, lanczos_ends, lanczos_largest};
use crate::assembly::SymmetricMatrix;
use crate::error::Result;
use crate::linear::{Ldlt, dot, norm};
use crate::operator::LinearOperator;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, Dyn, SymmetricEigen};

/// An eigenvalue with its unit vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpair {
    /// λ, in N/m.
    pub value: f64,
    /// x, reduced, `‖x‖ = 1`.
    pub vector: Vec<f64>,
    /// `‖Ax − λx‖`: A has an eigenvalue within this distance of λ.
    pub residual: f64,
}

/// What is known of a spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// The lowest eigenpairs, ascending.
    pub lowest: Vec<Eigenpair>,
    /// The largest eigenvalue.
    pub largest: f64,
    /// `max|λ|/min|λ|`; infinite where an eigenvalue cannot be told from zero.
    pub condition: f64,
}

impl Spectrum {
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

/// Residual at which a search with solves stops, relative to the largest eigenvalue of the inverse, and the most steps it
/// takes, to which each wanted pair adds one; then the shift is moved nearer.
pub(super) const TOLERANCE: f64 = 1e-5;
pub(super) const STEPS: usize = 20;

/// The same where only what is certified is wanted: the error of a Rayleigh quotient is of the order of the square.
const CERTIFIED_TOLERANCE: f64 = 1e-3;

/// The same for the last search, with a shift so near that it converges in a few steps.
const LAST_TOLERANCE: f64 = 1e-12;
const LAST_STEPS: usize = 5;

/// How often the shift is moved nearer, and by how much.
const MOVES: usize = 12;
const NEARER: f64 = 1.0 / 16.0;

/// How far outside the spectrum may reach beyond what was found, relative to ‖A‖.
const ACCURACY: f64 = 5e-7;

/// The same relative to λ_min, where A is positive definite.
const RELATIVE_ACCURACY: f64 = 1e-3;

/// The lowest `wanted` eigenpairs (all, for a small matrix), the largest eigenvalue and the condition number. `inertia` is
/// that of A. Where A has up to `wanted` negative eigenvalues, all of them are found.
///
/// # Errors
/// A matrix that is too large to factor.
pub fn spectrum(a: &SymmetricMatrix, inertia: &Inertia, wanted: usize, par: Par, work: &mut Work) -> Result<Spectrum> {
    work.symbolic_factorizations += 1;
    Ok(spectrum_with(&mut Ldlt::analyse(a.pattern(), par)?, a, inertia, wanted, Digits::All, work))
}

/// As [`spectrum`], with a factorization that has been analysed before.
pub(super) fn spectrum_with(
    factorization: &mut Ldlt,
    a: &SymmetricMatrix,
    inertia: &Inertia,
    wanted: usize,
    digits: Digits,
    work: &mut Work,
) -> Spectrum {
    let n = a.dofs().len();
    let mut sums = vec![0.0; n];
    if n == 0 || !a.norm_inf(&mut sums).is_finite() {
        return Spectrum { lowest: Vec::new(), largest: f64::NAN, condition: f64::NAN };
    }
    if n <= LARGEST_DENSE
        && let Some(spectrum) = dense(a, inertia)
    {
        return spectrum;
    }
    let mut search = Search { a, factorization, work };
    let ends = search.ends();
    let largest = search.largest(&ends);
    let lowest = search.lowest(inertia.negative, wanted.clamp(1, n), digits, &ends);
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    let nearest = match () {
        () if inertia.zero > 0 => 0.0,
        () if inertia.negative == 0 => smallest,
        () => search.nearest_to_zero(size(&ends)),
    };
    Spectrum { condition: largest.abs().max(smallest.abs()) / nearest, lowest, largest }
}

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
fn dense(a: &SymmetricMatrix, inertia: &Inertia) -> Option<Spectrum> {
    let n = a.dofs().len();
    let eigen = diagonalise(a)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let pair = |&k: &usize| eigenpair(a, eigen.eigenvectors.column(k).as_slice().to_vec());
    let lowest: Vec<Eigenpair> = order.iter().map(pair).collect();
    let sizes = || lowest.iter().map(|pair| pair.value.abs());
    let nearest = if inertia.zero > 0 { 0.0 } else { sizes().fold(f64::INFINITY, f64::min) };
    let (condition, largest) = (sizes().fold(0.0, f64::max) / nearest, lowest.last()?.value);
    Some(Spectrum { lowest, largest, condition })
}

/// A unit vector with its Rayleigh quotient.
pub(super) fn eigenpair(a: &SymmetricMatrix, vector: Vec<f64>) -> Eigenpair {
    let mut product = vec![0.0; vector.len()];
    a.apply(&vector, &mut product);
    let value = dot(&vector, &product);
    for (p, x) in product.iter_mut().zip(&vector) {
        *p -= value * x;
    }
    Eigenpair { value, residual: norm(&product), vector }
}

/// Doublings of the distance to a shift: 1e-8 of ‖A‖ has then become far more than ‖A‖.
const LONGEST_RETREAT: usize = 60;

/// Products that tell where a spectrum ends, and those that find its upper end: about one factorization of a large cloth.
const ENDS_STEPS: usize = 60;
const LARGEST_STEPS: usize = 240;

/// On which side of the spectrum a shift lies.
#[derive(Clone, Copy)]
enum Side {
    Below,
    Above,
}

impl Side {
    fn outwards(self) -> f64 {
        match self {
            Self::Below => -1.0,
            Self::Above => 1.0,
        }
    }
}

/// How exact an end is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Digits {
    /// As many as there are, vectors too.
    All,
    /// As many as are certified: a value, no vector.
    Certified,
}

impl Digits {
    /// Residual at which a search stops before the end is certified.
    fn tolerance(self) -> f64 {
        match self {
            Self::All => TOLERANCE,
            Self::Certified => CERTIFIED_TOLERANCE,
        }
    }
}

/// A Krylov search at one end of the spectrum.
struct Target {
    side: Side,
    /// σ, beyond the end.
    shift: f64,
    wanted: usize,
    /// How many negative eigenvalues must be among those found.
    due: usize,
    /// How far the spectrum may reach beyond the first eigenvalue λ found: as a part of ‖A‖ and of |λ|.
    accuracy: [f64; 2],
    digits: Digits,
}

/// ‖A‖, nearly.
fn size(ends: &[End; 2]) -> f64 {
    ends.iter().fold(0.0f64, |size, end| size.max(end.value.abs()))
}

pub(super) struct Search<'a> {
    pub a: &'a SymmetricMatrix,
    pub factorization: &'a mut Ldlt,
    pub work: &'a mut Work,
}

impl Search<'_> {
    pub fn n(&self) -> usize {
        self.a.dofs().len()
    }

    /// Where the spectrum ends, roughly.
    pub fn ends(&self) -> [End; 2] {
        lanczos_ends(self.n(), ENDS_STEPS, |x, y| self.a.apply(x, y))
    }

    /// Products find it, and one factorization proves that they have; where they have not, it is searched for.
    fn largest(&mut self, ends: &[End; 2]) -> f64 {
        let side = Side::Above;
        let found = lanczos_largest(self.n(), LARGEST_STEPS, &mut |x: &[f64], y: &mut [f64]| self.a.apply(x, y));
        if self.is_beyond(found + ACCURACY * size(ends), side) {
            return found;
        }
        let Some(shift) = self.factor_beyond(ends, side) else { return f64::NAN };
        let pairs = self.extreme(
            ends,
            &Target { side, shift, wanted: 1, due: 0, accuracy: [ACCURACY, f64::INFINITY], digits: Digits::Certified },
        );
        pairs.first().map_or(f64::NAN, |pair| pair.value)
    }

    /// The lowest pairs. As many of them as Sylvester's count says are negative are not missed for being multiple.
    pub fn lowest(&mut self, negative: usize, wanted: usize, digits: Digits, ends: &[End; 2]) -> Vec<Eigenpair> {
        let (side, due) = (Side::Below, negative.min(wanted));
        let accuracy = |relative| [ACCURACY, relative];
        let target = if self.is_beyond(0.0, side) {
            Target { side, shift: 0.0, wanted, due, accuracy: accuracy(RELATIVE_ACCURACY), digits }
        } else {
            let Some(shift) = self.factor_beyond(ends, side) else { return Vec::new() };
            Target { side, shift, wanted, due, accuracy: accuracy(f64::INFINITY), digits }
        };
        self.extreme(ends, &target)
    }

    /// Searches at one end, with `A − σ` factored, until the end is certified; σ is moved nearer as long as it is not.
    fn extreme(&mut self, ends: &[End; 2], target: &Target) -> Vec<Eigenpair> {
        let Target { side, shift, accuracy, digits, .. } = *target;
        let size = size(ends);
        let mut distance = f64::INFINITY;
        let (tolerance, steps) = (digits.tolerance(), STEPS + target.wanted);
        let mut pairs = self.search(target, Vec::new(), tolerance, steps);
        for _ in 0..MOVES {
            let Some(first) = pairs.first().map(|pair| pair.value) else { return pairs };
            let reach = (accuracy[0] * size).min(accuracy[1] * first.abs());
            let outside = |distance: f64| first + side.outwards() * distance;
            let is_certified = self.is_beyond(outside(reach), side);
            if is_certified && digits == Digits::Certified {
                return pairs;
            }
            if is_certified {
                return self.search(
                    &Target { shift: outside(reach), ..*target },
                    pairs,
                    LAST_TOLERANCE,
                    LAST_STEPS + target.wanted,
                );
            }
            distance = (NEARER * distance.min((first - shift).abs())).max(2.0 * reach);
            while !self.is_beyond(outside(distance), side) {
                distance *= 2.0;
                if distance > 4.0 * size {
                    return pairs;
                }
            }
            pairs = self.search(&Target { shift: outside(distance), ..*target }, pairs, tolerance, steps);
        }
        pairs
    }

    /// The pairs nearest to the target's σ, for which `A − σ` is factored, from those found before; the outermost first.
    fn search(&mut self, target: &Target, before: Vec<Eigenpair>, tolerance: f64, steps: usize) -> Vec<Eigenpair> {
        let Target { side, shift, wanted, due, .. } = *target;
        let Self { a, factorization, work } = self;
        let n = a.dofs().len();
        // (A − σ)⁻¹ below the spectrum, (σ − A)⁻¹ above it: positive definite both.
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += (x.len() / n) as u64;
            y.iter_mut().zip(x).for_each(|(y, x)| *y = -side.outwards() * x);
            factorization.solve_columns_in_place(n, y);
        };
        let start: Vec<Vec<f64>> = before.into_iter().map(|pair| pair.vector).collect();
        let mut space = Krylov::from_vectors(n, wanted, &start, &mut solve);
        let mut found = space.iterate(tolerance, steps, &mut solve);
        let missed = |pairs: &[Ritz]| pairs.iter().filter(|pair| shift + 1.0 / pair.value < 0.0).count() < due;
        for _ in 0..due {
            if !missed(&found) {
                break;
            }
            space.refresh(&mut solve);
            found = space.iterate(tolerance, steps, &mut solve);
        }
        let mut pairs: Vec<Eigenpair> = found.into_iter().map(|pair| eigenpair(a, pair.vector)).collect();
        pairs.sort_by(|a, b| (side.outwards() * b.value).total_cmp(&(side.outwards() * a.value)));
        pairs
    }

    /// Factors `A − σ`; whether σ lies beyond that end of the spectrum.
    fn is_beyond(&mut self, shift: f64, side: Side) -> bool {
        let mut shifted = self.a.clone();
        shifted.shift(-shift);
        self.work.factorizations += 1;
        self.factorization.factor(&shifted).is_ok()
            && self.factorization.pivots().all(|(_, d)| d * side.outwards() < 0.0)
    }

    /// Factors `A − σ` with a σ beyond one end of the spectrum, and returns σ.
    fn factor_beyond(&mut self, ends: &[End; 2], side: Side) -> Option<f64> {
        let [low, high] = ends;
        let size = low.value.abs().max(high.value.abs());
        let end = match side {
            Side::Below => low,
            Side::Above => high,
        };
        let mut margin = end.residual.max(0.02 * end.value.abs()).max(1e-8 * size);
        for _ in 0..LONGEST_RETREAT {
            let shift = end.value + side.outwards() * margin;
            if self.is_beyond(shift, side) {
                return Some(shift);
            }
            margin *= 2.0;
        }
        None
    }
}
