//! The numbers of negative, zero and positive eigenvalues of a symmetric matrix, with a measured certificate.
//!
//! **Sylvester's law.** A and `S A Sᵀ` have as many negative, zero and positive eigenvalues, for every invertible S. So the signs of the blocks of B
//! in `A = L B Lᵀ` count those of A: the *inertia*, without one eigenvalue being computed.
//!
//! **Rounding.** The factorization is that of a matrix nearby, `L B Lᵀ = A + E`. By Weyl's theorem the signs of eigenvalues above `‖E‖` are right,
//! but an indefinite matrix can make E arbitrarily large without any pivot failing. Hence:
//!
//! 1. A is *equilibrated*, `C = S A S` with S a diagonal of powers of two that brings the largest entry of every row near 1: masses or stiffnesses of
//!    very different size then hide no small eigenvalues.
//! 2. `C − τ` and `C + τ` are factored. The first counts the eigenvalues below τ, the second those below −τ; those between count as *zero*. Where the
//!    first has no negative pivot A is positive definite, and the second is not needed.
//! 3. E is measured: `‖E‖ ≤ 10 √(2/π) maxᵢ ‖E gᵢ‖` for r Gaussian vectors gᵢ, wrong with probability 10⁻ʳ (Halko, Martinsson and Tropp 2011, lemma
//!    4.1); here r = 6. If the bound exceeds τ/2, the matrix is factored again with pivoting inside supernodes, then, if it is small, densely;
//!    otherwise τ is widened to the measured error, and the count repeated.
//!
//! The result holds for every eigenvalue of C outside ±[`band`](Inertia::band): `48 √n u‖C‖`, u = 2⁻⁵³, for a well-behaved matrix.
//!
//! **Proof.** Without pivoting `‖E‖` has a rigorous bound too (`linear/certificate.rs`). Where it is below τ, the count is a theorem about the stored
//! matrix: at least as many eigenvalues as were counted are negative, and at least as many positive. Where it is above, τ is widened once to prove
//! the same count.

use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::eigen::{Pencil, gaussian};
use crate::error::Result;
use crate::linear::{FactorKind, Factorization, PivotSigns, PivotedLdlt, Pivoting, norm};
use crate::operator::{LinearOperator, SystemOperator};
use crate::spring::SpringBlock;
use crate::work::Work;
use faer::{Mat, Par, Side};
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// Numbers of eigenvalues by sign, with the error of the count.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::inspect::Inertia;
/// use sprung::integrate::StepMatrices;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?.a;
/// let inertia = Inertia::of(&a)?;
/// assert_eq!((inertia.negative, inertia.zero, inertia.positive), (2, 0, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Inertia {
    /// Eigenvalues below the band.
    pub negative: usize,
    /// Eigenvalues in the band: too near to zero for this precision to tell their sign.
    pub zero: usize,
    /// Eigenvalues above the band.
    pub positive: usize,
    /// Half the width of the band around zero, for the equilibrated matrix C, relative to `‖C‖` (maximum norm).
    pub band: f64,
    /// Bound on `‖C ± τ − L B Lᵀ‖/‖C‖` for the factorizations that were counted: measured, or rigorous where that is smaller.
    #[serde(skip)]
    pub factorization_error: f64,
    /// The factorization in which it was counted.
    #[serde(skip)]
    pub method: InertiaMethod,
    /// True if a rigorous bound of rounding errors proves that at least `negative` eigenvalues of the stored matrix are negative and at least
    /// `positive` are positive; otherwise the count is right with the probability of the measured error.
    pub proven: bool,
}

/// The factorization in which signs were counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum InertiaMethod {
    /// Sparse, without pivoting.
    Sparse,
    /// Sparse, pivoted inside supernodes.
    Pivoted,
    /// Dense, pivoted without restriction.
    Dense,
    /// None was needed: no spring has negative curvature, and every free particle has a mass.
    Springs,
    /// None could be trusted (the matrix has entries that are not finite): every eigenvalue counts as zero.
    None,
}

impl Inertia {
    /// Counts for one matrix. For several on one pattern keep an [`InertiaCounter`].
    ///
    /// # Errors
    /// A matrix that is too large to factor.
    pub fn of(a: &SymmetricMatrix) -> Result<Self> {
        Ok(InertiaCounter::new(a.pattern(), Par::Seq)?.count(a, &mut Work::default()))
    }

    /// n eigenvalues of unknown sign.
    pub(super) fn undecided(n: usize, band: f64) -> Self {
        let (factorization_error, method) = (f64::INFINITY, InertiaMethod::None);
        Self { negative: 0, zero: n, positive: 0, band, factorization_error, method, proven: n == 0 }
    }

    /// n positive eigenvalues, proven by masses and springs.
    pub(super) fn definite(n: usize) -> Self {
        let (factorization_error, method) = (0.0, InertiaMethod::Springs);
        Self { negative: 0, zero: 0, positive: n, band: 0.0, factorization_error, method, proven: true }
    }

    /// Every eigenvalue is positive.
    pub fn is_definite(&self) -> bool {
        self.negative == 0 && self.zero == 0
    }
}

/// The first half-width of the band, in units of `√n u‖C‖`: twice the measured error of factorizations that lose no digits, about 11 units for
/// matrices of 10³ to 10⁵ rows, and some more.
const FIRST_SHIFT: f64 = 32.0;

/// The error below which pivoting does not improve a factorization, in the same units.
const STABLE: f64 = 64.0;

/// Gaussian vectors that measure a factorization: its error is underestimated with probability 10⁻⁶.
const PROBES: usize = 6;

/// Counts inertia for matrices of one pattern, analysed once. Each count begins with the method that the last one needed.
pub struct InertiaCounter {
    factorization: PivotedLdlt,
    pub(super) method: InertiaMethod,
}

pub(super) struct Count {
    signs: PivotSigns,
    pub error: f64,
    /// A rigorous bound of the same error, where there is one.
    bound: f64,
    pub method: InertiaMethod,
}

impl InertiaCounter {
    /// Orders and analyses a pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn new(pattern: &BlockPattern, par: Par) -> Result<Self> {
        Ok(Self { factorization: PivotedLdlt::analyse(pattern, par)?, method: InertiaMethod::Sparse })
    }

    /// As [`new`](Self::new), on a pattern that has been analysed.
    ///
    /// # Errors
    /// When the factor does not fit the memory.
    pub fn sharing<K: FactorKind>(analysed: &Factorization<K>) -> Result<Self> {
        Ok(Self { factorization: PivotedLdlt::sharing(analysed)?, method: InertiaMethod::Sparse })
    }

    /// Counts the eigenvalues of a matrix on the analysed pattern.
    pub fn count(&mut self, a: &SymmetricMatrix, work: &mut Work) -> Inertia {
        let n = a.order();
        let undecided = |band| Inertia::undecided(n, band);
        if n == 0 {
            return Inertia { factorization_error: 0.0, method: InertiaMethod::Sparse, ..undecided(0.0) };
        }
        let c = equilibrated(a);
        let scale = Pencil::of(&c).norm();
        if !scale.is_finite() {
            return undecided(f64::INFINITY);
        }
        let mut shift = FIRST_SHIFT * unit(n);
        let mut method = self.method;
        let mut unproven = None;
        for _ in 0..5 {
            let below = self.factor(&c, -shift * scale, scale, shift, method, work);
            method = below.method;
            let (mut error, mut bound) = (below.error, below.bound);
            let mut negative = below.signs.negative;
            if error <= shift / 2.0 && negative + below.signs.zero > 0 {
                let above = self.factor(&c, shift * scale, scale, shift, method, work);
                method = above.method;
                error = if above.error <= error { error } else { above.error };
                bound = bound.max(above.bound);
                negative = above.signs.negative;
            }
            if error <= shift / 2.0 {
                self.method = method;
                let positive = below.signs.positive;
                let zero = n.saturating_sub(positive + negative);
                let (band, proven) = (1.5 * shift, bound < shift);
                let found = Inertia { negative, zero, positive, band, factorization_error: error, method, proven };
                if unproven.is_some() || proven || bound > 0.1 {
                    return unproven.filter(|first: &Inertia| !proven || first.zero != zero).unwrap_or(found);
                }
                unproven = Some(found);
                shift = 1.25 * bound;
                continue;
            }
            // Where a pivot vanished the error is not finite; another shift has other pivots.
            shift = if error.is_finite() { 4.0 * error } else { 2.0 * shift };
        }
        unproven.unwrap_or(undecided(1.5 * shift))
    }

    /// Factors `C + shift` with a method, and with better ones as long as the error is too large for a band of `tolerance`.
    pub(super) fn factor(
        &mut self,
        c: &SymmetricMatrix,
        shift: f64,
        scale: f64,
        tolerance: f64,
        first: InertiaMethod,
        work: &mut Work,
    ) -> Count {
        let mut shifted = c.clone();
        shifted.shift(shift);
        let [error, bound] = [f64::INFINITY; 2];
        let mut count = Count { signs: PivotSigns::default(), error, bound, method: first };
        for method in [InertiaMethod::Sparse, InertiaMethod::Pivoted, InertiaMethod::Dense] {
            let affordable = method != InertiaMethod::Dense || c.order() <= 2000;
            let is_good = count.error <= f64::max(tolerance / 2.0, STABLE * unit(c.order()));
            if method < first || !affordable || is_good {
                continue;
            }
            work.factorizations += 1;
            let (signs, error) = match method {
                InertiaMethod::Sparse => self.signs(&shifted, Pivoting::None),
                InertiaMethod::Pivoted => self.signs(&shifted, Pivoting::InSupernodes),
                _ => dense_signs(&shifted),
            };
            let bound = match method {
                InertiaMethod::Sparse => self.factorization.rounding_bound(None) / scale + 4.0 * f64::EPSILON,
                _ => f64::INFINITY,
            };
            let error = (error / scale).min(bound);
            if error < count.error {
                count = Count { signs, error, bound, method };
            }
        }
        count
    }

    /// The signs of pivots, and a bound on `‖A − L B Lᵀ‖₂` from products with Gaussian vectors.
    fn signs(&mut self, a: &SymmetricMatrix, pivoting: Pivoting) -> (PivotSigns, f64) {
        self.factorization.factor(a, pivoting);
        let n = a.order();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(n as u64);
        let mut vectors = vec![vec![0.0; n]; PROBES];
        vectors.iter_mut().for_each(|vector| gaussian(&mut rng, vector));
        let rows: Vec<[f64; PROBES]> = (0..n).map(|row| std::array::from_fn(|k| vectors[k][row])).collect();
        let mut factored = vec![[0.0; PROBES]; n];
        self.factorization.multiply(&rows, &mut factored);
        let mut product = vec![0.0; n];
        let mut largest = 0.0;
        for (k, vector) in vectors.iter().enumerate() {
            a.apply(vector, &mut product);
            for (p, factored) in product.iter_mut().zip(&factored) {
                *p -= factored[k];
            }
            let error = norm(&product);
            largest = if error <= largest { largest } else { error };
        }
        (self.factorization.signs(), 10.0 * std::f64::consts::FRAC_2_PI.sqrt() * largest)
    }
}

/// `√n u`: how rounding errors of a factorization grow, relative to ‖C‖.
fn unit(n: usize) -> f64 {
    (n as f64).sqrt() * f64::EPSILON / 2.0
}

/// If no spring's block has a negative eigenvalue, `λ_min(A) ≥ min mᵢ·mass` without any factorization, for A assembled from an operator with this
/// coefficient of the masses. `None` where a block has one, or where that bound is below 10⁻⁹ ‖A‖, near the band of a count. That leaves room for the
/// rounding of blocks and sums, some hundred units in the last place of ‖A‖ and one more for every spring at a particle, up to a million of them.
pub(super) fn definite_by_blocks(operator: &SystemOperator<'_>, a: &SymmetricMatrix, mass: f64) -> Option<Inertia> {
    let (n, system) = (a.order(), operator.system());
    let floor = mass * system.free_masses()[0];
    let is_visible = floor > 1e-9 * Pencil::of(a).norm();
    let is_definite = n > 0 && is_visible && operator.has_no_negative_block();
    let mut springs = vec![0u32; system.particles()];
    system.pairs().iter().flatten().for_each(|&end| springs[end as usize] += 1);
    let is_hub = springs.iter().any(|&count| count > 1_000_000);
    is_definite.then(|| Inertia { proven: !is_hub, ..Inertia::definite(n) })
}

/// The largest over all free particles of a sum over the blocks at each: `start` of its mass, then the external block, then every spring's block
/// (with `true` where both ends are free); `finish` takes the sum and the mass.
pub(super) fn largest_at_particle(
    a: &SystemOperator<'_>,
    start: impl Fn(f64) -> f64,
    external: impl Fn(&Matrix3<f64>) -> f64,
    spring: impl Fn(&SpringBlock, bool) -> f64,
    finish: impl Fn(f64, f64) -> f64,
) -> f64 {
    let (system, dofs) = (a.system(), a.system().dofs());
    let is_free = |p: usize| !dofs.rows(p).is_empty();
    let mut sums: Vec<f64> = system.masses().iter().map(|&mass| start(mass)).collect();
    sums.iter_mut().zip(a.external()).for_each(|(sum, block)| *sum += external(block));
    for ((_, [i, j], _), block) in system.active().zip(a.blocks()) {
        let share = spring(block, is_free(i) && is_free(j));
        sums[i] += share;
        sums[j] += share;
    }
    let free = sums.iter().zip(system.masses()).enumerate().filter(|&(p, _)| is_free(p));
    free.map(|(_, (&sum, &mass))| finish(sum, mass)).fold(0.0, f64::max)
}

/// `C = S A S` with powers of two on the diagonal of S, three rounds of dividing rows and columns by the root of their largest entry (Ruiz 2001). An
/// empty row stays.
fn equilibrated(a: &SymmetricMatrix) -> SymmetricMatrix {
    let mut c = a.clone();
    for _ in 0..3 {
        let mut largest = vec![0.0f64; a.order()];
        for (row, column, value) in c.iter() {
            [row, column].iter().for_each(|&index| largest[index] = largest[index].max(value.abs()));
        }
        let inverse_root = |entry: f64| (-(entry.log2() / 2.0).round()).exp2();
        let is_usable = |entry: f64| entry > 0.0 && entry.is_finite();
        let scaling = largest.into_iter().map(|entry| if is_usable(entry) { inverse_root(entry) } else { 1.0 });
        c.scale_rows_and_columns(&scaling.collect::<Vec<_>>());
    }
    c
}

/// Signs in a dense Bunch–Kaufman factorization, and the Frobenius norm of its error.
pub(super) fn dense_signs(a: &SymmetricMatrix) -> (PivotSigns, f64) {
    let n = a.order();
    let mut dense = Mat::<f64>::zeros(n, n);
    for (row, column, value) in a.to_coo().triplet_iter() {
        dense[(row, column)] = *value;
    }
    let lblt = dense.lblt(Side::Lower);
    let (l, d, e) = (lblt.L(), lblt.B_diag().column_vector(), lblt.B_subdiag().column_vector());
    let mut signs = PivotSigns::default();
    let mut b = Mat::<f64>::zeros(n, n);
    let mut k = 0;
    while k < n {
        b[(k, k)] = d[k];
        if k + 1 < n && e[k] != 0.0 {
            (b[(k, k + 1)], b[(k + 1, k)], b[(k + 1, k + 1)]) = (e[k], e[k], d[k + 1]);
            signs.count_pair(d[k], e[k], d[k + 1]);
            k += 2;
        } else {
            signs.count(d[k]);
            k += 1;
        }
    }
    let p = lblt.P();
    let permuted = p * &dense * p.transpose();
    let error = permuted - l * &b * l.transpose();
    (signs, error.norm_l2())
}
