//! What implicit methods share: the linear system of a step under a stiffness policy.

use super::linear_tolerance::LinearTolerance;
use super::terms::{Choice, Terms};
use super::{Regularization, Statistics, StepFailure, StiffnessPolicy};
use crate::error::Result;
use crate::force::{Configuration, SpringGeometry, add_damping_product, add_elastic_differential};
use crate::interrupt::Interrupt;
use crate::linear::{LinearSolver, MatrixAndSolver, Solution, SolveFailure, SolverOptions, Tolerance, norm, select};
use crate::memory;
use crate::operator::{BlockDiagonal, Combination, SystemOperator};
use crate::spring::{Extension, Spring, SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::{Matrix3, Vector3};

/// Options of implicit methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImplicitOptions {
    /// Which stiffness enters the matrix.
    pub stiffness: StiffnessPolicy,
    /// Which linear solver.
    pub linear: SolverOptions,
}

impl ImplicitOptions {
    /// With this stiffness in the matrix: an option, or the policy.
    ///
    /// ```
    /// use sprung::Stiffness;
    /// use sprung::integrate::ImplicitOptions;
    /// use sprung::linear::{SolverChoice, SolverOptions};
    ///
    /// let linear = SolverOptions::default().with_solver(SolverChoice::Cg).with_tolerance(1e-8)?;
    /// let options = ImplicitOptions::default().with_stiffness(Stiffness::Tension).with_linear(linear);
    /// assert_eq!(options.stiffness.name(), "tension");
    /// assert!(SolverOptions::default().with_tolerance(1.5).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn with_stiffness(self, stiffness: impl Into<StiffnessPolicy>) -> Self {
        Self { stiffness: stiffness.into(), ..self }
    }

    /// With these options of the linear solver.
    #[must_use]
    pub fn with_linear(self, linear: SolverOptions) -> Self {
        Self { linear, ..self }
    }
}

impl Default for ImplicitOptions {
    fn default() -> Self {
        let linear = SolverOptions { tolerance: Tolerance::Adaptive, ..SolverOptions::default() };
        Self { stiffness: StiffnessPolicy::OnDemand, linear }
    }
}

/// The relative residual to which errors are propagated by iterative solvers: two digits are more than an estimate has.
const ERROR_TOLERANCE: f64 = 1e-2;

/// Bytes that a stepper with conjugate gradients holds at most for a spring (its block, its extension, its option) and for a particle
/// (some thirty vectors). Found by lowering the limit on memory until a run failed.
const SPRING: u64 = 200;
const PARTICLE: u64 = 1000;

/// The linear systems of a stepper: extensions, matrix, solver and reduced vectors, all allocated once.
pub(super) struct LinearSystem<'s> {
    pub system: &'s System,
    /// Those of the matrix: nothing else may be written here between `prepare` and the last solve with it.
    pub extensions: SpringGeometry,
    pub statistics: Statistics,
    equations: MatrixAndSolver<'s>,
    /// Made when the policy asks for it, or Newton's method first does.
    softening: Option<Regularization>,
    pub policy: StiffnessPolicy,
    /// How exactly iterative solvers are worth solving, and the relative residual that they are asked for.
    pub exactness: LinearTolerance,
    tolerance: f64,
    interrupt: Interrupt,
    combination: Combination,
    choice: Choice,
    /// The matrix's diagonal ones; filled when first asked for.
    blocks: Vec<Matrix3<f64>>,
    rhs: Vec<f64>,
    solution: Vec<f64>,
    /// ‖b − A x‖₂ of the last solution as needed, in N; zero where it is as small as is ever asked for.
    pub residual: f64,
}

impl<'s> LinearSystem<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        // Before the solver, which may be large: a refusal comes early.
        Self::check(system, state, options)?;
        let mut work = Work::default();
        let solver = select(system, &options.linear, options.stiffness.assurance(), &mut work)?;
        let mut linear = Self::with_solver(system, state, options, solver)?;
        linear.statistics.work = work;
        Ok(linear)
    }

    fn check(system: &System, state: &State, options: &ImplicitOptions) -> Result<()> {
        state.check(system)?;
        options.linear.tolerance.check()?;
        let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
        memory::ensure(SPRING * springs + PARTICLE * particles, "the state of the method")
    }

    /// With a solver of the caller's own.
    pub fn with_solver(
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
        solver: Box<dyn LinearSolver + 's>,
    ) -> Result<Self> {
        Self::check(system, state, options)?;
        let extensions = SpringGeometry::at(system, state)?;
        let policy = options.stiffness;
        let combination = Combination::STIFFNESS;
        let matrix = SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        let softening = (policy == StiffnessPolicy::OnDemand).then(|| Regularization::new(system));
        let zeros = || vec![0.0; system.dofs().len()];
        let (rhs, solution) = (zeros(), zeros());
        Ok(Self {
            system,
            extensions,
            statistics: Statistics::default(),
            equations: MatrixAndSolver::new(matrix, solver),
            softening,
            policy,
            exactness: LinearTolerance::new(system, options.linear.tolerance),
            tolerance: options.linear.tolerance.strictest(),
            interrupt: options.linear.interrupt,
            combination,
            choice: Choice::first(policy),
            blocks: Vec::new(),
            rhs,
            solution,
            residual: 0.0,
        })
    }

    pub fn solver(&self) -> &dyn LinearSolver {
        self.equations.solver()
    }

    pub fn set_extensions<'a>(&mut self, at: impl Into<Configuration<'a>>) -> Result<(), StepFailure> {
        let at = at.into();
        self.equations.set_positions(at.positions());
        let updated = self.extensions.update(self.system, at);
        StepFailure::of_any(self.system, updated.map_err(Into::into))
    }

    /// How exactly iterative solvers are to solve from now on.
    pub fn set_tolerance(&mut self, tolerance: f64) {
        self.tolerance = tolerance;
        self.equations.set_tolerance(tolerance);
    }

    /// Takes over the matrix of the given combination at the current extensions under a policy, as a rule
    /// [`policy`](Self::policy).
    pub fn prepare(&mut self, policy: StiffnessPolicy, combination: Combination) -> Result<(), SolveFailure> {
        self.combination = combination;
        let mut outcome = self.take_over(Choice::first(policy));
        while let (Err(SolveFailure::Indefinite(_)), Some(softer)) = (&outcome, self.choice.softer()) {
            outcome = self.take_over(softer);
        }
        outcome
    }

    /// Takes over the matrix of the given combination at the current extensions with the full stiffness. It is refused as
    /// indefinite, here or by [`solve`](Self::solve), where it is not positive definite, whatever the solver.
    pub fn prepare_whole(&mut self, combination: Combination) -> Result<(), SolveFailure> {
        self.combination = combination;
        self.take_over(Choice::whole())
    }

    /// Takes over the matrix of the given combination at the current extensions, with transverse coefficients of its own in
    /// place of an option: `transverse` gives that of a spring by its position among the active ones, in N/m and not negative.
    pub fn prepare_with(
        &mut self,
        combination: Combination,
        transverse: impl Fn(usize, &Spring, &Extension) -> f64 + Sync,
    ) -> Result<(), SolveFailure> {
        self.combination = combination;
        self.choice = Choice::first(Stiffness::Tension.into());
        let Self { extensions, equations, statistics, choice, .. } = self;
        statistics.work.assemblies += 1;
        let change = |matrix: &mut SystemOperator<'s>| {
            matrix.set_external_under(extensions, Stiffness::Tension, combination);
            matrix.set_blocks(extensions, combination.mass, |position, spring, at| {
                let axial = spring.stiffness_block(at, Stiffness::Axial);
                let block =
                    SpringBlock { transverse: transverse(position, spring, at), ..axial } * -combination.stiffness;
                if spring.damping > 0.0 { block + spring.damping_block(at) * -combination.damping } else { block }
            });
        };
        choice.accept(equations.prepare(change, &mut statistics.work)?)
    }

    /// `fᵀ D⁻¹ f` with D the 3×3 diagonal blocks of the prepared matrix: about `fᵀ A⁻¹ f`. Infinite where D is not positive
    /// definite.
    pub fn block_energy(&mut self, force: &[Vector3<f64>]) -> f64 {
        let Self { system, equations, blocks, .. } = self;
        blocks.resize(system.particles(), Matrix3::zeros());
        equations.matrix().diagonal_blocks(blocks);
        let energy = |(p, (block, force)): (usize, (&Matrix3<f64>, &Vector3<f64>))| {
            let free = system.dofs().free_axes(p);
            let (mut block, mut force) = (*block, *force);
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block[(axis, axis)] = 1.0;
                force[axis] = 0.0;
            }
            inverse_energy(&block, &force)
        };
        let own = system.own_particles();
        let here = blocks.iter().zip(force).enumerate().take(own).map(energy).sum();
        let [energy] = system.total([here]);
        energy
    }

    /// Whether the prepared matrix is the full one less some terms.
    pub fn is_softened(&self) -> bool {
        self.choice.dropped > 0
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
        self.solve_to(Exactly::AsSet, force, displacement)
    }

    /// As [`solve`](Self::solve), as exactly as is worth for a step with about the error in time of the last one, see [`LinearTolerance`].
    pub fn solve_as_needed(
        &mut self,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        self.solve_to(Exactly::AsNeeded, force, displacement)
    }

    fn solve_to(
        &mut self,
        exactly: Exactly,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        let mut outcome = self.attempt(exactly, force, displacement);
        while let (Err(SolveFailure::Indefinite(_)), Some(softer)) = (&outcome, self.choice.softer()) {
            outcome = self.take_over(softer).and_then(|()| self.attempt(exactly, force, displacement));
        }
        let solution = outcome?;
        self.choice.count(&mut self.statistics);
        self.system.dofs().scatter(&self.solution, displacement);
        Ok(solution)
    }

    /// Applies the resolvent `(1 − τJ)⁻¹` of the linearised motion to an error, of positions in m and of velocities in m/s, with the matrix at hand: a step of
    /// backward Euler of τ seconds, which corrects steady motion,
    ///
    /// ```text
    /// A(τ) c = K (e_x + τ e_v) + G e_v − r,      d = τ e_v + c,      e_x += d,      e_v = d/τ.
    /// ```
    ///
    /// K is exact, whatever the matrix has of it. r, in N, is what the step that is linearised left out. On entry `r` holds it; it is used up. An iterative
    /// solver starts at c = 0, which is too little: what it leaves out is a part of the forces of the error, never of its velocity, so that vibrations
    /// of the error are not braked from step to step. Where the matrix at hand is another one than A(τ), or the solve fails, the error stays as it is. No
    /// later solve depends on this one.
    pub fn resolve(
        &mut self,
        tau: f64,
        [x, v]: [&mut [Vector3<f64>]; 2],
        r: &mut [Vector3<f64>],
        d: &mut [Vector3<f64>],
    ) {
        let Self { system, extensions, equations, statistics, combination, rhs, solution, .. } = self;
        if combination.mass != Combination::step(tau).mass {
            return;
        }
        let Some(mut prepared) = equations.prepared() else { return };
        for (((d, r), x), v) in d.iter_mut().zip(&mut *r).zip(&*x).zip(&*v) {
            *d = x + v * tau;
            *r = -*r;
        }
        add_elastic_differential(system, extensions, d, r);
        add_damping_product(system, extensions, v, r);
        system.dofs().gather(r, rhs);
        if prepared.solve_aside(rhs, solution, ERROR_TOLERANCE, &mut statistics.work).is_ok() {
            d.fill(Vector3::zeros());
            system.dofs().scatter(solution, d);
            for ((d, x), v) in d.iter().zip(&mut *x).zip(&mut *v) {
                *x += *v * tau + d;
                *v += d / tau;
            }
        }
    }

    /// As [`solve_as_needed`](Self::solve_as_needed), and further where the error turns out to be much smaller: `error` is ‖E‖_M of the step
    /// with a displacement, in m √kg.
    pub fn solve_within(
        &mut self,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
        error: impl Fn(&[Vector3<f64>]) -> f64,
    ) -> Result<Solution, SolveFailure> {
        let mut solution = self.solve_as_needed(force, displacement)?;
        while self.exactness.follows() {
            let error = error(displacement);
            self.exactness.learn(error);
            if self.exactness.suffices(self.residual, self.combination.mass, error) {
                break;
            }
            // At most a tenth of the last tolerance.
            solution = self.improve(Exactly::AsNeeded)?;
            self.system.dofs().scatter(&self.solution, displacement);
        }
        Ok(solution)
    }

    /// Where there is much to do, it is asked for again and again: here a request to stop is answered.
    fn go_on(&self) -> Result<(), SolveFailure> {
        if self.interrupt.is_requested() { Err(SolveFailure::Interrupted) } else { Ok(()) }
    }

    /// Takes over the matrix with the terms of a choice.
    fn take_over(&mut self, choice: Choice) -> Result<(), SolveFailure> {
        self.go_on()?;
        self.choice = choice;
        let Self { system, extensions, equations, statistics, softening, choice, combination, .. } = self;
        let combination = *combination;
        statistics.work.assemblies += 1;
        let change = |matrix: &mut SystemOperator<'s>| match choice.terms() {
            Terms::Of(option) => {
                let dropped = || {
                    let springs = extensions.springs(system);
                    springs.filter(|((number, _, s), at)| s.is_compressed(at) && system.owns_spring(*number)).count()
                };
                choice.dropped = if option == Stiffness::Tension { whole(system, dropped()) } else { 0 };
                matrix.update(extensions, option, combination);
            }
            Terms::Whole => {
                choice.dropped = 0;
                matrix.update(extensions, Stiffness::Full, combination);
            }
            Terms::Softened => {
                let softening = softening.get_or_insert_with(|| Regularization::new(system));
                choice.dropped = softening.choose(system, extensions, combination);
                let options = softening.options();
                matrix.update_each(extensions, combination, |position| options[position]);
            }
        };
        let definiteness = equations.prepare(change, &mut statistics.work)?;
        choice.accept(definiteness)
    }

    fn attempt(
        &mut self,
        exactly: Exactly,
        force: &[Vector3<f64>],
        displacement: &[Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        self.system.dofs().gather(force, &mut self.rhs);
        self.equations.matrix().subtract_coupling(displacement, &mut self.rhs);
        self.solution.fill(0.0);
        self.improve(exactly)
    }

    /// Solves for the right-hand side at hand from the solution at hand.
    fn improve(&mut self, exactly: Exactly) -> Result<Solution, SolveFailure> {
        self.go_on()?;
        let Self { equations, rhs, solution, statistics, exactness, combination, .. } = self;
        let size = norm(rhs);
        if exactly == Exactly::AsNeeded {
            self.tolerance = exactness.ask(size, combination.mass);
            equations.set_tolerance(self.tolerance);
        }
        let mut prepared = equations.prepared().ok_or(SolveFailure::Unprepared)?;
        let before = statistics.work.iterative_solves;
        let solved = prepared.solve(rhs, solution, &mut statistics.work)?;
        if statistics.work.iterative_solves > before {
            statistics.max_tolerance = statistics.max_tolerance.max(self.tolerance);
        }
        self.residual = exactness.improvable(solved.relative_residual * size);
        Ok(solved)
    }
}

/// How exactly an iterative solver is to solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Exactly {
    /// As [`LinearSystem::set_tolerance`] has it.
    AsSet,
    /// As the step deserves.
    AsNeeded,
}

/// How many there are in all parts of a system. Numbers below 2⁵³ are added without rounding.
fn whole(system: &System, here: usize) -> usize {
    let [all] = system.total([here as f64]);
    all as usize
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
