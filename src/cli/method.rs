//! Which method, stiffness and linear solver: the arguments of commands that simulate.

use super::console::Console;
use super::interrupt;
use super::values::{choice, fraction};
use sprung::Stiffness;
use sprung::accuracy::Configuration;
use sprung::integrate::{Method, StiffnessPolicy};
use sprung::linear::{PreconditionerKind, SolverChoice};
use sprung::plan::{MethodChoice, Plan, RunOptions};

/// How to simulate. Options that are not given are `None`, so that those given in vain can be told.
#[derive(Debug, clap::Args)]
pub struct MethodArguments {
    /// Time integration method [default: linear-backward-euler with a time step; without one dop853 or rodas4, by the stiffness of the scene]
    #[arg(long)]
    #[arg(value_parser = choice(&MethodChoice::ALL, MethodChoice::name, describe_choice))]
    method: Option<MethodChoice>,

    /// Required accuracy: the position error at the end stays below R times the extent of the scene, the distance of all particles from their centroid. (A
    /// vibration of a thousandth of the extent is lost in R = 1e-3.) A run is confirmed by one with steps at least twice as fine and by the propagated error of
    /// its steps; an answer that cannot be confirmed ends `unconfirmed`, with status 1. A method, stiffness or solver that is given is kept. --dt is the interval of
    /// records, which --frames counts
    #[arg(long, value_name = "R", value_parser = fraction, conflicts_with_all = ["rtol", "steps"])]
    accuracy: Option<f64>,

    /// Adaptive steps that keep local errors of positions and velocities so small that positions at the end are wrong by at most about R
    /// times their distance from their centroid, as a rule by much less, unless the motion itself magnifies differences, as folding and
    /// toppling do: the run warns of that. --dt is then the first step to try and the interval of records, which --frames counts.
    /// For methods with an error estimate: bdf2, w2, rodas4, dop853 [default: 1e-2 where no dt is given, neither here nor in the
    /// scene, with 300 records, whatever the duration]
    #[arg(long, value_name = "R", value_parser = fraction)]
    rtol: Option<f64>,

    /// Which part of every spring's stiffness enters the matrix A; forces are never changed [default: on-demand]
    #[arg(long, value_name = "OPTION")]
    #[arg(value_parser = choice(&StiffnessPolicy::ALL, StiffnessPolicy::name, describe_stiffness))]
    stiffness: Option<StiffnessPolicy>,

    /// Linear solver [default: auto]
    #[arg(long, value_parser = choice(&SolverChoice::ALL, SolverChoice::name, describe_solver))]
    solver: Option<SolverChoice>,

    /// Preconditioner of conjugate gradients [default: auto]
    #[arg(long, value_name = "KIND")]
    #[arg(value_parser = choice(&PRECONDITIONERS, PreconditionerChoice::name, describe_preconditioner))]
    preconditioner: Option<PreconditionerChoice>,

    /// Conjugate gradients stop at ‖b − A·δx‖ ≤ R·‖b‖ [default: as the error in time of a step is worth; 1e-10 with a solver given by name]
    #[arg(long, value_name = "R", value_parser = fraction)]
    tolerance: Option<f64>,
}

fn describe_choice(choice: MethodChoice) -> &'static str {
    match choice {
        MethodChoice::Named(method) => describe_method(method),
        MethodChoice::Auto => {
            "explicit where the steps resolve the fastest vibration (verlet, dop853), else implicit (bdf2, rodas4)"
        }
    }
}

fn describe_method(method: Method) -> &'static str {
    match method {
        Method::LinearBackwardEuler => "backward Euler with forces linearised: one linear solve a step; first order",
        Method::BackwardEuler => {
            "backward Euler, its equations solved by Newton's method with line search; first order"
        }
        Method::Bdf2 => "BDF2, forces linearised where the step ends: one linear solve a step as a rule; second order",
        Method::W2 => "two linear solves a step with one matrix, damps what is stiff; second order",
        Method::Rodas4 => "six or more linear solves a step with one matrix of the full stiffness; fourth order",
        Method::Verlet => "explicit, one force evaluation a step: needs small steps; second order",
        Method::Dop853 => "explicit, twelve force evaluations a step, for high accuracy; eighth order",
        Method::ImplicitMidpoint => "keeps momenta and, nearly, energy; Newton's method as above; second order",
        Method::ForwardEuler => "explicit, for comparison: needs very small steps; first order",
        Method::SymplecticEuler => "explicit, for comparison: needs small steps; first order",
        other => other.name(),
    }
}

fn describe_stiffness(policy: StiffnessPolicy) -> &'static str {
    match policy {
        StiffnessPolicy::OnDemand => {
            "full while A is positive definite; in solves where it is not, without the few terms that spoil it"
        }
        StiffnessPolicy::Always(Stiffness::Full) => {
            "the exact stiffness; A may be indefinite when springs are compressed"
        }
        StiffnessPolicy::Always(Stiffness::Tension) => "drop the transverse terms of compressed springs",
        StiffnessPolicy::Always(Stiffness::Axial) => "drop all transverse terms",
    }
}

fn describe_solver(solver: SolverChoice) -> &'static str {
    match solver {
        SolverChoice::Auto => "llt or cg: by size, and from there by the effort that the first steps take",
        SolverChoice::Llt => "sparse Cholesky factorization; refuses an indefinite A",
        SolverChoice::Ldlt => "sparse LDLᵀ factorization; accepts an indefinite A",
        SolverChoice::Cg => "conjugate gradients without a matrix",
        SolverChoice::CgAssembled => "conjugate gradients on the assembled A",
        other => other.name(),
    }
}

const PRECONDITIONERS: [PreconditionerChoice; 5] = [
    PreconditionerChoice::Auto,
    PreconditionerChoice::Kind(PreconditionerKind::None),
    PreconditionerChoice::Kind(PreconditionerKind::Jacobi),
    PreconditionerChoice::Kind(PreconditionerKind::BlockJacobi),
    PreconditionerChoice::Kind(PreconditionerKind::Multigrid),
];

fn describe_preconditioner(choice: PreconditionerChoice) -> &'static str {
    match choice {
        PreconditionerChoice::Auto => "none, block-jacobi or multigrid, whichever turns out to cost least",
        PreconditionerChoice::Kind(PreconditionerKind::None) => "no preconditioner",
        PreconditionerChoice::Kind(PreconditionerKind::Jacobi) => "the diagonal of A",
        PreconditionerChoice::Kind(PreconditionerKind::BlockJacobi) => "the 3×3 diagonal block of every particle",
        PreconditionerChoice::Kind(PreconditionerKind::Multigrid) => {
            "algebraic multigrid: few iterations whatever the size, each costing as much as several others"
        }
        PreconditionerChoice::Kind(other) => other.name(),
    }
}

#[derive(Debug, Clone, Copy)]
enum PreconditionerChoice {
    Auto,
    Kind(PreconditionerKind),
}

impl PreconditionerChoice {
    fn name(self) -> &'static str {
        self.kind().map_or("auto", PreconditionerKind::name)
    }

    fn kind(self) -> Option<PreconditionerKind> {
        match self {
            Self::Auto => None,
            Self::Kind(kind) => Some(kind),
        }
    }
}

/// The arguments that choose the same method, stiffness and solver as a plan.
pub fn repeat(plan: &Plan) -> String {
    let Configuration { method, options } = &plan.configuration;
    let (stiffness, solver) = (options.stiffness.name(), options.linear.solver.name());
    format!("--method {} --stiffness {stiffness} --solver {solver}", method.name())
}

impl MethodArguments {
    /// What is asked of a run.
    pub fn run_options(&self) -> RunOptions {
        RunOptions {
            method: self.method,
            accuracy: self.accuracy,
            rtol: self.rtol,
            stiffness: self.stiffness,
            solver: self.solver,
            preconditioner: self.preconditioner.and_then(PreconditionerChoice::kind),
            tolerance: self.tolerance,
            interrupt: interrupt::request(),
        }
    }

    /// Names the options that the method or the solver asked for, or the method that stands for none in runs of this tolerance, does not use.
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
        let explicit = method.filter(|method| !method.is_implicit());
        let (with, unused) = match self.solver {
            _ if explicit.is_some() => (explicit.map_or("", Method::name), &given[..]),
            Some(solver @ (SolverChoice::Llt | SolverChoice::Ldlt)) => (solver.name(), &given[2..]),
            _ => return,
        };
        for (name, _) in unused.iter().filter(|(_, is_given)| *is_given) {
            console.note(format_args!("--{name} has no effect with {with}"));
        }
    }
}
