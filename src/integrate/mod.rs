//! Time stepping: one method a file behind [`TimeStepper`], and the run loop that drives them.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `methods`, `newton`, `exactness`, `adaptive`, `ledger`, `definiteness`.

mod adaptive;
mod backward_euler;
mod bdf2;
mod dop853;
mod explicit;
mod failure;
mod forcing;
mod implicit;
mod implicit_midpoint;
#[cfg(test)]
mod kinds_tests;
#[cfg(test)]
mod law_tests;
mod line_search;
mod linear_backward_euler;
mod linear_tolerance;
mod matrices;
mod method;
mod monitor;
mod newton;
mod newton_matrix;
#[cfg(test)]
mod oscillator;
#[cfg(test)]
mod parts_tests;
mod propagated_error;
mod regularization;
mod rodas4;
mod run;
mod schedule;
mod spring_visitor;
mod statistics;
#[cfg(test)]
mod steps_tests;
mod stiffness_policy;
mod substeps;
mod terms;
#[cfg(test)]
mod tolerances_tests;
mod verlet;
mod w_method;

pub(crate) use adaptive::hermite;
pub use adaptive::{
    AdaptiveOptions, AdaptiveStepper, ErrorEstimate, OutputTimes, run_adaptive, run_adaptive_monitored,
};
pub use backward_euler::BackwardEuler;
pub use bdf2::Bdf2;
pub use dop853::Dop853;
pub use explicit::{ForwardEuler, SymplecticEuler};
pub use failure::{NotSolved, Status, StepFailure};
pub use implicit::ImplicitOptions;
pub use implicit_midpoint::ImplicitMidpoint;
pub use linear_backward_euler::LinearBackwardEuler;
pub use matrices::{Matrices, StepMatrices};
pub use method::{Equations, Method, PositionUpdate};
pub use monitor::{
    Balance, ErrorIndicators, INACCURATE, Monitor, MonitorCheckpoint, MonitorOptions, Warning, percent, threshold,
};
pub use newton::NewtonOptions;
pub use propagated_error::{CompletedStep, PropagatedError};
pub use regularization::Regularization;
pub use rodas4::Rodas4;
pub use run::{Outcome, RunFailure, run, run_monitored};
pub use schedule::Schedule;
pub(crate) use schedule::is_end;
pub(crate) use spring_visitor::SpringVisitor;
pub use statistics::Statistics;
pub use stiffness_policy::StiffnessPolicy;
pub use verlet::Verlet;
pub use w_method::WMethod;

use crate::linear::LinearSolver;
use crate::system::State;

/// A method that advances a system's state.
pub trait TimeStepper {
    /// The method's name on the command line and in files.
    fn name(&self) -> &'static str;

    /// The linear solver really used; `None` for explicit methods.
    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        None
    }

    /// Advances the state by `dt` seconds.
    ///
    /// # Errors
    /// Why the step could not be done; the state is then as it was.
    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure>;

    /// As [`step`](Self::step), for a monitor's account of the springs: a method that goes through all springs where the step ends lets it
    /// see them on the way.
    ///
    /// # Errors
    /// As of `step`.
    #[doc(hidden)]
    fn step_seen(&mut self, state: &mut State, dt: f64, _watch: &mut dyn SpringVisitor) -> Result<(), StepFailure> {
        self.step(state, dt)
    }

    /// Forgets what was kept of the steps before. To be called where the state or its rate has been changed otherwise than by
    /// steps: by hand, or by a kink of a prescribed path.
    fn restart(&mut self) {}

    /// Propagates the error of a run over the step done or accepted last, and adds the step's own: `e' = Φ e + δ`, see [`PropagatedError`]. Returns
    /// `false`, and leaves the error as it is, where the method does not know how.
    fn propagate(&mut self, _error: &mut PropagatedError, _step: &CompletedStep<'_>) -> bool {
        false
    }

    /// What has been done since the stepper was made.
    fn statistics(&self) -> &Statistics;
}
