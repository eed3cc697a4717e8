//! The methods by name, with their properties.

use super::{
    AdaptiveStepper, BackwardEuler, Bdf2, Dop853, ExplicitEuler, ImplicitMidpoint, ImplicitOptions,
    LinearBackwardEuler, NewtonOptions, Rodas4, TimeStepper, Verlet, WMethod,
};
use crate::error::Result;
use crate::system::{State, System};

/// A method that advances the state; see [`run_monitored`](super::run_monitored) for an example.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Method {
    /// [`LinearBackwardEuler`].
    LinearBackwardEuler,
    /// [`BackwardEuler`].
    BackwardEuler,
    /// [`Bdf2`].
    Bdf2,
    /// [`WMethod`].
    W2,
    /// [`Rodas4`].
    Rodas4,
    /// [`ImplicitMidpoint`].
    ImplicitMidpoint,
    /// [`Verlet`].
    Verlet,
    /// [`Dop853`].
    Dop853,
    /// [`ExplicitEuler::forward`].
    ForwardEuler,
    /// [`ExplicitEuler::symplectic`].
    SymplecticEuler,
}

/// The kind of equations in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Equations {
    /// None: forces at known states only.
    Explicit,
    /// Linear ones with a matrix `A = M/dt² − G/dt − K`; the result depends on its stiffness option.
    Linear,
    /// Linear ones with the full stiffness, whatever the option.
    LinearExact,
    /// Nonlinear ones, up to the tolerance of Newton's method; the option affects the iterations only.
    Nonlinear,
}

/// The velocity by which a step moves positions, `x' = x + dt v`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PositionUpdate {
    /// The velocity at the start.
    Old,
    /// The velocity at the end.
    New,
    /// The mean of both.
    Mean,
    /// None of these: there are several stages, or older states contribute.
    Other,
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 10] = [
        Self::LinearBackwardEuler,
        Self::BackwardEuler,
        Self::Bdf2,
        Self::W2,
        Self::Rodas4,
        Self::ImplicitMidpoint,
        Self::Verlet,
        Self::Dop853,
        Self::ForwardEuler,
        Self::SymplecticEuler,
    ];

    /// Name, order, equations, and velocity of the positions.
    const fn properties(self) -> (&'static str, u32, Equations, PositionUpdate) {
        use Equations::{Explicit, Linear, LinearExact, Nonlinear};
        use PositionUpdate::{Mean, New, Old, Other};
        match self {
            Self::LinearBackwardEuler => ("linear-backward-euler", 1, Linear, New),
            Self::BackwardEuler => ("backward-euler", 1, Nonlinear, New),
            Self::Bdf2 => ("bdf2", 2, Linear, Other),
            Self::W2 => ("w2", 2, Linear, Other),
            Self::Rodas4 => ("rodas4", 4, LinearExact, Other),
            Self::ImplicitMidpoint => ("implicit-midpoint", 2, Nonlinear, Mean),
            Self::Verlet => ("verlet", 2, Explicit, Other),
            Self::Dop853 => ("dop853", 8, Explicit, Other),
            Self::ForwardEuler => ("forward-euler", 1, Explicit, Old),
            Self::SymplecticEuler => ("symplectic-euler", 1, Explicit, New),
        }
    }

    /// The name used on the command line and in files.
    pub const fn name(self) -> &'static str {
        self.properties().0
    }

    /// The power of dt with which the error at a fixed time falls on smooth motions.
    pub const fn order(self) -> u32 {
        self.properties().1
    }

    /// The kind of equations in a step.
    pub const fn equations(self) -> Equations {
        self.properties().2
    }

    /// The velocity by which a step moves positions.
    pub const fn moves_by(self) -> PositionUpdate {
        self.properties().3
    }

    /// True if steps estimate their own error, so that there is an [`adaptive_stepper`](Self::adaptive_stepper).
    pub const fn estimates_errors(self) -> bool {
        matches!(self, Self::Bdf2 | Self::W2 | Self::Rodas4 | Self::Dop853)
    }

    /// True if steps solve linear systems, so that the solver of [`ImplicitOptions`] matters.
    pub fn is_implicit(self) -> bool {
        self.equations() != Equations::Explicit
    }

    /// True if the stiffness option of [`ImplicitOptions`] matters.
    pub fn takes_stiffness(self) -> bool {
        matches!(self.equations(), Equations::Linear | Equations::Nonlinear)
    }

    /// The dt of the first matrix `A = M/dt² − G/dt − K` in a step of length `step`, both in s; for several equal steps that of the last.
    pub const fn matrix_dt(self, step: f64) -> f64 {
        match self {
            Self::Bdf2 => 2.0 / 3.0 * step,
            Self::W2 => WMethod::GAMMA * step,
            Self::Rodas4 => super::rodas4::GAMMA * step,
            Self::ImplicitMidpoint => 0.5 * step,
            _ => step,
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
    ) -> Result<Option<Box<dyn AdaptiveStepper + Send + 's>>> {
        Ok(match self {
            Self::Bdf2 => Some(Box::new(Bdf2::new(system, state, options)?)),
            Self::W2 => Some(Box::new(WMethod::new(system, state, options)?)),
            Self::Rodas4 => Some(Box::new(Rodas4::new(system, state, options)?)),
            Self::Dop853 => Some(Box::new(Dop853::new(system, state)?)),
            _ => None,
        })
    }

    /// A stepper that starts from `state`, with default [`NewtonOptions`].
    ///
    /// # Errors
    /// Coincident ends of a spring; a state of another system; a matrix that is too large; with rodas4 external forces without derivatives.
    pub fn stepper<'s>(
        self,
        system: &'s System,
        state: &State,
        options: &ImplicitOptions,
    ) -> Result<Box<dyn TimeStepper + Send + 's>> {
        let newton = NewtonOptions::default();
        Ok(match self {
            Self::LinearBackwardEuler => Box::new(LinearBackwardEuler::new(system, state, options)?),
            Self::BackwardEuler => Box::new(BackwardEuler::new(system, state, options, newton)?),
            Self::Bdf2 => Box::new(Bdf2::new(system, state, options)?),
            Self::W2 => Box::new(WMethod::new(system, state, options)?),
            Self::Rodas4 => Box::new(Rodas4::new(system, state, options)?),
            Self::ImplicitMidpoint => Box::new(ImplicitMidpoint::new(system, state, options, newton)?),
            Self::Verlet => Box::new(Verlet::new(system, state)?),
            Self::Dop853 => Box::new(Dop853::new(system, state)?),
            Self::ForwardEuler => Box::new(ExplicitEuler::forward(system, state)?),
            Self::SymplecticEuler => Box::new(ExplicitEuler::symplectic(system, state)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;
    use crate::integrate::{CompletedStep, Monitor, MonitorOptions, PropagatedError, StepFailure};
    use crate::system::fixtures::row;
    use crate::system::{Axes, Constraint, Motion};
    use nalgebra::Vector3;

    /// The dt of the matrices; and methods that solve with the exact matrix, or with none, ignore the stiffness option.
    #[test]
    fn matrices_are_those_of_the_stages() {
        let w2 = 1.0 - 0.5f64.sqrt();
        for (method, part) in Method::ALL.into_iter().zip([1.0, 1.0, 2.0 / 3.0, w2, 0.25, 0.5, 1.0, 1.0, 1.0, 1.0]) {
            assert!([0.25, 3.0].iter().all(|step| (method.matrix_dt(*step) - part * step).abs() < 1e-15), "{method:?}");
        }
        let ignores: Vec<_> = Method::ALL.into_iter().filter(|method| !method.takes_stiffness()).collect();
        let explicit = [Method::Verlet, Method::Dop853, Method::ForwardEuler, Method::SymplecticEuler];
        assert_eq!(ignores, [&[Method::Rodas4][..], &explicit].concat());
    }

    /// Every stepper has its method's name and, if implicit, a solver; counts its work, and is at the end of the step when it is done,
    /// prescribed particles included. It refuses states and step lengths that are none, without a panic.
    #[test]
    fn every_stepper_has_the_properties_of_its_method() {
        let mut builder = scene(&[0.0, 1.0, 2.0].map(|x| ([x, 0.0, 0.0], 1.0)), &[(0, 1, [5.0, 0.9, 0.1])]);
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
            let mut adaptive = method.adaptive_stepper(&system, &start, &ImplicitOptions::default()).unwrap();
            let adaptive_name = adaptive.as_ref().map(|stepper| stepper.name());
            assert_eq!(adaptive_name, method.estimates_errors().then_some(method.name()));
            let mut state = start.clone();
            stepper.step(&mut state, 0.25).unwrap();
            assert!(stepper.statistics().work.force_evaluations > 0, "{}", method.name());
            assert_eq!(state.time, 1.75);
            assert_eq!(state.positions[2], Vector3::new(8.0, 6.0, 6.0), "{}", method.name());

            let (other, foreign) = row(2);
            assert!(method.stepper(&system, &foreign, &ImplicitOptions::default()).is_err());
            let mut error = PropagatedError::none(&other);
            for (before, after) in [(&start, &state), (&start, &foreign), (&foreign, &foreign)] {
                assert!(!stepper.propagate(&mut error, &CompletedStep { before, after, length: 0.25 }));
            }
            let timeless = State { time: f64::NAN, ..start.clone() };
            let short = State { velocities: foreign.velocities.clone(), ..start.clone() };
            let wrong = StepFailure::ForeignState { found: 2, expected: 3 };
            let lengths = [0.0, -1.0, f64::NAN, f64::INFINITY].map(|dt| (&start, dt, StepFailure::StepLength(dt)));
            let states = [(&foreign, wrong), (&short, wrong), (&timeless, StepFailure::NonFinite)];
            for (state, dt, expected) in
                states.map(|(state, failure)| (state, 0.25, failure)).into_iter().chain(lengths)
            {
                let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
                let mut moved = state.clone();
                let failures = [stepper.step(&mut moved, dt), stepper.step_seen(&mut moved, dt, monitor.springs())];
                let tried = adaptive.as_mut().map(|stepper| stepper.try_step(state, dt).map(drop));
                for failure in failures.into_iter().chain(tried) {
                    assert_eq!(failure.unwrap_err().to_string(), expected.to_string(), "{method:?}");
                }
                assert_eq!((moved.positions, moved.velocities), (state.positions.clone(), state.velocities.clone()));
            }
            if let Some(stepper) = &mut adaptive {
                stepper.accept(&mut foreign.clone());
                stepper.restart();
                stepper.try_step(&start, 0.25).unwrap();
                stepper.accept(&mut foreign.clone());
                stepper.try_step(&start, 0.25).unwrap();
            }
        }
    }
}
