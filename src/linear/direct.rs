//! The sparse factorizations as a time step's solvers: refill, refactor, solve, and measure the residual.

use super::analysis::{Analysis, FactorReport, NonPositivePivot};
use super::factorization::{Cholesky, Factorization, Ldl, Ldlt, Llt, SolvingKind};
use super::ordering::FactorSize;
use super::outcome::{Definiteness, Evidence, Solution, SolveFailure, Solved};
use super::vector::{backward_error, norm, scaling};
use super::{LinearSolver, PreparedMatrix};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::operator::{LinearOperator, SystemOperator};
use crate::system::System;
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// Backward error up to which an LDLᵀ solution is accepted: above the 30 units in the last place of a stable solve, a hundredth of CG's default.
const TRUSTED_BACKWARD_ERROR: f64 = 1e-12;

/// The assembled matrix, its factorization, and the residual of its solutions.
struct Assembled<K> {
    matrix: SystemMatrix,
    factorization: Factorization<K>,
    residual: Vec<f64>,
    /// The right-hand side times a [power of two](scaling), and that power.
    scaled: Vec<f64>,
    factor: f64,
}

impl<K: SolvingKind> Assembled<K> {
    fn new(matrix: SystemMatrix, factorization: Factorization<K>) -> Self {
        let zeros = || vec![0.0; matrix.matrix().order()];
        let (residual, scaled) = (zeros(), zeros());
        Self { matrix, factorization, residual, scaled, factor: 1.0 }
    }

    fn factorize(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.matrix.refill(a);
        work.factorizations += 1;
        self.factorization.factor(self.matrix.matrix()).map_err(|pivot| self.failure(pivot))
    }

    /// Sets x and its residual.
    fn substitute(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], work: &mut Work) {
        work.solves += 1;
        self.factor = scaling(b);
        for (scaled, b) in self.scaled.iter_mut().zip(b) {
            *scaled = b * self.factor;
        }
        x.copy_from_slice(&self.scaled);
        self.factorization.substitute(x);
        self.set_residual(a, x);
    }

    /// `r = b − A x` with the matrix-free product, which shares no entry with the assembled matrix.
    fn set_residual(&mut self, a: &SystemOperator, x: &[f64]) {
        a.apply(x, &mut self.residual);
        for (r, b) in self.residual.iter_mut().zip(&self.scaled) {
            *r = b - *r;
        }
    }

    /// Undoes the scaling of x, whose residual is known.
    fn solution(&self, x: &mut [f64]) -> Solved {
        if self.factor != 1.0 {
            x.iter_mut().for_each(|x| *x /= self.factor);
        }
        let residual = norm(&self.residual);
        let relative_residual = if residual == 0.0 { 0.0 } else { residual / norm(&self.scaled) };
        if relative_residual.is_finite() { Ok(Solution { relative_residual }) } else { Err(SolveFailure::NonFinite) }
    }

    /// A failed pivot means an indefinite matrix only if the matrix is finite.
    fn failure(&self, pivot: NonPositivePivot) -> SolveFailure {
        if self.matrix.matrix().values().iter().all(|value| value.is_finite()) {
            SolveFailure::Indefinite(Evidence::Pivot(pivot.dof))
        } else {
            SolveFailure::NonFinite
        }
    }
}

/// A sparse Cholesky factorization that is analysed but has no memory yet.
pub struct CholeskyPlan {
    pattern: Arc<SpringPattern>,
    factorization: Cholesky,
}

impl CholeskyPlan {
    /// Analyses the system's pattern and counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices, or its analysis the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        work.symbolic_factorizations += 1;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Cholesky::plan(pattern.pattern(), Analysis::estimate(pattern.pattern())?, par)?;
        Ok(Self { pattern, factorization })
    }

    /// As [`new`](Self::new), if `is_worth` accepts the size and the bytes of the factor, and before of its cheap lower bound.
    pub(super) fn if_worth(
        system: &System,
        par: Par,
        work: &mut Work,
        is_worth: impl Fn(FactorSize, u64) -> bool,
    ) -> Option<Self> {
        work.symbolic_factorizations += 1;
        let pattern = Arc::new(SpringPattern::of_stiffness(system).ok()?);
        let with_matrix = |size, bytes| is_worth(size, bytes + 8 * pattern.pattern().entries() as u64);
        let factorization = Cholesky::plan_if(pattern.pattern(), par, with_matrix)?;
        Some(Self { pattern, factorization })
    }

    /// Entries and operations of the factor.
    pub fn size(&self) -> FactorSize {
        self.factorization.size()
    }

    /// Size, and times so far.
    pub fn report(&self) -> FactorReport {
        self.factorization.report()
    }

    /// The solver, with its memory.
    ///
    /// # Errors
    /// [`Error::TooLarge`](crate::Error::TooLarge) when the factor does not fit the memory.
    pub fn solver(self) -> Result<CholeskySolver> {
        let factorization = self.factorization.allocate()?;
        Ok(CholeskySolver(Assembled::new(SystemMatrix::try_zeros(self.pattern)?, factorization)))
    }
}

/// Sparse Cholesky.
pub struct CholeskySolver(Assembled<Llt>);

impl CholeskySolver {
    /// Analyses the system's pattern; counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        CholeskyPlan::new(system, par, work)?.solver()
    }
}

impl LinearSolver for CholeskySolver {
    fn name(&self) -> &'static str {
        "llt"
    }

    fn factor(&self) -> Option<FactorReport> {
        Some(self.0.factorization.report())
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.0.factorize(a, work).map(|()| Definiteness::Positive)
    }

    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        self.0.substitute(&a, b, x, work);
        self.0.solution(x)
    }
}

/// Sparse LDLᵀ: accepts an indefinite A, refines, and rejects solutions whose backward error stays large.
pub struct LdltSolver {
    assembled: Assembled<Ldl>,
    correction: Vec<f64>,
    matrix_norm: f64,
}

impl LdltSolver {
    /// Analyses the system's pattern; counts one symbolic factorization.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn new(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        let matrix = SystemMatrix::of_stiffness(system)?;
        let factorization = Ldlt::analyse(matrix.matrix().pattern(), par)?;
        work.symbolic_factorizations += 1;
        let correction = vec![0.0; system.dofs().len()];
        Ok(Self { assembled: Assembled::new(matrix, factorization), correction, matrix_norm: 0.0 })
    }
}

impl LinearSolver for LdltSolver {
    fn name(&self) -> &'static str {
        "ldlt"
    }

    fn factor(&self) -> Option<FactorReport> {
        Some(self.assembled.factorization.report())
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.assembled.factorize(a, work)?;
        let Assembled { matrix, factorization, .. } = &self.assembled;
        self.matrix_norm = matrix.matrix().norm_inf(&mut self.correction);
        let mut negative = factorization.pivots().filter(|&(_, d)| d < 0.0);
        let Some((row, _)) = negative.next() else { return Ok(Definiteness::Positive) };
        let (negative, dof) = (1 + negative.count(), a.system().dofs().dof(row));
        Ok(Definiteness::Indefinite { negative, dof })
    }

    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        let Self { assembled, correction, matrix_norm } = self;
        assembled.substitute(&a, b, x, work);
        let error_of = |assembled: &Assembled<Ldl>, x: &[f64]| {
            backward_error(&assembled.residual, *matrix_norm, x, &assembled.scaled)
        };
        let mut error = error_of(assembled, x);
        // Rounds of iterative refinement to reach it.
        for _ in 0..3 {
            if error <= TRUSTED_BACKWARD_ERROR {
                break;
            }
            correction.copy_from_slice(&assembled.residual);
            assembled.factorization.substitute(correction);
            for (x, c) in x.iter_mut().zip(&*correction) {
                *x += c;
            }
            assembled.set_residual(&a, x);
            error = error_of(assembled, x);
        }
        let solution = assembled.solution(x)?;
        if error <= TRUSTED_BACKWARD_ERROR {
            Ok(solution)
        } else {
            Err(SolveFailure::Untrusted { backward_error: error })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::linear::Prepare;
    use crate::operator::Combination;
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;
    use crate::system::fixtures::{row, tethered};

    fn solvers(system: &System, work: &mut Work) -> [Box<dyn LinearSolver>; 2] {
        [
            Box::new(CholeskySolver::new(system, Par::Seq, work).unwrap()),
            Box::new(LdltSolver::new(system, Par::Seq, work).unwrap()),
        ]
    }

    /// Two free particles and a spring: six rows, and a factor that has all entries of its triangle at least.
    #[test]
    fn both_factorizations_report_their_factor() {
        let (system, _) = row(2);
        let work = &mut Work::default();
        for solver in solvers(&system, work) {
            let entries = solver.factor().unwrap().size.entries;
            assert!((21..=36).contains(&entries), "{}: {entries}", solver.name());
        }
        // The matrix has the 21 numbers of its triangle, of eight bytes each.
        let asked = std::cell::Cell::new(0);
        let plan = CholeskyPlan::if_worth(&system, Par::Seq, work, |_, bytes| {
            asked.set(bytes);
            true
        });
        assert_eq!(asked.get() - plan.unwrap().factorization.bytes(), 168);
    }

    /// Two particles of just above 1 kg, pressed to half the rest length of their spring: across it A is (ε 1; 1 ε) with ε = 10⁻⁷ times 100 N/m.
    /// Either order of elimination begins with that ε and loses seven digits, which refinement gives back.
    #[test]
    fn refinement_gives_back_what_small_pivots_lose() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0 + 1e-7);
        builder.particle([0.5, 0.0, 0.0], 1.0 + 1e-7);
        builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let work = &mut Work::default();
        let mut solver = LdltSolver::new(&system, Par::Seq, work).unwrap();
        let (b, mut x) = ([0.0, 3.0, 0.7, 0.0, 0.2, -0.9], [0.0; 6]);
        let mut prepared = solver.prepare(&a, work).unwrap();
        assert!(prepared.solve(&b, &mut x, work).unwrap().relative_residual < 1e-12);
        // ε x + y = b/100 and x + ε y = c/100.
        for (axis, [b, c]) in [(1, [0.03, 0.002]), (2, [0.007, -0.009])] {
            let (found, expected) = ([x[axis], x[axis + 3]], [c - 1e-7 * b, b - 1e-7 * c]);
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-10 * b.abs()), "{found:?} {expected:?}");
        }
    }

    /// However small or large it is, a right-hand side has its solution: the same digits.
    #[test]
    fn solutions_have_the_size_of_their_right_hand_side() {
        let (system, state) = tethered(0.5, 1.0, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.01));
        let work = &mut Work::default();
        for mut solver in solvers(&system, work) {
            let mut solved = |size: f64| {
                let (b, mut x) = ([3.0, -2.0, 0.7].map(|b| b * size), [0.0; 3]);
                let solution = solver.prepare(&a, work).unwrap().solve(&b, &mut x, work).unwrap();
                assert!(solution.relative_residual < 1e-15, "{solution:?}");
                x.map(|x| x / size)
            };
            let plain = solved(1.0);
            for size in [-500.0f64, 500.0].map(f64::exp2) {
                assert_eq!(solved(size), plain);
            }
        }
        assert_eq!(work.solves, 6);
    }
}
