//! Running a subject by each of the methods.

use super::{TestCase, Unfinished};
use crate::integrate::{Equations, ImplicitOptions, Method, Status, StepFailure, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::State;

/// A method with the stiffness in its matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Way {
    pub method: Method,
    pub stiffness: StiffnessPolicy,
}

impl Way {
    /// Linearised backward Euler under an option.
    pub fn notes(option: Stiffness) -> Self {
        Self { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::Always(option) }
    }

    /// Every method; those that solve one linear system after the other under every option, as the option is in the
    /// result. On large subjects one implicit way and one explicit one.
    pub fn of(subject: &TestCase) -> impl Iterator<Item = Self> {
        let affordable = subject.system.dofs().len() <= AFFORDABLE;
        let all = Method::ALL.into_iter().flat_map(|method| {
            let options = if has_option(method) { &Stiffness::ALL[..] } else { &[] };
            let always = options.iter().map(move |&option| Self { method, stiffness: StiffnessPolicy::Always(option) });
            always.chain([Self { method, stiffness: StiffnessPolicy::OnDemand }])
        });
        all.filter(move |way| affordable || *way == Self::notes(Stiffness::Tension) || way.method == Method::Verlet)
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

    /// The subject's step, or one that resolves all motion where only such a step makes sense.
    pub fn step(self, subject: &TestCase) -> f64 {
        if self.method.is_implicit() { subject.dt } else { subject.dt.min(subject.resolving_step()) }
    }

    /// Whether theory allows that a step is refused: A may be indefinite under the full stiffness.
    fn may_be_refused(self) -> bool {
        self.stiffness == StiffnessPolicy::Always(Stiffness::Full) || self.method.equations() == Equations::LinearExact
    }

    /// The states of a run, the initial one first; `None` where theory allows that a step is refused, and one was.
    pub fn run(
        self,
        subject: &TestCase,
        linear: SolverOptions,
        dt: f64,
        steps: usize,
    ) -> Result<Option<Vec<State>>, Unfinished> {
        let options = ImplicitOptions { stiffness: self.stiffness, linear };
        let mut stepper = self.method.stepper(&subject.system, &subject.state, &options)?;
        let mut state = subject.state.clone();
        let mut states = vec![state.clone()];
        for _ in 0..steps {
            match stepper.step(&mut state, dt) {
                Ok(()) => states.push(state.clone()),
                Err(failure) if self.may_be_refused() && is_refusal(&failure) => return Ok(None),
                Err(failure) => return Err(failure.into()),
            }
        }
        Ok(Some(states))
    }
}

/// Degrees of freedom up to which every method is run.
const AFFORDABLE: usize = 10_000;

/// Whether the stiffness option is in the result, not only on the way to it.
fn has_option(method: Method) -> bool {
    method.equations() == Equations::Linear
}

fn is_refusal(failure: &StepFailure) -> bool {
    failure.status() == Status::Indefinite
}

/// Sparse Cholesky: the solver that leaves rounding errors only.
pub(super) fn direct() -> SolverOptions {
    SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() }
}

/// How many numbers differ, in bits; a run that only one of the two could do differs in everything.
pub(super) fn differences(a: &Option<Vec<State>>, b: &Option<Vec<State>>) -> f64 {
    let (Some(a), Some(b)) = (a, b) else { return if a.is_none() && b.is_none() { 0.0 } else { f64::INFINITY } };
    let numbers = |states: &[State]| -> Vec<u64> {
        let vectors = states.iter().flat_map(|state| state.positions.iter().chain(&state.velocities));
        // Plus zero makes one of both zeros: they are the same number.
        vectors.flat_map(|v| [v.x, v.y, v.z]).map(|c| (c + 0.0).to_bits()).collect()
    };
    let (a, b) = (numbers(a), numbers(b));
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(&b).filter(|(a, b)| a != b).count() as f64
}
