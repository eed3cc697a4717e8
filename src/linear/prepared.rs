//! Solvers that hold a matrix, enforced by types.
//!
//! A solver is updated for a matrix once and solves with it many times, and most solvers read the matrix again in every solve. So a solve takes a
//! [`PreparedMatrix`], which only a [`Prepared`] solver has: as long as that lives the matrix cannot change. [`MatrixAndSolver`] owns both; its
//! matrix can only be changed by preparing again.

use super::LinearSolver;
use super::outcome::{Definiteness, SolveFailure, Solved};
use crate::operator::{LinearOperator, SystemOperator};
use crate::work::Work;
use nalgebra::Vector3;
use std::ops::Deref;

/// The matrix for which a solver was prepared.
#[derive(Clone, Copy)]
pub struct PreparedMatrix<'a>(pub(super) &'a SystemOperator<'a>);

impl<'a> Deref for PreparedMatrix<'a> {
    type Target = SystemOperator<'a>;

    fn deref(&self) -> &Self::Target {
        self.0
    }
}

/// Prepares solvers for a matrix.
pub trait Prepare: LinearSolver {
    /// Updates the solver for a matrix; the result solves with it.
    ///
    /// # Errors
    /// As for [`LinearSolver::update`].
    ///
    /// # Examples
    /// ```
    /// use sprung::force::SpringGeometry;
    /// use sprung::linear::{CholeskySolver, Prepare};
    /// use sprung::operator::{Combination, SystemOperator};
    /// use sprung::work::Work;
    /// use sprung::{Spring, Stiffness, SystemBuilder};
    ///
    /// let mut builder = SystemBuilder::new();
    /// builder.particle([0.0, 0.0, 0.0], 1.0);
    /// builder.particle([1.0, 0.0, 0.0], 1.0);
    /// builder.spring(0, 1, Spring { stiffness: 10.0, rest_length: 1.0, damping: 0.0 });
    /// let (system, state) = builder.build()?;
    ///
    /// let extensions = SpringGeometry::at(&system, &state.positions)?;
    /// let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
    /// let mut work = Work::default();
    /// let mut solver = CholeskySolver::new(&system, sprung::faer::Par::Seq, &mut work)?;
    /// let mut prepared = solver.prepare(&a, &mut work)?;
    /// let mut x = [0.0; 6];
    /// let solution = prepared.solve(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], &mut x, &mut work)?;
    /// assert!(solution.relative_residual < 1e-14);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    fn prepare<'a>(
        &'a mut self,
        a: &'a SystemOperator<'_>,
        work: &mut Work,
    ) -> Result<Prepared<'a, Self>, SolveFailure> {
        let definiteness = self.update(a, work)?;
        Ok(Prepared { solver: self, matrix: PreparedMatrix(a), definiteness })
    }
}

impl<S: LinearSolver + ?Sized> Prepare for S {}

/// A solver that holds a matrix.
pub struct Prepared<'a, S: ?Sized> {
    solver: &'a mut S,
    matrix: PreparedMatrix<'a>,
    definiteness: Definiteness,
}

impl<S: LinearSolver + ?Sized> Prepared<'_, S> {
    /// The definiteness that preparing has proved.
    pub fn definiteness(&self) -> Definiteness {
        self.definiteness
    }

    /// Solves `A x = b`, see [`LinearSolver::solve`].
    ///
    /// # Errors
    /// A solution that does not meet the tolerance; `x` is then unspecified.
    pub fn solve(&mut self, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        self.check_lengths(b, x)?;
        self.solver.solve(self.matrix, b, x, work)
    }

    /// Solves to a relative residual of `tolerance` without a trace, see [`LinearSolver::solve_aside`].
    ///
    /// # Errors
    /// As for [`solve`](Self::solve).
    pub fn solve_aside(&mut self, b: &[f64], x: &mut [f64], tolerance: f64, work: &mut Work) -> Solved {
        self.check_lengths(b, x)?;
        self.solver.solve_aside(self.matrix, b, x, tolerance, work)
    }

    fn check_lengths(&self, b: &[f64], x: &[f64]) -> Result<(), SolveFailure> {
        let expected = self.matrix.order();
        let wrong = [b.len(), x.len()].into_iter().find(|&found| found != expected);
        wrong.map_or(Ok(()), |found| Err(SolveFailure::WrongLength { expected, found }))
    }
}

/// A matrix and its solver.
pub struct MatrixAndSolver<'s> {
    matrix: SystemOperator<'s>,
    solver: Box<dyn LinearSolver + 's>,
    /// `None` while the solver holds no matrix.
    definiteness: Option<Definiteness>,
}

impl<'s> MatrixAndSolver<'s> {
    /// A matrix for which the solver is not prepared yet.
    pub fn new(matrix: SystemOperator<'s>, solver: Box<dyn LinearSolver + 's>) -> Self {
        Self { matrix, solver, definiteness: None }
    }

    /// Changes the matrix and updates the solver.
    ///
    /// # Errors
    /// As for [`LinearSolver::update`].
    pub fn prepare(
        &mut self,
        change: impl FnOnce(&mut SystemOperator<'s>),
        work: &mut Work,
    ) -> Result<Definiteness, SolveFailure> {
        self.definiteness = None;
        change(&mut self.matrix);
        let definiteness = self.solver.update(&self.matrix, work)?;
        self.definiteness = Some(definiteness);
        Ok(definiteness)
    }

    /// The solver with its matrix; `None` before the first update and after one that failed.
    pub fn prepared(&mut self) -> Option<Prepared<'_, dyn LinearSolver + 's>> {
        let definiteness = self.definiteness?;
        Some(Prepared { solver: &mut *self.solver, matrix: PreparedMatrix(&self.matrix), definiteness })
    }

    /// The matrix.
    pub fn matrix(&self) -> &SystemOperator<'s> {
        &self.matrix
    }

    /// The solver.
    pub fn solver(&self) -> &(dyn LinearSolver + 's) {
        &*self.solver
    }

    /// See [`LinearSolver::set_positions`].
    pub fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.solver.set_positions(positions);
    }

    /// See [`LinearSolver::set_tolerance`].
    pub fn set_tolerance(&mut self, tolerance: f64) {
        self.solver.set_tolerance(tolerance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::operator::Combination;
    use crate::spring::Stiffness;
    use crate::system::fixtures::row;
    use std::sync::{Arc, Mutex};

    /// Records the positions that it is given, and refuses every matrix.
    struct Recorder(Arc<Mutex<Vec<Vector3<f64>>>>);

    impl LinearSolver for Recorder {
        fn name(&self) -> &'static str {
            "recorder"
        }

        fn set_positions(&mut self, positions: &[Vector3<f64>]) {
            *self.0.lock().unwrap() = positions.to_vec();
        }

        fn update(&mut self, _: &SystemOperator, _: &mut Work) -> Result<Definiteness, SolveFailure> {
            Err(SolveFailure::NonFinite)
        }

        fn solve(&mut self, _: PreparedMatrix, _: &[f64], _: &mut [f64], _: &mut Work) -> Solved {
            Err(SolveFailure::NonFinite)
        }
    }

    #[test]
    fn the_owner_forwards_to_its_solver() {
        let (system, state) = row(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let matrix = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let recorded = Arc::default();
        let mut owner = MatrixAndSolver::new(matrix, Box::new(Recorder(Arc::clone(&recorded))));
        owner.set_positions(&state.positions);
        assert_eq!(*recorded.lock().unwrap(), state.positions);
        assert!(owner.prepare(|_| (), &mut Work::default()).is_err() && owner.prepared().is_none());
    }
}
