//! What has to be done before a matrix can be solved with, held by types.
//!
//! A solver is given a matrix once and solves with it many times. Most need it again in every solve, for products and residuals, and
//! it must be the same one. So a solve takes a [`Held`] matrix, which only a [`Prepared`] solver has: nothing can change the matrix
//! as long as that lives. Who prepares here and solves there owns both in [`MatrixAndSolver`], where the only way to the matrix is to
//! prepare again.

use super::outcome::{Definiteness, Solution, SolveFailure};
use super::{FactorReport, LinearSolver};
use crate::operator::{LinearOperator, SystemOperator};
use crate::work::Work;
use nalgebra::Vector3;
use std::ops::Deref;

/// The matrix that a solver holds.
#[derive(Clone, Copy)]
pub struct Held<'a>(pub(super) &'a SystemOperator<'a>);

impl<'a> Deref for Held<'a> {
    type Target = SystemOperator<'a>;

    fn deref(&self) -> &Self::Target {
        self.0
    }
}

/// Gives solvers a matrix.
pub trait Prepare: LinearSolver {
    /// Gives the solver a matrix; what comes back solves with it.
    ///
    /// # Errors
    /// As of [`LinearSolver::take`].
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
        let definiteness = self.take(a, work)?;
        Ok(Prepared { solver: self, matrix: Held(a), definiteness })
    }
}

impl<S: LinearSolver + ?Sized> Prepare for S {}

/// A solver that holds a matrix.
pub struct Prepared<'a, S: ?Sized> {
    solver: &'a mut S,
    matrix: Held<'a>,
    definiteness: Definiteness,
}

impl<S: LinearSolver + ?Sized> Prepared<'_, S> {
    /// What preparing proved of the matrix.
    pub fn definiteness(&self) -> Definiteness {
        self.definiteness
    }

    /// Solves `A x = b`; `b` and `x` are reduced. On entry `x` is the first guess of an iterative solver, or zero where it shall
    /// find its own.
    ///
    /// # Errors
    /// When no solution can be vouched for; `x` is then unspecified.
    pub fn solve(&mut self, b: &[f64], x: &mut [f64], work: &mut Work) -> Result<Solution, SolveFailure> {
        let expected = self.matrix.order();
        match [b.len(), x.len()].into_iter().find(|&found| found != expected) {
            Some(found) => Err(SolveFailure::WrongLength { expected, found }),
            None => self.solver.solve(self.matrix, b, x, work),
        }
    }

    /// Solves to a relative residual of `tolerance` and keeps nothing of it, see [`LinearSolver::solve_aside`].
    ///
    /// # Errors
    /// As of [`solve`](Self::solve).
    pub fn solve_aside(
        &mut self,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        let expected = self.matrix.order();
        match [b.len(), x.len()].into_iter().find(|&found| found != expected) {
            Some(found) => Err(SolveFailure::WrongLength { expected, found }),
            None => self.solver.solve_aside(self.matrix, b, x, tolerance, work),
        }
    }

    /// The solver, for those who give it no other matrix.
    pub(super) fn solver(&mut self) -> &mut S {
        self.solver
    }
}

/// A matrix and the solver that it is given to.
pub struct MatrixAndSolver<'s> {
    matrix: SystemOperator<'s>,
    solver: Box<dyn LinearSolver + 's>,
    /// What is known of the matrix that the solver holds; `None` when it holds none, or has refused it.
    held: Option<Definiteness>,
}

impl<'s> MatrixAndSolver<'s> {
    /// Of a matrix that nobody has been given yet.
    pub fn new(matrix: SystemOperator<'s>, solver: Box<dyn LinearSolver + 's>) -> Self {
        Self { matrix, solver, held: None }
    }

    /// Changes the matrix and gives it to the solver.
    ///
    /// # Errors
    /// As of [`LinearSolver::take`].
    pub fn prepare(
        &mut self,
        change: impl FnOnce(&mut SystemOperator<'s>),
        work: &mut Work,
    ) -> Result<Definiteness, SolveFailure> {
        self.held = None;
        change(&mut self.matrix);
        let definiteness = self.solver.take(&self.matrix, work)?;
        self.held = Some(definiteness);
        Ok(definiteness)
    }

    /// The solver, holding the matrix; `None` before the matrix is prepared, or where it was refused.
    pub fn prepared(&mut self) -> Option<Prepared<'_, dyn LinearSolver + 's>> {
        let definiteness = self.held?;
        Some(Prepared { solver: &mut *self.solver, matrix: Held(&self.matrix), definiteness })
    }

    /// The matrix as it is now.
    pub fn matrix(&self) -> &SystemOperator<'s> {
        &self.matrix
    }

    /// The solver: its name, and what it says of itself.
    pub fn solver(&self) -> &(dyn LinearSolver + 's) {
        &*self.solver
    }

    /// See [`LinearSolver::factor`].
    pub fn factor(&self) -> Option<FactorReport> {
        self.solver.factor()
    }

    /// See [`LinearSolver::place`].
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        self.solver.place(positions);
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
    use crate::linear::CholeskySolver;
    use crate::operator::Combination;
    use crate::spring::Stiffness;
    use crate::system::fixtures::row;
    use std::sync::{Arc, Mutex};

    /// Notes where it is told the particles are.
    struct Placed(Arc<Mutex<Vec<Vector3<f64>>>>);

    impl LinearSolver for Placed {
        fn name(&self) -> &'static str {
            "placed"
        }

        fn place(&mut self, positions: &[Vector3<f64>]) {
            *self.0.lock().unwrap() = positions.to_vec();
        }

        fn take(&mut self, _: &SystemOperator, _: &mut Work) -> Result<Definiteness, SolveFailure> {
            Err(SolveFailure::NonFinite)
        }

        fn solve(&mut self, _: Held<'_>, _: &[f64], _: &mut [f64], _: &mut Work) -> Result<Solution, SolveFailure> {
            Err(SolveFailure::NonFinite)
        }
    }

    /// A factorization has a report, which other solvers do not; those may want to know where the particles are.
    #[test]
    fn the_solver_is_told_and_asked_through_its_owner() {
        let (system, state) = row(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let matrix = || SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
        let work = &mut Work::default();
        let cholesky = CholeskySolver::new(&system, faer::Par::Seq, work).unwrap();
        let size = cholesky.size();
        let owner = MatrixAndSolver::new(matrix(), Box::new(cholesky));
        assert_eq!(owner.factor().map(|report| report.size), Some(size));
        let places = Arc::default();
        let mut owner = MatrixAndSolver::new(matrix(), Box::new(Placed(Arc::clone(&places))));
        owner.place(&state.positions);
        assert_eq!(*places.lock().unwrap(), state.positions);
        assert!(owner.factor().is_none() && owner.prepare(|_| (), work).is_err() && owner.prepared().is_none());
    }
}
