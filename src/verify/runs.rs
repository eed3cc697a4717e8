//! Runs of a scene by each of the methods, and runs that must be the same to the bit: twice, with one thread and with two, in a plane and in space.

use super::{Check, Claim, LARGE, Measured, TestCase, worst};
use crate::error::Error;
use crate::integrate::{Equations, ImplicitOptions, Method, Status, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::State;
use faer::Par;

/// A method with the stiffness in its matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MethodVariant {
    pub method: Method,
    pub stiffness: StiffnessPolicy,
}

impl MethodVariant {
    pub fn linear(option: Stiffness) -> Self {
        Self { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::Always(option) }
    }

    /// Linear backward Euler, with the full stiffness where that is definite.
    pub fn on_demand() -> Self {
        Self { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::OnDemand }
    }

    /// The accurate motion that others are compared with: explicit and of eighth order.
    pub fn dop853() -> Self {
        Self { method: Method::Dop853, stiffness: StiffnessPolicy::OnDemand }
    }

    /// Every method, under every option where the result depends on it. On large scenes one implicit variant and one explicit one.
    pub fn of(case: &TestCase) -> impl Iterator<Item = Self> {
        let affordable = case.system.dofs().len() <= LARGE;
        let all = Method::ALL.into_iter().flat_map(|method| {
            let options = if has_option(method) { &Stiffness::ALL[..] } else { &[] };
            let always = options.iter().map(move |&option| Self { method, stiffness: StiffnessPolicy::Always(option) });
            always.chain([Self { method, stiffness: StiffnessPolicy::OnDemand }])
        });
        all.filter(move |v| affordable || *v == Self::linear(Stiffness::Tension) || v.method == Method::Verlet)
    }

    pub fn name(self) -> String {
        if has_option(self.method) {
            format!("{}, {}", self.method.name(), self.stiffness.name())
        } else {
            self.method.name().into()
        }
    }

    /// Whether nonlinear equations are solved, up to the tolerance of Newton's method.
    pub fn is_nonlinear(self) -> bool {
        self.method.equations() == Equations::Nonlinear
    }

    /// The scene's step, or for an explicit method one that resolves all motion.
    pub fn step(self, case: &TestCase) -> f64 {
        if self.method.is_implicit() { case.dt } else { case.dt.min(case.resolving_step()) }
    }

    /// Whether theory allows that a step is refused: A may be indefinite under the full stiffness.
    fn may_be_refused(self) -> bool {
        self.stiffness == StiffnessPolicy::Always(Stiffness::Full) || self.method.equations() == Equations::LinearExact
    }

    /// The states of a run, the initial one first; `None` where theory allows that a step is refused, and one was.
    pub fn run(self, case: &TestCase, linear: SolverOptions, dt: f64, steps: usize) -> Measured<Option<Vec<State>>> {
        let options = ImplicitOptions { stiffness: self.stiffness, linear };
        let mut stepper = self.method.stepper(&case.system, &case.state, &options)?;
        let mut state = case.state.clone();
        let mut states = vec![state.clone()];
        for _ in 0..steps {
            match stepper.step(&mut state, dt) {
                Ok(()) => states.push(state.clone()),
                Err(failure) if self.may_be_refused() && failure.status() == Status::Indefinite => return Ok(None),
                Err(failure) => return Err(failure.into()),
            }
        }
        Ok(Some(states))
    }
}

/// Whether the result depends on the stiffness option.
fn has_option(method: Method) -> bool {
    method.equations() == Equations::Linear
}

/// Sparse Cholesky, the solver that leaves rounding errors only.
pub(super) fn direct() -> SolverOptions {
    SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() }
}

/// The checks of the states of every run that was not refused: `check(variant, dt, states)`.
pub(super) fn each_run<C: IntoIterator<Item = Check>>(
    case: &TestCase,
    variants: impl Iterator<Item = MethodVariant>,
    steps: usize,
    check: impl Fn(MethodVariant, f64, &[State]) -> C,
) -> Measured {
    let mut checks = Vec::new();
    for variant in variants {
        let dt = variant.step(case);
        if let Some(states) = variant.run(case, direct(), dt, steps)? {
            checks.extend(check(variant, dt, &states));
        }
    }
    Ok(checks)
}

pub(super) fn worst_step(states: &[State], error: impl Fn(&State, &State) -> f64) -> f64 {
    worst(states.windows(2).map(|pair| error(&pair[0], &pair[1])))
}

/// The count of numbers that differ in a bit; infinite where only one of the runs was refused.
pub(super) fn differences(a: &Option<Vec<State>>, b: &Option<Vec<State>>) -> f64 {
    let (Some(a), Some(b)) = (a, b) else { return if a == b { 0.0 } else { f64::INFINITY } };
    let numbers = |states: &[State]| -> Vec<u64> {
        let vectors = states.iter().flat_map(|state| state.positions.iter().chain(&state.velocities));
        // Plus zero makes one of both zeros: they are the same number.
        vectors.flat_map(|v| [v.x, v.y, v.z]).map(|c| (c + 0.0).to_bits()).collect()
    };
    let (a, b) = (numbers(a), numbers(b));
    let differing = a.iter().zip(&b).filter(|(a, b)| a != b).count();
    if a.len() == b.len() { differing as f64 } else { f64::INFINITY }
}

pub(super) fn in_space(case: &TestCase) -> Measured {
    let twin = case.in_space()?;
    let why = "the degrees of freedom are the same, so every operation is: not one bit may differ";
    let check = |variant: MethodVariant| {
        let run = |scene| variant.run(scene, direct(), variant.step(case), 10);
        let name = format!("same in space with the other axes held, {}", variant.name());
        Ok(Check::new(Claim::Constraints, name, &case.name, differences(&run(case)?, &run(&twin)?), 0.0, why))
    };
    MethodVariant::of(case).map(check).collect()
}

pub(super) fn repeated(case: &TestCase) -> Measured {
    let why = "nothing but the scene and the options decides a result: not one bit may differ";
    let check = |name, value| Check::new(Claim::Solvers, name, &case.name, value, 0.0, why);
    let mut checks = Vec::new();
    for variant in MethodVariant::of(case) {
        let run = || variant.run(case, SolverOptions::default(), variant.step(case), 10);
        checks.push(check(format!("same run twice, {}", variant.name()), differences(&run()?, &run()?)));
    }
    for (solver, name) in [(SolverChoice::Llt, "Cholesky"), (SolverChoice::Ldlt, "LDLᵀ"), (SolverChoice::Cg, "CG")] {
        // The number of parts of a factorization is an option; the number of threads that work on them must not matter.
        let options = SolverOptions { solver, par: Par::rayon(2), ..SolverOptions::default() };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.map_err(|error| Error::Unsupported(format!("no pool of {threads} threads: {error}")))?;
            pool.install(|| MethodVariant::on_demand().run(case, options, case.dt, 10))
        };
        checks.push(check(format!("same with one thread and two, {name}"), differences(&run(1)?, &run(2)?)));
    }
    Ok(checks)
}
