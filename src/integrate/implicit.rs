//! What implicit methods share: the linear system of a step under a stiffness policy.

use super::Statistics;
use crate::error::Result;
use crate::force::{DegenerateSpring, Extensions};
use crate::linear::{Definiteness, Evidence, LinearSolver, SolveFailure, SolverOptions, select};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use nalgebra::Vector3;

/// Which stiffness enters the matrix of each solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StiffnessPolicy {
    /// The same option in every solve.
    Always(Stiffness),
    /// `Full` while A is positive definite, `Tension` in the solves where it is not. With a factorization "is not" is
    /// proven; with conjugate gradients it means that negative curvature was met.
    OnDemand,
}

impl StiffnessPolicy {
    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Always(option) => option.name(),
            Self::OnDemand => "on-demand",
        }
    }

    /// Whether A is positive definite in every accepted solve, whatever the state.
    fn promises_definite(self) -> bool {
        self != Self::Always(Stiffness::Full)
    }
}

impl From<Stiffness> for StiffnessPolicy {
    fn from(option: Stiffness) -> Self {
        Self::Always(option)
    }
}

/// Options of implicit methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImplicitOptions {
    /// Which stiffness enters the matrix.
    pub stiffness: StiffnessPolicy,
    /// Which linear solver.
    pub linear: SolverOptions,
}

impl Default for ImplicitOptions {
    fn default() -> Self {
        Self { stiffness: StiffnessPolicy::OnDemand, linear: SolverOptions::default() }
    }
}

/// The linear systems of a stepper: extensions, operator, solver and reduced vectors, all allocated once.
pub(super) struct LinearSystem<'s> {
    pub system: &'s System,
    pub extensions: Extensions,
    pub statistics: Statistics,
    operator: SystemOperator<'s>,
    solver: Box<dyn LinearSolver>,
    policy: StiffnessPolicy,
    rhs: Vec<f64>,
    solution: Vec<f64>,
}

impl<'s> LinearSystem<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::STIFFNESS);
        let policy = options.stiffness;
        let mut statistics = Statistics::default();
        let solver = select(system, &options.linear, policy.promises_definite(), &mut statistics.work)?;
        let zeros = || vec![0.0; system.dofs().len()];
        Ok(Self { system, extensions, statistics, operator, solver, policy, rhs: zeros(), solution: zeros() })
    }

    pub fn solver(&self) -> &'static str {
        self.solver.name()
    }

    pub fn preconditioner(&self) -> Option<&'static str> {
        self.solver.preconditioner()
    }

    pub fn set_extensions(&mut self, positions: &[Vector3<f64>]) -> Result<(), DegenerateSpring> {
        self.solver.place(positions);
        self.extensions.update(self.system, positions)
    }

    /// Solves `A_ff δx_f = force_f − A_fc δx_c` for the matrix at the current extensions and the given combination.
    ///
    /// `force` is full-length. `displacement` is full-length too: its prescribed entries hold δx_c on entry, and on
    /// success its free entries hold δx_f.
    pub fn solve(
        &mut self,
        combination: Combination,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<(), SolveFailure> {
        let on_demand = self.policy == StiffnessPolicy::OnDemand;
        let first = if let StiffnessPolicy::Always(option) = self.policy { option } else { Stiffness::Full };
        match self.attempt(first, combination, force, displacement) {
            Err(SolveFailure::Indefinite(_)) if on_demand => {
                self.statistics.tension_solves += 1;
                self.attempt(Stiffness::Tension, combination, force, displacement)?;
            }
            other => other?,
        }
        self.system.dofs().scatter(&self.solution, displacement);
        Ok(())
    }

    fn attempt(
        &mut self,
        option: Stiffness,
        combination: Combination,
        force: &[Vector3<f64>],
        displacement: &[Vector3<f64>],
    ) -> Result<(), SolveFailure> {
        let work = &mut self.statistics.work;
        work.assemblies += 1;
        self.operator.update(&self.extensions, option, combination);
        let definiteness = self.solver.prepare(&self.operator, work)?;
        if let Definiteness::Indefinite { dof, .. } = definiteness
            && self.policy == StiffnessPolicy::OnDemand
        {
            return Err(SolveFailure::Indefinite(Evidence::Pivot(dof)));
        }
        self.system.dofs().gather(force, &mut self.rhs);
        self.operator.subtract_coupling(displacement, &mut self.rhs);
        self.solution.fill(0.0);
        let solution = self.solver.solve(&self.operator, &self.rhs, &mut self.solution, work)?;
        self.statistics.record(&solution);
        if let Definiteness::Indefinite { .. } = definiteness {
            self.statistics.indefinite_solves += 1;
        }
        Ok(())
    }
}
