//! The methods by name.

use super::{
    BackwardEuler, ForwardEuler, ImplicitOptions, LinearBackwardEuler, NewtonOptions, SymplecticEuler, TimeStepper,
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
    /// [`ForwardEuler`].
    ForwardEuler,
    /// [`SymplecticEuler`].
    SymplecticEuler,
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 4] =
        [Self::LinearBackwardEuler, Self::BackwardEuler, Self::ForwardEuler, Self::SymplecticEuler];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::LinearBackwardEuler => "linear-backward-euler",
            Self::BackwardEuler => "backward-euler",
            Self::ForwardEuler => "forward-euler",
            Self::SymplecticEuler => "symplectic-euler",
        }
    }

    /// Whether steps solve linear systems, so that [`ImplicitOptions`] matter.
    pub fn is_implicit(self) -> bool {
        matches!(self, Self::LinearBackwardEuler | Self::BackwardEuler)
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
            Self::ForwardEuler => Box::new(ForwardEuler::new(system, state)?),
            Self::SymplecticEuler => Box::new(SymplecticEuler::new(system, state)?),
        })
    }
}
