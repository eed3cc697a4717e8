//! The methods by name.

use super::{
    AdaptiveStepper, BackwardEuler, ForwardEuler, ImplicitMidpoint, ImplicitOptions, LinearBackwardEuler,
    NewtonOptions, SymplecticEuler, TimeStepper, WMethod,
};
use crate::error::Result;
use crate::system::{State, System};

/// Which method advances the state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Method {
    /// [`LinearBackwardEuler`].
    LinearBackwardEuler,
    /// [`BackwardEuler`].
    BackwardEuler,
    /// [`WMethod`].
    W2,
    /// [`ImplicitMidpoint`].
    ImplicitMidpoint,
    /// [`ForwardEuler`].
    ForwardEuler,
    /// [`SymplecticEuler`].
    SymplecticEuler,
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 6] = [
        Self::LinearBackwardEuler,
        Self::BackwardEuler,
        Self::W2,
        Self::ImplicitMidpoint,
        Self::ForwardEuler,
        Self::SymplecticEuler,
    ];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::LinearBackwardEuler => "linear-backward-euler",
            Self::BackwardEuler => "backward-euler",
            Self::W2 => "w2",
            Self::ImplicitMidpoint => "implicit-midpoint",
            Self::ForwardEuler => "forward-euler",
            Self::SymplecticEuler => "symplectic-euler",
        }
    }

    /// Whether steps solve linear systems, so that [`ImplicitOptions`] matter.
    pub fn is_implicit(self) -> bool {
        !matches!(self, Self::ForwardEuler | Self::SymplecticEuler)
    }

    /// The power of dt with which the error at a fixed time falls on smooth motions.
    pub fn order(self) -> u32 {
        match self {
            Self::W2 | Self::ImplicitMidpoint => 2,
            Self::LinearBackwardEuler | Self::BackwardEuler | Self::ForwardEuler | Self::SymplecticEuler => 1,
        }
    }

    /// The dt of the matrix `A = M/dt² − G/dt − K` with which a step of length `step` begins, both in s.
    pub fn matrix_dt(self, step: f64) -> f64 {
        match self {
            Self::W2 => WMethod::GAMMA * step,
            Self::ImplicitMidpoint => 0.5 * step,
            Self::LinearBackwardEuler | Self::BackwardEuler | Self::ForwardEuler | Self::SymplecticEuler => step,
        }
    }

    /// A stepper for runs with error control; `None` for a method without an error estimate.
    ///
    /// # Errors
    /// As for [`stepper`](Self::stepper).
    pub fn adaptive_stepper<'s>(
        self,
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
    ) -> Result<Option<Box<dyn AdaptiveStepper + 's>>> {
        Ok(match self {
            Self::W2 => Some(Box::new(WMethod::new(system, state, options)?)),
            _ => None,
        })
    }

    /// A stepper that starts from `state`, with default options for what `options` does not hold.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a matrix that is too large.
    pub fn stepper<'s>(
        self,
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
    ) -> Result<Box<dyn TimeStepper + 's>> {
        Ok(match self {
            Self::LinearBackwardEuler => Box::new(LinearBackwardEuler::new(system, state, options)?),
            Self::BackwardEuler => Box::new(BackwardEuler::new(system, state, options, NewtonOptions::default())?),
            Self::W2 => Box::new(WMethod::new(system, state, options)?),
            Self::ImplicitMidpoint => {
                Box::new(ImplicitMidpoint::new(system, state, options, NewtonOptions::default())?)
            }
            Self::ForwardEuler => Box::new(ForwardEuler::new(system, state)?),
            Self::SymplecticEuler => Box::new(SymplecticEuler::new(system, state)?),
        })
    }
}
