//! Which method, stiffness and linear solver: the arguments of commands that simulate.

use super::console::Console;
use super::values::{choice, fraction};
use faer::Par;
use sprung::integrate::{
    AdaptiveStepper, Adaptivity, ImplicitOptions, Method, Outcome, Sampling, Schedule, StiffnessPolicy, TimeStepper,
    run, run_adaptive,
};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
use sprung::{Error, Result, State, Stiffness, System};
use std::ops::ControlFlow;

/// How to simulate. Options that are not given are `None`, so that those given in vain can be told.
#[derive(Debug, clap::Args)]
pub struct MethodArguments {
    /// Time integration method [default: linear-backward-euler; with --rtol: w2]
    #[arg(long)]
    #[arg(value_parser = choice(&Method::ALL, Method::name, describe_method))]
    method: Option<Method>,

    /// Adaptive steps, short enough for a relative error of positions of about R at the end. --dt is then the first step to try
    /// and the interval of records, which --frames counts. For methods with an error estimate: w2
    #[arg(long, value_name = "R", value_parser = fraction)]
    rtol: Option<f64>,

    /// Which part of every spring's stiffness enters the matrix A; forces are never changed [default: on-demand]
    #[arg(long, value_name = "OPTION")]
    #[arg(value_parser = choice(&STIFFNESSES, StiffnessPolicy::name, describe_stiffness))]
    stiffness: Option<StiffnessPolicy>,

    /// Linear solver [default: auto]
    #[arg(long, value_parser = choice(&SOLVERS, SolverChoice::name, describe_solver))]
    solver: Option<SolverChoice>,

    /// Preconditioner of conjugate gradients [default: auto]
    #[arg(long, value_name = "KIND")]
    #[arg(value_parser = choice(&PRECONDITIONERS, PreconditionerChoice::name, describe_preconditioner))]
    preconditioner: Option<PreconditionerChoice>,

    /// Conjugate gradients stop at ‖b − A·δx‖ ≤ R·‖b‖ [default: 1e-10]
    #[arg(long, value_name = "R", value_parser = fraction)]
    tolerance: Option<f64>,
}

fn describe_method(method: Method) -> &'static str {
    match method {
        Method::LinearBackwardEuler => "backward Euler with forces linearised: one linear solve a step; first order",
        Method::BackwardEuler => {
            "backward Euler, its equations solved by Newton's method with line search; first order"
        }
        Method::W2 => "two linear solves a step with one matrix, as stable as backward Euler; second order",
        Method::ImplicitMidpoint => "keeps momenta and, nearly, energy; Newton's method as above; second order",
        Method::ForwardEuler => "explicit, for comparison: needs very small steps; first order",
        Method::SymplecticEuler => "explicit, for comparison: needs small steps; first order",
    }
}

const STIFFNESSES: [StiffnessPolicy; 4] = [
    StiffnessPolicy::OnDemand,
    StiffnessPolicy::Always(Stiffness::Full),
    StiffnessPolicy::Always(Stiffness::Tension),
    StiffnessPolicy::Always(Stiffness::Axial),
];

fn describe_stiffness(policy: StiffnessPolicy) -> &'static str {
    match policy {
        StiffnessPolicy::OnDemand => "full while A is positive definite, tension in the solves where it is not",
        StiffnessPolicy::Always(Stiffness::Full) => {
            "the exact stiffness; A may be indefinite when springs are compressed"
        }
        StiffnessPolicy::Always(Stiffness::Tension) => "drop the transverse terms of compressed springs",
        StiffnessPolicy::Always(Stiffness::Axial) => "drop all transverse terms",
    }
}

const SOLVERS: [SolverChoice; 5] =
    [SolverChoice::Auto, SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled];

fn describe_solver(solver: SolverChoice) -> &'static str {
    match solver {
        SolverChoice::Auto => "llt or cg, by the size and shape of the system",
        SolverChoice::Llt => "sparse Cholesky factorization; refuses an indefinite A",
        SolverChoice::Ldlt => "sparse LDLᵀ factorization; accepts an indefinite A",
        SolverChoice::Cg => "conjugate gradients without a matrix",
        SolverChoice::CgAssembled => "conjugate gradients on the assembled A",
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
        PreconditionerChoice::Auto => "block-jacobi as long as it is quick, then multigrid",
        PreconditionerChoice::Kind(PreconditionerKind::None) => "no preconditioner",
        PreconditionerChoice::Kind(PreconditionerKind::Jacobi) => "the diagonal of A",
        PreconditionerChoice::Kind(PreconditionerKind::BlockJacobi) => "the 3×3 diagonal block of every particle",
        PreconditionerChoice::Kind(PreconditionerKind::Multigrid) => {
            "algebraic multigrid: few iterations whatever the size, each costing as much as several others"
        }
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

/// Degrees of freedom from which splitting a factorization pays: a cloth of about 10⁴ particles.
const LARGE: usize = 30_000;

/// How a factorization is split. Splitting changes how numbers are rounded, so it depends on the system alone, never on
/// the number of threads; any number of threads then gives the same bits.
pub fn parallelism(system: &System) -> Par {
    if system.dofs().len() < LARGE { Par::Seq } else { Par::rayon(2) }
}

/// A stepper with steps as scheduled, or with steps that keep an error within a tolerance.
pub enum Stepper<'s> {
    Scheduled(Box<dyn TimeStepper + 's>),
    Adaptive { stepper: Box<dyn AdaptiveStepper + 's>, rtol: f64 },
}

impl Stepper<'_> {
    /// Runs; `observe` sees the state after every step, with error control at every multiple of dt.
    pub fn run(
        &mut self,
        system: &System,
        state: &mut State,
        schedule: &Schedule,
        observe: impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> Outcome {
        match self {
            Self::Scheduled(stepper) => run(&mut **stepper, state, schedule, observe),
            Self::Adaptive { stepper, rtol } => {
                let (duration, dt) = (schedule.elapsed(schedule.len()), schedule.dt());
                let how = Adaptivity { duration, rtol: *rtol, first_step: dt, sampling: Sampling::Every(dt) };
                run_adaptive(&mut **stepper, system, state, &how, observe)
            }
        }
    }

    /// What can be asked of it.
    pub fn get(&self) -> &dyn TimeStepper {
        match self {
            Self::Scheduled(stepper) => &**stepper,
            Self::Adaptive { stepper, .. } => &**stepper,
        }
    }
}

impl MethodArguments {
    fn method(&self) -> Method {
        self.method.unwrap_or(if self.rtol.is_some() { Method::W2 } else { Method::LinearBackwardEuler })
    }

    /// The stepper asked for. Call inside the pool of threads that is to compute.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; a method without an error estimate for --rtol.
    pub fn stepper<'s>(&self, system: &'s System, state: &State) -> Result<Stepper<'s>> {
        let defaults = ImplicitOptions::default();
        let linear = SolverOptions {
            solver: self.solver.unwrap_or(defaults.linear.solver),
            preconditioner: self.preconditioner.and_then(PreconditionerChoice::kind),
            tolerance: self.tolerance.unwrap_or(defaults.linear.tolerance),
            par: parallelism(system),
        };
        let options = ImplicitOptions { stiffness: self.stiffness.unwrap_or(defaults.stiffness), linear };
        let method = self.method();
        let Some(rtol) = self.rtol else {
            return method.stepper(system, state, &options).map(Stepper::Scheduled);
        };
        let without =
            || Error::Usage(format!("--rtol needs an error estimate, and {} has none: use w2", method.name()));
        let stepper = method.adaptive_stepper(system, state, &options)?.ok_or_else(without)?;
        Ok(Stepper::Adaptive { stepper, rtol })
    }

    /// Name of the stiffness policy in effect; `none` for a method without matrices.
    pub fn stiffness(&self) -> &'static str {
        match self.method().is_implicit() {
            true => self.stiffness.unwrap_or(ImplicitOptions::default().stiffness).name(),
            false => "none",
        }
    }

    /// The option of the matrices that a failed solve was given, and the dt of the first one of a step.
    pub fn failed_matrix(&self, step: f64) -> (Stiffness, f64) {
        let option = match self.stiffness.unwrap_or(ImplicitOptions::default().stiffness) {
            StiffnessPolicy::Always(option) => option,
            StiffnessPolicy::OnDemand => Stiffness::Full,
        };
        (option, self.method().matrix_dt(step))
    }

    /// Names the options that the method or the solver asked for does not use.
    pub fn note_unused(&self, console: &Console) {
        let given = [
            ("stiffness", self.stiffness.is_some()),
            ("solver", self.solver.is_some()),
            ("preconditioner", self.preconditioner.is_some()),
            ("tolerance", self.tolerance.is_some()),
        ];
        let (with, unused) = match self.solver {
            _ if !self.method().is_implicit() => (self.method().name(), &given[..]),
            Some(solver @ (SolverChoice::Llt | SolverChoice::Ldlt)) => (solver.name(), &given[2..]),
            _ => return,
        };
        for (name, _) in unused.iter().filter(|(_, is_given)| *is_given) {
            console.note(format_args!("--{name} has no effect with {with}"));
        }
    }
}
