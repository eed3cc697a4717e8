//! The choice of a solver: conjugate gradients with block Jacobi or multigrid, or a Cholesky factorization.
//!
//! The number of iterations is known only when they have been done, and the cost of a factorization only when the pattern has been analysed. So block
//! Jacobi comes first and may spend on a matrix what the cheaper of the other two would cost, which is at most twice the better choice (the
//! ski-rental argument). Then that one takes over, from the solution so far, and for the matrices that follow. Multigrid in turn may spend what a
//! factorization would cost. Block Jacobi is tried again after [`FIRST_TRIAL`] matrices, and after twice as many each time that it has overspent.
//!
//! The pattern is analysed when block Jacobi first overspends, or has spent twenty times what an analysis costs at least. A factor takes memory only
//! when it is chosen, and no more than half of what the process may hold.
//!
//! Effort is [counted](CostModel), not timed: a repeated run makes the same choice, for any number of threads.

use super::analysis::FactorReport;
use super::cg_solver::CgSolver;
use super::cost::CostModel;
use super::direct::{CholeskyPlan, CholeskySolver, LdltSolver};
use super::options::{DefinitenessGuarantee, PreconditionerKind, SolverChoice, SolverOptions};
use super::ordering::FactorSize;
use super::outcome::{Definiteness, NotConverged, SolveFailure, Solved};
use super::preconditioner::Preconditioner;
use super::{LinearSolver, PreparedMatrix};
use crate::assembly::SystemMatrix;
use crate::error::Result;
use crate::memory;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::Vector3;

/// Matrices before block Jacobi is first tried again: the trial costs at most the price of one of them.
const FIRST_TRIAL: u64 = 16;

/// Degrees of freedom beyond which nothing is analysed: ordering alone would take seconds.
const LARGEST_ANALYSED: usize = 1_500_000;

/// Factor operations per spring up to which a matrix that may be indefinite is factored, as only that proves definiteness.
const WORTH_PROVING: f64 = 3e5;

/// Creates the solver. `Auto` factors what is small, or worth a proof of definiteness, and fits half of the memory; otherwise block Jacobi, multigrid
/// or a factorization solves, at most at about twice the effort of the best of them.
///
/// # Errors
/// When the matrix or its factor is too large.
pub fn select(
    system: &System,
    options: &SolverOptions,
    guarantee: DefinitenessGuarantee,
    work: &mut Work,
) -> Result<Box<dyn LinearSolver>> {
    let dofs = system.dofs().len();
    let iterative = |matrix, factors| -> Result<Box<dyn LinearSolver>> {
        Ok(match options.preconditioner {
            Some(kind) => Box::new(CgSolver::new(system, kind, options, matrix)?),
            None => Box::new(AutomaticSolver::new(system, options, matrix, factors)?),
        })
    };
    Ok(match options.solver {
        SolverChoice::Llt => Box::new(CholeskySolver::new(system, options.par, work)?),
        SolverChoice::Ldlt => Box::new(LdltSolver::new(system, options.par, work)?),
        SolverChoice::Cg => iterative(None, false)?,
        SolverChoice::CgAssembled => iterative(Some(SystemMatrix::of_stiffness(system)?), false)?,
        // Factoring so little takes about as long as a solve by conjugate gradients.
        SolverChoice::Auto if dofs <= 60 => Box::new(CholeskySolver::new(system, options.par, work)?),
        SolverChoice::Auto if guarantee == DefinitenessGuarantee::Unknown && dofs <= LARGEST_ANALYSED => {
            let most = WORTH_PROVING * system.active_springs().len().max(1) as f64;
            let is_worth = |size: FactorSize, bytes| size.flops <= most && fits(bytes);
            let plan = CholeskyPlan::if_worth(system, options.par, work, is_worth);
            match plan.and_then(|plan| plan.solver().ok()) {
                Some(direct) => Box::new(direct),
                None => iterative(None, false)?,
            }
        }
        SolverChoice::Auto => iterative(None, guarantee != DefinitenessGuarantee::Unknown)?,
    })
}

/// Whether a factor of so many bytes leaves as much room for everything else.
fn fits(bytes: u64) -> bool {
    memory::limit().is_none_or(|limit| bytes <= limit / 2)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    BlockJacobi,
    Multigrid,
    Cholesky,
}

enum Direct {
    Unknown,
    /// Analysed, and without memory yet.
    Analysed(Box<CholeskyPlan>),
    Ready(Box<CholeskySolver>),
    /// Not wanted, too expensive, or too large.
    Never,
}

/// The price of a matrix and of every solve with it, in force evaluations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cost {
    once: f64,
    solve: f64,
}

impl Cost {
    const INFINITE: Self = Self { once: f64::INFINITY, solve: 0.0 };

    fn direct(costs: &CostModel, size: FactorSize) -> Self {
        Self { once: costs.factorization(size), solve: costs.direct_solve(size) }
    }

    fn total(self, solves: f64) -> f64 {
        self.once + solves * self.solve
    }
}

/// Three solvers for one system, one of which solves.
struct AutomaticSolver {
    method: Method,
    /// With the preconditioner of the method.
    iterative: CgSolver,
    /// The preconditioner that is not in use.
    other: Option<Preconditioner>,
    direct: Direct,
    par: Par,
    costs: CostModel,
    multigrid_cost: Cost,
    direct_cost: Cost,
    positions: Vec<Vector3<f64>>,
    /// Solves with the current matrix, and what the method has spent on it.
    solves: f64,
    spent: f64,
    /// What block Jacobi has spent on all matrices.
    total_spent: f64,
    /// Matrices before block Jacobi is tried again, and the interval after which it was.
    until_trial: u64,
    interval: u64,
}

impl AutomaticSolver {
    /// `factors` allows factorizations.
    fn new(system: &System, options: &SolverOptions, matrix: Option<SystemMatrix>, factors: bool) -> Result<Self> {
        let costs = CostModel::of(system);
        let iterative = CgSolver::new(system, PreconditionerKind::BlockJacobi, options, matrix)?;
        // A first estimate of the iterations of a solve to ten digits: 12 to 35 on cloths, lattices and networks.
        let solve = 25.0 * costs.iteration(PreconditionerKind::Multigrid);
        let factors = factors && system.dofs().len() <= LARGEST_ANALYSED;
        Ok(Self {
            method: Method::BlockJacobi,
            iterative,
            other: None,
            direct: if factors { Direct::Unknown } else { Direct::Never },
            par: options.par,
            multigrid_cost: Cost { once: costs.multigrid_setup(), solve },
            direct_cost: Cost::INFINITE,
            costs,
            positions: vec![Vector3::zeros(); system.particles()],
            solves: 0.0,
            spent: 0.0,
            total_spent: 0.0,
            until_trial: FIRST_TRIAL,
            interval: FIRST_TRIAL,
        })
    }

    fn current(&self) -> &dyn LinearSolver {
        match (&self.direct, self.method) {
            (Direct::Ready(direct), Method::Cholesky) => &**direct,
            _ => &self.iterative,
        }
    }

    fn factored(&mut self) -> Option<&mut CholeskySolver> {
        match &mut self.direct {
            Direct::Ready(direct) if self.method == Method::Cholesky => Some(direct),
            _ => None,
        }
    }

    /// Of multigrid and of a factorization, for so many solves.
    fn prices(&self, solves: f64) -> [f64; 2] {
        [self.multigrid_cost, self.direct_cost].map(|price| price.total(solves))
    }

    /// What the method may spend on the current matrix: the price of the cheaper of those that follow.
    fn allowance(&self) -> f64 {
        let [multigrid, direct] = self.prices(self.solves);
        match self.method {
            Method::BlockJacobi => multigrid.min(direct),
            Method::Multigrid => direct,
            Method::Cholesky => f64::INFINITY,
        }
    }

    /// Analyses the pattern, as far as factorizations seem to pay.
    fn analyse(&mut self, system: &System, work: &mut Work) {
        if !matches!(self.direct, Direct::Unknown) {
            return;
        }
        self.direct = Direct::Never;
        // A factorization that costs ten times what multigrid does is not analysed further.
        let (costs, most) = (self.costs, 10.0 * self.multigrid_cost.total(1.0));
        let is_worth = |size, bytes| Cost::direct(&costs, size).total(1.0) <= most && fits(bytes);
        if let Some(plan) = CholeskyPlan::if_worth(system, self.par, work, is_worth) {
            self.direct_cost = Cost::direct(&costs, plan.size());
            self.direct = Direct::Analysed(Box::new(plan));
        }
    }

    /// Changes to the cheaper one of the methods that follow; one that cannot be set up is not considered again.
    fn change_method(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        if self.method == Method::BlockJacobi {
            self.interval = self.interval.saturating_mul(2);
            self.until_trial = self.interval;
        }
        self.analyse(a.system(), work);
        self.spent = 0.0;
        let [multigrid, direct] = self.prices(self.solves);
        if self.method == Method::Multigrid || direct <= multigrid {
            self.direct = match std::mem::replace(&mut self.direct, Direct::Never) {
                Direct::Analysed(plan) => plan.solver().map_or(Direct::Never, |direct| Direct::Ready(Box::new(direct))),
                direct => direct,
            };
            if let Direct::Ready(direct) = &mut self.direct {
                let updated = direct.update(a, work).map(drop);
                self.use_block_jacobi();
                self.method = Method::Cholesky;
                return updated;
            }
            self.direct_cost = Cost::INFINITE;
            return Ok(());
        }
        let create = || Preconditioner::new(PreconditionerKind::Multigrid, a.system());
        let Ok(mut multigrid) = self.other.take().map_or_else(create, Ok) else {
            self.multigrid_cost = Cost::INFINITE;
            return Ok(());
        };
        multigrid.set_positions(&self.positions);
        self.exchange_preconditioner(multigrid);
        self.method = Method::Multigrid;
        self.counting_setups(work, |iterative, work| iterative.preconditioner.update(a, work))
    }

    fn exchange_preconditioner(&mut self, mut preconditioner: Preconditioner) {
        std::mem::swap(&mut self.iterative.preconditioner, &mut preconditioner);
        self.other = Some(preconditioner);
    }

    /// Does something that may set up multigrid, which counts as spent.
    fn counting_setups<R>(&mut self, work: &mut Work, f: impl FnOnce(&mut CgSolver, &mut Work) -> R) -> R {
        let before = work.multigrid_setups;
        let result = f(&mut self.iterative, work);
        self.spent += (work.multigrid_setups - before) as f64 * self.costs.multigrid_setup();
        result
    }

    fn use_block_jacobi(&mut self) {
        if self.method == Method::Multigrid
            && let Some(blocks) = self.other.take()
        {
            self.exchange_preconditioner(blocks);
        }
        self.method = Method::BlockJacobi;
    }
}

impl LinearSolver for AutomaticSolver {
    fn name(&self) -> &'static str {
        self.current().name()
    }

    fn preconditioner(&self) -> Option<&'static str> {
        self.current().preconditioner()
    }

    fn factor(&self) -> Option<FactorReport> {
        match &self.direct {
            Direct::Analysed(plan) => Some(plan.report()),
            Direct::Ready(direct) => direct.factor(),
            Direct::Unknown | Direct::Never => None,
        }
    }

    fn choice(&self) -> Option<String> {
        let [multigrid, direct] = self.prices(1.0);
        let direct = match self.direct {
            Direct::Unknown => "a factorization has not been considered".into(),
            Direct::Never => "a factorization costs far more, or is too large".into(),
            Direct::Analysed(_) | Direct::Ready(_) => format!("a factorization and a solve cost {direct:.0}"),
        };
        let with = self.preconditioner().map_or(String::new(), |preconditioner| format!(" with {preconditioner}"));
        Some(format!("{}{with}: in force evaluations, multigrid costs about {multigrid:.0}; {direct}", self.name()))
    }

    fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.positions.iter_mut().zip(positions).for_each(|(place, position)| *place = *position);
        self.iterative.set_positions(positions);
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        (self.solves, self.spent) = (0.0, 0.0);
        // An analysis at a twentieth of the effort so far is always made: fill may make it a few times more expensive.
        if self.total_spent > 20.0 * self.costs.least_analysis() {
            self.analyse(a.system(), work);
        }
        if self.method != Method::BlockJacobi {
            match self.until_trial {
                0 => self.use_block_jacobi(),
                _ => self.until_trial -= 1,
            }
        }
        match self.factored() {
            Some(direct) => direct.update(a, work),
            None => self.counting_setups(work, |iterative, work| iterative.update(a, work)),
        }
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.iterative.set_tolerance(tolerance);
    }

    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        self.solves += 1.0;
        loop {
            if let Some(direct) = self.factored() {
                let solution = direct.solve(a, b, x, work)?;
                // For the first guess of a trial.
                self.iterative.warm_start.record(x);
                return Ok(solution);
            }
            let is_multigrid = self.method == Method::Multigrid;
            let kind = if is_multigrid { PreconditionerKind::Multigrid } else { PreconditionerKind::BlockJacobi };
            let iteration = self.costs.iteration(kind);
            let limit = self.iterative.method().iteration_limit;
            let most = ((self.allowance() - self.spent) / iteration).max(1.0) as u64;
            self.iterative.method().iteration_limit = limit.min(most);
            let before = work.cg_iterations;
            let solved = self.iterative.solve(a, b, x, work);
            self.iterative.method().iteration_limit = limit;
            let cost = (work.cg_iterations - before) as f64 * iteration;
            self.spent += cost;
            match self.method {
                Method::BlockJacobi => self.total_spent += cost,
                Method::Multigrid if solved.is_ok() => {
                    self.multigrid_cost.solve = 0.5 * (self.multigrid_cost.solve + cost);
                }
                Method::Multigrid => self.multigrid_cost.solve = self.multigrid_cost.solve.max(cost),
                Method::Cholesky => {}
            }
            match solved {
                Err(SolveFailure::NotConverged { reason: NotConverged::IterationLimit, .. }) if most < limit => {
                    self.change_method(&a, work)?;
                }
                _ => return solved,
            }
        }
    }

    fn solve_aside(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], tolerance: f64, work: &mut Work) -> Solved {
        match self.factored() {
            Some(direct) => direct.solve(a, b, x, work),
            None => self.iterative.solve_aside(a, b, x, tolerance, work),
        }
    }
}

#[cfg(feature = "scene")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::linear::fixtures::{chain, operator, right_hand_side};
    use crate::linear::outcome::Evidence;
    use crate::operator::Combination;
    use crate::scene::builtin;
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;

    fn automatic(system: &System, factors: bool) -> AutomaticSolver {
        AutomaticSolver::new(system, &SolverOptions::default(), None, factors).unwrap()
    }

    fn solve(solver: &mut AutomaticSolver, a: &SystemOperator, work: &mut Work) -> Solved {
        solver.update(a, work)?;
        let rows = a.system().dofs().len();
        solver.solve(PreparedMatrix(a), &right_hand_side(rows), &mut vec![0.0; rows], work)
    }

    /// Block Jacobi needs as many iterations as the chain has particles. It may spend what multigrid would; then the pattern is analysed, and a chain
    /// is cheap to factor. The next matrix is factored at once.
    #[test]
    fn stiff_matrices_are_factored_where_that_is_cheap() {
        let scene = chain(2000);
        let (a, mut work, mut solver) = (operator(&scene, 1.0), Work::default(), automatic(&scene.0, true));
        let allowed = solver.multigrid_cost.total(1.0) / solver.costs.iteration(PreconditionerKind::BlockJacobi);
        let solution = solve(&mut solver, &a, &mut work).unwrap();
        assert!(solution.relative_residual < 1e-9, "{solution:?}");
        assert_eq!((work.cg_iterations, work.factorizations, solver.name()), (allowed as u64, 1, "llt"));
        assert!(solver.factor().is_some() && solver.preconditioner().is_none());
        solve(&mut solver, &a, &mut work).unwrap();
        assert_eq!((work.cg_iterations, work.factorizations, work.symbolic_factorizations), (allowed as u64, 2, 1));
    }

    /// Without factorizations multigrid takes over, at the places that the particles have.
    #[test]
    fn stiff_matrices_have_multigrid_where_nothing_is_factored() {
        let scene = builtin::cloth(16).unwrap().build().unwrap();
        let a = operator(&scene, 0.1);
        let iterations = [false, true].map(|has_positions| {
            let (mut work, mut solver) = (Work::default(), automatic(&scene.0, false));
            if has_positions {
                solver.set_positions(&scene.1.positions);
            }
            solver.multigrid_cost.solve = 0.0;
            solve(&mut solver, &a, &mut work).unwrap();
            assert_eq!((solver.name(), solver.preconditioner()), ("cg", Some("multigrid")));
            assert_eq!((work.multigrid_setups, work.symbolic_factorizations), (1, 0));
            work.multigrid_iterations
        });
        assert!(iterations[1] > 0 && iterations[1] < iterations[0], "{iterations:?}");
    }

    /// Where masses dominate, block Jacobi needs few iterations and nothing else is looked at. Steps that become short again are left to it after
    /// twice sixteen matrices, because the first attempt was in vain.
    #[test]
    fn block_jacobi_is_tried_again() {
        let scene = chain(500);
        let [stiff, easy] = [1.0, 1e-4].map(|dt| operator(&scene, dt));
        let (mut work, mut solver) = (Work::default(), automatic(&scene.0, true));
        solve(&mut solver, &easy, &mut work).unwrap();
        assert_eq!((solver.name(), solver.preconditioner()), ("cg", Some("block-jacobi")));
        assert_eq!((work.symbolic_factorizations, work.multigrid_setups), (0, 0));
        assert!(solver.choice().unwrap().contains("not been considered"));
        solve(&mut solver, &stiff, &mut work).unwrap();
        for _ in 0..2 * FIRST_TRIAL {
            solve(&mut solver, &easy, &mut work).unwrap();
            assert_eq!(solver.name(), "llt");
        }
        solve(&mut solver, &easy, &mut work).unwrap();
        assert_eq!(solver.name(), "cg");
        let iterations = work.cg_iterations;
        // A trial in vain ends in a factorization, and the next one comes later.
        solve(&mut solver, &stiff, &mut work).unwrap();
        assert_eq!((solver.name(), solver.until_trial), ("llt", 4 * FIRST_TRIAL));
        assert!(work.cg_iterations > iterations);
    }

    /// What cannot be had is not considered again, and block Jacobi goes on to its own limit.
    #[test]
    fn block_jacobi_goes_on_where_there_is_nothing_else() {
        let scene = chain(500);
        let (a, mut work, mut solver) = (operator(&scene, 1.0), Work::default(), automatic(&scene.0, false));
        solver.multigrid_cost = Cost::INFINITE;
        solve(&mut solver, &a, &mut work).unwrap();
        assert!(solver.preconditioner() == Some("block-jacobi") && work.cg_iterations >= 490, "{work:?}");
    }

    /// Two pressed particles: their blocks are 20 − 15 across the spring and the matrix is 20 − 30 for ends that part, or the blocks are 1 − 15.
    /// Either way the matrix is refused, by conjugate gradients and by a factorization.
    #[test]
    fn indefinite_matrices_are_refused() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0, 0.0, 0.0], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 4.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let refusal = |dt: f64, method| {
            let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
            let (mut solver, mut work) = (automatic(&system, true), Work::default());
            if method == Method::Cholesky {
                solver.direct = Direct::Ready(Box::new(CholeskySolver::new(&system, Par::Seq, &mut work).unwrap()));
                solver.method = method;
            }
            let apart = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0];
            let updated = solver.update(&a, &mut work);
            updated.and_then(|_| solver.solve(PreparedMatrix(&a), &apart, &mut [0.0; 6], &mut work)).unwrap_err()
        };
        let [curvature, block] = [1.0 / 20.0_f64.sqrt(), 1.0].map(|dt| refusal(dt, Method::BlockJacobi));
        assert!(matches!(curvature, SolveFailure::Indefinite(Evidence::NegativeCurvature { .. })), "{curvature}");
        assert!(matches!(block, SolveFailure::Indefinite(Evidence::DiagonalBlock(_))), "{block}");
        let pivot = refusal(1.0, Method::Cholesky);
        assert!(matches!(pivot, SolveFailure::Indefinite(Evidence::Pivot(_))), "{pivot}");
    }

    /// Half a million free particles are the most that are ordered.
    #[test]
    fn what_is_too_large_is_not_analysed() {
        let system = |particles: usize| {
            let mut builder = SystemBuilder::new();
            builder.positions = vec![Vector3::zeros(); particles];
            builder.velocities = builder.positions.clone();
            builder.masses = vec![1.0; particles];
            builder.build().unwrap().0
        };
        let chosen = |system: &System, guarantee| {
            let mut work = Work::default();
            let solver = select(system, &SolverOptions::default(), guarantee, &mut work).unwrap();
            (solver.name(), work.symbolic_factorizations, solver.choice().is_some())
        };
        let (large, too_large) = (system(500_000), system(500_001));
        assert_eq!(chosen(&large, DefinitenessGuarantee::Unknown), ("cg", 1, true));
        assert_eq!(chosen(&too_large, DefinitenessGuarantee::Unknown), ("cg", 0, true));
        // Matrices known to be definite are analysed only when that may pay.
        for guarantee in [DefinitenessGuarantee::Definite, DefinitenessGuarantee::RegularizedDefinite] {
            assert_eq!([&large, &too_large].map(|system| chosen(system, guarantee)), [("cg", 0, true); 2]);
        }
    }
}
