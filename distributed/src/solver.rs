//! The linear systems of a part, solved together with those of all others by PETSc.
//!
//! **What ends a solve** is said in the terms of the library. Conjugate gradients that meet negative curvature have proven that A is
//! not positive definite. A preconditioner that fails, or that is not positive definite itself, proves nothing about A: one that always
//! can be set up and is definite, ICC of this rank's rows with a shift, then takes its place for the solve.

use crate::part::Halo;
use crate::petsc::{End, Matrix, Petsc, Solver, Vector};
use crate::ranks;
use crate::rows::Rows;
use sprung::System;
use sprung::linear::{Definiteness, Evidence, LinearSolver, NotConverged, PreparedMatrix, Solution, SolveFailure};
use sprung::nalgebra::Vector3;
use sprung::operator::{LinearOperator, SystemOperator};
use sprung::system::{Communicator, Dof};
use sprung::work::Work;
use std::sync::Arc;

type Result<T, E = crate::petsc::Error> = std::result::Result<T, E>;

/// The most iterations of a solve.
const ITERATIONS: usize = 20_000;

/// How far the true residual may be above the tolerance.
const TRUE: f64 = 10.0;

/// How systems are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Preconditioner {
    /// Smoothed aggregation (PETSc's GAMG) that keeps rigid motions, smoothed by ICC
    Gamg,
    /// Algebraic multigrid of hypre
    Hypre,
    /// ICC of every rank's rows: least memory; iterations grow with the scene
    Icc,
    /// The diagonal block of every particle
    BlockJacobi,
}

/// Which solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Conjugate gradients.
    Cg(Preconditioner),
    /// MUMPS: a factorization that accepts an indefinite A and knows whether it is.
    Mumps,
}

impl Choice {
    /// PETSc's options for it; those that the user gives come later.
    pub fn options(self) -> &'static str {
        match self {
            // The bound of the smoother's eigenvalues must be found anew where an older prolongator is used again.
            //
            // The largest eigenvalue of D⁻¹A, by which prolongators are smoothed: conjugate gradients, GAMG's own choice, leave a
            // number unset that differs from rank to rank where they meet negative curvature, and ranks that find zero end while
            // the others wait. GMRES finds singular values, which for D⁻¹A are too large (32 iterations where 16 do). For the
            // symmetric D^(-1/2) A D^(-1/2) they are the eigenvalues' sizes, of every A.
            //
            // The bound of the smoothers is found by GMRES too: where A is indefinite the eigenvalues that PETSc computes from the unset
            // number of conjugate gradients may be an iteration without end, on one rank.
            Self::Cg(Preconditioner::Gamg) => {
                "-pc_type gamg -pc_gamg_reuse_interpolation true -pc_gamg_use_sa_esteig false \
                 -pc_gamg_esteig_ksp_type gmres -pc_gamg_esteig_ksp_norm_type preconditioned \
                 -pc_gamg_esteig_ksp_pc_side symmetric -mg_levels_esteig_ksp_type gmres \
                 -mg_levels_pc_type bjacobi -mg_levels_sub_pc_type icc"
            }
            Self::Cg(Preconditioner::Hypre) => "-pc_type hypre",
            Self::Cg(Preconditioner::Icc) => "-pc_type bjacobi -sub_pc_type icc",
            Self::Cg(Preconditioner::BlockJacobi) => "-pc_type pbjacobi",
            Self::Mumps => "-pc_type cholesky -pc_factor_mat_solver_type mumps -mat_mumps_icntl_24 1",
        }
    }

    /// More options where there are several ranks. They make the products PᵀAP of smoothed aggregation without keeping A·P, as PETSc
    /// does of itself: 7300 bytes a particle of a cloth in place of 10 600, by as many operations. One rank has no such choice.
    pub fn options_of_several(self) -> &'static str {
        match self {
            Self::Cg(Preconditioner::Gamg) => "-matptap_via allatonce_merged",
            _ => "",
        }
    }

    /// The options of what takes the place of a preconditioner that failed.
    pub const SPARE: &'static str = "-spare_pc_type bjacobi -spare_sub_pc_type icc";

    fn solver(self) -> &'static str {
        match self {
            Self::Cg(_) => "cg",
            Self::Mumps => "mumps",
        }
    }

    fn preconditioner(self) -> Option<&'static str> {
        match self {
            Self::Cg(Preconditioner::Gamg) => Some("gamg"),
            Self::Cg(Preconditioner::Hypre) => Some("hypre"),
            Self::Cg(Preconditioner::Icc) => Some("icc"),
            Self::Cg(Preconditioner::BlockJacobi) => Some("block-jacobi"),
            Self::Mumps => None,
        }
    }
}

/// How old multigrid's aggregates and prolongators are, in iterations.
///
/// They serve for many matrices, and making them anew costs as much as some 15 iterations (80² particles on 2 ranks). But they are
/// made for rigid motions of the positions of then, and as springs turn iterations grow, by about one every second step of a falling
/// cloth. Made anew as soon as there are more than at first, a cloth of 80² needs at most 1.4 times the fewest over 60 steps; kept, 2.2
/// times.
#[derive(Debug, Default)]
struct Age {
    /// Of the first solve with them, and of the first with the last matrix.
    iterations: Option<[u64; 2]>,
    /// Whether there has been a solve with the last matrix. Others may be asked for fewer digits.
    is_counted: bool,
    /// Whether they had to be replaced for a solve.
    failed: bool,
}

impl Age {
    fn is_stale(&self) -> bool {
        self.failed || self.iterations.is_some_and(|[first, last]| last > first)
    }

    fn count(&mut self, iterations: u64, failed: bool) {
        self.failed |= failed;
        if !std::mem::replace(&mut self.is_counted, true) {
            self.iterations = Some([self.iterations.map_or(iterations, |[first, _]| first), iterations]);
        }
    }
}

/// Solves the systems of all parts together.
pub struct PetscSolver<'p> {
    petsc: &'p Petsc,
    halo: Arc<Halo>,
    choice: Choice,
    tolerance: f64,
    rows: Rows,
    matrix: Matrix<'p>,
    solver: Solver<'p>,
    /// What takes the place of a preconditioner that failed, and for which it is.
    spare: Option<Solver<'p>>,
    is_spare: bool,
    age: Age,
    b: Vector<'p>,
    x: Vector<'p>,
    positions: Vector<'p>,
    /// Full-length, to fill in ghosts.
    full: Vec<Vector3<f64>>,
    product: Vec<f64>,
    definiteness: Definiteness,
}

impl<'p> PetscSolver<'p> {
    /// For a part, once.
    ///
    /// # Errors
    /// What PETSc says.
    pub fn new(petsc: &'p Petsc, system: &System, halo: Arc<Halo>, choice: Choice, tolerance: f64) -> Result<Self> {
        let rows = Rows::new(system, &halo);
        let (own, size) = (halo.own, rows.size);
        let kind = if choice == Choice::Cg(Preconditioner::Icc) { "sbaij" } else { "aij" };
        let matrix = Matrix::new(petsc, kind, size, &rows.counts())?;
        if choice != Choice::Mumps {
            matrix.trust_definite()?;
        }
        let solver = Solver::new(petsc, if choice == Choice::Mumps { "preonly" } else { "cg" }, "")?;
        let vector = || Vector::new(petsc, own, size);
        let (b, x, positions) = (vector()?, vector()?, vector()?);
        let full = vec![Vector3::zeros(); system.particles()];
        let product = vec![0.0; system.dofs().len()];
        Ok(Self {
            petsc,
            halo,
            choice,
            tolerance,
            rows,
            matrix,
            solver,
            spare: None,
            is_spare: false,
            age: Age::default(),
            b,
            x,
            positions,
            full,
            product,
            definiteness: Definiteness::Unknown,
        })
    }

    /// The matrix, for those who want to see it.
    pub fn matrix(&self) -> &Matrix<'p> {
        &self.matrix
    }

    fn take_over(&mut self, a: &SystemOperator) -> Result<Definiteness> {
        let Self { rows, matrix, solver, .. } = self;
        let size = rows.size;
        rows.fill(a, |row, columns, values| matrix.set_row(row, columns, values, size))?;
        matrix.assemble()?;
        self.is_spare = false;
        if self.choice == Choice::Cg(Preconditioner::Gamg) {
            matrix.set_rigid_modes(&self.positions)?;
            if self.age.is_stale() {
                // A new one: GAMG that is told to begin anew still takes the rigid motions of the first positions that it saw.
                *solver = Solver::new(self.petsc, "cg", "")?;
                self.age = Age::default();
            }
            self.age.is_counted = false;
        }
        if self.choice == Choice::Mumps {
            solver.prepare(matrix)?;
            let [negative, _] = solver.inertia()?;
            // MUMPS says how many there are, and not where.
            let dof = Dof { particle: 0, axis: 0 };
            return Ok(if negative > 0 { Definiteness::Indefinite { negative, dof } } else { Definiteness::Positive });
        }
        solver.prepare(matrix)?;
        // It may have failed on one rank alone, of which the others then know.
        if ranks::any(solver.has_failed()?) {
            self.change_to_spare()?;
        }
        Ok(Definiteness::Unknown)
    }

    fn change_to_spare(&mut self) -> Result<()> {
        if self.spare.is_none() {
            self.spare = Some(Solver::new(self.petsc, "cg", "spare_")?);
        }
        if let Some(spare) = &self.spare {
            spare.prepare(&self.matrix)?;
        }
        self.is_spare = true;
        Ok(())
    }

    /// Solves for what stands in `b`; counts iterations.
    fn iterate(&mut self, work: &mut Work) -> Result<End> {
        loop {
            let solver = self.spare.as_ref().filter(|_| self.is_spare).unwrap_or(&self.solver);
            if self.choice != Choice::Mumps {
                solver.set_tolerance(self.tolerance, ITERATIONS)?;
            }
            let solved = solver.solve(&self.b, &self.x)?;
            work.cg_iterations += if self.choice == Choice::Mumps { 0 } else { solved.iterations };
            if solved.end == End::Preconditioner && !self.is_spare && self.choice != Choice::Mumps {
                self.change_to_spare()?;
                continue;
            }
            return Ok(solved.end);
        }
    }

    fn failure(&self, end: End, iterations: u64, relative_residual: f64) -> SolveFailure {
        match end {
            End::NegativeCurvature => SolveFailure::Indefinite(Evidence::Curvature { iteration: iterations }),
            End::NonFinite => SolveFailure::NonFinite,
            _ => {
                let reason = match end {
                    End::IterationLimit => NotConverged::IterationLimit,
                    End::Preconditioner => NotConverged::Preconditioner,
                    _ => NotConverged::Stagnated,
                };
                SolveFailure::NotConverged { iterations, relative_residual, reason }
            }
        }
    }

    /// `‖b − A x‖/‖b‖` over all parts, by the product without a matrix.
    fn residual(&mut self, a: &SystemOperator, b: &[f64], x: &[f64]) -> f64 {
        a.apply(x, &mut self.product);
        let own = a.system().dofs().first_row(self.halo.own);
        let rest = b.iter().zip(&self.product).take(own).map(|(b, ax)| (b - ax) * (b - ax)).sum();
        let mut squares: [f64; 2] = [rest, b.iter().take(own).map(|b| b * b).sum()];
        ranks::sum(&mut squares);
        let [rest, whole] = squares.map(f64::sqrt);
        if rest == 0.0 { 0.0 } else { rest / whole }
    }

    fn run(
        &mut self,
        a: &SystemOperator,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Result<Solution, SolveFailure>> {
        let (dofs, own, size) = (a.system().dofs(), self.halo.own, self.rows.size);
        self.b.with(size * own, |values| {
            for p in 0..own {
                let row = dofs.get(b, p);
                values[size * p..size * (p + 1)].copy_from_slice(&row.as_slice()[..size]);
            }
        })?;
        let before = work.cg_iterations;
        work.solves += 1;
        work.iterative_solves += u64::from(self.choice != Choice::Mumps);
        let end = self.iterate(work)?;
        let full = &mut self.full;
        self.x.with(size * own, |values| {
            for (full, value) in full.iter_mut().zip(values.chunks_exact(size)) {
                full.as_mut_slice()[..size].copy_from_slice(value);
            }
        })?;
        self.halo.halo_exchange(&mut self.full);
        dofs.gather(&self.full, x);
        let relative_residual = self.residual(a, b, x);
        let iterations = work.cg_iterations - before;
        self.age.count(iterations, self.is_spare);
        Ok(match end {
            // The residual that iterations carry along falls on where rounding keeps the true one.
            End::Converged if self.choice != Choice::Mumps && relative_residual > TRUE * self.tolerance => {
                Err(self.failure(End::Diverged, iterations, relative_residual))
            }
            End::Converged if relative_residual.is_finite() => Ok(Solution { relative_residual }),
            End::Converged => Err(SolveFailure::NonFinite),
            end => Err(self.failure(end, iterations, relative_residual)),
        })
    }
}

/// An error of PETSc itself is not one of the computation: it ends all ranks with what it says.
fn or_abort<T>(result: Result<T>) -> T {
    result.unwrap_or_else(|error| crate::end_all(&error.to_string()))
}

impl LinearSolver for PetscSolver<'_> {
    fn name(&self) -> &'static str {
        self.choice.solver()
    }

    fn preconditioner(&self) -> Option<&'static str> {
        self.choice.preconditioner()
    }

    fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        let (own, size) = (self.halo.own, self.rows.size);
        or_abort(self.positions.with(size * own, |values| {
            for (value, x) in values.chunks_exact_mut(size).zip(positions) {
                value.copy_from_slice(&x.as_slice()[..size]);
            }
        }));
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        let is_finite = a.blocks().iter().all(|block| block.axial.is_finite() && block.transverse.is_finite());
        if ranks::any(!is_finite || !a.mass_factor().is_finite()) {
            return Err(SolveFailure::NonFinite);
        }
        work.factorizations += u64::from(self.choice == Choice::Mumps);
        self.definiteness = or_abort(self.take_over(a));
        Ok(self.definiteness)
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.tolerance = tolerance;
    }

    fn solve(
        &mut self,
        a: PreparedMatrix<'_>,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        or_abort(self.run(&a, b, x, work))
    }

    fn solve_aside(
        &mut self,
        a: PreparedMatrix<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        x.fill(0.0);
        let own = std::mem::replace(&mut self.tolerance, tolerance);
        let solved = or_abort(self.run(&a, b, x, work));
        self.tolerance = own;
        solved
    }
}
