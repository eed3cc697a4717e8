//! Method, stiffness and linear solver: the arguments of commands that simulate.

use super::common::{choice, fraction};
use super::console::Console;
use super::threads::interrupt;
use sprung::Stiffness;
use sprung::accuracy::Configuration;
use sprung::integrate::Method::{
    BackwardEuler, Bdf2, Dop853, ForwardEuler, ImplicitMidpoint, LinearBackwardEuler, Rodas4, SymplecticEuler, Verlet,
    W2,
};
use sprung::integrate::StiffnessPolicy::{self, Always, OnDemand, Progressive};
use sprung::linear::{PreconditionerKind, SolverChoice};
use sprung::plan::MethodChoice::{self, Auto, Named};
use sprung::plan::{Plan, RunOptions};

/// The arguments of a simulation. Options that are not given are `None`.
#[derive(Debug, clap::Args)]
pub struct MethodArguments {
    /// Time integration method [default: linear-backward-euler with a time step; without one dop853 or rodas4, by the stiffness of the scene]
    #[arg(long, value_parser = choice(&METHODS, MethodChoice::name))]
    method: Option<MethodChoice>,

    /// Required accuracy: the position error at the end stays below R times the extent of the scene, the distance of all particles from their centroid. (A
    /// vibration of a thousandth of the extent is lost in R = 1e-3.) A run is confirmed by one with steps at least twice as fine and by the propagated error of
    /// its steps; an answer that cannot be confirmed ends `unconfirmed`, with status 1. A method, stiffness or solver that is given is kept. --dt is the interval of
    /// records, which --frames counts
    #[arg(long, value_name = "R", value_parser = fraction, conflicts_with_all = ["rtol", "steps"])]
    accuracy: Option<f64>,

    /// Adaptive steps that keep local errors of positions and velocities so small that positions at the end are wrong by at most about R times their
    /// distance from their centroid, as a rule by much less, unless the motion itself magnifies differences, as folding and toppling do: the run
    /// warns of that. --dt is then the first step to try and the interval of records, which --frames counts. For methods with an error estimate:
    /// bdf2, w2, rodas4, dop853 [default: 1e-2 where no dt is given, neither here nor in the scene, with 300 records, whatever the duration]
    #[arg(long, value_name = "R", value_parser = fraction)]
    rtol: Option<f64>,

    /// Which part of every spring's stiffness enters the matrix A; forces are never changed [default: on-demand]
    #[arg(long, value_name = "OPTION", value_parser = choice(&STIFFNESSES, StiffnessPolicy::name))]
    stiffness: Option<StiffnessPolicy>,

    /// Linear solver [default: auto]
    #[arg(long, value_parser = choice(&SOLVERS, SolverChoice::name))]
    solver: Option<SolverChoice>,

    /// Preconditioner of conjugate gradients [default: auto]
    #[arg(long, value_name = "KIND", value_parser = choice(&PRECONDITIONERS, preconditioner_name))]
    preconditioner: Option<Preconditioner>,

    /// Conjugate gradients stop at ‖b − A·δx‖ ≤ R·‖b‖ [default: as the error in time of a step is worth; 1e-10 with a solver given by name]
    #[arg(long, value_name = "R", value_parser = fraction)]
    tolerance: Option<f64>,
}

const METHODS: [(MethodChoice, &str); 11] = [
    (Named(LinearBackwardEuler), "backward Euler with forces linearised: one linear solve a step; first order"),
    (Named(BackwardEuler), "backward Euler, its equations solved by Newton's method with line search; first order"),
    (Named(Bdf2), "BDF2, forces linearised where the step ends: one linear solve a step as a rule; second order"),
    (Named(W2), "two linear solves a step with one matrix, damps what is stiff; second order"),
    (Named(Rodas4), "six or more linear solves a step with one matrix of the full stiffness; fourth order"),
    (Named(ImplicitMidpoint), "keeps momenta and, nearly, energy; Newton's method as above; second order"),
    (Named(Verlet), "explicit, one force evaluation a step: needs small steps; second order"),
    (Named(Dop853), "explicit, twelve force evaluations a step, for high accuracy; eighth order"),
    (Named(ForwardEuler), "explicit, for comparison: needs very small steps; first order"),
    (Named(SymplecticEuler), "explicit, for comparison: needs small steps; first order"),
    (Auto, "explicit where the steps resolve the fastest vibration (verlet, dop853), else implicit (bdf2, rodas4)"),
];

pub(super) const STIFFNESSES: [(StiffnessPolicy, &str); 6] = [
    (OnDemand, "full while A is positive definite; in solves where it is not, without the few terms that spoil it"),
    (Progressive, "full while A is positive definite; where it is not, tension for springs at large residuals"),
    (Always(Stiffness::Full), "the exact stiffness; A may be indefinite when springs are compressed"),
    (Always(Stiffness::Tension), "drop the transverse terms of compressed springs"),
    (Always(Stiffness::Axial), "drop all transverse terms"),
    (Always(Stiffness::Absolute), "the transverse terms of compressed springs with the other sign"),
];

const SOLVERS: [(SolverChoice, &str); 5] = [
    (SolverChoice::Auto, "llt or cg: by size, and from there by the effort that the first steps take"),
    (SolverChoice::Llt, "sparse Cholesky factorization; refuses an indefinite A"),
    (SolverChoice::Ldlt, "sparse LDLᵀ factorization; accepts an indefinite A"),
    (SolverChoice::Cg, "conjugate gradients without a matrix"),
    (SolverChoice::CgAssembled, "conjugate gradients on the assembled A"),
];

/// `None` for the program's choice.
type Preconditioner = Option<PreconditionerKind>;

const PRECONDITIONERS: [(Preconditioner, &str); 5] = [
    (None, "none, block-jacobi or multigrid, whichever turns out to cost least"),
    (Some(PreconditionerKind::None), "no preconditioner"),
    (Some(PreconditionerKind::Jacobi), "the diagonal of A"),
    (Some(PreconditionerKind::BlockJacobi), "the 3×3 diagonal block of every particle"),
    (
        Some(PreconditionerKind::Multigrid),
        "algebraic multigrid: few iterations whatever the size, each costing as much as several others",
    ),
];

pub fn preconditioner_name(preconditioner: Preconditioner) -> &'static str {
    preconditioner.map_or("auto", PreconditionerKind::name)
}

pub fn arguments_of(plan: &Plan) -> String {
    let Configuration { method, options } = &plan.configuration;
    let (stiffness, solver) = (options.stiffness.name(), options.linear.solver.name());
    format!("--method {} --stiffness {stiffness} --solver {solver}", method.name())
}

impl MethodArguments {
    pub fn run_options(&self) -> RunOptions {
        RunOptions {
            method: self.method,
            accuracy: self.accuracy,
            rtol: self.rtol,
            stiffness: self.stiffness,
            solver: self.solver,
            preconditioner: self.preconditioner.flatten(),
            tolerance: self.tolerance,
            interrupt: interrupt(),
        }
    }

    /// Notes the options that the method, given or chosen for this tolerance, or the solver does not use.
    pub fn note_unused(&self, console: &Console, rtol: Option<f64>) {
        let method = RunOptions { rtol, ..self.run_options() }.method();
        let given = [
            ("stiffness", self.stiffness.is_some()),
            ("solver", self.solver.is_some()),
            ("preconditioner", self.preconditioner.is_some()),
            ("tolerance", self.tolerance.is_some()),
        ];
        if self.stiffness.is_some()
            && let Some(method) = method.filter(|method| method.is_implicit() && !method.takes_stiffness())
        {
            console.note(format_args!("--stiffness has no effect with {}", method.name()));
        }
        let (with, unused) = match (method, self.solver) {
            (Some(method), _) if !method.is_implicit() => (method.name(), &given[..]),
            (_, Some(solver @ (SolverChoice::Llt | SolverChoice::Ldlt))) => (solver.name(), &given[2..]),
            _ => return,
        };
        for (name, _) in unused.iter().filter(|(_, is_given)| *is_given) {
            console.note(format_args!("--{name} has no effect with {with}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_choice_of_the_library_is_offered() {
        assert!(METHODS.iter().map(|(method, _)| *method).eq(MethodChoice::ALL));
        assert!(STIFFNESSES.iter().map(|(policy, _)| *policy).eq(StiffnessPolicy::ALL));
        assert!(SOLVERS.iter().map(|(solver, _)| *solver).eq(SolverChoice::ALL));
    }
}
