//! The linear system of a step under a stiffness policy, shared by all implicit methods.

use super::linear_tolerance::LinearTolerance;
use super::progressive::Projection;
use super::stiffness_policy::{StiffnessState, Terms};
use super::{Regularization, Statistics, StepFailure, StiffnessPolicy, check_room, sum_of_all};
use crate::error::Result;
use crate::force::{Configuration, SpringGeometry, add_damping_product, add_elastic_differential};
use crate::interrupt::Interrupt;
use crate::linear::{LinearSolver, MatrixAndSolver, Solution, SolveFailure, SolverOptions, Tolerance, norm, select};
use crate::operator::{BlockDiagonal, Combination, SystemOperator};
use crate::spring::{Extension, Spring, SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::{Matrix3, Vector3};

/// Options of implicit methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImplicitOptions {
    /// The stiffness that enters the matrix.
    pub stiffness: StiffnessPolicy,
    /// The linear solver.
    pub linear: SolverOptions,
}

impl Default for ImplicitOptions {
    fn default() -> Self {
        let linear = SolverOptions { tolerance: Tolerance::Adaptive, ..SolverOptions::default() };
        Self { stiffness: StiffnessPolicy::OnDemand, linear }
    }
}

/// The constructors of an implicit method, by its `of`, which gets the linear system, the state and an option of its own if it has one.
macro_rules! constructors {
    ($($own:ident: $type:ty)?) => {
        /// Prepares pattern, ordering and symbolic analysis once for all steps.
        ///
        /// # Errors
        /// Coincident ends of a spring in `state`; a state of another system; a matrix that is too large; invalid options.
        pub fn new(system: &'s System, state: &State, options: &ImplicitOptions $(, $own: $type)?) -> Result<Self> {
            Self::of(LinearSystem::new(system, state, options)?, state $(, $own)?)
        }

        /// As [`new`](Self::new), with your own linear solver; of `options.linear` only the tolerance and the interrupt apply.
        ///
        /// # Errors
        /// As [`new`](Self::new).
        pub fn with_solver(
            system: &'s System,
            state: &State,
            options: &ImplicitOptions,
            $($own: $type,)?
            solver: Box<dyn LinearSolver + 's>,
        ) -> Result<Self> {
            Self::of(LinearSystem::with_solver(system, state, options, solver)?, state $(, $own)?)
        }
    };
}

/// The functions of a [`TimeStepper`](super::TimeStepper) that an implicit method answers by its linear system, which is at `path`.
macro_rules! of_linear_system {
    ($name:literal, $($path:ident).+) => {
        fn name(&self) -> &'static str {
            $name
        }

        fn linear_solver(&self) -> Option<&dyn LinearSolver> {
            Some(self.$($path).+.solver())
        }

        fn load_kinks(&self) -> &[f64] {
            self.$($path).+.system.prescribed().load_kinks()
        }

        fn statistics(&self) -> &Statistics {
            &self.$($path).+.statistics
        }
    };
}

pub(super) use {constructors, of_linear_system};

/// The linear systems of a stepper: geometry of the springs, matrix, solver and reduced vectors, all allocated once.
pub(super) struct LinearSystem<'s> {
    pub system: &'s System,
    /// The geometry of the matrix; not to be changed between `prepare` and the last solve.
    pub extensions: SpringGeometry,
    pub statistics: Statistics,
    equations: MatrixAndSolver<'s>,
    regularization: Option<Regularization>,
    projection: Option<Projection>,
    /// Transverse terms that all prepared matrices have dropped or mirrored, those of stretched springs under `axial` included.
    pub changed_terms: u64,
    pub policy: StiffnessPolicy,
    pub adaptive_tolerance: LinearTolerance,
    interrupt: Interrupt,
    combination: Combination,
    stiffness: StiffnessState,
    /// The diagonal blocks of the matrix; filled when first needed.
    blocks: Vec<Matrix3<f64>>,
    rhs: Vec<f64>,
    solution: Vec<f64>,
    /// ‖b − A x‖₂ of the last solution to an adaptive tolerance, in N; zero where it is as small as is ever asked for.
    pub residual: f64,
}

impl<'s> LinearSystem<'s> {
    pub fn new(system: &'s System, state: &State, options: &ImplicitOptions) -> Result<Self> {
        // Before the solver, which may be large.
        Self::check(system, state, options)?;
        let mut work = Work::default();
        let solver = select(system, &options.linear, options.stiffness.guarantee(), &mut work)?;
        let mut linear = Self::with_solver(system, state, options, solver)?;
        linear.statistics.work = work;
        Ok(linear)
    }

    /// With conjugate gradients a stepper holds at most 200 bytes for a spring and 1000 for a particle.
    fn check(system: &System, state: &State, options: &ImplicitOptions) -> Result<()> {
        options.linear.tolerance.check()?;
        check_room(system, state, [200, 1000])
    }

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
        let zeros = || vec![0.0; system.dofs().len()];
        Ok(Self {
            system,
            extensions,
            statistics: Statistics::default(),
            equations: MatrixAndSolver::new(matrix, solver),
            regularization: (policy == StiffnessPolicy::OnDemand).then(|| Regularization::new(system)),
            projection: (policy == StiffnessPolicy::Progressive).then(|| Projection::new(system)),
            changed_terms: 0,
            policy,
            adaptive_tolerance: LinearTolerance::new(system, options.linear.tolerance),
            interrupt: options.linear.interrupt,
            combination,
            stiffness: StiffnessState::first(policy),
            blocks: Vec::new(),
            rhs: zeros(),
            solution: zeros(),
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

    /// Begins an iteration, the first of a problem or a later one, or a linearised step, with its residual r: for the progressive policy.
    pub fn begin(&mut self, r: &[Vector3<f64>], is_first: bool) {
        if let Some(projection) = &mut self.projection {
            if is_first {
                projection.restart();
            }
            projection.begin(self.system, r);
        }
    }

    /// Prepares the matrix of a combination at the current extensions under a policy.
    pub fn prepare(&mut self, policy: StiffnessPolicy, combination: Combination) -> Result<(), SolveFailure> {
        self.combination = combination;
        let mut outcome = self.assemble(StiffnessState::first(policy));
        while let Err(SolveFailure::Indefinite(_)) = outcome
            && let Some(softer) = self.softer()
        {
            outcome = self.assemble(softer);
        }
        outcome
    }

    fn softer(&mut self) -> Option<StiffnessState> {
        let Self { system, extensions, projection, stiffness, .. } = self;
        if let (Terms::Projected, Some(projection)) = (stiffness.terms, projection)
            && projection.lower(system, extensions, stiffness.dropped, compressed(system, extensions))
        {
            return Some(*stiffness);
        }
        stiffness.softer()
    }

    /// As [`prepare`](Self::prepare), with the full stiffness. Where that is not positive definite it is refused as indefinite, here or by
    /// [`solve`](Self::solve), whatever the solver.
    pub fn prepare_whole(&mut self, combination: Combination) -> Result<(), SolveFailure> {
        self.combination = combination;
        self.assemble(StiffnessState::whole())
    }

    /// As [`prepare`](Self::prepare), with transverse coefficients, in N/m and not negative, of a spring and its position among the active ones.
    pub fn prepare_with(
        &mut self,
        combination: Combination,
        transverse: impl Fn(usize, &Spring, &Extension) -> f64 + Sync,
    ) -> Result<(), SolveFailure> {
        self.combination = combination;
        self.stiffness = StiffnessState::first(Stiffness::Tension.into());
        let Self { extensions, equations, statistics, stiffness, .. } = self;
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
        stiffness.accept(equations.prepare(change, &mut statistics.work)?)
    }
    fn assemble(&mut self, state: StiffnessState) -> Result<(), SolveFailure> {
        self.check_interrupt()?;
        self.stiffness = state;
        let Self {
            system, extensions, equations, statistics, regularization, projection, stiffness, combination, ..
        } = self;
        let combination = *combination;
        statistics.work.assemblies += 1;
        let change = |matrix: &mut SystemOperator<'s>| match stiffness.terms {
            Terms::Of(option) => {
                stiffness.dropped = match option {
                    Stiffness::Tension | Stiffness::Absolute => compressed(system, extensions),
                    Stiffness::Full | Stiffness::Axial => 0,
                };
                matrix.update(extensions, option, combination);
            }
            Terms::Projected => {
                let projection = projection.get_or_insert_with(|| Projection::new(system));
                stiffness.dropped = projection.update(system, extensions);
                let options = projection.options();
                match stiffness.dropped {
                    0 => matrix.update(extensions, Stiffness::Full, combination),
                    _ => matrix.update_each(extensions, combination, |position| options[position]),
                }
            }
            Terms::Regularized => {
                let regularization = regularization.get_or_insert_with(|| Regularization::new(system));
                stiffness.dropped = regularization.update(system, extensions, combination);
                let options = regularization.options();
                matrix.update_each(extensions, combination, |position| options[position]);
            }
        };
        let definiteness = equations.prepare(change, &mut statistics.work)?;
        stiffness.accept(definiteness)
    }

    /// True if the prepared matrix is the full one less some terms.
    pub fn is_regularized(&self) -> bool {
        self.stiffness.dropped > 0
    }

    /// `fᵀ D⁻¹ f` with D the 3×3 diagonal blocks of the prepared matrix, an estimate of `fᵀ A⁻¹ f`. Infinite where D is not positive definite.
    pub fn block_energy(&mut self, force: &[Vector3<f64>]) -> f64 {
        let Self { system, equations, blocks, .. } = self;
        blocks.resize(system.particles(), Matrix3::zeros());
        equations.matrix().diagonal_blocks(blocks);
        let energy = |p: usize| {
            let free = system.dofs().free_axes(p);
            let (mut block, mut force) = (blocks[p], force[p]);
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block[(axis, axis)] = 1.0;
                force[axis] = 0.0;
            }
            block.cholesky().map_or(f64::INFINITY, |factor| force.dot(&factor.solve(&force)))
        };
        sum_of_all(system, energy)
    }

    /// Solves `A_ff δx_f = force_f − A_fc δx_c` with the prepared matrix to a relative residual: `tolerance`, or where that is `None`
    /// what the error in time of the last step allows, see [`LinearTolerance`].
    ///
    /// `force` and `displacement` are full-length. Prescribed entries of `displacement` hold δx_c on entry and free ones zero; on success these hold
    /// δx_f. Where conjugate gradients find the matrix indefinite and the policy allows, a softer one takes its place, for later solves too.
    pub fn solve(
        &mut self,
        tolerance: Option<f64>,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        let mut outcome = self.attempt(tolerance, force, displacement);
        while let Err(SolveFailure::Indefinite(_)) = outcome
            && let Some(softer) = self.softer()
        {
            outcome = self.assemble(softer).and_then(|()| self.attempt(tolerance, force, displacement));
        }
        let solution = outcome?;
        self.stiffness.count(&mut self.statistics);
        self.changed_terms += match self.stiffness.terms {
            Terms::Of(Stiffness::Axial) => self.system.active_springs().len() as u64,
            _ => self.stiffness.dropped as u64,
        };
        self.system.dofs().scatter(&self.solution, displacement);
        Ok(solution)
    }

    /// As [`solve`](Self::solve) to an adaptive tolerance, and further where the error in time turns out to be much smaller: `error` is ‖E‖_M of the
    /// step with a displacement, in m √kg.
    pub fn solve_within(
        &mut self,
        force: &[Vector3<f64>],
        displacement: &mut [Vector3<f64>],
        error: impl Fn(&[Vector3<f64>]) -> f64,
    ) -> Result<Solution, SolveFailure> {
        let mut solution = self.solve(None, force, displacement)?;
        while self.adaptive_tolerance.is_adaptive {
            let error = error(displacement);
            self.adaptive_tolerance.record(error);
            if self.adaptive_tolerance.suffices(self.residual, self.combination.mass, error) {
                break;
            }
            // With at most a tenth of the last tolerance.
            solution = self.improve(None)?;
            self.system.dofs().scatter(&self.solution, displacement);
        }
        Ok(solution)
    }

    fn attempt(
        &mut self,
        tolerance: Option<f64>,
        force: &[Vector3<f64>],
        displacement: &[Vector3<f64>],
    ) -> Result<Solution, SolveFailure> {
        self.system.dofs().gather(force, &mut self.rhs);
        self.equations.matrix().subtract_coupling(displacement, &mut self.rhs);
        self.solution.fill(0.0);
        self.improve(tolerance)
    }

    fn improve(&mut self, tolerance: Option<f64>) -> Result<Solution, SolveFailure> {
        self.check_interrupt()?;
        let Self { equations, rhs, solution, statistics, adaptive_tolerance, combination, .. } = self;
        let size = norm(rhs);
        let tolerance = tolerance.unwrap_or_else(|| adaptive_tolerance.next(size, combination.mass));
        equations.set_tolerance(tolerance);
        let mut prepared = equations.prepared().ok_or(SolveFailure::Unprepared)?;
        let before = statistics.work.iterative_solves;
        let solved = prepared.solve(rhs, solution, &mut statistics.work)?;
        if statistics.work.iterative_solves > before {
            statistics.max_tolerance = statistics.max_tolerance.max(tolerance);
        }
        self.residual = adaptive_tolerance.improvable(solved.relative_residual * size);
        Ok(solved)
    }

    /// Applies the resolvent `(1 − τJ)⁻¹` of the linearised motion to an error of positions, in m, and velocities, in m/s, with the prepared matrix:
    ///
    /// ```text
    /// A(τ) c = K (e_x + τ e_v) + G e_v − r,      d = τ e_v + c,      e_x += d,      e_v = d/τ.
    /// ```
    ///
    /// K is exact, whatever stiffness the matrix has. `r` holds on entry the force that the linearised step left out, in N; it is used up. As c is a
    /// correction of steady motion, the residual of an iterative solver does not damp vibrations of the error. The error is unchanged where the
    /// prepared matrix is not A(τ) or the solve fails. No later solve depends on this one.
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
        // An estimate has two digits at most.
        if prepared.solve_aside(rhs, solution, 1e-2, &mut statistics.work).is_ok() {
            d.fill(Vector3::zeros());
            system.dofs().scatter(solution, d);
            for ((d, x), v) in d.iter().zip(x).zip(v) {
                *x += *v * tau + d;
                *v += d / tau;
            }
        }
    }

    fn check_interrupt(&self) -> Result<(), SolveFailure> {
        if self.interrupt.is_requested() { Err(SolveFailure::Interrupted) } else { Ok(()) }
    }
}

/// The number of compressed springs in all parts of a system. (Numbers below 2⁵³ are added without rounding.)
fn compressed(system: &System, extensions: &SpringGeometry) -> usize {
    let springs = extensions.springs(system);
    let compressed =
        springs.filter(|((number, _, spring), at)| spring.is_compressed(at) && system.owns_spring(*number));
    let [all] = system.total([compressed.count() as f64]);
    all as usize
}

#[cfg(test)]
mod tests;
