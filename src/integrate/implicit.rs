//! What implicit methods share: the linear system of a step under a stiffness policy.

use super::{Softening, Statistics};
use crate::error::Result;
use crate::force::{DegenerateSpring, Extensions};
use crate::interrupt::Interrupt;
use crate::linear::{Definiteness, Evidence, LinearSolver, Promise, Solution, SolveFailure, SolverOptions, select};
use crate::memory;
use crate::operator::{BlockDiagonal, Combination, SystemOperator};
use crate::spring::{Extension, Spring, SpringBlock, Stiffness};
use crate::system::{State, System};
use nalgebra::{Matrix3, Vector3};

/// Which stiffness enters the matrix of each solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StiffnessPolicy {
    /// The same option in every solve.
    Always(Stiffness),
    /// `Full` while A is positive definite; in the solves where it is not, transverse terms are dropped, as few as a
    /// condition without factorizations can promise to be enough, see [`Softening`]. With a factorization "is not" is proven;
    /// with conjugate gradients it means that negative curvature was met. [`Bdf2`](super::Bdf2), whose result does not hang on the
    /// matrix, takes the transverse terms of tensions that last.
    OnDemand,
}

impl StiffnessPolicy {
    /// Every policy.
    pub const ALL: [Self; 4] = [
        Self::OnDemand,
        Self::Always(Stiffness::Full),
        Self::Always(Stiffness::Tension),
        Self::Always(Stiffness::Axial),
    ];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Always(option) => option.name(),
            Self::OnDemand => "on-demand",
        }
    }

    fn promise(self) -> Promise {
        match self {
            Self::Always(Stiffness::Full) => Promise::Unknown,
            Self::Always(Stiffness::Tension | Stiffness::Axial) => Promise::Definite,
            Self::OnDemand => Promise::MadeDefinite,
        }
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

/// Bytes that a stepper with conjugate gradients holds at most for a spring (its block, its extension, its option) and for a particle
/// (some thirty vectors). Found by lowering the limit on memory until a run failed.
const SPRING: u64 = 200;
const PARTICLE: u64 = 1000;

/// The linear systems of a stepper: extensions, operator, solver and reduced vectors, all allocated once.
pub(super) struct LinearSystem<'s> {
    pub system: &'s System,
    /// Those of the matrix: nothing else may be written here between `prepare` and the last solve with it.
    pub extensions: Extensions,
    pub statistics: Statistics,
    operator: SystemOperator<'s>,
    /// Made when the policy asks for it, or Newton's method first does.
    softening: Option<Softening>,
    solver: Box<dyn LinearSolver>,
    pub policy: StiffnessPolicy,
    /// The relative residual asked of iterative solvers.
    pub tolerance: f64,
    interrupt: Interrupt,
    prepared: Prepared,
    /// The matrix's diagonal ones; filled when first asked for.
    blocks: Vec<Matrix3<f64>>,
    rhs: Vec<f64>,
    solution: Vec<f64>,
}

/// The matrix that the solver holds.
struct Prepared {
    policy: StiffnessPolicy,
    combination: Combination,
    terms: Terms,
    /// Transverse terms that the on-demand policy has dropped from it.
    dropped: usize,
    definiteness: Definiteness,
}

/// Which transverse terms a matrix has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Terms {
    /// Those of an option.
    Of(Stiffness),
    /// All but those that a [`Softening`] drops.
    Softened,
    /// All, in a matrix whose definiteness its caller sees to.
    Whole,
}

impl<'s> LinearSystem<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
        memory::ensure(SPRING * springs + PARTICLE * particles, "the state of the method")?;
        let extensions = Extensions::at(system, &state.positions)?;
        let (option, combination) = (Stiffness::Full, Combination::STIFFNESS);
        let operator = SystemOperator::new(system, &extensions, option, combination);
        let (policy, tolerance) = (options.stiffness, options.linear.tolerance);
        let mut statistics = Statistics::default();
        let solver = select(system, &options.linear, policy.promise(), &mut statistics.work)?;
        let prepared =
            Prepared { policy, combination, terms: Terms::Of(option), dropped: 0, definiteness: Definiteness::Unknown };
        let softening = (policy == StiffnessPolicy::OnDemand).then(|| Softening::new(system));
        let zeros = || vec![0.0; system.dofs().len()];
        let (rhs, solution) = (zeros(), zeros());
        Ok(Self {
            system,
            extensions,
            statistics,
            operator,
            softening,
            solver,
            policy,
            tolerance,
            interrupt: options.linear.interrupt,
            prepared,
            blocks: Vec::new(),
            rhs,
            solution,
        })
    }

    pub fn solver(&self) -> &dyn LinearSolver {
        &*self.solver
    }

    pub fn set_extensions(&mut self, positions: &[Vector3<f64>]) -> Result<(), DegenerateSpring> {
        self.solver.place(positions);
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
        let mut outcome = self.take_over(Terms::Of(first));
        while let (Err(SolveFailure::Indefinite(_)), Some(softer)) = (&outcome, self.softer()) {
            outcome = self.take_over(softer);
        }
        outcome
    }

    /// Takes over the matrix of the given combination at the current extensions with the full stiffness. It is refused as
    /// indefinite, here or by [`solve`](Self::solve), where it is not positive definite, whatever the solver.
    pub fn prepare_whole(&mut self, combination: Combination) -> Result<(), SolveFailure> {
        self.prepared.policy = StiffnessPolicy::OnDemand;
        self.prepared.combination = combination;
        self.take_over(Terms::Whole)
    }

    /// Takes over the matrix of the given combination at the current extensions, with transverse coefficients of its own in
    /// place of an option: `transverse` gives that of a spring by its position among the active ones, in N/m and not negative.
    pub fn prepare_with(
        &mut self,
        combination: Combination,
        transverse: impl Fn(usize, &Spring, &Extension) -> f64 + Sync,
    ) -> Result<(), SolveFailure> {
        let Self { extensions, operator, prepared, statistics, solver, .. } = self;
        prepared.policy = StiffnessPolicy::Always(Stiffness::Tension);
        prepared.combination = combination;
        prepared.terms = Terms::Of(Stiffness::Tension);
        prepared.dropped = 0;
        operator.set_blocks(extensions, combination.mass, |position, spring, at| {
            let axial = spring.stiffness_block(at, Stiffness::Axial);
            let block = SpringBlock { transverse: transverse(position, spring, at), ..axial } * -combination.stiffness;
            if spring.damping > 0.0 { block + spring.damping_block(at) * -combination.damping } else { block }
        });
        statistics.work.assemblies += 1;
        prepared.definiteness = solver.prepare(operator, &mut statistics.work)?;
        Ok(())
    }

    /// `fᵀ D⁻¹ f` with D the 3×3 diagonal blocks of the prepared matrix: about `fᵀ A⁻¹ f`. Infinite where D is not positive
    /// definite.
    pub fn block_energy(&mut self, force: &[Vector3<f64>]) -> f64 {
        let Self { system, operator, blocks, .. } = self;
        blocks.resize(system.particles(), Matrix3::zeros());
        operator.diagonal_blocks(blocks);
        let energy = |(p, (block, force)): (usize, (&Matrix3<f64>, &Vector3<f64>))| {
            let free = system.dofs().free_axes(p);
            let (mut block, mut force) = (*block, *force);
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block[(axis, axis)] = 1.0;
                force[axis] = 0.0;
            }
            inverse_energy(&block, &force)
        };
        blocks.iter().zip(force).enumerate().map(energy).sum()
    }

    /// Whether the prepared matrix is the full one less some terms.
    pub fn is_softened(&self) -> bool {
        self.prepared.dropped > 0
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
        let mut outcome = self.attempt(force, displacement);
        while let (Err(SolveFailure::Indefinite(_)), Some(softer)) = (&outcome, self.softer()) {
            outcome = self.take_over(softer).and_then(|()| self.attempt(force, displacement));
        }
        let solution = outcome?;
        let is_whole = matches!(self.prepared.terms, Terms::Of(Stiffness::Full) | Terms::Whole);
        if self.prepared.policy == StiffnessPolicy::OnDemand && !is_whole {
            self.statistics.softened_solves += 1;
            self.statistics.dropped_terms += self.prepared.dropped as u64;
        }
        if let Definiteness::Indefinite { .. } = self.prepared.definiteness {
            self.statistics.indefinite_solves += 1;
        }
        self.system.dofs().scatter(&self.solution, displacement);
        Ok(solution)
    }

    /// What replaces a matrix that turns out to be indefinite, if the policy allows: first the few terms that may be enough,
    /// then, should rounding have spoilt that, all that can be.
    fn softer(&self) -> Option<Terms> {
        match (self.prepared.policy, self.prepared.terms) {
            (StiffnessPolicy::OnDemand, Terms::Of(Stiffness::Full)) => Some(Terms::Softened),
            (StiffnessPolicy::OnDemand, Terms::Softened) => Some(Terms::Of(Stiffness::Tension)),
            _ => None,
        }
    }

    /// Where there is much to do, it is asked for again and again: here a request to stop is answered.
    fn go_on(&self) -> Result<(), SolveFailure> {
        if self.interrupt.is_requested() { Err(SolveFailure::Interrupted) } else { Ok(()) }
    }

    fn take_over(&mut self, terms: Terms) -> Result<(), SolveFailure> {
        self.go_on()?;
        let work = &mut self.statistics.work;
        work.assemblies += 1;
        self.prepared.terms = terms;
        let Self { system, extensions, operator, softening, prepared, .. } = self;
        match terms {
            Terms::Of(option) => {
                let compressed = || system.active().zip(extensions.iter()).filter(|((.., s), at)| s.is_compressed(at));
                prepared.dropped = if option == Stiffness::Tension { compressed().count() } else { 0 };
                operator.update(extensions, option, prepared.combination);
            }
            Terms::Whole => {
                prepared.dropped = 0;
                operator.update(extensions, Stiffness::Full, prepared.combination);
            }
            Terms::Softened => {
                let softening = softening.get_or_insert_with(|| Softening::new(system));
                prepared.dropped = softening.choose(system, extensions, prepared.combination);
                let options = softening.options();
                operator.update_each(extensions, prepared.combination, |position| options[position]);
            }
        }
        self.prepared.definiteness = self.solver.prepare(&self.operator, work)?;
        match self.prepared.definiteness {
            Definiteness::Indefinite { dof, .. } if self.prepared.policy == StiffnessPolicy::OnDemand => {
                Err(SolveFailure::Indefinite(Evidence::Pivot(dof)))
            }
            _ => Ok(()),
        }
    }

    fn attempt(&mut self, force: &[Vector3<f64>], displacement: &[Vector3<f64>]) -> Result<Solution, SolveFailure> {
        self.go_on()?;
        self.system.dofs().gather(force, &mut self.rhs);
        self.operator.subtract_coupling(displacement, &mut self.rhs);
        self.solution.fill(0.0);
        let work = &mut self.statistics.work;
        self.solver.solve(&self.operator, &self.rhs, &mut self.solution, work)
    }
}

/// `fᵀ D⁻¹ f` of a symmetric matrix by its factors L D Lᵀ; infinite where that is not positive definite.
fn inverse_energy(d: &Matrix3<f64>, f: &Vector3<f64>) -> f64 {
    let first = d[(0, 0)];
    let (l1, l2) = (d[(1, 0)] / first, d[(2, 0)] / first);
    let second = d[(1, 1)] - l1 * d[(1, 0)];
    let l3 = (d[(2, 1)] - l2 * d[(1, 0)]) / second;
    let third = d[(2, 2)] - l2 * d[(2, 0)] - l3 * l3 * second;
    if !(first > 0.0 && second > 0.0 && third > 0.0) {
        return f64::INFINITY;
    }
    let y = f.y - l1 * f.x;
    let z = f.z - l2 * f.x - l3 * y;
    f.x * f.x / first + y * y / second + z * z / third
}

#[cfg(test)]
mod tests;
