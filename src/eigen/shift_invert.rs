//! Eigenpairs of a pencil nearest to a shift, by solves with its factorization, and a count that proves that none is missing.
//!
//! With σ below the spectrum the eigenvalues of
//!
//! ```text
//! (A − σM)⁻¹ M φ = θ φ,      λ = σ + 1/θ,
//! ```
//!
//! that are largest belong to the lowest λ and are far apart, so [`BlockLanczos`] finds them in a few blocks, with one solve a vector (Ericsson and
//! Ruhe, Math. Comput. 35, 1980). `A − σM = L D Lᵀ` has as many negative pivots as there are eigenvalues below σ (Sylvester), which proves
//!
//! - that σ lies below the spectrum, or above it: none or all of them are negative;
//! - that the k eigenvalues found are the lowest ones: as many lie below a shift τ just below the last of them as were found there. Where there are
//!   more, the search goes on from its pairs and random vectors, with σ moved nearer (Grimes, Lewis and Simon 1994).
//!
//! A rigorous bound ε of the rounding errors in `L D Lᵀ` (`linear/certificate.rs`) makes the count a theorem about the stored pencil: at most as many
//! eigenvalues as there are negative pivots lie below `σ − ε`, and at least as many below `σ + ε`.

use super::{BlockLanczos, Eigenpair, End, Ritz, Search, Tolerance, divide, largest, probe, product, scaled_products};
use crate::assembly::SymmetricMatrix;
use crate::error::{Invalid, Result, check_length};
use crate::linear::{Ldlt, SOLVE_COLUMNS, dot};
use crate::memory;
use crate::operator::LinearOperator;
use crate::work::Work;
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Mat, Par};

/// The least distance of a shift from an end, relative to ‖A‖: nearer, the largest θ would drown the others in rounding.
const NEAR_ZERO: f64 = 1e-6;

/// A and the diagonal of M (`None` for the identity).
#[derive(Clone, Copy)]
pub(crate) struct Pencil<'a> {
    pub a: &'a SymmetricMatrix,
    /// A by its fastest products.
    pub products: &'a dyn LinearOperator,
    pub masses: Option<&'a [f64]>,
}

impl<'a> Pencil<'a> {
    /// `A φ = λ φ`.
    pub fn of(a: &'a SymmetricMatrix) -> Self {
        Self { a, products: a, masses: None }
    }

    /// The largest sum of the sizes in a row of `M⁻¹A`, no smaller than any |λ|.
    pub fn norm(&self) -> f64 {
        let mut sums = vec![0.0; self.a.order()];
        let norm = self.a.norm_inf(&mut sums);
        let Some(masses) = self.masses else { return norm };
        divide(&mut sums, Some(masses));
        sums.iter().fold(0.0, |largest, &sum| if sum <= largest { largest } else { sum })
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Accuracy {
    /// The residual of θ at which a pair has converged.
    pub tolerance: Tolerance,
    /// The largest distance of τ from the last pair, relative to ‖A‖ and to its |λ|.
    pub edge: [f64; 2],
}

impl Accuracy {
    /// Full precision, vectors too.
    pub const FULL: Self = Self { tolerance: Tolerance { of_value: 1e-9, of_norm: 1e-13 }, edge: [1e-9, 1e-6] };
    /// A value certified to half a millionth of ‖A‖ and a thousandth of itself; the error of a Rayleigh quotient is of the order of the square of the
    /// tolerance.
    pub const CERTIFIED: Self = Self { tolerance: RESOLVED, edge: [5e-7, 1e-3] };
}

/// The lowest eigenpairs of a pencil, see [`lowest`].
#[derive(Debug, Clone, PartialEq)]
pub struct Lowest {
    /// The pairs, ascending.
    pub pairs: Vec<Eigenpair>,
    /// A count of the eigenvalues below `counted_below` proves that none is missing.
    pub complete: bool,
    /// A value just below the last one.
    pub counted_below: f64,
}

/// The `count` lowest eigenpairs of `A φ = λ M φ`, M given by its diagonal (the identity where it is `None`), each multiple eigenvalue as often as it
/// occurs.
///
/// # Errors
/// Masses that are not as many as A has rows or not positive; a matrix that is too large to factor.
///
/// # Examples
/// ```
/// use faer::Par;
/// use sprung::eigen::lowest;
/// use sprung::{Spring, Stiffness, SystemBuilder, integrate::StepMatrices, work::Work};
///
/// // A mass of 2 kg on a spring of 200 N/m, and steps of 1 s: the eigenvalues are 1/dt² + ω², ω² = 100/s² along the spring.
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 2.0);
/// builder.spring(0, 1, Spring { stiffness: 200.0, rest_length: 1.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
/// let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?.a;
/// let found = lowest(&a, Some(&[2.0; 3]), 3, Par::Seq, &mut Work::default())?;
/// assert!(found.complete && (found.pairs[1].value - 1.0).abs() < 1e-9 && (found.pairs[2].value - 101.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn lowest(a: &SymmetricMatrix, masses: Option<&[f64]>, count: usize, par: Par, work: &mut Work) -> Result<Lowest> {
    if let Some(masses) = masses {
        check_length("masses", masses.len(), a.order())?;
        if let Some((row, mass)) = masses.iter().enumerate().find(|(_, mass)| !(**mass > 0.0 && mass.is_finite())) {
            return Err(Invalid::new("masses", mass, "must be finite and positive").at(row).into());
        }
    }
    work.symbolic_factorizations += 1;
    let mut factorization = Ldlt::analyse(a.pattern(), par)?;
    let mut search = ShiftInvert::new(Pencil { masses, ..Pencil::of(a) }, &mut factorization, work);
    let pairs = search.lowest(count, Accuracy::FULL);
    let counted_below = search.edge.unwrap_or(f64::NEG_INFINITY);
    Ok(Lowest { complete: search.edge.is_some() && pairs.len() == count.min(a.order()), pairs, counted_below })
}

pub(crate) struct ShiftInvert<'a> {
    pub pencil: Pencil<'a>,
    factorization: &'a mut Ldlt,
    work: &'a mut Work,
    norm: f64,
    /// Pairs known beforehand, from which searches start.
    pub known: Vec<Eigenpair>,
    /// Proven bounds of the spectrum.
    pub within: [f64; 2],
    /// The factorization is that of A itself, and positive definite.
    pub is_factored: bool,
    /// The τ that proves the pairs found last to be complete.
    pub edge: Option<f64>,
    /// ε of the last count.
    pub count_error: f64,
}

impl<'a> ShiftInvert<'a> {
    pub fn new(pencil: Pencil<'a>, factorization: &'a mut Ldlt, work: &'a mut Work) -> Self {
        let (within, count_error) = ([f64::NEG_INFINITY, f64::INFINITY], f64::INFINITY);
        // A matrix of zeros has no scale of its own.
        let norm = Some(pencil.norm()).filter(|norm| *norm != 0.0).unwrap_or(1.0);
        let (known, is_factored, edge) = (Vec::new(), false, None);
        Self { pencil, factorization, work, norm, known, within, is_factored, edge, count_error }
    }

    fn order(&self) -> usize {
        self.pencil.a.order()
    }

    /// The `wanted` lowest pairs, ascending. Empty where nothing can be factored.
    pub fn lowest(&mut self, wanted: usize, accuracy: Accuracy) -> Vec<Eigenpair> {
        self.edge = None;
        let Some(mut shift) = self.first_shift() else { return Vec::new() };
        let (mut pairs, mut due) = (self.known.clone(), None);
        for attempt in 0..12 {
            pairs = self.search(End::Lowest, shift, wanted, accuracy.tolerance, &pairs, due);
            let (Some(first), Some(last)) = (pairs.first(), pairs.last()) else { return pairs };
            let [of_norm, of_value] = [accuracy.edge[0] * self.norm, accuracy.edge[1] * last.value.abs()];
            // A pivot that vanishes at one edge does not at another.
            let offset = of_norm.min(of_value).max(1e-12 * self.norm) * (1.0 + 0.37 * attempt as f64);
            let edge = last.value - offset;
            let found = pairs.iter().filter(|pair| pair.value < edge).count();
            let first = first.value;
            if found == 0 && edge <= self.within[0] {
                self.edge = Some(edge);
                self.count_error = f64::INFINITY;
                return pairs;
            }
            let count = self.below(edge);
            if count == Some(found) {
                self.edge = Some(edge);
                // By Kahan's theorem as many eigenvalues lie within the norm of all residuals of those found.
                let residual = pairs.iter().take(found).map(|pair| pair.residual.powi(2)).sum::<f64>().sqrt();
                self.within[0] = self.within[0].max(if found == 0 { edge } else { first - residual });
                return pairs;
            }
            due = count.map(|count| (edge, count.min(wanted)));
            let mut distance = (0.0625 * (first - shift).abs()).max(2.0 * offset).max(NEAR_ZERO * self.norm);
            shift = first - distance;
            while !self.is_floor(shift) {
                distance *= 2.0;
                if distance > 8.0 * self.norm || distance.is_nan() {
                    return pairs;
                }
                shift = first - distance;
            }
        }
        pairs
    }

    /// The largest eigenvalue of A, without masses, and in `within` a bound above it; NaN where nothing can be factored.
    pub fn largest(&mut self) -> f64 {
        let (n, norm) = (self.order(), self.norm);
        let products = self.pencil.products;
        let of_recurrence = |tolerance: f64| largest(n, tolerance * norm, 1000, &mut scaled_products(products, None));
        let (mut value, mut distance) = (of_recurrence(1e-7), Accuracy::CERTIFIED.edge[0] * norm);
        let mut is_rough = true;
        while self.below(value + distance) != Some(n) {
            if std::mem::take(&mut is_rough) {
                value = of_recurrence(1e-10);
            } else {
                distance *= 2.0;
            }
            if distance > 8.0 * norm || !value.is_finite() {
                return f64::NAN;
            }
        }
        self.within[1] = self.within[1].min(value + distance);
        value
    }

    /// The eigenvalue nearest to zero; zero where nothing can be factored.
    ///
    /// A pivot of an indefinite A may almost vanish though no eigenvalue does, which spoils the solves: the residual of the pair tells. The pivots of
    /// `A − σ` do not vanish in the same place; σ is the root of the rounding error, at the cost of half of the digits.
    pub fn nearest_to_zero(&mut self) -> f64 {
        let mut best: Option<Eigenpair> = None;
        for shift in [0.0, 1e-8 * self.norm, -1e-8 * self.norm] {
            if self.below(shift).is_none() {
                continue;
            }
            let nearest = self.search(End::Farthest, shift, 1, RESOLVED, &[], None).pop();
            let Some(nearest) = nearest.filter(|pair| pair.value.is_finite()) else { continue };
            let is_good = nearest.residual <= 1e-3 * nearest.value.abs();
            if best.as_ref().is_none_or(|best| nearest.residual < best.residual) {
                best = Some(nearest);
            }
            if is_good {
                break;
            }
        }
        best.map_or(0.0, |pair| pair.value.abs())
    }

    /// Factors `A − σM` and counts the eigenvalues below σ; `None` where a pivot vanishes.
    pub fn below(&mut self, shift: f64) -> Option<usize> {
        let mut shifted = self.pencil.a.clone();
        match self.pencil.masses {
            Some(masses) => shifted.add_diagonal(-shift, masses),
            None => shifted.shift(-shift),
        }
        self.work.factorizations += 1;
        (self.is_factored, self.count_error) = (false, f64::INFINITY);
        self.factorization.factor(&shifted).ok()?;
        let of_shift = 2.0 * f64::EPSILON * (shift.abs() + self.norm);
        self.count_error = self.factorization.rounding_bound(self.pencil.masses) + of_shift;
        let below = self.factorization.pivots().filter(|(_, d)| *d < 0.0).count();
        self.is_factored = below == 0 && shift == 0.0;
        Some(below)
    }

    /// The eigenvalues below a shift, by [`below`](Self::below), or below one a little farther from zero where a pivot vanishes; with that shift.
    pub fn below_about(&mut self, shift: f64) -> Option<(usize, f64)> {
        let mut shifts = (0..8).map(|k| shift * (1.0 + 0.01 * f64::from(k)));
        shifts.find_map(|shift| Some((self.below(shift)?, shift)))
    }

    /// No eigenvalue is below σ, by [`below`](Self::below).
    fn is_floor(&mut self, shift: f64) -> bool {
        let is_floor = self.below(shift) == Some(0);
        if is_floor {
            self.within[0] = self.within[0].max(shift);
        }
        is_floor
    }

    /// A factored shift below all eigenvalues: zero where A is positive definite, or a little below the lowest Ritz value.
    fn first_shift(&mut self) -> Option<f64> {
        let Pencil { products, masses, .. } = self.pencil;
        let mut guess = None;
        if !(self.is_factored || self.within[0] >= 0.0) {
            let ends = probe(self.order(), masses, 40, &mut scaled_products(products, masses));
            guess = Some(ends.map(|[low, _]| (low.value, low.residual))?);
        }
        let near = NEAR_ZERO * self.norm;
        let may_be_positive = guess.is_none_or(|(value, _)| value > near);
        // A known zero is the lowest eigenvalue, unless the probe has found a lower one.
        let is_singular = self.known.iter().any(|pair| pair.value.abs() <= near);
        if is_singular && guess.is_none_or(|(value, _)| value > -near) && self.is_floor(-near) {
            return Some(-near);
        }
        if self.is_factored || !is_singular && may_be_positive && self.is_floor(0.0) {
            self.within[0] = self.within[0].max(0.0);
            return Some(0.0);
        }
        let (value, residual) = guess?;
        let mut distance = residual.max(0.02 * value.abs()).max(near);
        for _ in 0..60 {
            if self.is_floor(value - distance) {
                return Some(value - distance);
            }
            distance *= 2.0;
        }
        None
    }

    /// The pairs nearest to σ, above it or on both sides, ascending, with the factor of `A − σM` and from pairs found before. Random vectors join as
    /// long as there are fewer pairs, or fewer below an edge than are due.
    fn search(
        &mut self,
        end: End,
        shift: f64,
        wanted: usize,
        tolerance: Tolerance,
        before: &[Eigenpair],
        due: Option<(f64, usize)>,
    ) -> Vec<Eigenpair> {
        // A search for very many eigenvalues, and for a large part of all, spans much of the space anyway.
        let is_dense = end == End::Lowest && self.order() <= 1500 && wanted > 64 && 8 * wanted > self.order();
        if let Some(pairs) = is_dense.then(|| dense(&self.pencil, wanted)).flatten() {
            return pairs;
        }
        let Self { pencil, factorization, work, .. } = self;
        let (n, masses) = (pencil.a.order(), pencil.masses);
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += (x.len() / n) as u64;
            y.copy_from_slice(x);
            if let Some(masses) = masses {
                y.chunks_mut(n).flat_map(|y| y.iter_mut().zip(masses)).for_each(|(y, mass)| *y *= mass);
            }
            factorization.substitute_columns(n, y);
        };
        // θ is positive above σ and negative below it.
        let of_inverse = if end == End::Lowest { End::Highest } else { End::Farthest };
        let search = Search::new(of_inverse, wanted, SOLVE_COLUMNS);
        let before = before.iter().map(|pair| &pair.vector[..]);
        let mut space = BlockLanczos::from(n, masses, search, 1, before, &mut solve);
        let longest = 40 + wanted;
        let mut found = space.iterate(tolerance, longest, &mut solve, None);
        for _ in 0..wanted {
            let below = |edge: f64| found.iter().filter(|pair| shift + pair.value.recip() < edge).count();
            if due.is_none_or(|(edge, count)| below(edge) >= count) && found.len() >= wanted.min(n) {
                break;
            }
            space.refresh(&mut solve);
            found = space.iterate(tolerance, longest, &mut solve, None);
        }
        // Images are nearer to the eigenvectors than Ritz vectors, and orthogonal to the tolerance only.
        let mut pairs: Vec<Eigenpair> = Vec::with_capacity(wanted);
        for Ritz { mut image, .. } in found.into_iter().take(wanted) {
            for Eigenpair { vector, .. } in &pairs {
                let part = match masses {
                    Some(masses) => vector.iter().zip(&image).zip(masses).map(|((a, b), mass)| a * b * mass).sum(),
                    None => dot(vector, &image),
                };
                image.iter_mut().zip(vector).for_each(|(x, v)| *x -= part * v);
            }
            pairs.push(eigenpair(pencil, image));
        }
        pairs.sort_by(|a, b| a.value.total_cmp(&b.value));
        pairs
    }
}

/// The lowest pairs by a dense decomposition of `M^{-1/2} A M^{-1/2}`.
fn dense(pencil: &Pencil<'_>, wanted: usize) -> Option<Vec<Eigenpair>> {
    let n = pencil.a.order();
    // Two matrices, and as much again to work in.
    memory::ensure(32 * (n * n) as u64, "a dense decomposition").ok()?;
    let root = |k: usize| pencil.masses.map_or(1.0, |masses| masses[k].sqrt());
    let mut a = Mat::<f64>::zeros(n, n);
    for (i, j, value) in pencil.a.to_csc().triplet_iter() {
        a[(i, j)] = value / (root(i) * root(j));
    }
    let (mut values, mut vectors) = (Diag::<f64>::zeros(n), Mat::<f64>::zeros(n, n));
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut buffer = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut buffer);
    self_adjoint_evd(a.as_ref(), values.as_mut(), Some(vectors.as_mut()), Par::Seq, stack, Default::default()).ok()?;
    let pair = |k: usize| eigenpair(pencil, (0..n).map(|i| vectors[(i, k)] / root(i)).collect());
    let mut pairs: Vec<Eigenpair> = (0..wanted.min(n)).map(pair).collect();
    pairs.sort_by(|a, b| a.value.total_cmp(&b.value));
    Some(pairs)
}

const RESOLVED: Tolerance = Tolerance { of_value: 0.0, of_norm: 1e-4 };

/// The Rayleigh quotient of a vector with its residual; the vector is scaled to `xᵀMx = 1`.
pub(crate) fn eigenpair(pencil: &Pencil<'_>, mut vector: Vec<f64>) -> Eigenpair {
    let weighted = |x: &[f64]| match pencil.masses {
        Some(masses) => x.iter().zip(masses).map(|(x, mass)| x * mass).collect(),
        None => x.to_vec(),
    };
    let length = dot(&vector, &weighted(&vector)).sqrt();
    vector.iter_mut().for_each(|x| *x /= length);
    let mut rest = product(pencil.a, &vector);
    let value = dot(&vector, &rest);
    rest.iter_mut().zip(weighted(&vector)).for_each(|(r, x)| *r -= value * x);
    let mut scaled = rest.clone();
    divide(&mut scaled, pencil.masses);
    Eigenpair { value, residual: dot(&rest, &scaled).sqrt(), vector }
}
