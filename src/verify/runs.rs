//! Running a subject by each of the methods.

use super::{Subject, Unfinished};
use crate::error::Result;
use crate::integrate::{
    BackwardEuler, ForwardEuler, ImplicitOptions, LinearBackwardEuler, NewtonOptions, StiffnessPolicy, SymplecticEuler,
    TimeStepper,
};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::State;

/// A method with its option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Way {
    Linear(StiffnessPolicy),
    Nonlinear,
    Symplectic,
    Forward,
}

impl Way {
    pub const ALL: [Self; 7] = [
        Self::Linear(StiffnessPolicy::Always(Stiffness::Full)),
        Self::Linear(StiffnessPolicy::Always(Stiffness::Tension)),
        Self::Linear(StiffnessPolicy::Always(Stiffness::Axial)),
        Self::Linear(StiffnessPolicy::OnDemand),
        Self::Nonlinear,
        Self::Symplectic,
        Self::Forward,
    ];

    pub fn name(self) -> String {
        match self {
            Self::Linear(policy) => format!("linear backward Euler, {}", policy.name()),
            Self::Nonlinear => "backward Euler".into(),
            Self::Symplectic => "symplectic Euler".into(),
            Self::Forward => "forward Euler".into(),
        }
    }

    /// Whether a step needs no matrix, so that only short ones stay near the motion.
    pub fn is_explicit(self) -> bool {
        matches!(self, Self::Symplectic | Self::Forward)
    }

    /// The power of dt with which the error falls.
    pub fn order(self) -> f64 {
        1.0
    }

    /// The subject's step, or one that resolves all motion where only such a step makes sense.
    pub fn step(self, subject: &Subject) -> f64 {
        if self.is_explicit() { subject.dt.min(subject.resolving_step()) } else { subject.dt }
    }

    /// Whether theory allows that a step is refused: A may be indefinite under the full stiffness.
    pub fn may_be_refused(self) -> bool {
        self == Self::Linear(StiffnessPolicy::Always(Stiffness::Full))
    }

    pub fn stepper<'s>(self, subject: &'s Subject, linear: SolverOptions) -> Result<Box<dyn TimeStepper + 's>> {
        let Subject { system, state, .. } = subject;
        let options = |stiffness| ImplicitOptions { stiffness, linear };
        Ok(match self {
            Self::Linear(policy) => Box::new(LinearBackwardEuler::new(system, state, &options(policy))?),
            Self::Nonlinear => {
                let options = options(StiffnessPolicy::OnDemand);
                Box::new(BackwardEuler::new(system, state, &options, NewtonOptions::default())?)
            }
            Self::Symplectic => Box::new(SymplecticEuler::new(system, state)?),
            Self::Forward => Box::new(ForwardEuler::new(system, state)?),
        })
    }

    /// The states of a run, the initial one first; `None` where theory allows that a step is refused, and one was.
    pub fn run(
        self,
        subject: &Subject,
        linear: SolverOptions,
        dt: f64,
        steps: usize,
    ) -> Result<Option<Vec<State>>, Unfinished> {
        let mut stepper = self.stepper(subject, linear)?;
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

fn is_refusal(failure: &crate::integrate::StepFailure) -> bool {
    failure.status() == crate::integrate::Status::Indefinite
}

/// Sparse Cholesky: the solver that leaves rounding errors only.
pub(super) fn direct() -> SolverOptions {
    SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() }
}
