//! Sparse factorizations `A = L B Lᵀ` by faer: analysed once, refactored for every matrix.
//!
//! The [kinds](FactorKind) differ in B and in the choice of pivots. Single right-hand sides are solved by `linear/substitution.rs`, several at once
//! by faer.

use super::analysis::{Analysis, FactorReport, NonPositivePivot, SOLVE_COLUMNS};
use super::ordering::{FactorSize, OrderingEstimate};
use super::substitution::{Diagonal, columns};
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::error::{Error, Result, check_length};
use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::ldlt::factor::LdltError;
use faer::linalg::cholesky::llt::factor::LltError;
use faer::mat::MatMut;
use faer::sparse::linalg::cholesky::{LdltRef, LltRef};
use faer::{Conj, Par, Side, Spec};
use std::time::Instant;

/// A sparse factorization of symmetric matrices on one pattern.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::faer::Par;
/// use sprung::integrate::StepMatrices;
/// use sprung::linear::{Cholesky, Ldlt};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let short = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1)?;
/// let mut cholesky = Cholesky::analyse(short.a.pattern(), Par::Seq)?;
/// cholesky.factor(&short.a)?;
/// let mut x = short.b.clone();
/// cholesky.solve_in_place(&mut x)?;
/// assert!((x[0] - 10.0 / 110.0).abs() < 1e-15);
///
/// // A step of a second: 1 − 10 N/m across the compressed spring.
/// let long = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?;
/// assert!(cholesky.factor(&long.a).is_err());
/// let mut ldlt = Ldlt::analyse(long.a.pattern(), Par::Seq)?;
/// ldlt.factor(&long.a)?;
/// assert_eq!(ldlt.pivots().filter(|(_, d)| *d < 0.0).count(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Factorization<K> {
    pub(super) analysis: Analysis,
    pub(super) kind: K,
}

/// Sparse Cholesky factorization `A = L Lᵀ`: exists if and only if A is positive definite (to rounding).
pub type Cholesky = Factorization<Llt>;

/// Sparse factorization `A = L D Lᵀ` without pivoting; where A is indefinite nothing keeps rounding errors small: check the residual.
pub type Ldlt = Factorization<Ldl>;

/// B and the choice of pivots: [`Llt`], [`Ldl`] or [`BunchKaufman`](super::BunchKaufman).
pub trait FactorKind: Sized {
    /// For matrices of order n.
    #[doc(hidden)]
    fn of_order(n: usize) -> Self;

    /// Factors; returns the index of a failed pivot, in the order of elimination.
    #[doc(hidden)]
    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize>;
}

/// A kind whose factors solve.
pub trait SolvingKind: FactorKind {
    /// The stored diagonal.
    #[doc(hidden)]
    const DIAGONAL: Diagonal;

    /// `X ← A⁻¹ X` for at most [`SOLVE_COLUMNS`] columns.
    #[doc(hidden)]
    fn solve(analysis: &mut Analysis, x: MatMut<'_, f64>);
}

/// `A = L Lᵀ`.
pub struct Llt;

/// `A = L D Lᵀ`, D diagonal, pivots in the order of elimination.
pub struct Ldl;

impl FactorKind for Llt {
    fn of_order(_: usize) -> Self {
        Self
    }

    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        let (plain, stack) = (Default::default(), MemStack::new(memory));
        let done =
            symbolic.factorize_numeric_llt(values, a.as_faer(), Side::Lower, plain, *par, stack, Spec::default());
        done.map(|_| ()).map_err(|LltError::NonPositivePivot { index }| index)
    }
}

impl FactorKind for Ldl {
    fn of_order(_: usize) -> Self {
        Self
    }

    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        let (plain, stack) = (Default::default(), MemStack::new(memory));
        let done =
            symbolic.factorize_numeric_ldlt(values, a.as_faer(), Side::Lower, plain, *par, stack, Spec::default());
        done.map(|_| ()).map_err(|LdltError::ZeroPivot { index }| index)
    }
}

impl SolvingKind for Llt {
    const DIAGONAL: Diagonal = Diagonal::Roots;

    fn solve(analysis: &mut Analysis, x: MatMut<'_, f64>) {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
    }
}

impl SolvingKind for Ldl {
    const DIAGONAL: Diagonal = Diagonal::Pivots;

    fn solve(analysis: &mut Analysis, x: MatMut<'_, f64>) {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        LdltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, x, *par, MemStack::new(memory));
    }
}

impl<K: FactorKind> Factorization<K> {
    fn with_analysis(analysis: Analysis) -> Self {
        let kind = K::of_order(analysis.symbolic.nrows());
        Self { analysis, kind }
    }

    /// As [`analyse`](Self::analyse), from an estimate; memory for the factor must be [allocated](Self::allocate) before anything is factored.
    pub(super) fn plan(pattern: &BlockPattern, estimate: OrderingEstimate, par: Par) -> Result<Self> {
        Ok(Self::with_analysis(Analysis::new(pattern, estimate, par)?))
    }

    /// As [`plan`](Self::plan), if `is_worth` accepts the size and the bytes of the factor. A cheap lower bound is asked for first.
    pub(crate) fn plan_if(
        pattern: &BlockPattern,
        par: Par,
        is_worth: impl Fn(FactorSize, u64) -> bool,
    ) -> Option<Self> {
        let estimate = Analysis::estimate(pattern).ok()?;
        let least = estimate.least();
        let plan = is_worth(least, 8 * least.entries as u64).then(|| Self::plan(pattern, estimate, par));
        plan?.ok().filter(|plan| is_worth(plan.size(), plan.bytes()))
    }

    pub(crate) fn allocate(mut self) -> Result<Self> {
        self.analysis.allocate()?;
        Ok(self)
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.analysis.bytes()
    }

    /// Orders (approximate minimum degree or nested dissection, whichever costs less) and analyses a pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn analyse(pattern: &BlockPattern, par: Par) -> Result<Self> {
        Self::plan(pattern, Analysis::estimate(pattern)?, par)?.allocate()
    }

    /// A factorization with its own memory on the pattern that `analysed` has analysed.
    ///
    /// # Errors
    /// When the factor does not fit the memory.
    pub fn sharing<L: FactorKind>(analysed: &Factorization<L>) -> Result<Self> {
        Self::with_analysis(analysed.analysis.shared()).allocate()
    }

    /// Entries and operations of a numeric factorization.
    pub fn size(&self) -> FactorSize {
        self.analysis.size()
    }

    /// The size and the times so far.
    pub fn report(&self) -> FactorReport {
        FactorReport { size: self.size(), times: self.analysis.times }
    }

    /// Factors, timed; returns the index of a failed pivot, in the order of elimination.
    pub(super) fn run(&mut self, a: &SymmetricMatrix) -> Result<(), usize> {
        let start = Instant::now();
        let done = self.kind.factor(&mut self.analysis, a);
        self.analysis.times.factor_seconds += start.elapsed().as_secs_f64();
        done
    }
}

impl<K: SolvingKind> Factorization<K> {
    fn of(a: &SymmetricMatrix) -> Result<Self, NotFactored> {
        let mut factorization = Self::analyse(a.pattern(), Par::Seq)?;
        factorization.factor(a)?;
        Ok(factorization)
    }

    /// Factors a matrix on the analysed pattern.
    ///
    /// # Errors
    /// The first pivot that is not positive (LLᵀ), or is exactly zero or not finite (LDLᵀ).
    pub fn factor(&mut self, a: &SymmetricMatrix) -> Result<(), NonPositivePivot> {
        self.run(a).map_err(|k| {
            let row = self.analysis.row(k);
            NonPositivePivot { row, dof: a.dofs().dof(row) }
        })
    }

    /// `A⁻¹ b` with the last factored matrix.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a vector whose length is not the order of A.
    pub fn solve(&mut self, b: &[f64]) -> Result<Vec<f64>> {
        let mut x = b.to_vec();
        self.solve_in_place(&mut x)?;
        Ok(x)
    }

    /// `x ← A⁻¹ x` with the last factored matrix.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a vector whose length is not the order of A.
    pub fn solve_in_place(&mut self, x: &mut [f64]) -> Result<()> {
        check_length("x", x.len(), self.analysis.symbolic.nrows())?;
        self.substitute(x);
        Ok(())
    }

    /// As [`solve_in_place`](Self::solve_in_place), for a vector of the right length.
    pub(crate) fn substitute(&mut self, x: &mut [f64]) {
        self.substitute_columns(x.len(), x);
    }

    /// `X ← A⁻¹ X` for a matrix stored by columns of the right length n: [`SOLVE_COLUMNS`] at a time.
    pub(crate) fn substitute_columns(&mut self, n: usize, x: &mut [f64]) {
        let start = Instant::now();
        for x in x.chunks_mut((SOLVE_COLUMNS * n).max(1)) {
            let Analysis { symbolic, values, substitution, .. } = &mut self.analysis;
            match x.len() / n.max(1) {
                1 => substitution.solve(symbolic, values, K::DIAGONAL, x),
                columns => K::solve(&mut self.analysis, MatMut::from_column_major_slice_mut(x, n, columns)),
            }
        }
        self.analysis.times.solve_seconds += start.elapsed().as_secs_f64();
    }
}

impl SymmetricMatrix {
    /// The Cholesky factorization, analysed and computed. For several matrices on one pattern see [`Factorization::analyse`].
    ///
    /// # Errors
    /// A matrix that is not positive definite, or whose factor does not fit the memory.
    pub fn cholesky(&self) -> Result<Cholesky, NotFactored> {
        Factorization::of(self)
    }

    /// The factorization L D Lᵀ, analysed and computed; the matrix may be indefinite.
    ///
    /// # Errors
    /// A pivot that is zero or not finite; a factor that does not fit the memory.
    pub fn ldlt(&self) -> Result<Ldlt, NotFactored> {
        Factorization::of(self)
    }
}

/// The failure of a factorization.
#[derive(Debug, thiserror::Error)]
pub enum NotFactored {
    /// The factor does not fit the memory.
    #[error(transparent)]
    TooLarge(#[from] Error),
    /// A pivot failed: for Cholesky, the matrix is not positive definite.
    #[error(transparent)]
    Pivot(#[from] NonPositivePivot),
}

impl Factorization<Ldl> {
    /// The pivots D of the last factored matrix with the rows of A they belong to, in the order of elimination.
    pub fn pivots(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let Analysis { symbolic, values, .. } = &self.analysis;
        columns(symbolic).map(|(s, c)| (self.analysis.row(s.first + c), values[s.diagonal(c)]))
    }

    /// Rows and columns of the stored entries of L below its diagonal, the zeros inside supernodes included, numbered in the order of elimination.
    pub fn pattern(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        columns(&self.analysis.symbolic).flat_map(|(s, c)| s.rows_below(c).map(move |row| (row, s.first + c)))
    }

    /// Whether all pivots of the last factored matrix are positive: the matrix is then positive definite to rounding, with the Cholesky factor `L√D`.
    pub fn is_positive(&self) -> bool {
        self.pivots().all(|(_, d)| d > 0.0)
    }

    /// A direction of negative curvature, not normalised: `u = L⁻ᵀ e_j/d_j` with `uᵀAu = 1/d_j`, j the most negative pivot. Returns whether there is
    /// one that fits the length of u.
    pub fn negative_direction(&mut self, u: &mut [f64]) -> bool {
        let Self { analysis, .. } = self;
        if u.len() != analysis.symbolic.nrows() {
            return false;
        }
        let pivots = columns(&analysis.symbolic).map(|(s, c)| (analysis.values[s.diagonal(c)], s, c));
        let Some((_, s, c)) = pivots.filter(|(d, ..)| *d < 0.0).min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return false;
        };
        // A⁻¹ (L e_j) = L⁻ᵀ D⁻¹ e_j: a column of L and one ordinary solve.
        u.fill(0.0);
        u[analysis.row(s.first + c)] = 1.0;
        for (k, value) in s.rows_below(c).zip(&analysis.values[s.diagonal(c) + 1..]) {
            u[analysis.row(k)] = *value;
        }
        self.substitute(u);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::FactorTimes;
    use crate::linear::fixtures::{self, noise};
    use crate::memory::watch::asked;
    use crate::operator::LinearOperator;
    use std::collections::BTreeSet;

    /// A band with `diagonal` added to the diagonal.
    fn banded(particles: usize, diagonal: impl Fn(usize) -> f64) -> SymmetricMatrix {
        let entry = |row, column| noise(row, column) + if row == column { diagonal(row) } else { 0.0 };
        fixtures::banded(particles, 2, entry)
    }

    fn ldlt(a: &SymmetricMatrix) -> Ldlt {
        Ldlt::analyse(a.pattern(), Par::Seq).unwrap()
    }

    fn curvature(a: &SymmetricMatrix, u: &[f64]) -> f64 {
        let mut product = vec![0.0; u.len()];
        a.apply(u, &mut product);
        product.iter().zip(u).map(|(a, u)| a * u).sum()
    }

    /// The pattern of L holds that of A in the order of elimination and what elimination fills in, all below the diagonal and each entry once; the
    /// operations are the squares of its columns' heights.
    #[test]
    fn the_pattern_of_the_factor_is_closed_under_elimination() {
        for particles in [1, 3, 40] {
            let a = banded(particles, |_| 20.0);
            let mut factorization = ldlt(&a);
            factorization.factor(&a).unwrap();
            let mut place = vec![0; a.order()];
            factorization.pivots().enumerate().for_each(|(k, (row, _))| place[row] = k);
            let listed: Vec<(usize, usize)> = factorization.pattern().collect();
            let pattern: BTreeSet<(usize, usize)> = listed.iter().copied().collect();
            assert_eq!(pattern.len(), listed.len());
            assert!(pattern.iter().all(|&(row, column)| column < row && row < a.order()));
            let of_a =
                a.iter().filter(|(row, column, _)| row != column).map(|(row, column, _)| (place[row], place[column]));
            assert!(of_a.map(|(i, j)| (i.max(j), i.min(j))).all(|entry| pattern.contains(&entry)));
            let mut heights = vec![1.0; a.order()];
            pattern.iter().for_each(|&(_, column)| heights[column] += 1.0);
            assert_eq!(heights.iter().map(|h| h * h).sum::<f64>(), factorization.size().flops);
            for k in 0..a.order() {
                let below: Vec<usize> = pattern.iter().filter(|entry| entry.1 == k).map(|entry| entry.0).collect();
                let filled = below.iter().flat_map(|&j| below.iter().map(move |&i| (i, j))).filter(|(i, j)| i > j);
                assert!(filled.clone().all(|entry| pattern.contains(&entry)));
            }
            assert_eq!(pattern.len() < a.order() * (a.order() - 1) / 2, particles == 40, "dense if small");
        }
    }

    /// With d the most negative pivot `uᵀAu = 1/d`, wherever in the order it lies.
    #[test]
    fn a_negative_direction_has_the_curvature_of_the_most_negative_pivot() {
        let order = 3 * 20;
        for weak in (0..order).step_by(7) {
            let a = banded(20, |row| if row == weak { -40.0 } else { 20.0 });
            let mut factorization = ldlt(&a);
            factorization.factor(&a).unwrap();
            let worst = factorization.pivots().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            assert_eq!(worst.0, weak);
            assert!(!factorization.is_positive());
            let mut u = vec![f64::NAN; order];
            assert!(factorization.negative_direction(&mut u));
            assert!((curvature(&a, &u) * worst.1 - 1.0).abs() < 1e-12, "row {weak}");
            assert!((u[weak] * worst.1 - 1.0).abs() < 1e-12, "L has a unit diagonal");
        }
    }

    /// A definite matrix has no direction of negative curvature; a pivot that is zero is neither positive nor negative.
    #[test]
    fn zero_pivots_have_no_sign() {
        let a = banded(4, |_| 20.0);
        let mut factorization = ldlt(&a);
        let mut u = vec![0.0; a.order()];
        assert!(factorization.pivots().all(|(_, pivot)| pivot == 0.0), "nothing is factored yet");
        assert!(!factorization.is_positive());
        assert!(!factorization.negative_direction(&mut u));
        factorization.factor(&a).unwrap();
        assert!(factorization.is_positive());
        assert!(!factorization.negative_direction(&mut u));
    }

    /// Many right-hand sides at once are solved as each alone.
    #[test]
    fn columns_are_solved_like_vectors() {
        let a = banded(5, |_| 20.0);
        let (mut factorization, n) = (ldlt(&a), a.order());
        factorization.factor(&a).unwrap();
        for columns in [1, 4, 5, 9] {
            let mut together: Vec<f64> = (0..columns * n).map(|at| noise(at, 3 * at + 1)).collect();
            let mut alone = together.clone();
            factorization.substitute_columns(n, &mut together);
            alone.chunks_mut(n).for_each(|x| factorization.substitute(x));
            let error = together.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-14, "{columns} columns: {error:e}");
        }
    }

    /// The announced bytes are those allocated, but for alignment; a shared analysis has its own memory and zero times.
    #[test]
    fn factors_hold_what_they_say() {
        for particles in [3, 60] {
            let a = banded(particles, |_| 20.0);
            let (factorization, asked) = asked("the analysis of the matrix", || ldlt(&a));
            assert_eq!(asked, 64 * (a.pattern().entries() + a.order()) as u64);
            let held = |of: &Ldlt| {
                let Analysis { values, memory, substitution, .. } = &of.analysis;
                let vectors = [values, &substitution.ordered, &substitution.block].map(|list| size_of_val(&list[..]));
                vectors.iter().sum::<usize>() + memory.len()
            };
            let said = factorization.bytes() as usize;
            assert!(said.abs_diff(held(&factorization)) <= 256, "{said} {}", held(&factorization));
            assert!(factorization.report().times.analysis_seconds > 0.0);
            let shared = Ldlt::sharing(&factorization).unwrap();
            assert_eq!((held(&shared), shared.report().times), (held(&factorization), FactorTimes::default()));
        }
    }

    /// Right-hand sides that do not fit are errors.
    #[test]
    fn wrong_lengths_are_refused() {
        let a = banded(2, |_| 20.0);
        let mut cholesky = Cholesky::analyse(a.pattern(), Par::Seq).unwrap();
        cholesky.factor(&a).unwrap();
        assert!(cholesky.solve_in_place(&mut [1.0; 6]).is_ok());
        for length in [0, 5, 7, 12] {
            assert!(cholesky.solve_in_place(&mut vec![1.0; length]).is_err(), "{length}");
        }
    }
}
