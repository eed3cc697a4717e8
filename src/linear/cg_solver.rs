//! Conjugate gradients as the solver of a time step, and first guesses from earlier solutions.
//!
//! Motion is smooth, so the solution of a step lies near the span of the last two. The point of that span nearest to the solution in the energy norm
//! `‖e‖_A`, in which conjugate gradients measure, is `x = Σ α_i δx_i` with
//!
//! ```text
//! Σ_j (δx_iᵀ A δx_j) α_j = δx_iᵀ b
//! ```
//!
//! for the A and b at hand (Fischer 1998, "Projection techniques for iterative solution of Ax = b with successive right-hand sides"). It is never
//! farther from the solution than zero, and costs two products with A.

use super::cg::{CgOutcome, CgReport, ConjugateGradient};
use super::options::{PreconditionerKind, SolverOptions};
use super::outcome::{Definiteness, Evidence, NotConverged, Solution, SolveFailure, Solved};
use super::preconditioner::{CustomPreconditioner, Preconditioner};
use super::vector::dot;
use super::{LinearSolver, PreparedMatrix};
use crate::assembly::SystemMatrix;
use crate::error::Result;
use crate::operator::{LinearOperator, SystemOperator};
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// The last two solutions.
#[derive(Debug, Clone)]
pub struct WarmStart {
    last: Vec<f64>,
    second_last: Vec<f64>,
    product: Vec<f64>,
    known: usize,
}

impl WarmStart {
    /// For vectors of length n; no solution is known yet.
    pub fn new(order: usize) -> Self {
        let zeros = || vec![0.0; order];
        Self { last: zeros(), second_last: zeros(), product: zeros(), known: 0 }
    }

    /// Sets x to the best first guess; returns `false`, and leaves x alone, where there is none.
    pub fn guess(&mut self, a: &impl LinearOperator, b: &[f64], x: &mut [f64]) -> bool {
        let Self { last, second_last, product, known } = self;
        if *known == 0 || [b.len(), x.len()] != [last.len(); 2] {
            return false;
        }
        a.apply(last, product);
        let (a11, a12) = (dot(last, product), dot(second_last, product));
        let (b1, b2) = (dot(last, b), dot(second_last, b));
        let mut coefficients = [b1 / a11, 0.0];
        if *known > 1 {
            a.apply(second_last, product);
            let a22 = dot(second_last, product);
            let determinant = a11 * a22 - a12 * a12;
            // Two nearly parallel solutions span one dimension only.
            if determinant > 1e-12 * a11 * a22 {
                coefficients = [(b1 * a22 - b2 * a12) / determinant, (b2 * a11 - b1 * a12) / determinant];
            }
        }
        // There is no nearest point unless A is positive definite.
        if !(a11 > 0.0 && coefficients.iter().all(|c| c.is_finite())) {
            return false;
        }
        for ((x, last), second_last) in x.iter_mut().zip(&*last).zip(&*second_last) {
            *x = coefficients[0] * last + coefficients[1] * second_last;
        }
        true
    }

    /// Records a solution.
    pub fn record(&mut self, x: &[f64]) {
        if x.len() != self.last.len() {
            return;
        }
        std::mem::swap(&mut self.last, &mut self.second_last);
        self.last.copy_from_slice(x);
        self.known = (self.known + 1).min(2);
    }
}

/// Conjugate gradients with a preconditioner.
#[derive(Debug)]
pub struct CgSolver {
    method: ConjugateGradient,
    pub(super) preconditioner: Preconditioner,
    /// For products with the assembled matrix; without it they go spring by spring.
    matrix: Option<SystemMatrix>,
    pub(super) warm_start: WarmStart,
}

impl CgSolver {
    /// Matrix-free.
    ///
    /// # Errors
    /// For multigrid, more matrix blocks than 32-bit indices can count.
    pub fn matrix_free(system: &System, preconditioner: PreconditionerKind, tolerance: f64) -> Result<Self> {
        let preconditioner = Preconditioner::new(preconditioner, system)?;
        Ok(Self::from_parts(system, preconditioner, tolerance, None))
    }

    /// Matrix-free, with a custom preconditioner.
    pub fn with_preconditioner(system: &System, custom: Box<dyn CustomPreconditioner>, tolerance: f64) -> Self {
        Self::from_parts(system, Preconditioner::Custom(custom), tolerance, None)
    }

    pub(super) fn new(
        system: &System,
        preconditioner: PreconditionerKind,
        options: &SolverOptions,
        matrix: Option<SystemMatrix>,
    ) -> Result<Self> {
        let preconditioner = Preconditioner::new(preconditioner, system)?;
        let mut solver = Self::from_parts(system, preconditioner, options.tolerance.strictest(), matrix);
        solver.method.interrupt = options.interrupt;
        Ok(solver)
    }

    fn from_parts(
        system: &System,
        preconditioner: Preconditioner,
        tolerance: f64,
        matrix: Option<SystemMatrix>,
    ) -> Self {
        let order = system.dofs().len();
        let (method, warm_start) = (ConjugateGradient::new(order, tolerance), WarmStart::new(order));
        Self { method, preconditioner, matrix, warm_start }
    }

    /// The method: its parameters, and the direction of negative curvature after a failure.
    pub fn method(&mut self) -> &mut ConjugateGradient {
        &mut self.method
    }

    fn iterate(&mut self, a: &SystemOperator, b: &[f64], x: &mut [f64], work: &mut Work) -> CgReport {
        let Self { method, preconditioner, matrix, .. } = self;
        work.solves += 1;
        work.iterative_solves += 1;
        let report = match matrix {
            None => method.solve(a, preconditioner, b, x),
            Some(matrix) => method.solve(matrix.matrix(), preconditioner, b, x),
        };
        work.cg_iterations += report.iterations;
        match preconditioner.kind() {
            Some(PreconditionerKind::None) => work.plain_iterations += report.iterations,
            Some(PreconditionerKind::Multigrid) => work.multigrid_iterations += report.iterations,
            _ => {}
        }
        report
    }
}

impl LinearSolver for CgSolver {
    fn name(&self) -> &'static str {
        if self.matrix.is_some() { "cg-assembled" } else { "cg" }
    }

    fn preconditioner(&self) -> Option<&'static str> {
        Some(self.preconditioner.name())
    }

    fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.preconditioner.set_positions(positions);
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        if let Some(matrix) = &mut self.matrix {
            matrix.refill(a);
        }
        self.preconditioner.update(a, work).map(|()| Definiteness::Unknown)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.method.tolerance = tolerance;
    }

    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        if x.iter().all(|&x| x == 0.0) {
            work.warm_starts += u64::from(match &self.matrix {
                None => self.warm_start.guess(&*a, b, x),
                Some(matrix) => self.warm_start.guess(matrix.matrix(), b, x),
            });
        }
        let report = self.iterate(&a, b, x, work);
        if report.outcome == CgOutcome::Converged {
            self.warm_start.record(x);
            if let Preconditioner::Multigrid(multigrid) = &mut self.preconditioner {
                multigrid.record(report.iterations, (report.first_residual / self.method.tolerance).log10());
            }
        }
        accept(&report)
    }

    fn solve_aside(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], tolerance: f64, work: &mut Work) -> Solved {
        x.fill(0.0);
        let own = std::mem::replace(&mut self.method.tolerance, tolerance);
        let report = self.iterate(&a, b, x, work);
        self.method.tolerance = own;
        accept(&report)
    }
}

fn accept(report: &CgReport) -> Solved {
    let CgReport { outcome, iterations, relative_residual, .. } = *report;
    let not_converged = |reason| Err(SolveFailure::NotConverged { iterations, relative_residual, reason });
    match outcome {
        CgOutcome::Converged => Ok(Solution { relative_residual }),
        CgOutcome::NegativeCurvature { rayleigh_quotient, .. } => {
            let iteration = iterations;
            Err(SolveFailure::Indefinite(Evidence::NegativeCurvature { iteration, rayleigh_quotient }))
        }
        CgOutcome::Stagnated => not_converged(NotConverged::Stagnated),
        CgOutcome::IterationLimit => not_converged(NotConverged::IterationLimit),
        CgOutcome::NonFinite => Err(SolveFailure::NonFinite),
        CgOutcome::Interrupted => Err(SolveFailure::Interrupted),
    }
}

#[cfg(feature = "scene")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::Prepare;
    use crate::linear::fixtures::{chain, operator, right_hand_side};
    use std::cell::Cell;

    fn solver(system: &System, kind: PreconditionerKind) -> CgSolver {
        CgSolver::matrix_free(system, kind, 1e-10).unwrap()
    }

    /// Iterations are counted by their preconditioner, and a second solve starts from the first solution.
    #[test]
    fn work_is_counted() {
        let scene = chain(80);
        let (a, b) = (operator(&scene, 1.0), right_hand_side(80));
        for kind in PreconditionerKind::ALL {
            let (mut work, mut solver) = (Work::default(), solver(&scene.0, kind));
            let mut prepared = solver.prepare(&a, &mut work).unwrap();
            prepared.solve(&b, &mut [0.0; 80], &mut work).unwrap();
            let first = work;
            assert!(first.cg_iterations > 0 && (first.solves, first.iterative_solves, first.warm_starts) == (1, 1, 0));
            prepared.solve(&b, &mut [0.0; 80], &mut work).unwrap();
            assert_eq!((work.cg_iterations, work.solves, work.warm_starts), (first.cg_iterations, 2, 1), "{kind:?}");
            let plain = if kind == PreconditionerKind::None { work.cg_iterations } else { 0 };
            let multigrid = if kind == PreconditionerKind::Multigrid { work.cg_iterations } else { 0 };
            assert_eq!((work.plain_iterations, work.multigrid_iterations), (plain, multigrid), "{kind:?}");
            assert_eq!(work.multigrid_setups, u64::from(kind == PreconditionerKind::Multigrid));
        }
    }

    /// A solve aside is as good as it was asked for, and the next one as the solver's own tolerance says.
    #[test]
    fn solves_aside_leave_the_tolerance() {
        let scene = chain(500);
        let (a, b) = (operator(&scene, 1.0), right_hand_side(500));
        let (mut work, mut solver) = (Work::default(), solver(&scene.0, PreconditionerKind::None));
        let mut prepared = solver.prepare(&a, &mut work).unwrap();
        let aside = prepared.solve_aside(&b, &mut [0.0; 500], 1e-2, &mut work).unwrap();
        let own = prepared.solve(&b, &mut [0.0; 500], &mut work).unwrap();
        assert!(aside.relative_residual > 1e-6 && own.relative_residual <= 1e-10, "{aside:?} {own:?}");
    }

    /// At the limit a solve ends and says so; what it has found serves as a first guess.
    #[test]
    fn solves_end_at_their_limit() {
        let scene = chain(500);
        let (a, b) = (operator(&scene, 1.0), right_hand_side(500));
        let (mut work, mut solver) = (Work::default(), solver(&scene.0, PreconditionerKind::BlockJacobi));
        let own = std::mem::replace(&mut solver.method().iteration_limit, 400);
        let mut x = [0.0; 500];
        let failure = solver.prepare(&a, &mut work).unwrap().solve(&b, &mut x, &mut work).unwrap_err();
        let SolveFailure::NotConverged { iterations, reason, .. } = failure else { panic!("{failure}") };
        assert_eq!((iterations, reason), (400, NotConverged::IterationLimit));
        solver.method().iteration_limit = own;
        solver.prepare(&a, &mut work).unwrap().solve(&b, &mut x, &mut work).unwrap();
    }

    /// A diagonal matrix that counts its products.
    struct Diagonal {
        entries: Vec<f64>,
        products: Cell<usize>,
    }

    impl Diagonal {
        fn new(entries: &[f64]) -> Self {
            Self { entries: entries.into(), products: Cell::new(0) }
        }
    }

    impl LinearOperator for Diagonal {
        fn order(&self) -> usize {
            self.entries.len()
        }

        fn apply(&self, w: &[f64], y: &mut [f64]) {
            self.products.set(self.products.get() + 1);
            (0..w.len()).for_each(|i| y[i] = self.entries[i] * w[i]);
        }
    }

    fn guess(a: &Diagonal, earlier: &[[f64; 3]], b: [f64; 3]) -> Option<[f64; 3]> {
        let mut start = WarmStart::new(3);
        earlier.iter().for_each(|x| start.record(x));
        let mut x = [7.0; 3];
        let known = start.guess(a, &b, &mut x);
        assert!(known || x == [7.0; 3], "left alone");
        known.then_some(x)
    }

    /// The nearest point of the span of two solutions, by hand: with A a multiple of the identity, the projection of b/a. It does not depend on the
    /// unit of A.
    #[test]
    fn two_solutions_span_a_plane_in_any_unit() {
        for unit in [2f64.powi(-30), 1.0, 2f64.powi(30)] {
            let a = Diagonal::new(&[unit; 3]);
            let x = guess(&a, &[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], [3.0 * unit, 5.0 * unit, 4.0 * unit]);
            assert_eq!(x, Some([3.0, 5.0, 0.0]), "{unit}");
            assert_eq!(a.products.get(), 2);
        }
    }

    /// One solution spans a line, and costs one product. A second that is zero adds nothing to it.
    #[test]
    fn one_solution_spans_a_line() {
        let a = Diagonal::new(&[1.0, 2.0, 4.0]);
        assert_eq!(guess(&a, &[], [1.0; 3]), None);
        assert_eq!(a.products.get(), 0);
        // xᵀb/xᵀAx = 6/3 = 2.
        assert_eq!(guess(&a, &[[1.0, 1.0, 0.0]], [2.0, 4.0, 9.0]), Some([2.0, 2.0, 0.0]));
        assert_eq!(a.products.get(), 1);
        assert_eq!(guess(&a, &[[0.0; 3], [1.0, 1.0, 0.0]], [2.0, 4.0, 9.0]), Some([2.0, 2.0, 0.0]));
    }

    /// There is no guess where A is seen not to be positive definite, nor where it would not be finite.
    #[test]
    fn no_nearest_point_no_guess() {
        let earlier = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(guess(&Diagonal::new(&[-1.0; 3]), &earlier, [1.0; 3]), None);
        assert_eq!(guess(&Diagonal::new(&[-1.0; 3]), &earlier[..1], [1.0; 3]), None);
        assert_eq!(guess(&Diagonal::new(&[1.0; 3]), &earlier, [f64::INFINITY, 1.0, 1.0]), None);
        assert_eq!(guess(&Diagonal::new(&[0.0; 3]), &earlier, [1.0; 3]), None);
    }
}
