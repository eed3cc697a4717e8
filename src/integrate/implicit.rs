//! What implicit methods share: the linear system of a step under a stiffness policy.

use super::Statistics;
use crate::error::Result;
use crate::force::{DegenerateSpring, Extensions};
use crate::linear::{Definiteness, Evidence, LinearSolver, Solution, SolveFailure, SolverOptions, select};
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
    /// Those of the matrix: nothing else may be written here between `prepare` and the last solve with it.
    pub extensions: Extensions,
    pub statistics: Statistics,
    operator: SystemOperator<'s>,
    solver: Box<dyn LinearSolver>,
    pub policy: StiffnessPolicy,
    /// The relative residual asked of iterative solvers.
    pub tolerance: f64,
    prepared: Prepared,
    rhs: Vec<f64>,
    solution: Vec<f64>,
}

/// The matrix that the solver holds.
struct Prepared {
    policy: StiffnessPolicy,
    combination: Combination,
    option: Stiffness,
    definiteness: Definiteness,
}

impl<'s> LinearSystem<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let (option, combination) = (Stiffness::Full, Combination::STIFFNESS);
        let operator = SystemOperator::new(system, &extensions, option, combination);
        let (policy, tolerance) = (options.stiffness, options.linear.tolerance);
        let mut statistics = Statistics::default();
        let solver = select(system, &options.linear, policy.promises_definite(), &mut statistics.work)?;
        let prepared = Prepared { policy, combination, option, definiteness: Definiteness::Unknown };
        let zeros = || vec![0.0; system.dofs().len()];
        let (rhs, solution) = (zeros(), zeros());
        Ok(Self { system, extensions, statistics, operator, solver, policy, tolerance, prepared, rhs, solution })
    }

    pub fn solver(&self) -> &'static str {
        self.solver.name()
    }

    pub fn preconditioner(&self) -> Option<&'static str> {
        self.solver.preconditioner()
    }

    pub fn set_extensions(&mut self, positions: &[Vector3<f64>]) -> Result<(), DegenerateSpring> {
        self.extensions.update(self.system, positions)
    }

    /// Prepares the matrix at the current extensions and solves one system with it, see [`solve`](Self::solve).
    pub fn prepare_and_solve(
        &mut self,
        combination: Combination,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<(), SolveFailure> {
        self.prepare(self.policy, combination)?;
        let solution = self.solve(force, displacement)?;
        self.statistics.record(solution.relative_residual);
        Ok(())
    }

    /// How exactly iterative solvers are to solve from now on.
    pub fn set_tolerance(&mut self, tolerance: f64) {
        self.solver.set_tolerance(tolerance);
    }

    /// Takes over the matrix of the given combination at the current extensions under a policy, as a rule
    /// [`policy`](Self::policy).
    pub fn prepare(&mut self, policy: StiffnessPolicy, combination: Combination) -> Result<(), SolveFailure> {
        self.prepared.policy = policy;
        self.prepared.combination = combination;
        let first = if let StiffnessPolicy::Always(option) = policy { option } else { Stiffness::Full };
        match self.take_over(first) {
            Err(SolveFailure::Indefinite(_)) if self.may_soften() => self.take_over(Stiffness::Tension),
            other => other,
        }
    }

    /// Solves `A_ff δx_f = force_f − A_fc δx_c` with the prepared matrix.
    ///
    /// `force` is full-length. `displacement` is full-length too: its prescribed entries hold δx_c on entry and its free
    /// ones zero; on success these hold δx_f. When conjugate gradients find the matrix indefinite and the policy allows, the
    /// softened one takes its place, for later solves too.
    pub fn solve(
        &mut self,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        let solution = match self.attempt(force, displacement) {
            Err(SolveFailure::Indefinite(_)) if self.may_soften() => {
                self.take_over(Stiffness::Tension)?;
                self.attempt(force, displacement)?
            }
            other => other?,
        };
        if self.prepared.policy == StiffnessPolicy::OnDemand && self.prepared.option != Stiffness::Full {
            self.statistics.tension_solves += 1;
        }
        if let Definiteness::Indefinite { .. } = self.prepared.definiteness {
            self.statistics.indefinite_solves += 1;
        }
        self.system.dofs().scatter(&self.solution, displacement);
        Ok(solution)
    }

    /// Whether a matrix that turns out to be indefinite is to be replaced.
    fn may_soften(&self) -> bool {
        self.prepared.policy == StiffnessPolicy::OnDemand && self.prepared.option == Stiffness::Full
    }

    fn take_over(&mut self, option: Stiffness) -> Result<(), SolveFailure> {
        let work = &mut self.statistics.work;
        work.assemblies += 1;
        self.prepared.option = option;
        self.operator.update(&self.extensions, option, self.prepared.combination);
        self.prepared.definiteness = self.solver.prepare(&self.operator, work)?;
        match self.prepared.definiteness {
            Definiteness::Indefinite { dof, .. } if self.prepared.policy == StiffnessPolicy::OnDemand => {
                Err(SolveFailure::Indefinite(Evidence::Pivot(dof)))
            }
            _ => Ok(()),
        }
    }

    fn attempt(&mut self, force: &[Vector3<f64>], displacement: &[Vector3<f64>]) -> Result<Solution, SolveFailure> {
        self.system.dofs().gather(force, &mut self.rhs);
        self.operator.subtract_coupling(displacement, &mut self.rhs);
        self.solution.fill(0.0);
        let work = &mut self.statistics.work;
        self.solver.solve(&self.operator, &self.rhs, &mut self.solution, work)
    }
}
