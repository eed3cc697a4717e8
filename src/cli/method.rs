//! Which method, stiffness and linear solver: the arguments of commands that simulate.

use super::console::Console;
use super::interrupt;
use super::values::{choice, fraction};
use faer::Par;
use sprung::accuracy::{Configuration, Requirement, preset};
use sprung::integrate::{
    AdaptiveStepper, Adaptivity, ImplicitOptions, Method, Monitor, Outcome, Sampling, Schedule, StiffnessPolicy,
    TimeStepper, run_adaptive_monitored, run_monitored,
};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
use sprung::{Error, Result, State, Stiffness, System};
use std::ops::ControlFlow;

/// How to simulate. Options that are not given are `None`, so that those given in vain can be told.
#[derive(Debug, clap::Args)]
pub struct MethodArguments {
    /// Time integration method [default: linear-backward-euler; with adaptive steps: w2; with --accuracy: auto]
    #[arg(long)]
    #[arg(value_parser = choice(&METHODS, MethodChoice::name, describe_choice))]
    method: Option<MethodChoice>,

    /// The relative position error at the end stays below R: runs are made until two that could disagree agree, and the last one is
    /// the answer; what cannot be confirmed ends `unconfirmed`, with status 1. A method, stiffness or solver that is given is
    /// kept. --dt is the interval of records, which --frames counts
    #[arg(long, value_name = "R", value_parser = fraction, conflicts_with_all = ["rtol", "steps"])]
    accuracy: Option<f64>,

    /// Adaptive steps that keep local errors of positions and velocities so small that positions at the end are wrong by about R
    /// times their distance from their centroid, unless the motion itself magnifies differences, as folding and toppling do.
    /// --dt is then the first step to try and the interval of records, which --frames counts. For methods with an error estimate:
    /// bdf2, w2, rodas4, dop853 [default: 1e-2 where no dt is given, neither here nor in the scene, with records every
    /// 1/60 s, or every hundredth of shorter runs]
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

/// A method, or the one that suits the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MethodChoice {
    Named(Method),
    Auto,
}

const METHODS: [MethodChoice; Method::ALL.len() + 1] = {
    let mut all = [MethodChoice::Auto; Method::ALL.len() + 1];
    let mut i = 0;
    while i < Method::ALL.len() {
        all[i] = MethodChoice::Named(Method::ALL[i]);
        i += 1;
    }
    all
};

impl MethodChoice {
    fn name(self) -> &'static str {
        match self {
            Self::Named(method) => method.name(),
            Self::Auto => "auto",
        }
    }
}

fn describe_choice(choice: MethodChoice) -> &'static str {
    match choice {
        MethodChoice::Named(method) => describe_method(method),
        MethodChoice::Auto => "w2 where its matrix is safely definite, else linear-backward-euler; see --accuracy",
    }
}

fn describe_method(method: Method) -> &'static str {
    match method {
        Method::LinearBackwardEuler => "backward Euler with forces linearised: one linear solve a step; first order",
        Method::BackwardEuler => {
            "backward Euler, its equations solved by Newton's method with line search; first order"
        }
        Method::Bdf2 => "BDF2, forces linearised where the step ends: one linear solve a step as a rule; second order",
        Method::W2 => "two linear solves a step with one matrix, as stable as backward Euler; second order",
        Method::Rodas4 => "six or more linear solves a step with one matrix of the full stiffness; fourth order",
        Method::Verlet => "explicit, one force evaluation a step: needs small steps; second order",
        Method::Dop853 => "explicit, twelve force evaluations a step, for high accuracy; eighth order",
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
        SolverChoice::Auto => "llt or cg: by size, and from there by the effort that the first steps take",
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

/// The names of the methods with an error estimate.
fn adaptive() -> String {
    let methods = Method::ALL.into_iter().filter(|method| method.estimates_errors());
    methods.map(Method::name).collect::<Vec<_>>().join(", ")
}

/// A stepper with steps as scheduled, or with steps that keep an error within a tolerance.
pub enum Stepper<'s> {
    Scheduled(Box<dyn TimeStepper + 's>),
    Adaptive { stepper: Box<dyn AdaptiveStepper + 's>, rtol: f64 },
}

impl Stepper<'_> {
    /// Runs a schedule or a part of one; `observe` sees the state after every step, with error control at every multiple of dt.
    pub fn run(
        &mut self,
        system: &System,
        state: &mut State,
        schedule: &Schedule,
        monitor: &mut Monitor,
        mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
    ) -> Outcome {
        match self {
            Self::Scheduled(stepper) => run_monitored(&mut **stepper, state, schedule, monitor, observe),
            Self::Adaptive { stepper, rtol } => {
                let (first, dt) = (schedule.first(), schedule.dt());
                let duration = schedule.elapsed(schedule.len()) - schedule.elapsed(first);
                // A later part of a run begins with a step that the forces suggest.
                let first_step = (first == 0).then_some(dt);
                let how = Adaptivity { duration, rtol: *rtol, first_step, sampling: Sampling::Every(dt) };
                let observe = |count, state: &State, monitor: &Monitor| observe(first + count, state, monitor);
                run_adaptive_monitored(&mut **stepper, system, state, &how, monitor, observe)
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

/// How a run is to be done.
pub struct Plan {
    pub configuration: Configuration,
    /// For adaptive steps.
    pub rtol: Option<f64>,
    /// Why, where the program chose.
    pub reason: Option<&'static str>,
}

impl Plan {
    /// A stepper that follows the plan.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large; a method without an error estimate for --rtol.
    pub fn stepper<'s>(&self, system: &'s System, state: &State) -> Result<Stepper<'s>> {
        let Configuration { method, options } = &self.configuration;
        let Some(rtol) = self.rtol else {
            return method.stepper(system, state, options).map(Stepper::Scheduled);
        };
        let without = || {
            Error::Usage(format!("--rtol needs an error estimate, and {} has none: use {}", method.name(), adaptive()))
        };
        let stepper = method.adaptive_stepper(system, state, options)?.ok_or_else(without)?;
        Ok(Stepper::Adaptive { stepper, rtol })
    }

    /// The arguments that choose the same method, stiffness and solver.
    pub fn repeat(&self) -> String {
        let Configuration { method, options } = &self.configuration;
        let (stiffness, solver) = (options.stiffness.name(), options.linear.solver.name());
        format!("--method {} --stiffness {stiffness} --solver {solver}", method.name())
    }

    /// The option of the matrices that a failed solve was given, and the dt of the first one of a step.
    pub fn failed_matrix(&self, step: f64) -> (Stiffness, f64) {
        let Configuration { method, options } = &self.configuration;
        let option = match options.stiffness {
            StiffnessPolicy::Always(option) => option,
            StiffnessPolicy::OnDemand => Stiffness::Full,
        };
        (option, method.matrix_dt(step))
    }
}

impl MethodArguments {
    /// The method asked for by name, or the one that stands for none; `None` for the program's own choice.
    fn method(&self) -> Option<Method> {
        match self.method {
            Some(MethodChoice::Named(method)) => Some(method),
            Some(MethodChoice::Auto) => None,
            None if self.accuracy.is_some() => None,
            None if self.rtol.is_some() => Some(Self::ADAPTIVE),
            None => Some(Method::LinearBackwardEuler),
        }
    }

    /// The method of adaptive steps where none is asked for.
    const ADAPTIVE: Method = Method::W2;

    /// The tolerance of adaptive steps where no step is given.
    const RTOL: f64 = 1e-2;

    /// The tolerance of adaptive steps for a run for which no dt is given; `None` where a method was asked for that does not
    /// estimate its error.
    pub fn rtol_without_step(&self) -> Option<f64> {
        match self.method {
            Some(MethodChoice::Named(method)) if !method.estimates_errors() => self.rtol,
            _ => Some(self.rtol.unwrap_or(Self::RTOL)),
        }
    }

    /// The tolerance of adaptive steps asked for.
    pub fn rtol(&self) -> Option<f64> {
        self.rtol
    }

    /// Whether what cannot move is to be looked for and left out.
    pub fn reduces(&self) -> bool {
        self.accuracy.is_some() || self.method == Some(MethodChoice::Auto)
    }

    fn linear(&self, system: &System) -> SolverOptions {
        let defaults = SolverOptions::default();
        SolverOptions {
            solver: self.solver.unwrap_or(defaults.solver),
            preconditioner: self.preconditioner.and_then(PreconditionerChoice::kind),
            tolerance: self.tolerance.unwrap_or(defaults.tolerance),
            par: parallelism(system),
            interrupt: interrupt::request(),
        }
    }

    /// How to run with steps of dt seconds, or with adaptive ones of a tolerance. Call inside the pool of threads that is to
    /// compute.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn plan(&self, system: &System, state: &State, dt: f64, rtol: Option<f64>) -> Result<Plan> {
        let linear = self.linear(system);
        let asked = if self.method.is_none() && rtol.is_some() { Some(Self::ADAPTIVE) } else { self.method() };
        let (mut configuration, reason) = match (asked, rtol) {
            (Some(method), _) => {
                let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
                (Configuration { method, options }, None)
            }
            (None, Some(_)) => {
                let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
                (Configuration { method: Self::ADAPTIVE, options }, Some("the method with an error estimate"))
            }
            (None, None) => {
                let (configuration, reason) = preset(system, state, dt, linear)?;
                (configuration, Some(reason))
            }
        };
        configuration.options.stiffness = self.stiffness.unwrap_or(configuration.options.stiffness);
        Ok(Plan { configuration, rtol, reason })
    }

    /// What `--accuracy` asks for, if it is given.
    pub fn requirement(&self, system: &System, duration: f64, interval: f64) -> Option<Requirement> {
        let linear = self.linear(system);
        Some(Requirement {
            accuracy: self.accuracy?,
            duration,
            interval,
            par: linear.par,
            method: self.method(),
            stiffness: self.stiffness,
            solver: self.solver,
        })
    }

    /// The accuracy asked for.
    pub fn accuracy(&self) -> Option<f64> {
        self.accuracy
    }

    /// Names the options that the method or the solver asked for does not use.
    pub fn note_unused(&self, console: &Console) {
        let given = [
            ("stiffness", self.stiffness.is_some()),
            ("solver", self.solver.is_some()),
            ("preconditioner", self.preconditioner.is_some()),
            ("tolerance", self.tolerance.is_some()),
        ];
        if self.stiffness.is_some()
            && let Some(method) = self.method().filter(|method| method.is_implicit() && !method.takes_stiffness())
        {
            console.note(format_args!("--stiffness has no effect with {}", method.name()));
        }
        let explicit = self.method().filter(|method| !method.is_implicit());
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
