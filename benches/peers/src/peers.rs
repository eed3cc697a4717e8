//! Integrators of other libraries on a mass–spring system: what they are called, and how a run of them is made.

mod diffsol;
mod ivp;
mod ode_solvers;
mod tolerance;

use crate::Failure;
use crate::limits::Patience;
use crate::motion::{Motion, pieces, state, unknowns};
use sprung::accuracy::extent;
use sprung::{State, System};
use tolerance::Tolerance;

pub use diffsol::Method;

/// An integrator of variable step.
#[derive(Clone, Copy, PartialEq)]
pub enum Peer {
    /// Of `diffsol`.
    Diffsol(Method),
    /// The explicit Runge–Kutta method of order 8 by Dormand and Prince, of `ivp`.
    Ivp,
    /// The same, of `ode_solvers`.
    OdeSolvers,
}

impl Peer {
    pub const ALL: [Self; 5] = [
        Self::Ivp,
        Self::OdeSolvers,
        Self::Diffsol(Method::Tsit45),
        Self::Diffsol(Method::Bdf),
        Self::Diffsol(Method::Esdirk34),
    ];

    /// The name in tables and legends.
    pub fn name(self) -> &'static str {
        match self {
            Self::Diffsol(Method::Bdf) => "diffsol BDF",
            Self::Diffsol(Method::Esdirk34) => "diffsol ESDIRK34",
            Self::Diffsol(Method::Tsit45) => "diffsol Tsit45",
            Self::Ivp => "ivp DOP853",
            Self::OdeSolvers => "ode_solvers DOP853",
        }
    }

    /// The state `duration` seconds after `start`, to a local relative tolerance. The absolute one is as much of the scene's extent.
    ///
    /// Every method begins anew at kinks of prescribed paths, where motions are not smooth.
    pub fn run(
        self,
        system: &System,
        start: &State,
        duration: f64,
        rtol: f64,
        patience: &Patience,
    ) -> Result<State, Failure> {
        let end = start.time + duration;
        let tolerance = Tolerance { relative: rtol, absolute: rtol * extent(&start.positions, &start.positions) };
        let mut y = unknowns(system, start);
        for piece in pieces(system, [start.time, end]) {
            let motion = Motion::new(system, start, piece);
            y = match self {
                Self::Diffsol(method) => diffsol::solve(method, &motion, piece, &y, tolerance, patience)?,
                Self::Ivp => ivp::solve(&motion, piece, &y, tolerance, patience)?,
                Self::OdeSolvers => ode_solvers::solve(&motion, piece, y, tolerance, patience)?,
            };
        }
        let state = state(system, start, end, &y);
        if state.is_finite() { Ok(state) } else { Err("non finite".into()) }
    }
}
