//! The methods by name.

use super::{
    AdaptiveStepper, BackwardEuler, Bdf2, ForwardEuler, ImplicitMidpoint, ImplicitOptions, LinearBackwardEuler,
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
    /// [`Bdf2`].
    Bdf2,
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
    pub const ALL: [Self; 7] = [
        Self::LinearBackwardEuler,
        Self::BackwardEuler,
        Self::Bdf2,
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
            Self::Bdf2 => "bdf2",
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

    /// Whether there is an [`adaptive_stepper`](Self::adaptive_stepper): whether steps estimate their own error.
    pub fn estimates_errors(self) -> bool {
        matches!(self, Self::W2)
    }

    /// The power of dt with which the error at a fixed time falls on smooth motions.
    pub fn order(self) -> u32 {
        match self {
            Self::Bdf2 | Self::W2 | Self::ImplicitMidpoint => 2,
            Self::LinearBackwardEuler | Self::BackwardEuler | Self::ForwardEuler | Self::SymplecticEuler => 1,
        }
    }

    /// The dt of the matrix `A = M/dt² − G/dt − K` with which a step of length `step` begins, both in s; of several
    /// equal steps the last.
    pub fn matrix_dt(self, step: f64) -> f64 {
        match self {
            Self::Bdf2 => 2.0 / 3.0 * step,
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
            Self::Bdf2 => Box::new(Bdf2::new(system, state, options)?),
            Self::W2 => Box::new(WMethod::new(system, state, options)?),
            Self::ImplicitMidpoint => {
                Box::new(ImplicitMidpoint::new(system, state, options, NewtonOptions::default())?)
            }
            Self::ForwardEuler => Box::new(ForwardEuler::new(system, state)?),
            Self::SymplecticEuler => Box::new(SymplecticEuler::new(system, state)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Method;
    use crate::integrate::{ImplicitOptions, WMethod};
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;

    #[test]
    fn matrices_are_those_of_the_stages() {
        for method in Method::ALL {
            let part = match method {
                Method::Bdf2 => 2.0 / 3.0,
                Method::W2 => 1.0 - 0.5f64.sqrt(),
                Method::ImplicitMidpoint => 0.5,
                _ => 1.0,
            };
            for step in [0.25, 3.0] {
                assert!((method.matrix_dt(step) - part * step).abs() < 1e-15, "{}", method.name());
            }
        }
        assert!((WMethod::GAMMA - (1.0 - 0.5f64.sqrt())).abs() < 1e-16);
    }

    /// Every stepper goes by its method's name, tells its solver if it has one, counts its work, and is at the end of the step
    /// when it is done, prescribed particles with it.
    #[test]
    fn every_stepper_tells_what_it_is_and_does() {
        let mut builder = SystemBuilder::new();
        for x in [0.0, 1.0, 2.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        builder.spring(0, 1, Spring { stiffness: 5.0, rest_length: 0.9, damping: 0.1 });
        let motion =
            Motion::Path { times: vec![1.0, 2.0, 3.0], offsets: [0.0, 8.0, 4.0].map(Vector3::repeat).to_vec() };
        builder.constrain(Constraint { particles: vec![2], axes: Axes::ALL, motion });
        let (system, mut start) = builder.build().unwrap();
        start.time = 1.5;
        start.prescribe(&system);
        for method in Method::ALL {
            let mut stepper = method.stepper(&system, &start, &ImplicitOptions::default()).unwrap();
            assert_eq!(stepper.name(), method.name());
            assert_eq!(stepper.linear_solver().is_some(), method.is_implicit());
            assert_eq!(stepper.statistics().work.force_evaluations, 0);
            let mut state = start.clone();
            stepper.step(&mut state, 0.25).unwrap();
            assert!(stepper.statistics().work.force_evaluations > 0, "{}", method.name());
            assert_eq!(state.time, 1.75);
            assert_eq!(state.positions[2], Vector3::new(8.0, 6.0, 6.0), "{}", method.name());
        }
    }
}
