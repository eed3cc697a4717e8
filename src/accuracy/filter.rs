//! Backward Euler's filter: what is slow against a step.
//!
//! ```text
//! F = (1 + h² M⁻¹(−K))⁻¹,     1/(1 + (hω)²) of a mode of frequency ω.
//! ```

use crate::error::Result;
use crate::force::Extensions;
use crate::linear::{Assurance, CostModel, MatrixAndSolver, SolverOptions, Tolerance, select};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Vector3;

/// F of a state, with a matrix that is factored once.
pub(super) struct Filter<'s> {
    system: &'s System,
    equations: MatrixAndSolver<'s>,
    /// In s.
    pub h: f64,
    work: Work,
}

impl<'s> Filter<'s> {
    /// For steps of `h` seconds, with a K that is surely definite: `Tension` or `Axial`.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(
        system: &'s System,
        state: &State,
        h: f64,
        stiffness: Stiffness,
        options: &SolverOptions,
    ) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let combination = Combination { mass: 1.0 / (h * h), damping: 0.0, stiffness: -1.0 };
        let operator = SystemOperator::new(system, &extensions, stiffness, combination);
        let mut work = Work { assemblies: 1, ..Work::default() };
        let options = SolverOptions { tolerance: Tolerance::Fixed(1e-6), ..*options };
        let solver = select(system, &options, Assurance::Definite, &mut work)?;
        let mut equations = MatrixAndSolver::new(operator, solver);
        equations.place(&state.positions);
        // Where it fails, so does every solve.
        _ = equations.prepare(|_| {}, &mut work);
        Ok(Self { system, equations, h, work })
    }

    /// What it has cost so far, in force evaluations.
    pub fn cost(&self, costs: &CostModel) -> f64 {
        costs.cost(&self.work, self.equations.factor().map(|factor| factor.size))
    }

    /// `(1 − F) w`.
    pub fn fast(&mut self, w: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        w.iter().zip(&self.slow(w)).map(|(w, slow)| w - slow).collect()
    }

    /// `F w`, what is prescribed being slow by itself. Where a solve fails it is not a number.
    pub fn slow(&mut self, w: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let dofs = self.system.dofs();
        let (mut rhs, mut slow) = (vec![0.0; dofs.len()], vec![0.0; dofs.len()]);
        let weighted: Vec<Vector3<f64>> =
            w.iter().zip(self.system.masses()).map(|(w, mass)| w * (mass / (self.h * self.h))).collect();
        dofs.gather(&weighted, &mut rhs);
        let mut kept = vec![Vector3::zeros(); w.len()];
        for (dof, ..) in self.system.prescribed().iter() {
            if let (Some(to), Some(from)) = (kept.get_mut(dof.particle), w.get(dof.particle)) {
                to[dof.axis] = from[dof.axis];
            }
        }
        self.equations.matrix().subtract_coupling(&kept, &mut rhs);
        let solved =
            self.equations.prepared().is_some_and(|mut solver| solver.solve(&rhs, &mut slow, &mut self.work).is_ok());
        if !solved {
            slow.fill(f64::NAN);
        }
        dofs.scatter(&slow, &mut kept);
        kept
    }
}
